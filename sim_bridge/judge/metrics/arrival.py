"""Time of a recorded flight's arrival at d2."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.core.model.states import SwarmPhase
from mission.common.frames import Vec3, enu_to_ned
from mission.document.model import AtEnd, Mission
from mission.schema.kinds import Estimates
from sim_bridge.judge.metrics.arrays import Bools, Floats
from sim_bridge.judge.metrics.coverage import tolerance_m
from sim_bridge.judge.metrics.leadership import departure, swarm_phase, visits_of
from sim_bridge.judge.recording import Recording

ESTIMATES_TOLERANCE_M = 0.5  # two positions as PX4 reports them, 0.17-0.28 m an axis from the truth each


@dataclass(frozen=True, slots=True)
class Arrival:
    """Figures of arrival, as `Metrics` names them. None, and `absent` empty: it did not happen."""

    straight_s: float | None = None
    leader_s: float | None = None
    last_s: float | None = None
    absent: tuple[int, ...] = ()


def arrival(recording: Recording, mission: Mission, connected: Bools) -> Arrival:
    """The arrival of a flight; `connected` (T,): all alive vehicles are one component of G."""
    started = departure(recording)
    if started is None:
        return Arrival()
    start, leader = started
    alive = recording.agent_alive
    to_d2_m = distance_to_d2_m(recording, mission)
    straight_s = _straight_s(recording.pos_ned_m[start, leader], mission)
    leads_there: Bools = recording.acting & alive & (to_d2_m <= arrived_within_m(mission))
    there = ~recording.on_ground & (to_d2_m <= gathered_within_m(mission, _width_m(recording, mission, start)))
    gathered: Bools = connected & (there | ~alive).all(axis=1)
    bound_for_d2 = is_bound_for_d2(recording, mission) | (not mission.route.stops and not mission.lanes)
    leader_tick = _first(np.asarray(leads_there.any(axis=1) & bound_for_d2), start)
    if leader_tick is None:
        return Arrival(straight_s)
    last_tick = _first(gathered, leader_tick)
    since_s = recording.time_s - recording.time_s[start]
    return Arrival(
        straight_s,
        float(since_s[leader_tick]),
        None if last_tick is None else float(since_s[last_tick]),
        tuple(int(k) + 1 for k in np.flatnonzero(~(there & alive)[leader_tick:].any(axis=0))),
    )


def arrivals_s(recording: Recording, mission: Mission) -> list[float | None]:
    """Of each vehicle when it was first as near to d2 as the gathered swarm is, bound for it, s; None: never."""
    started = departure(recording)
    if started is None:
        return [None] * recording.on_ground.shape[1]
    near = distance_to_d2_m(recording, mission) <= gathered_within_m(mission, _width_m(recording, mission, started[0]))
    there = near & recording.agent_alive & ~recording.on_ground & is_bound_for_d2(recording, mission)[:, None]
    ticks = [_first(np.asarray(column), started[0]) for column in there.T]
    return [None if tick is None else float(recording.time_s[tick]) for tick in ticks]


def is_bound_for_d2(recording: Recording, mission: Mission) -> Bools:
    """(T,) true from when the swarm is bound for the last of its trees; on lanes it may come by: when it is there."""
    if mission.lanes:
        return np.maximum.accumulate(swarm_phase(recording) == SwarmPhase.COVERAGE)
    return np.asarray(visits_of(recording) == len(mission.trees) - 1)


def _straight_s(pos_ned_m: Floats, mission: Mission) -> float:
    """From a place (3,) straight on over all stops or lanes, with the time there, until as near to d2 as is arrived."""
    points_ned_m = np.array([pos_ned_m, *(enu_to_ned(visit.pos_enu_m) for visit in mission.visits)])
    way_m = float(np.linalg.norm(np.diff(points_ned_m, axis=0), axis=1).sum()) - mission.route.arrival_distance_m
    stays_s = sum(visit.duration_s for visit in mission.visits[:-1])
    return max(0.0, way_m) / mission.route.vel_leader_mps + stays_s


def visited(recording: Recording, mission: Mission) -> int:
    """At how many of the mission's trees an acting leader was within the arrival distance and announced COVERAGE."""
    visits, covering = visits_of(recording), swarm_phase(recording) == SwarmPhase.COVERAGE
    acting = recording.acting & recording.agent_alive
    count = 0
    for k, visit in enumerate(mission.trees):
        near: Bools = _distance_m(recording.pos_ned_m, visit.pos_enu_m) <= arrived_within_m(mission)
        count += bool(((near & acting).any(axis=1) & covering & (visits == k)).any())
    return count


def strayed(recording: Recording, mission: Mission) -> tuple[int, ...]:
    """Ids of the vehicles on the ground elsewhere than where the mission lands, as in Metrics."""
    started = departure(recording)
    if started is None or mission.route.at_end is AtEnd.HOLD:
        return ()
    goal_enu_m = mission.route.d1_enu_m
    within_m = float(gathered_within_m(mission, _width_m(recording, mission, started[0])))
    # The leader may stand off, and its place gives way to one that hangs at d1.
    within_m += 2.0 * mission.route.arrival_distance_m
    if mission.route.at_end is AtEnd.LAND:  # from where they cover
        goal_enu_m = mission.route.d2_enu_m
        within_m = max(within_m, mission.coverage.radius_m + tolerance_m(mission))
    level_m = np.linalg.norm((recording.pos_ned_m[-1] - np.array(enu_to_ned(goal_enu_m)))[:, :2], axis=1)
    return tuple(int(k) + 1 for k in np.flatnonzero(recording.on_ground[-1] & (level_m > within_m)))


def _width_m(recording: Recording, mission: Mission, start: int) -> float:
    """Distance of the farthest alive vehicle from d1 at departure, in the tick `start`."""
    alive = recording.agent_alive[start]
    return float(_distance_m(recording.pos_ned_m[start, alive], mission.route.d1_enu_m).max())


def distance_to_d2_m(recording: Recording, mission: Mission) -> Floats:
    """(T, n) from each vehicle to d2, in space."""
    return _distance_m(recording.pos_ned_m, mission.route.d2_enu_m)


def estimates_tolerance_m(mission: Mission) -> float:
    """The error of distances by what autopilots report, against the true ones that are judged."""
    return 0.0 if mission.sim.estimates is Estimates.EXACT else ESTIMATES_TOLERANCE_M


def arrived_within_m(mission: Mission) -> float:
    """True distance from its goal within which a leader has arrived that knows only its estimate of it."""
    return mission.route.arrival_distance_m + estimates_tolerance_m(mission)


def gathered_within_m(mission: Mission, width_m: Floats | float) -> Floats:
    """(...,) how far from d2 a vehicle may be; `width_m`: how far from d1 the farthest was at departure."""
    return np.asarray(np.maximum(mission.radio.transit_range_m, width_m + 2.0 * mission.route.arrival_distance_m))


def _distance_m(pos_ned_m: Floats, goal_enu_m: Vec3) -> Floats:
    """(...,) of positions (..., 3) to one place."""
    return np.asarray(np.linalg.norm(pos_ned_m - np.array(enu_to_ned(goal_enu_m)), axis=-1), dtype=np.float64)


def _first(flag: Bools, start: int) -> int | None:
    """First tick from `start` on with `flag` (T,)."""
    ticks = np.flatnonzero(flag[start:])
    return start + int(ticks[0]) if ticks.size else None


def overhead(arrival_s: float | None, straight_s: float | None) -> float | None:
    """Time over that of the straight flight, as a share."""
    return arrival_s / straight_s - 1.0 if arrival_s is not None and straight_s else None
