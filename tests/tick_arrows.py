"""Golden transcripts of the tick: flights written down arrow by arrow, and each arrow played by itself.

`tests/testdata/tick/*.txt` hold one vehicle's flight from its start on: an empty line ends a tick, a line is a row of
the table below, and `value_text` says how its value reads. An arrow that is played gets what was written of the others.

| row | what it holds |
|---|---|
| `at` | when the events that follow came, monotonic seconds |
| `event` | what it was, and what the localiser made of it: a position, whether the beacon was news |
| `known` | where it has changed: flight state, has the swarm taken off, does this vehicle lead, range of the radio |
| `picture`, `orders` | what `observe` and `decide` returned |
| `brief`, `desired` | what `guide` was given, surroundings among it, and what it returned |
| `setpoint` | what `filter` made of both: it remembers nothing, so every fourth tick will do |
| `rests` | not steered: guidance began anew |
"""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from companion.core.agent import Agent
from companion.core.guidance.guidance_input import Desired, GuidanceInput
from companion.core.model.beacon import Beacon
from companion.core.model.events import Event, HeardBeacon, Position
from companion.core.model.states import BeaconFate, Order, Role
from companion.core.model.vectors import ZERO
from companion.core.safety.setpoint import AT_REST, Setpoint
from companion.core.safety.surroundings import Surroundings
from companion.core.stages import StageFactory
from companion.core.swarm.orders import Orders
from companion.core.swarm.picture import Picture
from companion.core.vehicle.operator_orders import FloodedOrders, OperatorOrders
from mission.document.model import Mission
from sim_bridge.drive import fly
from tests.flights import flown
from tests.unit.core import core_kit
from tests.unit.core.core_fleet import Fleet
from tests.unit.core.ranging_kit import STARTS, ranging_mission
from tests.unit.core.value_text import Reader, Writer, differences

ROUTE = {"d1_enu_m": (2.0, 0.0, 3.0), "d2_enu_m": (60.0, 0.0, 3.0), "vel_leader_mps": 2.0}
TRUNKS = [(0.2, 4.2, 0.2), (2.5, 8.5, 0.3), (-3.0, 7.0, 0.2)]  # of the fleet's: north, east, radius


@dataclass(frozen=True)
class Flight:
    """A vehicle of a mission, for so many seconds."""

    make: Callable[[], Mission]
    vehicle: int
    until_s: float
    trunks: Sequence[tuple[float, float, float]] = ()


def _satellites() -> Mission:
    return core_kit.mission(route=ROUTE, swarm={"size": 2, "leader_priority": [1]})


def _trees() -> Mission:
    return core_kit.mission(route=ROUTE, swarm={"size": 2, "leader_priority": [1]}, sensing={"range_m": 8.0})


def _ranges() -> Mission:
    swarm = {"size": 2, "leader_priority": [1], "gnss": "leader"}
    route = {"d1_enu_m": (0, 0, 2.5), "d2_enu_m": (40, 0, 2.5), "vel_leader_mps": 2.0}
    return ranging_mission(route=route, swarm=swarm, ranging={"start_enu_m": STARTS[:2]})


FLIGHTS = {
    "satellites_leader": Flight(_satellites, 1, 512.0),
    "satellites_follower": Flight(_satellites, 2, 512.0),
    "trees_leader": Flight(_trees, 1, 512.0, TRUNKS),
    "ranges_follower": Flight(_ranges, 2, 26.0),
}
LOSS = 0.25  # of the fleet's beacons: so neighbours coast
FILTERED = 4  # of so many ticks one holds a setpoint
TESTDATA = Path(__file__).parent / "testdata" / "tick"


@dataclass
class Tick:
    """What was written of one."""

    event: list[tuple[float, Event, Any]] = field(default_factory=list)
    known: Any = None
    picture: Any = None
    orders: Any = None
    brief: Any = None
    desired: Any = None
    setpoint: Any = None
    rests: bool = False


# --- to write ---


