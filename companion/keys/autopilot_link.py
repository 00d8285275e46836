"""The key of the link between a companion and its autopilot: of the vehicle's own private key, so no file more.

It is the SHA-256 of a passphrase, as ground stations make theirs (QGroundControl, Mission Planner, MAVProxy): one that
is to speak to this autopilot is given the passphrase.
"""

from __future__ import annotations

import base64
from hashlib import sha256

from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from companion.keys.keyring import Keyring

INFO = b"understory autopilot link 1"
BYTES = 20  # 32 letters in base32


def link_passphrase(keyring: Keyring) -> str:
    """32 letters and digits, of which nobody learns anything of the private key."""
    return base64.b32encode(HKDF(SHA256(), BYTES, salt=None, info=INFO).derive(keyring.seed)).decode()


def link_key(keyring: Keyring) -> bytes:
    """The 32 bytes of MAVLink 2's signing key."""
    return sha256(link_passphrase(keyring).encode()).digest()
