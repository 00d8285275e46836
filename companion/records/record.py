"""A record, its place in its writer's log, and the vector by which nodes tell each other what they have."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

from companion.mavlink.peers.session import BASE_ID as BASE_ID
from companion.mavlink.schema.tables.measurements import BODY_MAX as BODY_MAX

NUMBER_MAX: Final = (1 << 24) - 1  # of a log: one each second for 194 days
LOGS_TOTAL_MAX: Final = 512  # of all vehicles: what is kept of each neighbour is bounded with them
BITMAP: Final = 32  # numbers behind a vector's window that it tells one by one


class RecordKind(IntEnum):
    """Meaning of a record's body."""

    STEM = 1
    TRACK = 2  # the area seen
    PAYLOAD = 3  # of another sensor
    SUMMARY = 4  # of the stand, by the acting leader: summary.py


class LogKey(NamedTuple):
    """A log: its only writer, and the number that was drawn when it was begun. A disk that is lost starts another."""

    vehicle_id: int
    log_id: int  # uint32


@dataclass(frozen=True, slots=True)
class Record:
    """One measurement. Its identity is (vehicle, log, number), as that of a bundle in RFC 9171."""

    vehicle_id: int  # of its only writer
    log_id: int
    number: int  # 1, 2, 3 ... in that log, without a gap
    kind: RecordKind
    made_s: float  # by its writer's clock; to the microsecond
    body: bytes  # at most BODY_MAX bytes: what one MAVLink frame holds
    signature: bytes = b""  # its writer's, in a swarm with keys

    @property
    def key(self) -> LogKey:
        """The log that it is in."""
        return LogKey(self.vehicle_id, self.log_id)

    @property
    def proven(self) -> bool:
        """Signed by its writer: one that is stored was checked before."""
        return self.signature != b""


@dataclass(frozen=True, slots=True)
class Draft:
    """A record of this vehicle's own that is not on the disk yet: only there is it given its number."""

    kind: RecordKind
    made_s: float
    body: bytes


class Entry(NamedTuple):
    """A node's word about one log: what it has, and what it knows the base station to have."""

    key: LogKey
    upto: int  # nothing is missing up to here: held, or not wanted any more
    window: int  # the number at which the bitmap begins
    last: int  # the highest number that it has
    acked: int  # the base station has all up to here
    bits: int  # bit k: it has number window + 1 + k


@dataclass(frozen=True, slots=True)
class Vector:
    """A part of a node's version vector: one message of it."""

    base_epoch: int  # of the base station's file that `acked` is about; 0: none known
    hops: int  # to the base station
    is_base: bool
    is_full: bool  # has no room for more
    entries: tuple[Entry, ...]
    mission_hash: int = 0  # of the sender's mission; 0: of none


@dataclass(frozen=True, slots=True)
class Progress:
    """Records of the swarm, as far as this node has heard of them."""

    made: int
    delivered: int  # to the base station

    def __str__(self) -> str:
        return f"{self.delivered} of {self.made} records delivered"