class Recorder(Agent):
    """An agent that writes down its ticks."""

    def __init__(self, mission: Mission, vehicle_id: int, until_s: float) -> None:
        super().__init__(mission, vehicle_id)
        self.lines: list[str] = []
        self.ended, self._until_s, self._at_s = False, until_s, -1.0
        self._passed_on: Event | None = None
        self._writer, self._known, self._told = Writer(), (), None
        for name in ("receive_position", "receive_beacon"):
            setattr(self.localiser, name, self._noting(getattr(self.localiser, name)))

    def _noting(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def noted(*args: Any, **kwargs: Any) -> Any:
            self._told = call(*args, **kwargs)
            return self._told

        return noted

    def _write(self, row: str, value: Any) -> None:
        if not self.ended:
            self.lines.append(f"{row} {self._writer.text(value)}")

    def receive(self, event: Event, now_s: float) -> None:
        self._told, self._passed_on = None, event
        super().receive(event, now_s)
        self._write_event(event, now_s)

    def receive_beacon(self, heard: HeardBeacon, now_s: float) -> BeaconFate:
        if heard is self._passed_on:
            return super().receive_beacon(heard, now_s)
        self._told = None
        fate = super().receive_beacon(heard, now_s)
        self._write_event(heard, now_s)
        return fate

    def _write_event(self, event: Event, now_s: float) -> None:
        if now_s != self._at_s:
            self._at_s = now_s
            self._write("at", now_s)
        self._write("event", (event, self._told))

    def tick(self, now_s: float) -> list[Any]:
        actions = super().tick(now_s)
        if not self.ended:
            self.lines.append("")
        self.ended = now_s >= self._until_s
        return actions

    def observe(self, now_s: float) -> Picture:
        swarm = self.swarm
        range_m = swarm.radio_range_m(airborne=self.flight.vehicle.airborne, misses=self.localiser.misses)
        known = (self.flight.state, swarm.launched, swarm.election.role, range_m)
        if known != self._known:
            self._known = known
            self._write("known", known)
        picture = super().observe(now_s)
        self._write("picture", picture)
        return picture

    def decide(self, picture: Picture) -> Orders:
        orders = super().decide(picture)
        self._write("orders", orders)
        return orders

    def guide(self, brief: GuidanceInput) -> Desired:
        self._write("brief", brief)
        desired = super().guide(brief)
        self._write("desired", desired)
        return desired

    def filter(self, around: Surroundings, desired: Desired) -> Setpoint:
        setpoint = super().filter(around, desired)
        if self._ticks % FILTERED == 0:
            self._write("setpoint", setpoint)
        return setpoint

    def _command_zero_velocity(self) -> None:
        super()._command_zero_velocity()
        self._write("rests", True)


class _Ended(Exception):  # noqa: N818  # no error
    """All is written."""


def transcripts() -> list[Path]:
    """All, those too that have not been written yet."""
    return [TESTDATA / f"{name}.txt" for name in FLIGHTS]


def record(name: str) -> str:
    """The transcript as it is now."""
    flight = FLIGHTS[name]
    recorder = Recorder(flight.make(), flight.vehicle, flight.until_s)
    if recorder.mission.flies_by_ranges:
        _fly_simulated(recorder)
    else:
        _fly_fleet(recorder, flight.trunks)
    return "\n".join(recorder.lines) + "\n"


def _fly_fleet(recorder: Recorder, trunks: Sequence[tuple[float, float, float]]) -> None:
    """A fleet without a wire: it is ready at once."""
    fleet = Fleet(recorder.mission)
    fleet.trunks += trunks
    fleet.loss = LOSS
    fleet.aircraft[recorder.id].agent = recorder
    fleet.run(1.0)
    fleet.order(1, Order.START)
    while not recorder.ended:
        fleet.tick()


def _fly_simulated(recorder: Recorder) -> None:
    """Point masses of the simulator, which measures ranges."""

    def watch(_flight: fly.Flight) -> None:
        if recorder.ended:
            raise _Ended

    def build(mission: Mission, vehicle_id: int, stages: StageFactory, operator: OperatorOrders) -> Agent:
        return recorder if vehicle_id == recorder.id else Agent(mission, vehicle_id, stages, operator)

    recording = patch("companion.mavlink.endpoint.Agent", build)
    with recording, suppress(_Ended), tempfile.TemporaryDirectory() as folder:
        flown(recorder.mission, Path(folder), watch=watch)


# --- to play ---


@functools.cache
def read(name: str) -> list[Tick]:
    """What the transcript says."""
    reader, ticks, tick, known = Reader(), list[Tick](), Tick(), None
    at_s = 0.0
    for line in (TESTDATA / f"{name}.txt").read_text(encoding="utf-8").splitlines():
        row, _, text = line.partition(" ")
        if row == "at":
            at_s = reader.value(text)
        elif row == "event":
            tick.event.append((at_s, *reader.value(text)))
        elif row:
            setattr(tick, row, reader.value(text))
        else:
            known = tick.known = tick.known or known
            ticks.append(tick)
            tick = Tick()
    return ticks


def play(arrow: str, name: str) -> list[str]:
    """Where this arrow is not as written, by the time of the tick."""
    flight, ticks = FLIGHTS[name], read(name)
    found: list[str] = []
    for tick, what, now in ARROWS[arrow](flight.make(), flight.vehicle, ticks):
        at_s = tick.picture.now_s
        found += [f"{at_s:.2f} s: {what}.{path}" for path in differences(getattr(tick, what), now)]
    return found


Played = Iterator[tuple[Tick, str, Any]]  # tick, row, what it is now


def _observe(mission: Mission, vehicle_id: int, ticks: list[Tick]) -> Played:
    agent = _Observer(mission, vehicle_id)
    for tick, following in zip_longest(ticks, ticks[1:], fillvalue=Tick()):
        for now_s, event, _ in tick.event:
            agent.receive(event, now_s)
        agent.play(tick, following)
        yield from agent.found


def _decide(mission: Mission, vehicle_id: int, ticks: list[Tick]) -> Played:
    agent = Agent(mission, vehicle_id)
    told = _ToldLocaliser()
    setattr(agent, "localiser", told)  # noqa: B010
    for tick in ticks:
        for now_s, event, made in tick.event:
            told.made = made
            agent.receive(event, now_s)
        yield tick, "orders", agent.decide(tick.picture)


def _guide(mission: Mission, vehicle_id: int, ticks: list[Tick]) -> Played:
    agent = Agent(mission, vehicle_id)
    for tick in ticks:
        if tick.rests:
            agent.movement.reset()
        if tick.brief is not None:
            yield tick, "desired", agent.guide(tick.brief)


def _filter(mission: Mission, vehicle_id: int, ticks: list[Tick]) -> Played:
    agent = Agent(mission, vehicle_id)
    for tick in ticks:
        if tick.setpoint is not None:
            yield tick, "setpoint", agent.filter(tick.brief.around, tick.desired)


ARROWS = {"observe": _observe, "decide": _decide, "guide": _guide, "filter": _filter}


class _DecidedSwarm:
    """A swarm of which all that is decided was written down."""

    launched = False
    operator = FloodedOrders()

    def __init__(self, me: int) -> None:
        self._me, self._range_m = me, 0.0
        self.election = SimpleNamespace(role=Role.UNLED)

    def set(self, launched: bool, role: Role, range_m: float) -> None:
        self.launched, self.election.role, self._range_m = launched, role, range_m

    def has(self, _vehicle_id: int) -> bool:
        return True

    def sanitise_beacon(self, beacon: Beacon, _now_s: float) -> Beacon:
        return beacon

    def receive_beacon(self, _beacon: Beacon, _now_s: float) -> None:
        """Decided."""

    def radio_range_m(self, **_: bool) -> float:
        return self._range_m

    def make_beacon(self, _lease: Any, *, time_s: float, **said: Any) -> Beacon:
        """As far as the localiser reads it."""
        return replace(core_kit.BEACON, sender=self._me, time_ms=int(time_s * 1000.0), dest_ned_m=said["dest_ned_m"])


class _Observer(Agent):
    """An agent that observes: all else is as it was written down."""

    def __init__(self, mission: Mission, vehicle_id: int) -> None:
        super().__init__(mission, vehicle_id)
        self._decided = _DecidedSwarm(vehicle_id)
        setattr(self, "swarm", self._decided)  # noqa: B010
        self._tick, self.found, self._setpoint = Tick(), list[tuple[Tick, str, Any]](), AT_REST

    def play(self, tick: Tick, following: Tick) -> None:
        self._tick, self.found = tick, []
        brief: GuidanceInput | None = following.brief
        self._setpoint = AT_REST if brief is None else Setpoint(brief.around.commanded_ned_mps)
        self.flight.state, *decided = tick.known
        self._decided.set(*decided)
        self.tick(tick.picture.now_s)

    def observe(self, now_s: float) -> Picture:
        self.found.append((self._tick, "picture", super().observe(now_s)))
        return self._tick.picture  # type: ignore[no-any-return]

    def decide(self, _picture: Picture) -> Orders:
        return self._tick.orders  # type: ignore[no-any-return]

    def guide(self, brief: GuidanceInput) -> Desired:
        self.found.append((self._tick, "brief", brief))
        desired: Desired = self._tick.desired
        self.movement.ref_ned_mps, self.movement.yaw_rad = desired.ref_ned_mps, desired.yaw_rad
        return desired

    def filter(self, _around: Surroundings, _desired: Desired) -> Setpoint:
        return self._setpoint


class _ToldLocaliser:
    """Answers with what the localiser did, as it was written down."""

    neighbours, unheard, velocity_bias_ned_mps, is_fix_lost = (), 0, ZERO, False
    made: Any = None

    def receive_position(self, _position: Position, _now_s: float, **_: bool) -> Any:
        return self.made

    def receive_beacon(self, *_: Any) -> bool:
        return bool(self.made)

    def receive_satellites(self, *_: Any) -> None:
        """Of no account to what is decided."""

    def receive_ranging(self, *_: Any) -> None:
        """Of no account to what is decided."""
