"""A keyring: the keys that one vehicle, or the operator, holds. A value; files are read and written elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

SECRET_BYTES = 32  # of a swarm's secret and of an Ed25519 seed
PUBLIC_BYTES = 32  # of an Ed25519 public key (RFC 8032)
EPOCHS = 256  # the link id of a MAVLink 2 signature says which secret it was made with: one byte
OPERATOR = 0  # in the place of a vehicle's id


@dataclass(frozen=True, slots=True)
class Keyring:
    """The keys of one of a fleet. Secrets are not shown by `repr`: a keyring in a log or a traceback tells nothing.

    While secrets are rotated two epochs are there: frames of both are taken, those of `active` are sent.
    """

    owner: int  # a vehicle's id; OPERATOR: the operator's
    seed: bytes = field(repr=False)  # its own Ed25519 private key
    secrets: Mapping[int, bytes] = field(repr=False)  # epoch 0..255 -> what all of the swarm share; at most two
    active: int  # the epoch that is sent with: one of `secrets`
    operator: bytes  # the operator's public key
    vehicles: Mapping[int, bytes]  # vehicle's id -> its public key; one that is revoked is not there
