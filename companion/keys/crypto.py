"""The cryptography of the swarm, by `cryptography`: Ed25519 (RFC 8032) and HKDF-SHA-256 (RFC 5869)."""

from __future__ import annotations

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

SESSION_BYTES = 32  # of a MAVLink 2 signing key
SIGNATURE_BYTES = 64
INFO = b"understory swarm session 1"


def session_key(secret: bytes, mission_sha256: bytes) -> bytes:
    """The key of the frames of one mission: HKDF-SHA-256 of the swarm's secret, the mission's digest as its salt.

    Vehicles with other missions do not understand one another, and frames of another mission's flight are of no use.
    """
    return HKDF(SHA256(), SESSION_BYTES, salt=mission_sha256, info=INFO).derive(secret)


def public_key(seed: bytes) -> bytes:
    """The public key, 32 bytes, of a private one."""
    return Ed25519PrivateKey.from_private_bytes(seed).public_key().public_bytes(Encoding.Raw, PublicFormat.Raw)


class Signer:
    """Signs with one private key."""

    __slots__ = ("_key",)

    def __init__(self, seed: bytes) -> None:
        self._key = Ed25519PrivateKey.from_private_bytes(seed)

    def sign(self, message: bytes) -> bytes:
        """64 bytes."""
        return self._key.sign(message)


class Verifier:
    """Checks signatures by one public key. ValueError: it is no public key."""

    __slots__ = ("_key", "public")

    def __init__(self, public: bytes) -> None:
        self.public = public
        self._key = Ed25519PublicKey.from_public_bytes(public)

    def holds(self, signature: bytes, message: bytes) -> bool:
        """True when the owner of the key has signed this message."""
        try:
            self._key.verify(signature, message)
        except InvalidSignature:
            return False
        return True
