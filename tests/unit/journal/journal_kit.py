"""One endpoint with its black box, a disk in memory, and logs that somebody has changed."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from companion.journal import mcap
from companion.journal.channels import Channel, unsealed
from companion.journal.journal import Batch, Outcome, begin_chain
from companion.journal.reading import Flight, find_flights
from companion.journal.recorder import BlackBox, Recorder, files_of, head_of, start_body
from companion.journal.segments import DirectWriter
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.signing import Gate
from companion.mavlink.harvest import RecordLink
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.peers.guard import Guard
from tests.unit.core.core_kit import mission
from tests.unit.mavlink.endpoint_kit import HOME, ME, TICK_S, heartbeat, packed, position
from tests.unit.mavlink.test_endpoint_peers import beacon_of

MISSION = mission()


def start_of(**how: Any) -> dict[str, Any]:
    return start_body(MISSION, "its text", "its digest", ME, sensors=[], clock="simulated", waived="all", **how)


START = start_of()
Messages = list[mcap.Message]


class MemoryDisk:
    """Takes chunks, or does not."""

    def __init__(self) -> None:
        self.chunks: list[bytes] = []
        self.error = ""
        self.is_slow = False  # the batch under way does not end
        self.finished = False
        self._outcome: Outcome | None = None

    def submit(self, batch: Batch) -> bool:
        if not self.error and not self.is_slow:
            self.chunks += batch.chunks
        if not self.is_slow:
            self._outcome = Outcome(0 if self.error else len(batch.chunks), self.error)
        return True

    def take_outcome(self) -> Outcome | None:
        outcome, self._outcome = self._outcome, None
        return outcome

    def finish(self, batch: Batch) -> None:
        self.submit(batch)
        self.finished = True


def recorder_of(
    writer: Any,
    *,
    guard: Guard | None = None,
    orders: OrderBook | None = None,
    gate: Gate | None = None,
    records: RecordLink | None = None,
    **start: Any,
) -> tuple[Recorder, Endpoint]:
    body = (
        start_of(has_records=records is not None, guard=guard, orders=orders, autopilot_signed=gate is not None) | start
    )
    box = BlackBox(writer, body)
    endpoint = Endpoint(
        MISSION,
        ME,
        guard=box.record_guard(guard),
        orders=box.record_orders(orders),
        autopilot_gate=box.record_gate(gate),
        records=box.record_link(records),
    )
    endpoint.agent.ground(body["grounded"])
    endpoint.agent.waive(body["waived"], unsigned=body["unsigned"])
    return box.record_endpoint(endpoint), endpoint


def fly_ticks(recorder: Recorder | Endpoint, count: int, *, first: int = 0) -> None:
    """Some telemetry, two neighbours, a tick; and so on."""
    for k in range(first, first + count):
        now_s = 10.0 + k * TICK_S
        if k % 20 == 0:
            recorder.from_autopilot(packed(HOME, heartbeat()), now_s)
        if k % 2 == 0:
            later = {"time_ms": 1000 + 50 * k}
            recorder.from_peers(beacon_of(5, **later) + beacon_of(6, version=9 if k == 2 else 1, **later), now_s)
        recorder.from_autopilot(packed(position(1.0 + 0.01 * k, boot_ms=1000 + 50 * k)), now_s)
        recorder.tick(now_s)


def recorded(folder: Path, ticks: int = 40, **how: Any) -> Flight:
    """The black box of a short flight."""
    recorder, _ = recorder_of(DirectWriter(files_of(folder, START, waits_for_disk=False)), **how)
    fly_ticks(recorder, ticks)
    recorder.close("ended")
    (flight,) = find_flights(folder)
    return flight


def chunks_of(data: bytes) -> tuple[bytes, list[Messages]]:
    """How a closed segment begins, and the messages of its chunks."""
    head = mcap.read_head(data)
    chunks = mcap.read_chunks(data, len(head))
    return head, [mcap.read_messages(body, offset) for offset, body in chunks]


def forge(path: Path, change: Callable[[Messages], Sequence[mcap.Message]]) -> None:
    """Change the messages of a segment; every CRC is right afterwards."""
    head, chunks = chunks_of(path.read_bytes())
    path.write_bytes(file_of(head, change([message for chunk in chunks for message in chunk])))


def file_of(head: bytes, messages: Sequence[mcap.Message]) -> bytes:
    """A closed segment, of one chunk."""
    records = b"".join(mcap.message(m.channel_id, m.sequence, m.time_ns, m.data) for m in messages)
    return head + mcap.chunk(records, 0, 0) + mcap.end()


def sealed_anew(messages: Messages, link: bytes | None = None) -> Messages:
    """As somebody writes them who knows the format: with a chain that holds. `link`: the first; None: of today's."""
    link, before, made = begin_chain(head_of(START)) if link is None else link, b"", []
    for m in messages:
        if m.channel_id in (Channel.TICK, Channel.END):
            text, _ = unsealed(m.data)
            link = hashlib.sha256(link + before + text).digest()
            m = replace(m, data=text[:-1] + b',"chain":"' + link.hex().encode() + b'"}')
            before = b""
        else:
            before += mcap.message(m.channel_id, m.sequence, m.time_ns, m.data)
        made.append(m)
    return made
