"""Time that a mission keeps vehicles in the air, and whether the simulated batteries last for it.

A lower estimate: nobody waits for another, nothing stands in the way, and the ring forms at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from mission.document.model import AtEnd, Mission, Personality

GATHER_S = 15.0  # at d1: the lone tree's four took 16 s after their climb
LAND_MPS = 0.7  # PX4's MPC_LAND_SPEED; ArduPilot's 0.5 over the last 10 m
HOVER_A = 11.0  # of the simulated quadrotor: 10.9 to 11.0 in flights of it
CAPACITY_MAH = {Personality.PX4: 5000.0, Personality.ARDUPILOT: 3300.0}
MOST_NAMED = 8  # vehicles in a line
LANDS_BELOW = 0.10  # share left at which companions land where they are
LEADS_ABOVE = 0.20  # and below which none leads


def airtime_s(mission: Mission) -> float:
    """From take-off to the end of coverage or, where the mission lands or returns, to the ground."""
    route, up_m = mission.route, mission.route.d1_enu_m[2]
    flown_s = up_m / mission.limits.climb_max_mps + GATHER_S + mission.way_m / route.vel_leader_mps
    flown_s += sum(visit.duration_s for visit in mission.visits)
    if route.at_end is AtEnd.RETURN:
        flown_s += math.dist(route.d2_enu_m, route.d1_enu_m) / route.vel_leader_mps + up_m / LAND_MPS
    elif route.at_end is AtEnd.LAND:
        flown_s += route.d2_enu_m[2] / LAND_MPS
    return flown_s


def battery_mah(mission: Mission) -> float:
    """Charge that a simulated vehicle uses meanwhile."""
    return HOVER_A * airtime_s(mission) / 3.6


def find_short_batteries(mission: Mission) -> Iterator[str]:
    """Simulated vehicles whose batteries do not last, those of one capacity together, in words."""
    if mission.lanes:  # refused: `simulator.problems`
        return
    needed_mah = battery_mah(mission)
    alike: dict[float, list[int]] = {}
    for vehicle_id in range(1, mission.swarm.size + 1):
        alike.setdefault(_capacity_mah(mission, vehicle_id), []).append(vehicle_id)
    for capacity_mah, members in sorted(alike.items()):
        left = 1.0 - needed_mah / capacity_mah
        more = " ..." if len(members) > MOST_NAMED else ""
        named = f"{', '.join(map(str, members[:MOST_NAMED]))}{more} ({capacity_mah:g} mAh)"
        if left < LANDS_BELOW:
            lasts_min = (1.0 - LANDS_BELOW) * capacity_mah * 3.6 / HOVER_A / 60.0
            when = f"landing after {lasts_min:.1f} min, at {100.0 * LANDS_BELOW:g} %"
            yield (
                f"the simulated battery does not last: {when}, vehicle {named}: less coverage.duration_s, or more "
                "sim.battery_mah"
            )
        elif left < LEADS_ABOVE:
            low = f"not leading below {100.0 * LEADS_ABOVE:g} %"
            yield f"the simulated battery is low at the end: {low}, vehicle {named}"


def battery_share(mission: Mission) -> float:
    """Share of the smallest simulated battery that the mission takes; above 1 - LANDS_BELOW it does not last."""
    capacities = (_capacity_mah(mission, vehicle_id) for vehicle_id in range(1, mission.swarm.size + 1))
    return battery_mah(mission) / min(capacities)


def _capacity_mah(mission: Mission, vehicle_id: int) -> float:
    """As fitted, or its autopilot's."""
    fitted = mission.sim.battery_mah.get(vehicle_id)
    return CAPACITY_MAH[mission.sim.personality_of(vehicle_id)] if fitted is None else fitted
