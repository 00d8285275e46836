"""Compares the estimates that vehicles broadcast, of their own and of others' places, with the truth.

No figure of the flight itself: of a swarm in which not all have GNSS these say how well it knew; `Metrics` says
how it flew.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated, Any, Final, get_args, get_type_hints

from companion.core.model.states import SwarmPhase
from companion.mavlink.own_messages import DESTINATION
from mission.common.frames import Vec3, enu_to_ned
from mission.document.model import Mission
from sim_bridge.judge.tick import Tick

HANDOVER_S: Final = 5.0  # after another acts as leader, what changes is laid to that
UNDER_WAY = (SwarmPhase.TRANSIT, SwarmPhase.COVERAGE)

Level = tuple[float, float]  # north, east


@dataclass(frozen=True, slots=True)
class EstimateFigures:
    """Figures of one flight of simulated vehicles. None: it did not happen, or there was nothing to measure."""

    relative_error_m: Annotated[
        float | None,
        "Without GNSS on all: level error of where followers reported the acting leader to be, against "
        "true positions and true north; root of the mean square over followers and beacons, in phases TRANSIT and "
        "COVERAGE.",
    ]
    relative_error_sds: Annotated[
        float | None,
        "The same, each error over the standard deviation that went with it (in the direction where it is largest): "
        "1 to 1.4 where these are honest, more where they are too small.",
    ]
    leader_error_d2_m: Annotated[
        float | None,
        "Level distance between d2 and where the acting leader's vector to it leads from where it truly is, by the "
        "compass that it steers by, in the first beacon that announced COVERAGE at d2.",
    ]
    handover_jump_m: Annotated[
        float | None,
        "Greatest level distance between where that vector of the last acting leader led, in its last beacon as such, "
        "and where that of its successor leads in its first, in phases TRANSIT and COVERAGE.",
    ]
    handover_step_mps: Annotated[
        float | None,
        "Greatest level change of a velocity setpoint from one tick to the next, of any vehicle, from when the acting "
        f"leader is lost until {HANDOVER_S:g} s after another acts, in phases TRANSIT and COVERAGE.",
    ]

    def as_dict(self) -> dict[str, Any]:
        """Name -> value in the order of declaration, ready for JSON."""
        return dataclasses.asdict(self)


TITLES: Final = {
    "relative_error_m": "reported leader off the truth",
    "relative_error_sds": "the same over its sd",
    "leader_error_d2_m": "leader off d2 by its own vector",
    "handover_jump_m": "jump of d2 at a handover",
    "handover_step_mps": "step of a setpoint at a handover",
}


def definitions() -> dict[str, str]:
    """Name -> definition of every figure in `EstimateFigures`, for the documentation."""
    hints = get_type_hints(EstimateFigures, include_extras=True)
    return {field.name: get_args(hints[field.name])[1] for field in dataclasses.fields(EstimateFigures)}


class EstimateRecorder:
    """Records the estimates of one flight. `add` every tick, in the order of time."""

    def __init__(self, mission: Mission) -> None:
        self._d2_ned_m = enu_to_ned(mission.route.d2_enu_m)
        self._last_stop = len(mission.visits) - 1
        self._before: Tick | None = None
        self._squares = self._sd_squares = 0.0
        self._count = 0
        self._error_d2_m: float | None = None
        self._leader = 0  # that acted last, under way
        self._led_to: Level | None = None  # where d2 was by it
        self._handed_s = -math.inf  # when another began to act
        self._jump_m: float | None = None
        self._step_mps: float | None = None

    def add(self, tick: Tick) -> None:
        """One tick of a simulated flight; others tell no truth to hold it against."""
        before, self._before = self._before, tick
        if before is None or not tick.north_off_rad:
            return
        phase = tick.phase(tick.answered)
        if phase not in UNDER_WAY:
            return
        leader = tick.leader(tick.answered) or 0
        self._add_followers(tick, before, leader)
        if leader:
            self._add_leader(tick, before, leader, phase)
        if self._leader and (not leader or tick.time_s - self._handed_s <= HANDOVER_S):
            self._add_setpoints(tick, before)

    def figures(self) -> EstimateFigures:
        """Of all ticks so far."""
        count = self._count
        return EstimateFigures(
            relative_error_m=math.sqrt(self._squares / count) if count else None,
            relative_error_sds=math.sqrt(self._sd_squares / count) if count else None,
            leader_error_d2_m=self._error_d2_m,
            handover_jump_m=self._jump_m,
            handover_step_mps=self._step_mps,
        )

    def _add_followers(self, tick: Tick, before: Tick, leader: int) -> None:
        for k, word in tick.words.items():
            said, to_leader = tick.said.get(k), word.to_leader_ne_m
            if said is None or to_leader is None or word.leader_sd_m <= 0.0 or said.acting_leader in (0, k):
                continue
            if not self._is_fresh(tick, before, k) or said.time_boot_ms != word.time_ms or said.leader != leader:
                continue
            if k not in tick.alive or tick.on_ground[k - 1]:
                continue
            here, there = before.pos_ned_m[k - 1], before.pos_ned_m[leader - 1]  # as things were when it was told
            off_n, off_e = to_leader[0] - (there[0] - here[0]), to_leader[1] - (there[1] - here[1])
            square = off_n * off_n + off_e * off_e
            self._count += 1
            self._squares += square
            self._sd_squares += square / (word.leader_sd_m * word.leader_sd_m)

    def _add_leader(self, tick: Tick, before: Tick, leader: int, phase: SwarmPhase) -> None:
        said = tick.said[leader]
        if not self._is_fresh(tick, before, leader) or not said.flags & DESTINATION:
            return
        leads_to = _turned((said.dest_x, said.dest_y), tick.north_off_rad[leader - 1], before.pos_ned_m[leader - 1])
        if self._leader and leader != self._leader:
            self._handed_s = tick.time_s
            if self._led_to is not None:
                self._jump_m = max(self._jump_m or 0.0, math.dist(leads_to, self._led_to))
        self._leader, self._led_to = leader, leads_to
        if self._error_d2_m is None and phase is SwarmPhase.COVERAGE and said.stop == self._last_stop:
            self._error_d2_m = math.dist(leads_to, self._d2_ned_m[:2])

    @staticmethod
    def _is_fresh(tick: Tick, before: Tick, vehicle_id: int) -> bool:
        """It told something in this tick."""
        return tick.said_s[vehicle_id] > before.time_s - 1e-9

    def _add_setpoints(self, tick: Tick, before: Tick) -> None:
        for now, then in zip(tick.asked_ned_mps, before.asked_ned_mps, strict=True):
            if now is not None and then is not None:
                self._step_mps = max(self._step_mps or 0.0, math.hypot(now[0] - then[0], now[1] - then[1]))


def _turned(to_ne_m: Level, by_rad: float, from_ned_m: Vec3) -> Level:
    """The end of a vector from `from_ned_m` along a north that is off by `by_rad`: north, east, m."""
    c, s = math.cos(by_rad), math.sin(by_rad)
    north, east = to_ne_m
    return (from_ned_m[0] + c * north - s * east, from_ned_m[1] + s * north + c * east)
