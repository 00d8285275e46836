"""Stands before an endpoint, takes what it takes, and records that and what comes of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from companion.core.model.actions import Say
from companion.journal.channels import VERSION, Channel, Json, Refusals, head, outputs, sensor_links, tick_text
from companion.journal.journal import ChunkWriter, Journal
from companion.journal.segments import SegmentFiles
from companion.journal.tape.recorded import RecordedGate, RecordedGuard, RecordedLink, RecordedMarks
from companion.journal.tape.tape import Tape
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.frames import Incoming
from companion.mavlink.framing.outbox import Outbox
from companion.mavlink.framing.signing import Gate
from companion.mavlink.harvest import RecordLink
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.peers.guard import Guard
from companion.mavlink.sensor_inputs import SHARED
from mission import __version__
from mission.common.compiled import STATE
from mission.document.model import Mission


def start_body(
    mission: Mission,
    mission_file: str,
    mission_sha256: str,
    vehicle_id: int,
    *,
    sensors: Sequence[str],
    clock: str,
    started: datetime | None = None,
    autopilot_is_stream: bool = False,
    sensor_streams: dict[str, bool] | None = None,
    has_survey: bool = False,
    has_records: bool = False,
    grounded: str = "",
    waived: str = "",
    unknown: str = "",
    unsigned: bool = False,
    flown_by: str = "",
    guard: Guard | None = None,
    orders: OrderBook | None = None,
    autopilot_signed: bool = False,
) -> Json:
    """All that an endpoint is built of. `mission_file`: its text as it was read; `mission` is what became of it.

    `waived`, `unknown`, `unsigned`: as Agent.waive has them. `flown_by`: a law in place of ours, not in the log.
    `guard`: with keys; None: an open one. `orders`: of the operator's key. Of their keys only the operator's public one
    is told, by which a replay checks the orders again.
    """
    return {
        "format": VERSION,
        "version": __version__,
        "compiled": STATE,
        "vehicle": vehicle_id,
        "started_utc": "" if started is None else started.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "clock": clock,
        "mission_sha256": mission_sha256,
        "mission_file": mission_file,
        "mission": mission.model_dump(mode="json", by_alias=True, exclude_none=True),
        "sensors": list(sensors),
        "autopilot_is_stream": autopilot_is_stream,
        "sensor_streams": dict(sensor_streams or {}),
        "has_survey": has_survey,
        "has_records": has_records,
        "grounded": grounded,
        "waived": waived,
        "unknown": unknown,
        "unsigned": unsigned,
        "flown_by": flown_by,
        "guard_flags": None if guard is None else guard.flags,
        "autopilot_signed": autopilot_signed,
        "orders": None if orders is None else _book_json(orders),
    }


def _book_json(orders: OrderBook) -> Json:
    """The beginning of a book of orders, for `rebuild_book`."""
    start = orders.start
    texts = {"operator": start.operator.hex(), "digest": start.digest.hex(), "kept": start.kept.hex()}
    return {**texts, "size": start.size, "boot": start.boot}


def head_of(start: Json) -> bytes:
    """The beginning of each segment of a flight."""
    about = {key: str(start[key]) for key in ("vehicle", "version", "compiled", "mission_sha256", "started_utc")}
    return head(sensor_links(start), about)


def files_of(folder: Path, start: Json, *, waits_for_disk: bool) -> SegmentFiles:
    """The files of one flight's black box."""
    return SegmentFiles(folder, start["vehicle"], head_of(start), waits_for_disk=waits_for_disk)


class BlackBox:
    """A flight's black box before there is an endpoint, which is built with what this hands to it."""

    def __init__(self, writer: ChunkWriter, start: Json) -> None:
        self._writer: Final = writer
        self._start: Final = start
        self._tape: Final = Tape()

    def record_guard(self, guard: Guard | None) -> Guard | None:
        """The guard to build the endpoint with; None: an open one, which asks nobody, and needs no record."""
        return None if guard is None else RecordedGuard(guard, self._tape)

    def record_orders(self, orders: OrderBook | None) -> OrderBook | None:
        """The book to build it with, which has not been used; None: there is none."""
        return None if orders is None else orders.with_marks(lambda marks: RecordedMarks(marks, self._tape))

    def record_gate(self, gate: Gate | None) -> Gate | None:
        """The gate of the autopilot's link to build it with; None: one without a key, which is run again."""
        return None if gate is None else RecordedGate(gate, self._tape)

    def record_link(self, link: RecordLink | None) -> RecordLink | None:
        """The link of records to build it with."""
        return None if link is None else RecordedLink(link, self._tape)

    def record_endpoint(self, endpoint: Endpoint) -> Recorder:
        """Takes the endpoint's inputs from now on."""
        return Recorder(endpoint, self._tape, self._writer, self._start)


