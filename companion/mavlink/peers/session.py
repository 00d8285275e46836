"""The keys of one flight of one companion, derived once, when it starts."""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from companion.keys.crypto import Signer, Verifier, session_key
from companion.keys.keyring import OPERATOR, Keyring

BASE_ID: Final = 254  # system id of the base station: vehicles go to 250, and 255 is the ground station's
OPERATOR_ID: Final = 253  # of whoever orders: both have the operator's keyring
_NAMES: Final = {BASE_ID: "the base station", OPERATOR_ID: "the operator"}
TWINS: Final = {BASE_ID: "another base station has this key", OPERATOR_ID: "another program orders with this key"}


def name_of(node: int) -> str:
    """A node of the swarm's radio by its system id, in words."""
    return _NAMES.get(node, f"vehicle {node}")


def twin_of(node: int) -> str:
    """The warning that another program has the key of this node."""
    return TWINS.get(node, f"another companion flies as vehicle {node}")


@dataclass(frozen=True, slots=True)
class Session:
    """The keys by which one node signs and checks. `boot`: a number that no other start of this companion has had."""

    me: int  # system id
    boot: int  # 1..2^32-1, drawn at random
    active: int  # the epoch that is sent with
    keys: Mapping[int, bytes] = field(repr=False)  # epoch -> session key
    signer: Signer = field(repr=False)
    verifiers: Mapping[int, Verifier] = field(repr=False)  # system id -> of its manifests

    def stream_key(self, epoch: int, sender: int, boot: int) -> bytes | None:
        """The MAVLink 2 signing key of one boot of one sender: frames of an earlier one do not hold.

        HMAC-SHA-256 of sender and boot with the session's key. None: this epoch is not known.
        """
        key = self.keys.get(epoch)
        if key is None:
            return None
        return hmac.digest(key, b"stream" + bytes([sender]) + boot.to_bytes(4, "little"), "sha256")


def open_session(keyring: Keyring, me: int, mission_sha256: bytes, boot: int) -> Session:
    """`me`: the vehicle's id; BASE_ID or OPERATOR_ID with the operator's keyring. `mission_sha256`: of its file.

    ValueError: the keyring is another's, or the boot's number is none.
    """
    if keyring.owner != (OPERATOR if me in (BASE_ID, OPERATOR_ID) else me):
        raise ValueError(f"the key is of {'the operator' if keyring.owner == OPERATOR else f'vehicle {keyring.owner}'}")
    if not 0 < boot < 1 << 32:
        raise ValueError(f"boot {boot}: must be 1..2^32-1")
    keys = {epoch: session_key(secret, mission_sha256) for epoch, secret in keyring.secrets.items()}
    verifiers = {vehicle: Verifier(public) for vehicle, public in keyring.vehicles.items()}
    verifiers[BASE_ID] = verifiers[OPERATOR_ID] = Verifier(keyring.operator)
    return Session(me, boot, keyring.active, keys, Signer(keyring.seed), verifiers)
