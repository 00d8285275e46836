"""Exchange of records with the swarm and the base station: frames in, frames out, batches to the disk. No I/O.

Every node tells its version vector, and sends what others lack. Union is the merge, so a split, a hand-over, a restart
and a frame that comes twice are one case. "Delivered" means that the base station's vector has come back, over however
many nodes; custody stays with the writer until then (RFC 5050, section 5.10; RFC 9171 leaves it out).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing.frames import source
from companion.mavlink.harvest import StandUpdate
from companion.mavlink.schema.tables.measurements import ENTRIES_MAX
from companion.records.airtime import OVERHEAD_BYTES, Airtime, frame_bytes
from companion.records.frames import (
    RECORD_ID,
    VECTOR_ID,
    encode_record,
    encode_vector,
    is_record_frame,
    read_record,
    read_vector,
)
from companion.records.holdings import Holding
from companion.records.peers import Candidate, Peers
from companion.records.record import (
    BASE_ID,
    BODY_MAX,
    LOGS_TOTAL_MAX,
    NUMBER_MAX,
    Entry,
    LogKey,
    Progress,
    Record,
    RecordKind,
    Vector,
)
from companion.records.store import RecordStore, Written
from companion.records.summary import StandFusion, StandSummary, decode_summary
from companion.records.write_queue import RecordWriter, WriteQueue

DROPPED: Final = ("of unknown vehicles", "conflicting", "of too many logs")
FOREIGN: Final = "of another mission"
VECTOR_S: Final = 1.0  # between a vehicle's vectors; nobody hears more of one's progress
BASE_VECTOR_S: Final = 0.5  # the base station's: what it has heard is not sent again
PLAN_S: Final = 0.25  # how long a plan holds
FRAMES_MAX: Final = 1  # records in a tick: another's beacon does not wait for more than one of each vehicle
LOGS_MAX: Final = 8  # of one vehicle: disks that it has lost since the swarm took off
GIVE_UP_S: Final = 30.0  # what the base station has, and nobody has sent for so long, a vehicle does without
SETTLE_S: Final = 5.0  # after a start, no own record goes out: others may have more of this log than a damaged disk


class RecordExchange:
    """One node's: a vehicle's or the base station's (`me` is BASE_ID). Times are the local clock's, s."""

    body_max: int = BODY_MAX

    def __init__(
        self,
        store: RecordStore,
        writer: RecordWriter,
        me: int,
        members: int,
        bit_rate_kbps: float,
        *,
        epoch: int = 0,
        mission_hash: int = 0,
        fusion: StandFusion | None = None,
    ) -> None:
        """`members`: number of vehicles of the swarm; others are not heard. `epoch`: of the base station's file.

        `fusion`: a vehicle's, of its store.
        `mission_hash`: vectors of another mission are not heard, nor records of logs that none of this one told of.
        """
        self.unstored = ""  # reason why they are in memory alone, where a file was asked for
        self.dropped: Final = dict.fromkeys((*DROPPED, FOREIGN), 0)
        self.mission_hash: Final = mission_hash
        self.store: Final = store  # the records on this node's disk
        self._fusion = fusion
        self._queue = WriteQueue(writer, keeps_own=me != BASE_ID)
        self._me, self.members, self._is_base = me, members, me == BASE_ID
        self._peers = Peers(me, members)
        self._airtime = Airtime(bit_rate_kbps)
        self._holdings: Final[dict[LogKey, Holding]] = store.holdings()
        self._own = store.own_log
        self._opened_last = 0 if self._is_base else self._holdings[self._own].last
        self._acked: Final = store.acked()
        self._epoch = epoch if self._is_base else store.base_epoch
        self._known: Final = {key: holding.last for key, holding in self._holdings.items()}  # highest number told of
        self._grew_s: Final = dict[LogKey, float]()
        self._vector_s: float | None = None
        self._settled_s: float | None = None
        self._plan: list[Candidate] = []
        self._plan_s = float("-inf")
        self._had_beacon = False  # in the last tick
        self.summaries: Final = dict[int, StandSummary]()  # of the stand, the newest of each vehicle that has led
        for vehicle_id, _, _, body in store.records(RecordKind.SUMMARY):
            self._note_summary(vehicle_id, body)

    # --- in ---

    def append(self, kind: int, body: bytes, now_s: float) -> None:
        """One more record of this vehicle's own; what there is no room for is counted and said."""
        if len(body) > self.body_max:
            self._queue.refuse(1)
        else:
            self._queue.add_own(RecordKind(kind), body, now_s)

    def take_stand(self, *, leads: bool, now_s: float) -> StandUpdate | None:
        """As `RecordLink` has it; what is new is a record, too."""
        if self._fusion is None:
            return None
        self._queue.lines.extend(self._fusion.lines())
        update = self._fusion.take_update(leads=leads, now_s=now_s)
        if update is not None:
            self.append(update.kind, update.body, now_s)
        return update

    def is_record(self, frame: bytes) -> bool:
        """A whole frame is one of records, by its header alone."""
        return is_record_frame(frame)

    def receive(self, frame: bytes, now_s: float) -> bool:
        """A frame of the swarm's radio that its guard has admitted; False: it is no valid frame of records."""
        record = read_record(frame)
        vector = read_vector(frame) if record is None else None
        if record is None and vector is None:
            return False
        sender, component = source(frame)
        if component != COMPONENT:
            return True
        if not self._is_other(sender):
            self.dropped["of unknown vehicles"] += 1
        elif record is not None:
            self._receive_record(record, now_s)
        elif vector is not None and vector.mission_hash != self.mission_hash:
            self._note_foreign()
        elif vector is not None and vector.is_base == (sender == BASE_ID):
            self._receive_vector(sender, vector, now_s)
        return True

    def _is_other(self, sender: int) -> bool:
        """Another node of this swarm."""
        return sender != self._me and (1 <= sender <= self.members or sender == BASE_ID)

    def _note_foreign(self) -> None:
        if not self.dropped[FOREIGN]:
            self._queue.lines.append("records: ignored: vehicles of another mission")
        self.dropped[FOREIGN] += 1

    def _receive_record(self, record: Record, now_s: float) -> None:
        key = record.key
        self._peers.note_aired(key, record.number, now_s)
        if not 1 <= key.vehicle_id <= self.members:
            self.dropped["of unknown vehicles"] += 1
        if key not in self._holdings:
            return  # no vector told of it: it may be another mission's. Nobody sends it for this node yet
        self._note_known(key, record.number)
        if key == self._own:
            return  # nobody else writes here
        holding = self._holdings[key]
        if not holding.takes(record.number):
            self._note_conflict(record)
        else:
            self._queue.add_copy(record, now_s)

    def _note_conflict(self, record: Record) -> None:
        """Counts what differs from the record that is here under the same number: that one stays."""
        kept = self.store.find_record(record.key, record.number)
        if kept is not None and kept != record:
            self.dropped["conflicting"] += 1

    def _receive_vector(self, sender: int, vector: Vector, now_s: float) -> None:
        self._note_epoch(vector)
        for entry in vector.entries:
            key = entry.key
            if not self._knows(key):
                continue
            if key == self._own and max(entry.last, entry.acked) > self._opened_last and self._is_unsettled(now_s):
                self._queue.begins_log = True
            self._note_known(key, max(entry.last, entry.upto, entry.acked))
            if vector.base_epoch == self._epoch != 0:
                self._note_acked(key, entry.upto if vector.is_base else entry.acked)
        self._peers.note_vector(sender, vector, now_s, self._knows)

    def _note_epoch(self, vector: Vector) -> None:
        """A later file of the base station's stands for all before it: what was delivered is to be delivered again."""
        if not self._is_base and vector.base_epoch > self._epoch:
            self._epoch = self._queue.epoch = vector.base_epoch
            self._acked.clear()
            self._queue.acked.clear()

    def _note_acked(self, key: LogKey, number: int) -> None:
        if key == self._own:
            number = min(number, self._holdings[key].last)
        if not self._is_base and self._acked.get(key, 0) < number <= NUMBER_MAX:
            self._acked[key] = self._queue.acked[key] = number

    def _note_known(self, key: LogKey, number: int) -> None:
        if number <= NUMBER_MAX:
            self._known[key] = max(self._known.get(key, 0), number)

    def _knows(self, key: LogKey) -> bool:
        """A log of one of this swarm's vehicles, now among those that are kept; of one vehicle LOGS_MAX at most."""
        if key in self._holdings:
            return True
        if not 1 <= key.vehicle_id <= self.members:
            self.dropped["of unknown vehicles"] += 1
            return False
        of_vehicle = sum(other.vehicle_id == key.vehicle_id for other in self._holdings)
        if of_vehicle >= LOGS_MAX or len(self._holdings) >= LOGS_TOTAL_MAX:
            self.dropped["of too many logs"] += 1
            return False
        self._holdings[key] = Holding()
        self._known.setdefault(key, 0)
        return True

    def _is_unsettled(self, now_s: float) -> bool:
        return self._settled_s is None or now_s < self._settled_s

    # --- out ---

    def frames(self, now_s: float, beacon_bytes: int) -> list[tuple[int, bytes]]:
        """Once a tick: message ids and payloads, to be sent after the `beacon_bytes` of this tick's beacons."""
        if self._settled_s is None:
            self._settled_s = now_s + SETTLE_S if self._opened_last else now_s
            self._vector_s = now_s + VECTOR_S * (self._me % 10) / 10.0  # not all at once
        self._write(now_s)
        out: list[tuple[int, bytes]] = []
        if self._vector_s is None or now_s >= self._vector_s:
            self._vector_s = now_s + (BASE_VECTOR_S if self._is_base else VECTOR_S)
            out += self._vectors(now_s)
        ahead_bytes = beacon_bytes + OVERHEAD_BYTES * (beacon_bytes > 0)
        ahead_bytes += sum(frame_bytes(payload) + OVERHEAD_BYTES for _, payload in out)
        self._refill(now_s, ahead_bytes)
        # Between the own beacons, unless there is one in each tick: a beacon waits for no record of its own vehicle.
        is_between = not beacon_bytes or self._had_beacon
        self._had_beacon = beacon_bytes > 0
        if is_between and not self._is_base:
            out += self._records(now_s)
        return out

    def _refill(self, now_s: float, ahead_bytes: int) -> None:
        self._airtime.refill(now_s, ahead_bytes, self._peers.heard(now_s))

    def note_line(self, line: str) -> None:
        """Something that happened when this node's file was opened."""
        self._queue.lines.append(line)

    @property
    def unwritten(self) -> tuple[int, int]:
        """Own records that are not on the disk: for which there is no room, and those that its next write takes."""
        return self._queue.refused + self._queue.waiting - self._queue.pending, self._queue.pending

    def finish(self, now_s: float) -> int:
        """As `WriteQueue` has it."""
        return self._queue.finish(now_s)

    def counters(self) -> dict[str, int]:
        """Counts for the log, of this node."""
        progress = self.progress()
        return {
            "records heard of": progress.made,
            "delivered": progress.delivered,
            "own ones lost": self._queue.refused,
            "own ones waiting for the disk": self._queue.waiting,
            **self.dropped,
        }

    def lines(self) -> list[str]:
        """Lines for the operator, since last asked."""
        said = list(self._queue.lines)
        self._queue.lines.clear()
        return said

    def progress(self) -> Progress:
        """Of the swarm's records that this node has heard of: at the base station its own, elsewhere acknowledged."""
        if self._is_base:
            return Progress(sum(self._known.values()), sum(holding.count for holding in self._holdings.values()))
        return Progress(sum(self._known.values()), sum(self._acked.values()))

    def count_waiting(self) -> int:
        """As `RecordLink` has it."""
        return sum(self._known.values()) - sum(self._acked.values())

    def missing(self) -> dict[LogKey, list[tuple[int, int]]]:
        """Numbers that somebody told of and that are not here: gaps, by log, each from its first to its last."""
        gaps = {key: list(holding.missing(self._known[key])) for key, holding in self._holdings.items()}
        return {key: found for key, found in gaps.items() if found}

    @property
    def acked(self) -> Mapping[LogKey, int]:
        """Up to which number the base station has all, log by log, as far as it was heard of."""
        return self._acked

    # --- the disk ---

    def _write(self, now_s: float) -> None:
        """Takes what is on the disk by now, and hands over what has gathered."""
        self._store_outcome(self._queue.take_written(now_s), now_s)
        if self._queue.is_due(now_s):
            self._note_stuck(now_s)
            self._queue.submit(now_s)
            self._store_outcome(self._queue.take_written(now_s), now_s)

    def _note_stuck(self, now_s: float) -> None:
        """Gives up, in time, what the base station has: nobody may be left who could send it."""
        for key, acked in self._acked.items():
            if key == self._own or self._holdings[key].upto >= acked:
                continue
            if now_s - self._grew_s.setdefault(key, now_s) > GIVE_UP_S:
                self._queue.given_up[key] = acked

    def _store_outcome(self, outcome: Written | None, now_s: float) -> None:
        if outcome is None:
            return
        if outcome.own_log != self._own:
            self._begin_log(outcome)
        for record in (*outcome.own, *outcome.others):
            self._grew_s[record.key] = now_s
            self._holdings[record.key].add(record.number)
            self._note_known(record.key, record.number)
            if record.kind is RecordKind.SUMMARY:
                self._note_summary(record.vehicle_id, record.body)
        for key, number in outcome.given_up.items():
            self._grew_s[key] = now_s
            self._holdings[key].give_up(number)

    def _note_summary(self, vehicle_id: int, body: bytes) -> None:
        """A vehicle's, of the stand: the one of the most records is its newest. What is malformed is none."""
        summary, before = decode_summary(body), self.summaries.get(vehicle_id)
        if summary is not None and (before is None or summary.fused >= before.fused):
            self.summaries[vehicle_id] = summary

    def _begin_log(self, outcome: Written) -> None:
        """Others have more of the old log than the disk: its end was lost. It is now a log as another's is."""
        self._holdings[self._own] = Holding.of(self._opened_last)
        self._own = outcome.own_log
        self._holdings[self._own] = Holding.of(outcome.moved)
        self._known[self._own] = outcome.moved
        self._opened_last, self._settled_s = 0, float("-inf")
        self._queue.lines.append("records: log cut short by disk: new log begun")

    # --- the radio ---

    def _vectors(self, now_s: float) -> list[tuple[int, bytes]]:
        """The own vector, in as many messages as it takes."""
        hops = 0 if self._is_base else self._peers.hops(now_s)
        return [
            (VECTOR_ID, encode_vector(replace(part, hops=hops, is_base=self._is_base)))
            for part in self._vector_parts(ENTRIES_MAX, now_s)
        ]

    def _vector_parts(self, entries_max: int, now_s: float) -> list[Vector]:
        """Of at most so many entries; one at least."""
        entries = [self._entry(key, holding) for key, holding in self._holdings.items()]
        parts = [tuple(entries[at : at + entries_max]) for at in range(0, len(entries), entries_max)]
        is_full = bool(parts) and self._queue.is_full(now_s)
        return [Vector(self._epoch, 0, False, is_full, part, self.mission_hash) for part in parts or [()]]

    def _entry(self, key: LogKey, holding: Holding) -> Entry:
        window = holding.advance_window(self._known[key])
        acked = holding.upto if self._is_base else self._acked.get(key, 0)
        return Entry(key, holding.upto, window, holding.last, acked, holding.bits(window))

    def _sendable(self, now_s: float) -> dict[LogKey, Holding]:
        """The logs of which records may go out."""
        silent = self._own if self._is_unsettled(now_s) else None
        return {key: holding for key, holding in self._holdings.items() if key != silent}

    def _encode(self, record: Record) -> tuple[int, bytes]:
        return RECORD_ID, encode_record(record)

    def _records(self, now_s: float) -> list[tuple[int, bytes]]:
        """Records that others lack, as far as the airtime reaches."""
        if now_s - self._plan_s >= PLAN_S:
            self._plan, self._plan_s = self._peers.plan(self._sendable(now_s), self._own, now_s), now_s
        out: list[tuple[int, bytes]] = []
        waiting: list[Candidate] = []
        for at, candidate in enumerate(self._plan):
            if not self._peers.is_turn(candidate, now_s):
                waiting.append(candidate)
                continue
            if self._peers.is_aired_since(candidate.key, candidate.number, self._plan_s):
                continue
            record = self.store.find_record(candidate.key, candidate.number)
            if record is None:
                continue
            message = self._encode(record)
            if len(out) == FRAMES_MAX or not self._airtime.take_tokens(frame_bytes(message[1])):
                waiting += self._plan[at:]
                break
            self._peers.note_aired(candidate.key, candidate.number, now_s)
            out.append(message)
        self._plan = waiting
        return out
