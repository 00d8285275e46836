"""Progress of the swarm's records, and its stand, as frames of records tell somebody who only listens."""

from __future__ import annotations

from collections import deque

from companion.mavlink.framing.frames import source
from companion.records.frames import read_record, read_vector
from companion.records.record import BASE_ID, LOGS_TOTAL_MAX, LogKey, Progress, Record, RecordKind, Vector
from companion.records.signed.intake import Intake
from companion.records.signed.keys import RecordKeys
from companion.records.signed.messages import read_base_vector, read_signed_record
from companion.records.summary import StandSummary, decode_summary


class HarvestHeard:
    """Bounded: LOGS_TOTAL_MAX logs, and a summary of each of 250 vehicles at most."""

    def __init__(self, keys: RecordKeys | None = None) -> None:
        """`keys`: of a swarm with keys, of which only what its writer or the base station has signed is shown."""
        self._intake = None if keys is None else Intake(keys, {}, deque(maxlen=1))
        self._made: dict[LogKey, int] = {}  # the highest number that anybody told of
        self._delivered: dict[LogKey, int] = {}
        self._base_epoch = 0  # of its file
        self._summaries: dict[int, StandSummary] = {}

    def take_frame(self, frame: bytes, now_s: float) -> bool:
        """A whole frame of the swarm's radio; False: it is none of records, or not valid."""
        if self._intake is not None:
            return self._take_signed(frame, self._intake, now_s)
        record = read_record(frame)
        if record is not None:
            self._take_record(record)
            return True
        vector = read_vector(frame)
        if vector is None:
            return False
        if vector.is_base == (source(frame)[0] == BASE_ID):
            self._take_vector(vector)
        return True

    def _take_signed(self, frame: bytes, intake: Intake, now_s: float) -> bool:
        record, sender = read_signed_record(frame), source(frame)[0]
        if record is not None:
            if record.number > self._made.get(record.key, 0) and intake.proves(record, sender, now_s):
                self._take_record(record)
            return True
        base = read_base_vector(frame)
        if base is not None and intake.proves_base(base, sender, now_s):
            self._take_vector(base.vector)
        return base is not None or read_vector(frame) is not None

    def _take_record(self, record: Record) -> None:
        self._note_made(record.key, record.number)
        summary = decode_summary(record.body) if record.kind is RecordKind.SUMMARY else None
        before = self._summaries.get(record.vehicle_id)
        if summary is not None and (before is None or summary.fused >= before.fused):
            self._summaries[record.vehicle_id] = summary

    def text(self, leader: int) -> str:
        """In a line, the stand as the `leader` has it, or whoever told of the most records; empty: no records yet."""
        if not self._made:
            return ""
        told = self._summaries
        summary = told.get(leader) or max(told.values(), key=lambda one: one.fused, default=None)
        progress = Progress(sum(self._made.values()), sum(self._delivered.values()))
        return str(progress) if summary is None else f"{progress}; {summary}"

    def _take_vector(self, vector: Vector) -> None:
        if vector.base_epoch > self._base_epoch:  # of another file: what was delivered is to be delivered again
            self._base_epoch = vector.base_epoch
            self._delivered.clear()
        for entry in vector.entries:
            self._note_made(entry.key, max(entry.last, entry.upto, entry.acked))
            there = entry.upto + entry.bits.bit_count() if vector.is_base else entry.acked
            if entry.key in self._made and vector.base_epoch == self._base_epoch != 0:
                self._delivered[entry.key] = max(self._delivered.get(entry.key, 0), there)

    def _note_made(self, key: LogKey, number: int) -> None:
        if key in self._made or len(self._made) < LOGS_TOTAL_MAX:
            self._made[key] = max(self._made.get(key, 0), number)
