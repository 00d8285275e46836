"""When a recorded flight arrived at d2."""

from __future__ import annotations

import numpy as np

from mission.frames import Vec3, enu_to_ned
from mission.model import Mission
from sim_bridge.metrics.arrays import Bools, Floats
from sim_bridge.metrics.leadership import departure
from sim_bridge.recording import Recording


def arrivals(
    recording: Recording, mission: Mission, connected: Bools
) -> tuple[float | None, float | None, float | None]:
    """straight_time_s, arrival_leader_s, arrival_last_s."""
    started = departure(recording)
    if started is None:
        return None, None, None
    start, leader = started
    alive = recording.agent_alive
    to_d2_m = distance_to_d2_m(recording, mission)
    way_m = float(to_d2_m[start, leader]) - mission.route.arrival_distance_m
    straight_s = max(0.0, way_m) / mission.route.vel_leader_mps
    leads_there: Bools = recording.acting & alive & (to_d2_m <= mission.route.arrival_distance_m)
    from_d1_m = _from_place_m(recording.pos_ned_m[start, alive[start]], mission.route.d1_enu_m)
    there = ~recording.on_ground & (to_d2_m <= gathered_within_m(mission, from_d1_m.max(keepdims=True)))
    gathered: Bools = connected & (there | ~alive).all(axis=1)
    leader_tick = _first(np.asarray(leads_there.any(axis=1)), start)
    last_tick = None if leader_tick is None else _first(gathered, leader_tick)
    since_s = recording.time_s - recording.time_s[start]
    return (
        straight_s,
        None if leader_tick is None else float(since_s[leader_tick]),
        None if last_tick is None else float(since_s[last_tick]),
    )


def distance_to_d2_m(recording: Recording, mission: Mission) -> Floats:
    """(T, n) from each vehicle to d2, in space."""
    return _from_place_m(recording.pos_ned_m, mission.route.d2_enu_m)


def gathered_within_m(mission: Mission, width_m: Floats) -> Floats:
    """(...,) how far from d2 a vehicle may be; `width_m`: how far from d1 the farthest was at departure."""
    return np.asarray(np.maximum(mission.radio.transit_range_m, width_m + 2.0 * mission.route.arrival_distance_m))


def _from_place_m(pos_ned_m: Floats, place_enu_m: Vec3) -> Floats:
    """(...,) of positions (..., 3) to one place."""
    return np.asarray(np.linalg.norm(pos_ned_m - np.array(enu_to_ned(place_enu_m)), axis=-1), dtype=np.float64)


def _first(flag: Bools, start: int) -> int | None:
    """First tick from `start` on with `flag` (T,)."""
    ticks = np.flatnonzero(flag[start:])
    return start + int(ticks[0]) if ticks.size else None


def overhead(arrival_s: float | None, straight_s: float | None) -> float | None:
    """What it took longer than straight, as a share."""
    return arrival_s / straight_s - 1.0 if arrival_s is not None and straight_s else None
