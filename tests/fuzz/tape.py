"""A tape: what comes by which link of one companion, and its ticks between, in order. What a finding is kept as."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from enum import IntEnum
from typing import Final, NamedTuple

_HEAD: Final = struct.Struct("<BH")
_SECONDS: Final = struct.Struct("<d")


class Kind(IntEnum):
    """One step of a tape."""

    AUTOPILOT = 0
    PEERS = 1
    SENSOR = 2
    TICK = 3  # its data: seconds since the last one


class Step(NamedTuple):
    """`data`: of a datagram, or of a tick its seconds."""

    kind: Kind
    data: bytes

    @property
    def seconds(self) -> float:
        """Of a tick: finite, and no going back; 0.05 where the data say nothing sensible."""
        passed_s = _SECONDS.unpack(self.data)[0] if len(self.data) == _SECONDS.size else 0.05
        return passed_s if 0.0 <= passed_s <= 1e6 else 0.05


def tick(passed_s: float = 0.05) -> Step:
    """A tick, so long after the last."""
    return Step(Kind.TICK, _SECONDS.pack(passed_s))


def write_tape(steps: Iterable[Step]) -> bytes:
    """Its file."""
    return b"".join(_HEAD.pack(step.kind, len(step.data)) + step.data for step in steps)


def read_tape(data: bytes) -> Iterator[Step]:
    """The steps of a file; any bytes are a tape."""
    at = 0
    while at + _HEAD.size <= len(data):
        kind, size = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        yield Step(Kind(kind % len(Kind)), data[at : at + size])
        at += size
