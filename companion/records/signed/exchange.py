"""Exchange of records in a swarm with keys: nothing is taken, and nothing freed, on the word of anybody else.

A record is taken when its writer has signed it, by whomever it comes, and only such a one opens a log: what vectors
tell of it decides what is sent to whom, no more. What the base station has is its own signed word, which vehicles pass
on unchanged.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil
from typing import Final

from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing.frames import source
from companion.mavlink.schema.tables.signed_records import BASE_ENTRIES_MAX, SIGNED_BODY_MAX
from companion.records.airtime import OVERHEAD_BYTES, frame_bytes
from companion.records.exchange import BASE_VECTOR_S, RecordExchange
from companion.records.frames import read_record, read_vector
from companion.records.holdings import Holding
from companion.records.peers import Peers
from companion.records.record import BASE_ID, LogKey, Record, Vector
from companion.records.signed.acknowledgements import Acknowledgements
from companion.records.signed.intake import Intake
from companion.records.signed.keys import RecordKeys
from companion.records.signed.messages import (
    BASE_VECTOR_ID,
    SIGNED_RECORD_ID,
    BaseVector,
    encode_base_vector,
    encode_signed_record,
    read_base_vector,
    read_signed_record,
)
from companion.records.store import RecordStore
from companion.records.summary import StandFusion
from companion.records.write_queue import RecordWriter

UNSIGNED: Final = "unsigned"
NONE: Final = Holding()  # of a log that nobody has told of
EPOCHS_MAX: Final = 16  # files of the base station whose messages are told from copies


class SignedExchange(RecordExchange):
    """One node's, of a store with the same keys."""

    body_max = SIGNED_BODY_MAX

    def __init__(
        self,
        store: RecordStore,
        writer: RecordWriter,
        me: int,
        members: int,
        bit_rate_kbps: float,
        *,
        keys: RecordKeys,
        epoch: int = 0,
        fusion: StandFusion | None = None,
    ) -> None:
        """As of `RecordExchange`."""
        super().__init__(
            *(store, writer, me, members, bit_rate_kbps), epoch=epoch, mission_hash=keys.mission_hash, fusion=fusion
        )
        self.dropped[UNSIGNED] = 0
        self._keys = keys
        self._peers = Peers(me, members, introduces=True)
        self._intake = Intake(keys, self.dropped, self._queue.lines)
        self._words = Acknowledgements()
        self._told = store.count_start() << 32 if self._is_base else 0
        self._base_payload = b""  # the last that came from the base station itself
        self._heard_told: dict[int, int] = {}  # by the base station's file: the newest that came from itself

    # --- in ---

    def receive(self, frame: bytes, now_s: float) -> bool:
        """As of `RecordExchange`; records and vectors of the base station without a signature are none."""
        record, base, vector = read_signed_record(frame), read_base_vector(frame), read_vector(frame)
        is_unsigned = vector.is_base if vector is not None else read_record(frame) is not None
        if record is None and base is None and vector is None and not is_unsigned:
            return False
        sender, component = source(frame)
        if component != COMPONENT:
            return True
        told = base.vector if base is not None else vector
        if not self._is_other(sender):
            self.dropped["of unknown vehicles"] += 1
        elif is_unsigned:
            self.dropped[UNSIGNED] += 1
        elif told is not None and told.mission_hash != self.mission_hash:
            self._note_foreign()
        elif record is not None:
            self._receive_signed(record, sender, now_s)
        elif base is not None:
            self._receive_base(base, sender, now_s)
        elif vector is not None and sender != BASE_ID:
            self._receive_vector(sender, vector, now_s)
        return True

    def _receive_signed(self, record: Record, sender: int, now_s: float) -> None:
        key, number = record.key, record.number
        holding = self._holdings.get(key, NONE)
        if not (1 <= key.vehicle_id <= self.members and self._intake.knows(key.vehicle_id)):
            self.dropped["of unknown vehicles"] += 1
        elif key == self._own:
            self._receive_own(record, sender, now_s)
        elif not holding.takes(number):
            self._compare(record, sender, now_s)
        elif self._queue.has_copy(record):
            self._peers.note_aired(key, number, now_s)
        elif self._intake.proves(record, sender, now_s) and super()._knows(key):
            self._peers.note_aired(key, number, now_s)
            self._note_known(key, number)
            self._queue.add_copy(record, now_s)

    def _receive_own(self, record: Record, sender: int, now_s: float) -> None:
        """Nobody else writes here; one that this disk does not have proves that its end was lost."""
        if record.number <= self._holdings[self._own].last:
            self._compare(record, sender, now_s)
        elif self._is_unsettled(now_s) and self._intake.proves(record, sender, now_s):
            self._queue.begins_log = True

    def _compare(self, record: Record, sender: int, now_s: float) -> None:
        """With the record of this number that is here, and stays."""
        kept = self.store.find_record(record.key, record.number)
        if kept is None:
            return
        if self._encode(kept) == self._encode(record):
            self._peers.note_aired(record.key, record.number, now_s)
        elif self._intake.proves(record, sender, now_s):
            self.dropped["conflicting"] += 1
            self._intake.note_twice(record)

    def _receive_base(self, base: BaseVector, sender: int, now_s: float) -> None:
        """A message of the base station, from itself or passed on."""
        vector = base.vector
        is_direct = sender == BASE_ID
        if is_direct and base.told <= self._heard_told.get(vector.base_epoch, 0):
            return  # a copy
        if not is_direct and not self._is_news(vector):
            self._words.note_passed_on(base, now_s)
            return
        if not self._intake.proves_base(base, sender, now_s):
            return
        self._words.note_genuine(base)
        if vector.base_epoch > self._epoch:
            self._words.clear()
        self._note_epoch(vector)
        if vector.base_epoch == self._epoch:
            self._note_words(base, now_s)
        if not is_direct:
            self._words.note_passed_on(base, now_s)
        else:
            self._base_payload = base.payload
            self._heard_told[vector.base_epoch] = base.told
            if len(self._heard_told) > EPOCHS_MAX:
                del self._heard_told[min(self._heard_told)]
            self._peers.note_vector(sender, vector, now_s, self._holdings.__contains__)

    def _is_news(self, vector: Vector) -> bool:
        """It would free more than is free."""
        if vector.base_epoch != self._epoch:
            return vector.base_epoch > self._epoch
        return any(self._is_more(entry.key, entry.upto) for entry in vector.entries)

    def _is_more(self, key: LogKey, upto: int) -> bool:
        holding = self._holdings.get(key)
        if holding is None:
            return False
        return (min(upto, holding.last) if key == self._own else upto) > self._acked.get(key, 0)

    def _note_words(self, base: BaseVector, now_s: float) -> None:
        for entry in base.vector.entries:
            key = entry.key
            if key not in self._holdings:
                continue
            if key == self._own and entry.upto > self._opened_last and self._is_unsettled(now_s):
                self._queue.begins_log = True
            if self._is_more(key, entry.upto) or (key not in self._words and entry.upto >= self._acked.get(key, 0) > 0):
                self._note_acked(key, entry.upto)
                self._words.store_word(key, base)

    def _receive_vector(self, sender: int, vector: Vector, now_s: float) -> None:
        """A vehicle's: what it lacks is sent; nothing is known by it, and nothing freed."""
        if vector.base_epoch != self._epoch:  # of another file of the base station's
            vector = replace(vector, entries=tuple(entry._replace(acked=0) for entry in vector.entries))
        self._peers.note_vector(sender, vector, now_s, self._holdings.__contains__)

    # --- out ---

    def _vectors(self, now_s: float) -> list[tuple[int, bytes]]:
        """The own vector; behind a vehicle's, what the base station has told and a neighbour does not know."""
        if not self._is_base:
            due = self._words.take_due(self._peers, self._acked, now_s)
            return [*super()._vectors(now_s), *((BASE_VECTOR_ID, payload) for payload in due)]
        out = []
        for part in self._vector_parts(BASE_ENTRIES_MAX, now_s):
            self._told += 1
            out.append((BASE_VECTOR_ID, encode_base_vector(part, self._told, self._keys.sign_base)))
        return out

    def _refill(self, now_s: float, ahead_bytes: int) -> None:
        """The base station has no beacons, and sends no records: its vectors are all that it takes of the channel.

        Beacons and manifests with their signatures leave little of a slow one: it must not be counted as a vehicle.
        """
        hears_base = self._peers.hears(BASE_ID, now_s)
        messages = max(1, ceil(len(self._holdings) / BASE_ENTRIES_MAX)) if hears_base else 0
        aside_bps = messages * (frame_bytes(self._base_payload) + OVERHEAD_BYTES) / BASE_VECTOR_S
        self._airtime.refill(now_s, ahead_bytes, self._peers.heard(now_s) - hears_base, aside_bps)

    def _sendable(self, now_s: float) -> dict[LogKey, Holding]:
        """Of vehicles alone whose key others have."""
        logs = super()._sendable(now_s)
        return {key: holding for key, holding in logs.items() if self._intake.knows(key.vehicle_id)}

    def _encode(self, record: Record) -> tuple[int, bytes]:
        return SIGNED_RECORD_ID, encode_signed_record(record)
