"""Abilities of the simulated vehicles, for missions that they are to fly: other aircraft have other limits.

The bridge's tables and the model of its quadrotor hold the same figures (a test compares them).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from mission.common.frames import Vec3
from mission.common.problems import MissionError, Problem
from mission.document.airtime import LANDS_BELOW, airtime_s, battery_share
from mission.document.model import AtEnd, Drag, Mission, Personality
from mission.rules import flight_rules
from mission.schema.check import LineOf, no_line, problem_of
from mission.schema.conflict import Conflict, conflict


@dataclass(frozen=True, slots=True)
class Abilities:
    """The most that an autopilot flies at, as its parameters have it; m/s."""

    speed_mps: float
    climb_mps: float
    descent_mps: float


AUTOPILOTS = {
    Personality.PX4: Abilities(12.0, 3.0, 1.5),
    Personality.ARDUPILOT: Abilities(10.0, 2.5, 1.5),
}
ACCELERATION_MPS2 = 3.0  # of the quadrotor, level: what its velocity control is made for
# The quadrotor's tilt is at its limit at 17.4 m/s through the air, or 5.2 in SIH's. At these it still answers with
# 0.7 m/s2.
AIRSPEED_MPS = {Drag.LOW: 15.0, Drag.SIH: 4.5}


def problems(
    mission: Mission, place: str, values: Mapping[str, Any] | None = None, line_of: LineOf = no_line
) -> tuple[Problem, ...]:
    """Abilities that `mission` asks of the simulated vehicles and they lack. `values`: of the file, for the lines."""
    found = (problem_of(broken, values or {}, place, line_of) for broken in _conflicts(mission))
    return tuple(sorted(found, key=lambda problem: problem.line or 0))


def check(mission: Mission, place: str) -> None:
    """MissionError, which names `place`, when the simulated vehicles cannot fly `mission`."""
    found = problems(mission, place)
    if found:
        raise MissionError(found)


def needs_satellites(mission: Mission, place: str, why: str) -> None:
    """MissionError where vehicles fly by ranges: what flies them cannot measure these, `why`."""
    if mission.flies_by_ranges:
        raise MissionError([problem_of(conflict(mission, ("swarm.gnss",), f"must be all: {why}"), {}, place, no_line)])


def _conflicts(mission: Mission) -> Iterator[Conflict]:
    limits, route = mission.limits, mission.route
    personalities = {mission.sim.personality_of(k) for k in range(1, mission.swarm.size + 1)}
    slowest = min(personalities, key=lambda personality: AUTOPILOTS[personality].speed_mps)
    able = AUTOPILOTS[slowest]
    for key, asked, most, unit in (
        ("limits.speed_max_mps", limits.speed_max_mps, able.speed_mps, "m/s"),
        ("limits.climb_max_mps", limits.climb_max_mps, able.climb_mps, "m/s"),
        ("limits.acceleration_max_mps2", limits.acceleration_max_mps2, ACCELERATION_MPS2, "m/s2"),
    ):
        if asked > most:
            requirement = f'must be at most {most:g} {unit}: more the simulated "{slowest}" quadrotor has not got'
            yield conflict(mission, (key,), requirement)
    for (from_key, here), (to_key, there) in _ways(mission):
        descent_mps = route.vel_leader_mps * (here[2] - there[2]) / math.dist(here, there)
        if descent_mps > able.descent_mps:
            yield conflict(
                mission,
                ("route.vel_leader_mps", from_key, to_key, "route.at_end"),
                f'makes the leader descend at {descent_mps:.2f} m/s: the simulated "{slowest}" descends at '
                f"{able.descent_mps:g} m/s at most",
            )
    yield from _lane_batteries(mission)
    airspeed_mps = _airspeed_mps(mission)
    most_mps = AIRSPEED_MPS[mission.sim.drag]
    if airspeed_mps > most_mps:
        yield conflict(
            mission,
            (
                "sim.wind_mps",
                "sim.drag",
                "route.vel_leader_mps",
                *(key for key, _ in flight_rules.route_points(mission)),
                "route.at_end",
            ),
            f"asks for {airspeed_mps:.1f} m/s through the air: the simulated quadrotor keeps its course up to "
            f"{most_mps:g} m/s",
        )


def _lane_batteries(mission: Mission) -> Iterator[Conflict]:
    """Lanes that the smallest battery does not last for: vehicles would land in the stand."""
    share, lanes = battery_share(mission), len(mission.lanes)
    if lanes and share > 1.0 - LANDS_BELOW:
        yield conflict(
            mission,
            ("survey.area_enu_m", "survey.lane_m", "route.vel_leader_mps", "swarm.size", "sim.battery_mah"),
            f"takes {lanes} lanes, {mission.way_m:.0f} m and {airtime_s(mission) / 60.0:.1f} min: must be at most "
            f"{100.0 * (1.0 - LANDS_BELOW):.0f} % of the smallest simulated battery, is {100.0 * share:.0f} %",
        )


def _ways(mission: Mission) -> Iterator[tuple[tuple[str, Vec3], tuple[str, Vec3]]]:
    """From where to where the swarm flies, each place with its key, the way home among them."""
    yield from flight_rules.legs(mission)
    key = "survey.area_enu_m"
    yield from (((key, here), (key, there)) for here, there in pairwise(mission.way_enu_m) if mission.lanes)
    if mission.route.at_end is AtEnd.RETURN and not mission.route.stops and not mission.lanes:
        there, back = flight_rules.route_points(mission)
        yield back, there


def _airspeed_mps(mission: Mission) -> float:
    """The most that the flight asks for: on each way, and standing still."""
    speed_mps, wind = mission.route.vel_leader_mps, mission.sim.wind_mps
    most_mps = math.hypot(*wind)
    for (_, here), (_, there) in _ways(mission):
        length_m = math.dist(here, there)
        through = ((b - a) * speed_mps / length_m - w for a, b, w in zip(here, there, wind, strict=True))
        most_mps = max(most_mps, math.hypot(*through))
    return most_mps
