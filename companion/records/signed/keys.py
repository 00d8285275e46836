"""The keys of one node's records: it signs its own, and knows those of others."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from companion.keys.crypto import Signer, Verifier
from companion.mavlink.peers.session import BASE_ID, Session
from companion.records.frames import made_us_of
from companion.records.record import Record
from companion.records.signed.messages import RECORD_HEAD
from mission.document.model import Mission

DOMAIN: Final = b"understory record 1"  # a signature of one kind of message is none of another
BASE_DOMAIN: Final = b"understory base vector 1"


@dataclass(frozen=True, slots=True)
class RecordKeys:
    """Of one node, in one mission: a record that was signed for another is none of this."""

    signer: Signer = field(repr=False)
    verifiers: Mapping[int, Verifier] = field(repr=False)  # by system id; BASE_ID: the operator's
    mission_hash: int

    def sign(self, record: Record) -> Record:
        """An own record, with its signature."""
        return replace(record, signature=self.signer.sign(self._told(record)))

    def proves(self, record: Record) -> bool:
        """The vehicle in whose log it is has made this record."""
        verifier = self.verifiers.get(record.vehicle_id)
        return verifier is not None and verifier.holds(record.signature, self._told(record))

    def sign_base(self, told: bytes) -> bytes:
        """Signature of what the base station has; `told`: as it is sent, without it."""
        return self.signer.sign(BASE_DOMAIN + told)

    def proves_base(self, told: bytes, signature: bytes) -> bool:
        """The base station has told this."""
        return self.verifiers[BASE_ID].holds(signature, BASE_DOMAIN + told)

    def _told(self, record: Record) -> bytes:
        body = record.body
        head = (made_us_of(record), record.log_id, record.number, record.vehicle_id, record.kind, len(body))
        return DOMAIN + self.mission_hash.to_bytes(4, "little") + RECORD_HEAD.pack(*head) + body


def mission_hash(mission: Mission) -> int:
    """Tells its records from another mission's: 32 bits of its name and origin."""
    frame = f"{mission.name}\n{mission.origin}".encode()
    return int.from_bytes(hashlib.sha256(frame).digest()[:4], "big")


def record_keys(session: Session | None, mission_hash: int) -> RecordKeys | None:
    """Of a node's start; None: of a swarm without keys."""
    if session is None:
        return None
    return RecordKeys(session.signer, session.verifiers, mission_hash)
