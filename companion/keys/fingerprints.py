"""Fingerprints: what may be shown of a key, short enough to be compared by eye."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

from companion.keys.key_file import fingerprinted_text, owner_name
from companion.keys.keyring import Keyring

BYTES = 10  # 80 bits: nobody finds another key with the same one
GROUP = 4  # digits


def fingerprint(kind: str, data: bytes) -> str:
    """Five groups of four hexadecimal digits, of SHA-256. Of 32 secret random bytes it tells nothing."""
    digits = hashlib.sha256(f"understory fingerprint 1 {kind}\n".encode() + data).digest()[:BYTES].hex()
    return ":".join(digits[at : at + GROUP] for at in range(0, len(digits), GROUP))


def public_fingerprint(key: bytes) -> str:
    """Of an Ed25519 public key."""
    return fingerprint("public", key)


def epoch_fingerprint(secret: bytes) -> str:
    """Of a swarm's secret."""
    return fingerprint("epoch", secret)


def file_fingerprint(keyring: Keyring) -> str:
    """Of all that a key file holds."""
    return fingerprint("file", fingerprinted_text(keyring).encode())


def fleet_fingerprint(keyring: Keyring) -> str:
    """Of all public keys: the same in every file of a fleet, another after a vehicle was revoked."""
    vehicles = (vehicle.to_bytes(1, "big") + key for vehicle, key in sorted(keyring.vehicles.items()))
    return fingerprint("fleet", keyring.operator + b"".join(vehicles))


def summary(keyring: Keyring) -> str:
    """In one line, for a row of the preflight."""
    epochs = " and ".join(
        f"{epoch} {epoch_fingerprint(secret)}{' (active)' if epoch == keyring.active else ''}"
        for epoch, secret in sorted(keyring.secrets.items())
    )
    return f"{owner_name(keyring.owner)}, fleet {fleet_fingerprint(keyring)}, epoch {epochs}"


def describe(keyring: Keyring) -> Iterator[str]:
    """Lines of `show-id`: nothing secret."""
    yield f"{'owner':14}{owner_name(keyring.owner)}"
    yield f"{'file':14}{file_fingerprint(keyring)}  this file alone"
    yield f"{'fleet':14}{fleet_fingerprint(keyring)}  the same in every file of the fleet"
    for epoch, secret in sorted(keyring.secrets.items()):
        state = "active: frames are signed with it" if epoch == keyring.active else "accepted"
        yield f"{f'epoch {epoch}':14}{epoch_fingerprint(secret)}  {state}"
    yield f"{'operator':14}{public_fingerprint(keyring.operator)}"
    for vehicle, key in sorted(keyring.vehicles.items()):
        yield f"{f'vehicle {vehicle}':14}{public_fingerprint(key)}"