class Recorder:
    """An endpoint that is recorded: takes its inputs as it does. Times are the companion's clock, s."""

    def __init__(self, endpoint: Endpoint, tape: Tape, writer: ChunkWriter, start: Json) -> None:
        """`tape`: the one that the endpoint's guard and link of records are recorded on."""
        self.journal: Final = Journal(writer, start, head_of(start))
        self._endpoint: Final = endpoint
        self._tape: Final = tape
        self._sensors: Final = {name: Channel.SENSORS_IN + k for k, name in enumerate(sensor_links(start))}
        self._refusals: Final = Refusals()
        self._data = b""  # that `read_autopilot` read last,
        self._verdicts = b""  # and what its gate said of it
        self._now_s = 0.0

    def hello(self) -> bytes:
        """As Endpoint, before the first input: no part of the flight."""
        data = self._endpoint.hello()
        self._tape.take_lists()
        return data

    def from_autopilot(self, data: bytes, now_s: float) -> None:
        """As Endpoint."""
        self.journal.put_datagram(Channel.AUTOPILOT_IN, data, now_s)
        self._endpoint.from_autopilot(data, now_s)

    def read_autopilot(self, data: bytes) -> list[Incoming]:
        """As Endpoint; recorded once it has its time, which others' datagrams may have before."""
        self._data, before = data, self._tape.count_verdicts()
        messages = self._endpoint.read_autopilot(data)
        self._verdicts = self._tape.cut_verdicts(before)
        return messages

    def autopilot_says(self, messages: Iterable[Incoming], now_s: float) -> None:
        """As Endpoint."""
        self.journal.put_datagram(Channel.AUTOPILOT_IN, self._data, now_s)
        self._tape.put_verdicts(self._verdicts)
        self._endpoint.autopilot_says(messages, now_s)

    def from_sensor(self, data: bytes, now_s: float, link: str = SHARED) -> None:
        """As Endpoint."""
        self.journal.put_datagram(self._sensors[link], data, now_s)
        self._endpoint.from_sensor(data, now_s, link)

    def from_peers(self, data: bytes, now_s: float) -> None:
        """As Endpoint."""
        self.journal.put_datagram(Channel.PEERS_IN, data, now_s)
        self._endpoint.from_peers(data, now_s)

    def report_surroundings(self, say: Say) -> None:
        """As Endpoint. Recorded: its severity, and the text."""
        data = bytes([say.severity]) + say.text.encode()
        self.journal.put_datagram(Channel.SURROUNDINGS_IN, data, self._now_s)
        self._endpoint.report_surroundings(say)

    def tick(self, now_s: float) -> Outbox:
        """As Endpoint."""
        self._now_s = now_s
        journal, tape = self.journal, self._tape
        out = self._endpoint.tick(now_s)
        journal.put_answers(tape.take_verdicts(), tape.take_lists(), now_s)
        for channel, data in outputs(out):
            journal.put_datagram(channel, data, now_s)
        journal.end_tick(
            tick_text(journal.ticks + 1, now_s, self._endpoint, out, self._refusals.take_refused(self._endpoint)), now_s
        )
        return out

    def take_lines(self) -> list[str]:
        """Lines for the flight log, since last asked."""
        lines = list(self.journal.lines)
        self.journal.lines.clear()
        return lines

    def close(self, why: str) -> None:
        """The end of the flight. What came since the last tick is in it: after a crash, what it crashed of."""
        self.journal.put_answers(self._tape.take_verdicts(), self._tape.take_lists(), self._now_s)
        self.journal.close({"tick": self.journal.ticks, "time_s": self._now_s, "why": why}, self._now_s)
