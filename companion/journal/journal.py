"""Entries in, chunks for the disk out. It never waits: what the disk does not take is counted, and a gap says so.

Ticks are chained: each bears the SHA-256 of the link before it, and of all that was recorded since, its own text
included. The first link is of the header, with which every file of the flight begins. Who changes, removes or moves a
record breaks the link behind it.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import cbor2

from companion.journal import mcap
from companion.journal.channels import CHAIN_BYTES, Channel, Json, encode, sealed, to_ns

CHUNK_S: Final = 0.25  # what a process that is killed loses at most
CHUNK_BYTES: Final = 1 << 20  # raw lidars fill one sooner
SYNC_S: Final = 1.0  # between two waits for the disk: what a power cut costs, besides the chunk
WAITING_BYTES: Final = 4 << 20  # of chunks that the disk has not taken: 90 s with all of PX4's streams, else minutes
RATE_BYTES_S: Final = 1 << 20  # ten times what a swarm with raw lidars records: a flood must not push all else out
BURST_BYTES: Final = 16 << 20  # beyond that rate
RETRY_S: Final = 5.0  # after the disk refused one
BEGIN: Final = bytes(CHAIN_BYTES)  # the link before the first of a box whose header is not chained


def begin_chain(head: bytes) -> bytes:
    """The link before the first: of the bytes with which every segment begins."""
    return hashlib.sha256(head).digest()


@dataclass(frozen=True, slots=True)
class Batch:
    """Chunks to be written, in order. `is_synced`: the disk is waited for."""

    chunks: tuple[bytes, ...]
    is_synced: bool


@dataclass(frozen=True, slots=True)
class Outcome:
    """Of a batch: how many of its chunks are written, why not the others, and what is to be said."""

    written: int
    error: str = ""
    lines: Sequence[str] = ()


class ChunkWriter(Protocol):
    """Writes chunks to the disk, now or beside the loop."""

    def submit(self, batch: Batch) -> bool:
        """Take a batch; False while another one is under way."""

    def take_outcome(self) -> Outcome | None:
        """Outcome of the last batch, once; None: not yet, or there was none."""

    def finish(self, batch: Batch) -> None:
        """Write the last batch behind the one under way, wait for it a while, close the file."""


class Journal:
    """One flight's. Times are the companion's clock, s."""

    def __init__(self, writer: ChunkWriter, start: Json, head: bytes) -> None:
        """`start`: the first entry; its time is that of the next. `head`: with which the writer begins each file."""
        self.lines: Final = deque[str](maxlen=8)  # to be said
        self.ticks = 0  # recorded or lost
        self.lost = 0  # of them
        self.incomplete = ""  # ticks that are lost, and why, once it is closed; empty: none
        self.link = begin_chain(head)  # of the last tick
        self._writer: Final = writer
        self._start = encode(start)
        self._records: list[bytes] = []  # since the last tick
        self._chunk: list[bytes] = []  # whole ticks
        self._chunk_bytes = self._chunk_ticks = 0
        self._first_ns = self._last_ns = 0
        self._number = 1  # of entries: the start
        self._began_s: float | None = None  # the chunk
        self._allowance = float(BURST_BYTES)  # bytes that may be recorded at once
        self._waiting: deque[bytes] = deque()
        self._waiting_ticks: deque[int] = deque()  # in each of them
        self._waiting_bytes = 0
        self._under_way = 0  # of them: with the writer
        self._is_losing = False
        self._gap: tuple[int, str] | None = None  # its first tick, and why
        self._error = ""  # of the disk; empty: it takes what it is given
        self._retry_s = self._sync_s = float("-inf")

    def put_datagram(self, channel: int, data: bytes, now_s: float) -> None:
        """A datagram that came or goes."""
        self._number += 1
        self._records.append(mcap.datagram(channel, self._number, to_ns(now_s), now_s, data))

    def put_answers(self, verdicts: bytes, lists: Sequence[object], now_s: float) -> None:
        """The answers of one tick."""
        if verdicts:
            self._put(Channel.VERDICTS, to_ns(now_s), verdicts)
        if lists:
            self._put(Channel.ANSWERS, to_ns(now_s), cbor2.dumps(list(lists)))

    def end_tick(self, text: bytes, now_s: float) -> None:
        """A tick is over: chains it, and gives the disk what is due. `text`: of `tick_text`."""
        self.ticks += 1
        self._seal(Channel.TICK, text, now_s)
        if self._began_s is None:
            self._began_s = now_s
        if now_s - self._began_s >= CHUNK_S or self._chunk_bytes >= CHUNK_BYTES or now_s < self._began_s:
            self._end_chunk(now_s)
            self._write(now_s)

    def close(self, body: Json, now_s: float) -> None:
        """The last entry, what is left, and the file. Of ticks that are being lost a gap says which."""
        if self._gap is not None and self._is_losing and self._gap[0] <= self.ticks:
            self.lost += self._chunk_ticks
            self._begin_chunk(now_s)
            self._records.clear()
            self._put_gap(now_s)
        self._seal(Channel.END, encode(body), now_s)
        self._queue_chunk()
        self._take_outcome(now_s)
        self._writer.finish(Batch(tuple(self._waiting)[self._under_way :], is_synced=True))
        for _ in range(2):  # that under way, and the last
            self._take_outcome(now_s)
        self.lost += sum(self._waiting_ticks)
        if self._waiting or self.lost:
            why = self._error or (self._gap or (0, "slow disk"))[1]
            is_open = ", and it is not closed" if self._waiting else ""
            self.incomplete = f"incomplete: {why}: {self.lost} of {self.ticks} ticks are LOST{is_open}"
            self.lines.append(f"black box: {self.incomplete}")

    # --- chain and chunks ---

    def _put(self, channel: int, time_ns: int, data: bytes) -> None:
        self._number += 1
        self._records.append(mcap.message(channel, self._number, time_ns, data))

    def _seal(self, channel: Channel, text: bytes, now_s: float) -> None:
        time_ns = to_ns(now_s)
        if self._start:
            self._records.insert(0, mcap.message(Channel.START, 1, time_ns, self._start))
            self._start = b""
        before = b"".join(self._records)
        self._records.clear()
        self.link = hashlib.sha256(b"".join((self.link, before, text))).digest()
        self._number += 1
        record = mcap.message(channel, self._number, time_ns, sealed(text, self.link))
        self._first_ns, self._last_ns = self._first_ns if self._chunk else time_ns, time_ns
        self._chunk += (before, record)
        self._chunk_ticks += channel == Channel.TICK
        self._chunk_bytes += len(before) + len(record)

    def _end_chunk(self, now_s: float) -> None:
        """Chunk to the queue; one that begins while that is full, or more comes than may, is lost."""
        since_s = 0.0 if self._began_s is None else max(0.0, now_s - self._began_s)
        spent = 0 if self._is_losing else self._chunk_bytes
        self._allowance = min(float(BURST_BYTES), self._allowance + since_s * RATE_BYTES_S) - spent
        if self._chunk and not self._is_losing:
            self._queue_chunk()
        else:
            self.lost += self._chunk_ticks
        self._begin_chunk(now_s)
        was_losing, why = self._is_losing, self._reason_to_lose()
        self._is_losing = why != ""
        if self._is_losing and not was_losing:
            self._gap = self.ticks + 1, why
            self.lines.append(f"black box: {why}: ticks are LOST from {self.ticks + 1} on")
        elif was_losing and not self._is_losing:
            self._put_gap(now_s)

    def _begin_chunk(self, now_s: float) -> None:
        self._chunk.clear()
        self._chunk_bytes, self._chunk_ticks, self._began_s = 0, 0, now_s

    def _queue_chunk(self) -> None:
        chunk = mcap.chunk(b"".join(self._chunk), self._first_ns, self._last_ns)
        self._waiting.append(chunk)
        self._waiting_ticks.append(self._chunk_ticks)
        self._waiting_bytes += len(chunk)

    def _put_gap(self, now_s: float) -> None:
        """Behind the last tick that is lost; hashed with the next tick, or the end."""
        assert self._gap is not None
        first, why = self._gap
        gap = {"first_tick": first, "last_tick": self.ticks, "ticks": self.ticks - first + 1, "why": why}
        self._put(Channel.GAP, to_ns(now_s), sealed(encode(gap), self.link))

    def _reason_to_lose(self) -> str:
        """The reason why the next chunk is lost; empty: it is not."""
        if self._waiting_bytes >= WAITING_BYTES:
            return self._error or "slow disk"
        if self._allowance < (BURST_BYTES / 2 if self._is_losing else 0.0):
            return "flood"
        return ""

    # --- the disk ---

    def _write(self, now_s: float) -> None:
        self._take_outcome(now_s)
        if self._under_way or not self._waiting or now_s < self._retry_s:
            return
        is_synced = not 0.0 <= now_s - self._sync_s < SYNC_S
        if self._writer.submit(Batch(tuple(self._waiting), is_synced)):
            self._under_way = len(self._waiting)
            self._sync_s = now_s if is_synced else self._sync_s
        self._take_outcome(now_s)  # one that does not write beside the loop has it at once

    def _take_outcome(self, now_s: float) -> None:
        outcome = self._writer.take_outcome()
        if outcome is None:
            return
        self._under_way = 0
        for _ in range(outcome.written):
            self._waiting_bytes -= len(self._waiting.popleft())
            self._waiting_ticks.popleft()
        self.lines.extend(outcome.lines)
        if outcome.error:
            self._retry_s = now_s + RETRY_S
            if not self._error:
                self.lines.append(f"black box: {outcome.error}: kept in memory")
        elif self._error:
            self.lines.append("black box: the disk takes it again")
        self._error = outcome.error
