"""Records that wait for the disk. Bounded; that a write failed is said once, and the flight goes on."""

from __future__ import annotations

from collections import deque
from typing import Final, Protocol

from companion.records.record import Draft, LogKey, Record, RecordKind
from companion.records.store import Batch, RecordStore, StoreError, Written

WRITE_S: Final = 0.5  # between writes: each waits for the disk, some for a tenth of a second
RETRY_S: Final = 5.0  # after a write that failed
FULL_S: Final = 10.0  # after there was no room for others' records, they are asked for again
DRAFTS_MAX: Final = 256  # own records that wait; minutes of them
COPIES_MAX: Final = 256  # of others; what is beyond is sent again


class RecordWriter(Protocol):
    """Writes to the disk, now or beside the loop."""

    def submit(self, batch: Batch) -> bool:
        """Take a batch to be written; False while another one is."""

    def take_outcome(self) -> Written | StoreError | None:
        """Outcome of the last batch, once; None: not yet, or there was none."""


class DirectWriter:
    """Writes while the caller waits."""

    def __init__(self, store: RecordStore) -> None:
        self._store = store
        self._outcome: Written | StoreError | None = None

    def submit(self, batch: Batch) -> bool:
        """Write it."""
        try:
            self._outcome = self._store.write(batch)
        except StoreError as error:
            self._outcome = error
        return True

    def take_outcome(self) -> Written | StoreError | None:
        """Its outcome."""
        outcome, self._outcome = self._outcome, None
        return outcome


class WriteQueue:
    """Of one node. Times are the local clock's, s."""

    def __init__(self, writer: RecordWriter, *, keeps_own: bool) -> None:
        """`keeps_own`: a vehicle's, which makes records; else the base station's."""
        self.refused = 0  # own records that are lost: no room, and nothing that may go
        self.lines: Final = deque[str](maxlen=8)  # to be said
        self.acked: Final = dict[LogKey, int]()  # to be written, as in Batch
        self.given_up: Final = dict[LogKey, int]()
        self.epoch = 0
        self.begins_log = False
        self._writer = writer
        self._keeps_own = keeps_own
        self._drafts: Final = deque[Draft]()
        self._copies: Final = dict[tuple[LogKey, int], Record]()
        self._under_way: Batch | None = None
        self._write_s = self._full_until_s = float("-inf")
        self._is_failing = self._is_full = False

    @property
    def waiting(self) -> int:
        """Own records in memory that are not known to be on the disk yet."""
        return len(self._drafts)

    @property
    def pending(self) -> int:
        """Number of them that the next write takes; 0 while the disk fails."""
        return 0 if self._is_failing else self.waiting

    def add_own(self, kind: RecordKind, body: bytes, now_s: float) -> None:
        """One more record of this vehicle's."""
        if len(self._drafts) < DRAFTS_MAX:
            self._drafts.append(Draft(kind, max(0.0, now_s), body))
        else:
            self.refuse(1)

    def add_copy(self, record: Record, now_s: float) -> None:
        """A record of another's."""
        if len(self._copies) < COPIES_MAX and not self.is_full(now_s):
            self._copies.setdefault((record.key, record.number), record)

    def has_copy(self, record: Record) -> bool:
        """This very record waits already."""
        return self._copies.get((record.key, record.number)) == record

    def is_full(self, now_s: float) -> bool:
        """Others need not send anything now."""
        return now_s < self._full_until_s

    def is_due(self, now_s: float) -> bool:
        """True if a batch may be written."""
        return self._under_way is None and now_s >= self._write_s

    def submit(self, now_s: float) -> None:
        """Hand to the writer what has gathered."""
        batch = Batch(
            own=tuple(self._drafts),
            others=tuple(self._copies.values()),
            acked=dict(self.acked),
            epoch=self.epoch,
            given_up=dict(self.given_up),
            begins_log=self.begins_log,
        )
        if batch == Batch() or not self._writer.submit(batch):
            return
        self._under_way = batch
        self._write_s = now_s + WRITE_S
        self._copies.clear()
        self.acked.clear()
        self.given_up.clear()
        self.epoch, self.begins_log = 0, False

    def take_written(self, now_s: float) -> Written | None:
        """The batch that is on the disk by now, once; only that may be told of, and sent."""
        outcome = self._writer.take_outcome()
        batch = self._under_way
        if outcome is None or batch is None:
            return None
        self._under_way = None
        if isinstance(outcome, StoreError):
            self._put_back(batch, outcome, now_s)
            return None
        if self._is_failing:
            self._is_failing = False
            self.lines.append("records: the disk takes them again")
        for _ in batch.own:
            self._drafts.popleft()
        lacking = len(batch.others) - len(outcome.others)
        if lacking:
            self._full_until_s = now_s + FULL_S
            if not self._keeps_own:
                self._say_full("records: no room for more: they wait on the vehicles")
        if outcome.refused:
            self.refuse(outcome.refused)
        elif not lacking:
            self._is_full = False
        return outcome

    def finish(self, now_s: float) -> int:
        """At the end, again and again until it is 0: own records not on the disk yet. What failed is repeated."""
        self.take_written(now_s)
        if self._under_way is None:
            self.submit(now_s)
            self.take_written(now_s)
        return self.waiting

    def refuse(self, count: int) -> None:
        """Own records are lost."""
        self.refused += count
        self._say_full("records: no room: new ones are LOST")

    def _say_full(self, line: str) -> None:
        if not self._is_full:
            self.lines.append(line)
        self._is_full = True

    def _put_back(self, batch: Batch, error: StoreError, now_s: float) -> None:
        """Nothing was written: own records wait in memory, others' come again."""
        if not self._is_failing:
            waiting = "kept in memory" if self._keeps_own else "none is taken"
            self.lines.append(f"records: {error}: {waiting}")
        self._is_failing = True
        self._write_s = self._full_until_s = now_s + RETRY_S
        for newer, older in ((self.acked, batch.acked), (self.given_up, batch.given_up)):
            merged = {**older, **newer}
            newer.update(merged)
        self.epoch = self.epoch or batch.epoch
        self.begins_log |= batch.begins_log
