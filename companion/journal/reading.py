"""A flight out of its segments: ticks as they were recorded, and where its chain is broken, it has a gap, or ends."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cbor2

from companion.journal import mcap
from companion.journal.channels import ARRIVED, OUTPUTS, UNCHAINED_HEAD, Channel, Json, unsealed
from companion.journal.journal import BEGIN, begin_chain
from companion.journal.segments import find_segments, segment_key
from mission.common.files import open_at_once

SEGMENT_BYTES_MAX = 1 << 30  # more is no segment of ours
TIME_MAX_S = 1e9  # of a companion's clock, which counts from the board's start
NAMED = "vehicle-K-flight-F-S.mcap"
# Power may be lost between two segments
TAKEN = "the next segment is missing, or was never begun; if this one is not full, entries were taken off"


class BlackBoxError(Exception):
    """There is no black box, or none that can be read."""


class NoBlackBoxError(BlackBoxError):
    """No file of a folder is named as one."""


@dataclass(frozen=True, slots=True)
class Flight:
    """The segments of one flight of one vehicle, by their numbers."""

    vehicle_id: int
    number: int
    segments: dict[int, Path]


@dataclass(frozen=True, slots=True)
class Input:
    """A datagram that came. `channel`: from Channel.AUTOPILOT_IN, PEERS_IN or SENSORS_IN on."""

    channel: int
    now_s: float
    data: bytes


@dataclass(slots=True)
class Recorded:
    """A tick, or the end, and all that was recorded since the tick before."""

    inputs: list[Input] = field(default_factory=list)
    verdicts: bytes = b""
    answers: list[Any] = field(default_factory=list)
    outputs: list[tuple[Channel, bytes]] = field(default_factory=list)
    body: Json = field(default_factory=dict)  # of the tick, or of the end
    is_end: bool = False
    text: bytes = b""  # of which `body` was read
    link: bytes = b""  # of the chain, behind it


@dataclass(frozen=True, slots=True)
class Start:
    """First of a flight. `body`: as `start_body` makes it."""

    body: Json


@dataclass(frozen=True, slots=True)
class Gap:
    """Ticks that the disk did not take, as the recorder itself says."""

    first: int
    last: int
    why: str


@dataclass(frozen=True, slots=True)
class Break:
    """A record was changed, removed or moved, or is damaged."""

    what: str


@dataclass(frozen=True, slots=True)
class CutOff:
    """The log ends without being closed: after a loss of power, or a process that was killed.

    `has_last_entry`: cut behind it; no tick is missing.
    """

    what: str
    has_last_entry: bool = False


Item = Start | Recorded | Gap | Break | CutOff


def find_flights(path: Path) -> list[Flight]:
    """All flights in a folder, or the one of a segment. BlackBoxError: there is none."""
    try:
        key = None if path.is_dir() else segment_key(path)
        if path.is_file() and key is None:
            raise BlackBoxError(f"{path}: is no black box: must be a folder, or {NAMED} in it")
        segments = find_segments(path if key is None else path.parent)
    except OSError as error:
        raise BlackBoxError(f"{path}: cannot be read: {error.strerror}") from None
    flights: dict[tuple[int, int], dict[int, Path]] = {}
    for (vehicle_id, number, segment), file in segments.items():
        if key is None or key[:2] == (vehicle_id, number):
            flights.setdefault((vehicle_id, number), {})[segment] = file
    if not flights:
        raise NoBlackBoxError(f"{path}: holds no black box: no file is named {NAMED}")
    return [Flight(vehicle_id, number, files) for (vehicle_id, number), files in flights.items()]


def read_flight(flight: Flight) -> Iterator[Item]:
    """All of a flight in the order in which it was recorded, verified. BlackBoxError: a file cannot be read."""
    chain = _Chain()
    first = min(flight.segments)
    if first > 1:
        yield Break(f"segments 1 to {first - 1} are missing")
    end, is_torn = "is empty", False
    for segment, path in flight.segments.items():
        if segment > first and segment - 1 not in flight.segments:
            yield Break(f"segment {segment - 1} is missing")
        end, is_torn = "", False
        try:
            data = _file_bytes(path)
            head = mcap.read_head(data)
            if not chain.take_head(head):
                yield Break(f"{path.name}: its header is not the first segment's")
            for offset, body in mcap.read_chunks(data, len(head)):
                try:
                    messages = mcap.read_messages(body, offset)
                except mcap.McapError as error:
                    yield Break(f"{path.name}, byte {error.offset}: {error.why}")
                    continue
                for item in chain.read_entries(messages):
                    yield item
                    if isinstance(item, Start) and item.body.get("vehicle") != flight.vehicle_id:
                        yield Break(f"{path.name}: is of vehicle {item.body.get('vehicle')}: its file was renamed")
        except mcap.TornError as error:  # or not closed: the next segment says whether all is there
            end, is_torn = f"{path.name}, byte {error.offset}: {error.why}", True
        except mcap.McapError as error:
            end = f"{path.name}, byte {error.offset}: {error.why}"
            yield Break(end)
    last = flight.segments[max(flight.segments)].name
    yield from _cut_off(chain, end or f"{last} has no last entry: {TAKEN}", is_torn=is_torn)


def _cut_off(chain: _Chain, what: str, *, is_torn: bool) -> Iterator[CutOff]:
    if not chain.has_ended or is_torn:
        yield CutOff(what, has_last_entry=chain.has_ended)


def _file_bytes(path: Path) -> bytes:
    try:
        with open(path, "rb", opener=open_at_once) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise BlackBoxError(f"{path}: is not a regular file")
            if status.st_size > SEGMENT_BYTES_MAX:
                raise BlackBoxError(f"{path}: more than {SEGMENT_BYTES_MAX >> 20} MiB: is no segment of ours")
            return file.read(SEGMENT_BYTES_MAX)
    except OSError as error:
        raise BlackBoxError(f"{path}: cannot be read: {error.strerror}") from None


class _Chain:
    """Verifies entries in the order in which they are found."""

    def __init__(self) -> None:
        self.has_ended = False
        self._head = b""  # of the first segment
        self._link = BEGIN
        self._tick = 0  # the last
        self._number = 0  # of the last entry
        self._missing = ""  # entries before this one, in words
        self._records: list[bytes] = []
        self._recorded = Recorded()

    def take_head(self, head: bytes) -> bool:
        """Take the header of a segment. False: it is another than the first segment's."""
        self._head = self._head or head
        return self._head == head

    def read_entries(self, messages: Sequence[mcap.Message]) -> Iterator[Item]:
        """Their content, and what is wrong with them."""
        for message in messages:
            if self.has_ended:
                yield Break("entries behind the last one")
                return
            try:
                yield from self._read_entry(message)
            except (ValueError, KeyError, TypeError, AttributeError, RecursionError, cbor2.CBORDecodeError):
                yield Break(f"entry {message.sequence}, behind tick {self._tick}: makes no sense")

    def _read_entry(self, message: mcap.Message) -> Iterator[Item]:
        channel, data = message.channel_id, message.data
        if channel != Channel.GAP and message.sequence != self._number + 1 & 0xFFFFFFFF:
            self._missing = f": entry {message.sequence} follows on {self._number}"
        self._number = message.sequence
        if channel in (Channel.TICK, Channel.END):
            yield from self._read_sealed(channel, data)
            return
        if channel == Channel.GAP:
            body, self._link = unsealed(data)
            gap = json.loads(body)
            self._records.clear()
            self._recorded, self._missing = Recorded(), ""
            yield Gap(int(gap["first_tick"]), int(gap["last_tick"]), str(gap["why"]))
            self._tick = int(gap["last_tick"])
        self._records.append(message.record)
        if channel == Channel.START:
            start = _object(json.loads(data))
            self._link = BEGIN if start.get("format") == UNCHAINED_HEAD else begin_chain(self._head)
            yield Start(start)
        elif channel == Channel.VERDICTS:
            self._recorded.verdicts += data
        elif channel == Channel.ANSWERS:
            answers = cbor2.loads(data)
            if not all(isinstance(answer, list) for answer in answers):
                raise ValueError("is no list of answers")
            self._recorded.answers += answers
        elif channel in OUTPUTS:
            self._recorded.outputs.append((Channel(channel), data[ARRIVED.size :]))
        elif channel != Channel.GAP:
            if len(data) < ARRIVED.size:
                raise ValueError("a datagram without its time")
            self._recorded.inputs.append(Input(channel, ARRIVED.unpack_from(data)[0], data[ARRIVED.size :]))

    def _read_sealed(self, channel: int, data: bytes) -> Iterator[Item]:
        """A tick, or the end: all since the last one hangs on it."""
        text, link = unsealed(data)
        body, is_end = _object(json.loads(text)), channel == Channel.END
        if not (_is_end(body) if is_end else _is_tick(body)):
            raise ValueError("is no tick")
        tick: int = body["tick"]
        is_whole = hashlib.sha256(self._link + b"".join(self._records) + text).digest() == link
        due, name = self._tick + (not is_end), "the end" if is_end else f"tick {tick}"
        if tick > due:
            yield Break(f"ticks {due} to {tick - (not is_end)} are missing")
        elif tick < due:
            yield Break(f"{name} is found behind tick {self._tick}: moved, or a copy")
        elif not is_whole:
            since = "since the last" if self._tick else "or the file's header"
            yield Break(f"{name}, or what came before it {since}, was changed{self._missing}")
        self._link, self._tick, self._missing = link, tick, ""
        self._records.clear()
        recorded, self._recorded = self._recorded, Recorded()
        recorded.body, recorded.text, recorded.is_end, recorded.link = body, text, is_end, link
        self.has_ended = is_end
        yield recorded


