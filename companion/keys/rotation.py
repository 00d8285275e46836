"""Rotation of a swarm's secret: three steps, of which any two that follow each other hear one another.

A fleet at rest has one secret. (1) All go on signing with it and accept a new one too; (2) all sign with the new one
and accept the old one too; (3) the old one is gone, and the fleet is at rest again. A step begins when every vehicle
has the files of the one before it.
"""

from __future__ import annotations

from dataclasses import replace
from enum import Enum

from companion.keys.keyring import EPOCHS, Keyring


class Step(Enum):
    """State of a keyring, told by its secrets alone."""

    REST = 0
    NEW_ACCEPTED = 1
    NEW_ACTIVE = 2


def newest(keyring: Keyring) -> int:
    """The epoch that came last. Numbers go on from 255 to 0: of two it is the one less than half of the way ahead."""
    lowest, highest = min(keyring.secrets), max(keyring.secrets)
    return highest if highest - lowest < EPOCHS // 2 else lowest


def step_of(keyring: Keyring) -> Step:
    """The step that these keys belong to."""
    if len(keyring.secrets) == 1:
        return Step.REST
    return Step.NEW_ACTIVE if keyring.active == newest(keyring) else Step.NEW_ACCEPTED


def advance(keyring: Keyring, fresh: bytes) -> Keyring:
    """The next step. `fresh`: 32 random bytes, which a rotation that begins takes as its new secret."""
    match step_of(keyring):
        case Step.REST:
            return _offer(keyring, fresh)
        case Step.NEW_ACCEPTED:
            return replace(keyring, active=newest(keyring))
        case Step.NEW_ACTIVE:
            return _keep_only(keyring, keyring.active)


def finish(keyring: Keyring, fresh: bytes) -> Keyring:
    """The end of the rotation, at once; of a fleet at rest that of a new one.

    Vehicles that have an earlier file do not hear those that have this one.
    """
    begun = _offer(keyring, fresh) if step_of(keyring) is Step.REST else keyring
    return replace(_keep_only(begun, newest(begun)), active=newest(begun))


def revoke(keyring: Keyring, vehicle: int, fresh: bytes) -> Keyring:
    """Without this vehicle, and at the first step of a rotation to a secret that it has never seen.

    A rotation under way is given up: the revoked vehicle may have its new secret. Before its second step all sign with
    the old one, after it all sign with the new one, so that is the one that stays.
    """
    vehicles = {other: key for other, key in keyring.vehicles.items() if other != vehicle}
    return replace(_offer(keyring, fresh), vehicles=vehicles)


def is_newer(keyring: Keyring, other: Keyring) -> bool:
    """True if `keyring` comes of `other`, of the same fleet, by steps and revocations.

    Vehicles only ever go. Between two that go the newest epoch counts up, and with the same one the steps do. What one
    step or revocation makes is always newer; of more, False where the epochs do not tell.
    """
    if not keyring.vehicles.keys() <= other.vehicles.keys():
        return False
    ahead = (newest(keyring) - newest(other)) % EPOCHS
    if ahead:
        return ahead < EPOCHS // 2 or is_revocation(keyring, other)
    same_secret = keyring.secrets[newest(keyring)] == other.secrets[newest(other)]
    return same_secret and _step_number(keyring) > _step_number(other)


def is_revocation(keyring: Keyring, other: Keyring) -> bool:
    """True if `keyring` is what `revoke` makes of `other`, of which one vehicle is gone."""
    gone = other.vehicles.keys() - keyring.vehicles.keys()
    if len(gone) != 1:
        return False
    fresh = keyring.secrets[newest(keyring)]
    made = revoke(other, next(iter(gone)), fresh)
    return fresh not in other.secrets.values() and (
        (made.secrets, made.active, made.vehicles) == (keyring.secrets, keyring.active, keyring.vehicles)
    )


def _step_number(keyring: Keyring) -> int:
    """Of the rotation to its newest epoch, 1 to 3: at rest it is finished."""
    return step_of(keyring).value or 3


def _keep_only(keyring: Keyring, epoch: int) -> Keyring:
    return replace(keyring, secrets={epoch: keyring.secrets[epoch]})


def _offer(keyring: Keyring, fresh: bytes) -> Keyring:
    """The active secret and a new one, under the next number that is not in use."""
    epoch = next(e for k in (1, 2) if (e := (keyring.active + k) % EPOCHS) not in keyring.secrets)
    return replace(keyring, secrets={keyring.active: keyring.secrets[keyring.active], epoch: fresh})
