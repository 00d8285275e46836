"""Keyrings of a fleet that is the same every time."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

from companion.keys.crypto import public_key
from companion.keys.key_file import render_keyring
from companion.keys.keyring import OPERATOR, Keyring


def random_bytes(*words: object) -> bytes:
    """32 bytes, of these words."""
    return hashlib.sha256(repr(words).encode()).digest()


def operator_of(size: int = 3, epochs: tuple[int, ...] = (7,), active: int | None = None) -> Keyring:
    """The operator's keyring."""
    seed = random_bytes("seed", OPERATOR)
    return Keyring(
        owner=OPERATOR,
        seed=seed,
        secrets={epoch: random_bytes("secret", epoch) for epoch in epochs},
        active=epochs[0] if active is None else active,
        operator=public_key(seed),
        vehicles={vehicle: public_key(random_bytes("seed", vehicle)) for vehicle in range(1, size + 1)},
    )


def vehicle_of(operator: Keyring, vehicle: int) -> Keyring:
    """That of a vehicle of this operator's fleet."""
    return replace(operator, owner=vehicle, seed=random_bytes("seed", vehicle))


def key_file(path: Path, keyring: Keyring, mode: int = 0o600) -> Path:
    """`path`, with this keyring in it."""
    path.write_text(render_keyring(keyring))
    path.chmod(mode)
    return path


def secret_texts(keyring: Keyring) -> set[str]:
    """Ways in which a secret of this keyring may be shown, parts of them too."""
    secrets = (keyring.seed, *keyring.secrets.values())
    return {secret.hex()[at : at + 8] for secret in secrets for at in range(0, 64, 8)} | {
        repr(secret)[2:10] for secret in secrets
    }