def _is_tick(body: Json) -> bool:
    """As `tick_text` writes it: what follows need not look again."""
    cuts, beacons, said = body["cuts"], body["beacons"], body["said"]
    return (
        _is_timed(body)
        and isinstance(body["state"], str)
        and all(isinstance(cut["reason"], str) and _is_number_or_none(cut["by_mps"]) for cut in cuts)
        and all(isinstance(sender, int) for senders in beacons.values() for sender in senders)
        and all(isinstance(count, int) for count in body["refused"].values())
        and all(isinstance(say["text"], str) for say in said)
        and len(body["setpoint_ned_mps"]) == 3
        and all(_is_number_or_none(v) for v in body["setpoint_ned_mps"])
    )


def _is_end(body: Json) -> bool:
    return _is_timed(body) and isinstance(body["why"], str)


def _is_timed(body: Json) -> bool:
    return isinstance(body["tick"], int) and isinstance(body["time_s"], float) and abs(body["time_s"]) < TIME_MAX_S


def _is_number_or_none(value: Any) -> bool:
    """A number that can be printed as one; a whole one may have any length in JSON."""
    return value is None or isinstance(value, float) or (isinstance(value, int) and abs(value) < 1 << 53)


def _object(value: Any) -> Json:
    if not isinstance(value, dict):
        raise ValueError("is no object")
    return value
