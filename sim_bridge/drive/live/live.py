"""A flight in lockstep with a live map: its rows go out, and what viewers ask for is done between two ticks.

Pace, pause and steps change only when ticks are flown. What changes the flight is a fault of this moment, as the
mission's own are: it is kept with them, and a mission that holds it flies the same flight again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final, Protocol

from mission.common.problems import MissionError, printable
from mission.schema.faults import FaultKind
from sim_bridge.drive.faults import Faults
from sim_bridge.drive.live.map import Map
from sim_bridge.drive.live.pace import Pace
from sim_bridge.judge.recording import Recorder
from sim_bridge.judge.tick import Tick
from sim_bridge.world.world import World

PACING: Final = ("pause", "resume", "step", "speed")
INTERFERING: Final = ("kill", "radio", "wind")
CONTROLS = (*PACING, *INTERFERING)
RADIO_LOST_S: Final = 20.0  # where a viewer does not say for how long
AT_ONCE: Final = 16  # wishes of one tick; what is more is left out


class Watched(Protocol):
    """The part of a fly.Flight that is needed here."""

    recorder: Recorder
    faults: Faults

    @property
    def world(self) -> World:
        """The vehicles."""

    @property
    def last(self) -> Tick:
        """The tick that was flown last."""

    @property
    def events(self) -> list[tuple[float, str]]:
        """Events of the flight, for people, with their times."""

    def leader(self) -> int | None:
        """The vehicle that acts as leader."""

    def record(self) -> None:
        """Record the last tick, if it is not yet."""

    def intervene(self, fault: Mapping[str, Any]) -> None:
        """Let a fault begin; MissionError."""


class Live:
    """Between one Flight and its Map."""

    def __init__(self, map_: Map, pace: Pace, title: str, look_s: float = 0.0) -> None:
        """`look_s`: of wall time, that the flight waits for the first look at most."""
        self.map = map_
        self.title = title
        self._look_s = look_s
        self._pace = pace
        self._faults = 0  # how many have been told
        self._lost = False

    def kept(self, flight: Watched) -> None:
        """Of the tick that was recorded just now; the world is still as it left it."""
        tick = flight.last
        if not self.map.due(tick.time_s):
            return
        self.map.row(flight.recorder.last, yaws_deg(flight.world), ages_s(tick))
        for event in flight.faults.happened[self._faults :]:
            self.map.fault(asdict(event))
        self._faults = len(flight.faults.happened)

    def await_look(self, flight: Watched, show: Callable[[], None]) -> None:
        """Until somebody looks, before the first tick."""
        if self._look_s <= 0.0:
            return
        flight.events.append((flight.world.now_s, f"waiting for a look at the map, {self._look_s:g} s at most"))
        show()
        until_s = time.monotonic() + self._look_s
        while not self.map.viewers and self.map.gone is None and (left_s := until_s - time.monotonic()) > 0.0:
            self._do_all(self.map.asked(left_s), flight)

    def wait(self, flight: Watched, show: Callable[[], None]) -> None:
        """Until the next tick is due, and do what viewers ask for meanwhile; `show` the flight's events."""
        wait_s = 0.0
        while True:
            self._do_all(self.map.asked(wait_s), flight)
            self._pace.watched = self.map.viewers > 0
            self._send_pace(flight)
            if flight.events:
                show()
            wait_s = self._pace.wait_s(flight.world.now_s)
            if wait_s <= 0.0:
                return

    def _do_all(self, wishes: Sequence[Mapping[str, Any]], flight: Watched) -> None:
        for asked in wishes[:AT_ONCE]:
            try:
                self._do(asked, flight)
            except (ValueError, MissionError) as error:
                self.map.event(flight.world.now_s, f"not done: {error}")

    def _send_pace(self, flight: Watched) -> None:
        if self._pace.paused and self._pace.watched:
            flight.record()  # what is looked at for long is the newest
        self.map.send_changes(pace={"paused": self._pace.paused, "factor": self._pace.factor})
        if self.map.gone is not None and not self._lost:
            self._lost = True
            flight.events.append((flight.world.now_s, self.map.gone))

    def _do(self, asked: Mapping[str, Any], flight: Watched) -> None:
        """ValueError, MissionError for what cannot be done."""
        match asked.get("do"):
            case "pause" | "resume" as word:
                if self._pace.paused != (word == "pause"):
                    flight.events.append((flight.world.now_s, "paused on the map" if word == "pause" else "goes on"))
                self._pace.pause(word == "pause")
            case "step":
                self._pace.step()
            case "speed":
                factor = asked.get("factor")
                self._pace.want(None if factor is None else _number(factor, "factor"))
            case "kill" | "radio" | "wind":
                flight.intervene(fault_of(asked, flight.leader(), flight.world))
            case other:
                raise ValueError(f"{printable(str(other))}: must be one of {', '.join(CONTROLS)}")


def fault_of(asked: Mapping[str, Any], leader: int | None, world: World) -> dict[str, Any]:
    """The fault that a viewer asks for, as in [[sim.faults]], without a time. ValueError where that cannot be told."""
    match asked.get("do"):
        case "kill":
            return {"kind": FaultKind.KILL.value, "vehicles": [_vehicle(asked, leader)]}
        case "radio":
            for_s = _number(asked.get("for_s", RADIO_LOST_S), "for_s")
            return {"kind": FaultKind.PARTITION.value, "vehicles": [_vehicle(asked, leader)], "for_s": for_s}
        case "wind":
            vehicles = [*world.vehicles] if asked.get("vehicle") is None else [_vehicle(asked, leader)]
            return {"kind": FaultKind.WIND.value, "vehicles": vehicles, "wind_mps": asked.get("wind_mps")}
        case other:
            raise ValueError(f"{printable(str(other))}: must be one of {', '.join(INTERFERING)}")


def yaws_deg(world: World) -> list[float]:
    """Of each vehicle, clockwise from north."""
    return [round(math.degrees(vehicle.airframe.state.attitude_rad[2]), 1) for vehicle in world.vehicles.values()]


def ages_s(tick: Tick) -> list[float | None]:
    """Of each vehicle's last beacon; None before the first."""
    ids = range(1, len(tick.pos_ned_m) + 1)
    return [tick.time_s - tick.said_s[k] if k in tick.said_s else None for k in ids]


def _vehicle(asked: Mapping[str, Any], leader: int | None) -> int:
    """The one that is named, else the leader."""
    vehicle = leader if asked.get("vehicle") is None else asked["vehicle"]
    if vehicle is None:
        raise ValueError("no vehicle leads now")
    if type(vehicle) is not int:
        raise ValueError(f"vehicle {printable(str(vehicle))}: must be an id")
    return vehicle


def _number(value: Any, name: str) -> float:
    if type(value) not in (int, float) or not math.isfinite(value):
        raise ValueError(f"{name} {printable(str(value))}: must be a number")
    return float(value)
