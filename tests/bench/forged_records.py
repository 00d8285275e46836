"""A member with all its own keys that forges records in others' names, and the base station's word."""

from __future__ import annotations

import itertools
from typing import Any, Final

from companion.mavlink.endpoint import Endpoint
from companion.records.exchange import RecordExchange
from companion.records.frames import RECORD_ID, VECTOR_ID, encode_record, encode_vector
from companion.records.record import BITMAP, Entry, LogKey, Record, RecordKind, Vector
from companion.records.signed.exchange import SignedExchange
from companion.records.signed.messages import (
    BASE_VECTOR_ID,
    SIGNED_RECORD_ID,
    encode_base_vector,
    encode_signed_record,
)
from sim_bridge.drive.fly import Flight

FORGED: Final = b"forged"  # how its bodies begin
FORGED_HZ: Final = 20
TICKS: Final = 20  # between its forged vectors


class Forger:
    """One vehicle, from when it flies; for `flown(watch=...)`. Its companion goes on as it would beside that."""

    def __init__(self, vehicle_id: int) -> None:
        self._id = vehicle_id
        self._others = itertools.count()
        self._ticks = 0
        self._records: RecordExchange | None = None

    def __call__(self, flight: Flight) -> None:
        """After a tick."""
        companion = flight.lockstep.companions.get(self._id)
        if self._records is not None or companion is None:
            return
        self._records = records = log_of(companion)
        honest = records.frames

        def frames(now_s: float, beacon_bytes: int) -> list[tuple[int, bytes]]:
            return [*honest(now_s, beacon_bytes), *self.forged(records)]

        setattr(records, "frames", frames)  # noqa: B010

    def forged(self, records: RecordExchange) -> list[tuple[int, bytes]]:
        """Messages of one tick: a record in another's name; once a second a false vector of its own and of the base."""
        self._ticks += 1
        lasts = {key: holding.last for key, holding in records.store.holdings().items() if key.vehicle_id != self._id}
        if not lasts:
            return []
        key = sorted(lasts)[next(self._others) % len(lasts)]
        out = [_record(records, key, lasts[key] + 1)]
        if self._ticks % TICKS == 0:
            false = {
                one: Entry(one, last + 5000, last + 5000, last + 5000, last + 5000, 0) for one, last in lasts.items()
            }
            out += _vectors(records, list(false.values())[:BITMAP])
        return out


def _record(records: RecordExchange, key: LogKey, number: int) -> tuple[int, bytes]:
    made = Record(*key, number, RecordKind.STEM, 1.0, FORGED + b" %d" % number, bytes(64))
    if isinstance(records, SignedExchange):
        return SIGNED_RECORD_ID, encode_signed_record(made)
    return RECORD_ID, encode_record(made)


def _vectors(records: RecordExchange, entries: list[Entry]) -> list[tuple[int, bytes]]:
    epoch, mission = records.store.base_epoch or 1, records.mission_hash
    out = [(VECTOR_ID, encode_vector(Vector(epoch, 1, False, False, tuple(entries[:11]), mission)))]
    if isinstance(records, SignedExchange):
        vector = Vector(epoch, 0, True, False, tuple(entries[:8]), mission)
        out.append((BASE_VECTOR_ID, encode_base_vector(vector, 1 << 60, lambda _told: bytes(64))))
    return out


def log_of(companion: Any) -> RecordExchange:
    """The records of a companion in this process."""
    endpoint: Endpoint = companion.endpoint
    records = endpoint.records
    assert isinstance(records, RecordExchange)
    return records
