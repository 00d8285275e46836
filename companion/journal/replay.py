"""Runs a recorded flight again and compares all that it puts out, bit for bit."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any

from companion.core.model.actions import Say
from companion.core.model.states import Severity
from companion.journal.channels import OUTPUTS, Channel, Json, Refusals, outputs, sensor_links, tick_text
from companion.journal.reading import Break, CutOff, Flight, Gap, Recorded, Start, read_flight
from companion.journal.rebuild import RebuildError, rebuild_endpoint
from companion.journal.summary import Summary
from companion.journal.tape.tape import PlayedTape, TapeError
from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import whole
from companion.mavlink.framing.outbox import Outbox

BREAKS_MAX = 20  # that are told


@dataclass(slots=True)
class Replayed:
    """One flight, run again."""

    start: Json = field(default_factory=dict)
    summary: Summary = field(default_factory=Summary)
    same: int = 0  # ticks that put out the same, to the bit
    breaks: list[str] = field(default_factory=list)  # of the chain
    difference: list[str] = field(default_factory=list)  # the first, in lines; empty: there is none
    stopped: str = ""  # why ticks from somewhere on could not be run again
    ends: str = ""  # how the log ends
    cut_off: str = ""  # that it ends without being closed, in words; empty: it was closed, as far as it was read
    head: str = ""  # the last link of the chain
    began_s: float | None = None  # the first tick that is there, on the companion's clock

    @property
    def is_same(self) -> bool:
        """All ticks were run again, put out the same, and the chain is whole."""
        return not (self.breaks or self.difference or self.stopped)

    def since_s(self, body: Json) -> float:
        """Time of a tick, or of the end, after the first tick, to a millisecond."""
        now_s = float(body["time_s"])
        self.began_s = now_s if self.began_s is None else self.began_s
        return round(now_s - self.began_s, 3)


def replay_flight(
    flight: Flight,
    *,
    from_s: float = -math.inf,
    to_s: float = math.inf,
    show: Callable[[Json, float], None] = lambda _body, _since_s: None,
) -> Replayed:
    """Ticks before `from_s` are run and compared, but not counted; those after `to_s` are not run.

    Both count from the first tick that is there, and are compared to a millisecond, as they are printed.
    `show`: each tick in between, as recorded, and its time after the first.
    BlackBoxError; ModuleNotFoundError as `rebuild_endpoint`.
    """
    player, replayed = _Player(), Replayed()
    for item in read_flight(flight):
        if isinstance(item, Start):
            replayed.start = item.body
            try:
                player.begin(item.body)
            except RebuildError as error:
                replayed.stopped = str(error)
        elif isinstance(item, Recorded):
            if not item.is_end and replayed.since_s(item.body) > to_s:
                replayed.ends = f"not read beyond {to_s:g} s"
                break
            _replay_one(item, player, replayed, from_s, show)
        elif isinstance(item, Gap):
            replayed.stopped = replayed.stopped or f"gap: ticks {item.first} to {item.last} were lost ({item.why})"
        elif isinstance(item, Break):
            if len(replayed.breaks) < BREAKS_MAX:
                replayed.breaks.append(item.what)
            replayed.stopped = replayed.stopped or "the chain is broken there"
        elif isinstance(item, CutOff):
            _note_cut(item, replayed)
    if not replayed.start:
        replayed.stopped = replayed.stopped or "the beginning is missing"
    return replayed


def _note_cut(item: CutOff, replayed: Replayed) -> None:
    if item.has_last_entry:
        replayed.cut_off = "the box is cut off behind its last entry"
        replayed.ends += f", and is cut off there: {item.what}"
    else:
        replayed.cut_off = "the box ends without being closed, and may lack ticks"
        replayed.ends = f"without being closed: {item.what}"


def _replay_one(
    item: Recorded, player: _Player, replayed: Replayed, from_s: float, show: Callable[[Json, float], None]
) -> None:
    body = item.body
    replayed.head = item.link.hex()
    since_s = replayed.since_s(body)
    if item.is_end:
        replayed.ends = f"{body['why']} at {since_s:.3f} s"
    elif since_s >= from_s:
        replayed.summary.add(body, replayed.began_s)
        show(body, since_s)
    if replayed.stopped or replayed.difference:
        return
    if item.is_end:
        replayed.difference = player.end(item)
        return
    replayed.difference = player.compare(item, since_s)
    replayed.same += not replayed.difference and since_s >= from_s


class _Player:
    """The endpoint that is run again."""

    def __init__(self) -> None:
        self._tape = PlayedTape()
        self._refusals = Refusals()
        self._endpoint: Endpoint | None = None
        self._links: list[str] = []

    def begin(self, start: Json) -> None:
        """RebuildError."""
        self._endpoint = rebuild_endpoint(start, self._tape)
        self._links = sensor_links(start)

    def compare(self, recorded: Recorded, since_s: float) -> list[str]:
        """Run one tick; the first difference, in lines. `since_s`: its time after the first."""
        body = recorded.body
        place = f"tick {body['tick']}, {since_s:.3f} s"
        try:
            out = self._run(recorded)
        except TapeError as error:
            return [f"{place}: {error}"]
        except Exception as error:  # noqa: BLE001  not swallowed: it is the difference
            return [f"{place}: it did not end in an error then, and does now: {type(error).__name__}: {error}"]
        for k, (then, now) in enumerate(zip_longest(recorded.outputs, outputs(out))):
            if then != now:
                return [f"{place}, output {k + 1}:", *_describe(then, now)]
        assert self._endpoint is not None
        text = tick_text(body["tick"], body["time_s"], self._endpoint, out, self._refusals.take_refused(self._endpoint))
        if text != recorded.text:
            now = json.loads(text)
            keys = [key for key in now if now[key] != body.get(key)]
            return [f"{place}: {key} then {body.get(key)}, now {now[key]}" for key in keys] or [f"{place}: its text"]
        return []

    def end(self, recorded: Recorded) -> list[str]:
        """After a crash: the same happens again."""
        if not str(recorded.body["why"]).startswith("broken"):
            return []
        try:
            self._run(recorded)
        except TapeError as error:
            return [f"the end: {error}"]
        except Exception:  # noqa: BLE001  as it was recorded
            return []
        return ["the end: it ended in an error then, and does not now"]

    def _run(self, recorded: Recorded) -> Outbox:
        endpoint = self._endpoint
        assert endpoint is not None
        self._tape.load_answers(recorded.verdicts, recorded.answers)
        for one in recorded.inputs:
            if one.channel == Channel.AUTOPILOT_IN:
                endpoint.from_autopilot(one.data, one.now_s)
            elif one.channel == Channel.PEERS_IN:
                endpoint.from_peers(one.data, one.now_s)
            elif one.channel == Channel.SURROUNDINGS_IN:
                endpoint.report_surroundings(Say(Severity(one.data[0]), one.data[1:].decode()))
            else:
                endpoint.from_sensor(one.data, one.now_s, self._links[one.channel - Channel.SENSORS_IN])
        return endpoint.tick(recorded.body["time_s"])


def _describe(then: tuple[Channel, bytes] | None, now: tuple[Channel, bytes] | None) -> list[str]:
    """The first message of two datagrams that differs, decoded."""
    if then is None or now is None or then[0] is not now[0]:
        names = [OUTPUTS[one[0]] if one else "nothing" for one in (then, now)]
        return [f"  to {names[0]} then, to {names[1]} now", *_messages("then", then), *_messages("now", now)]
    mine, theirs = (_frames(data) for data in (now[1], then[1]))
    for k, (was, is_) in enumerate(zip_longest(theirs, mine, fillvalue=b"")):
        if was != is_:
            return [f"  to {OUTPUTS[then[0]]}, message {k + 1}:", f"  then {_text(was)}", f"  now  {_text(is_)}"]
    return [f"  to {OUTPUTS[then[0]]}: {then[1].hex()} then, {now[1].hex()} now"]


def _messages(when: str, one: tuple[Channel, bytes] | None) -> list[str]:
    return [] if one is None else [f"  {when} {_text(frame)}" for frame in _frames(one[1])]


def _frames(data: bytes) -> list[bytes]:
    return [data[start:end] for start, end, _ in whole(data)]


def _text(frame: bytes) -> str:
    """A frame's message, as its sequence and fields."""
    if not frame:
        return "nothing"
    try:
        message: Any = wire.decode(frame)
    except dialect.MAVError as error:
        return f"{frame.hex()} ({error})"
    fields = ", ".join(f"{name} {getattr(message, name)}" for name in message.get_fieldnames())
    return f"{message.get_type()} (seq {frame[4]}): {fields}"
