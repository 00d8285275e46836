"""Heights by a barometer, which real PX4 report up to 1.2 m wrong (rms): which missions leave them no room.

A height is held as it is reported, and nothing on board without a range finder knows how wrong that is.
"""

from __future__ import annotations

from typing import Final

from mission.document.model import CoverageShape, Estimates, Mission, Personality, Sky
from mission.rules.flight_rules import route_points
from mission.rules.forest_rules import ground_up_m, lowest_crown_m

HEIGHT_SD_M: Final = 1.2  # the most that was recorded of a PX4's (`estimates = "recorded"`); a test compares them
ROOM_SDS: Final = 3.0  # of it that a mission is to leave below and above
TOLERATED_M: Final = 1.0  # above the fence: what a verdict allows


def goes_by_barometer(mission: Mission) -> bool:
    """A simulated vehicle has a height as wrong as a barometer's."""
    sim = mission.sim
    if sim.estimates is not Estimates.RECORDED or sim.range_finder or sim.position_noise_m is not None:
        return False
    if mission.flies_by_ranges and sim.satellites.crowns is Sky.SHADE:  # odometry's heights, which are true
        return False
    vehicles = range(1, mission.swarm.size + 1)
    return any(sim.personality_of(k) is Personality.PX4 and mission.has_satellites(k) for k in vehicles)


def find_lacking_room(mission: Mission) -> str:
    """The room that such heights lack, in words; empty: they have it, or heights are better."""
    if not goes_by_barometer(mission):
        return ""
    room_m = ROOM_SDS * HEIGHT_SD_M
    sphere_m = mission.coverage.radius_m if mission.coverage.shape is CoverageShape.SPHERE else 0.0
    places = [(mission.route.d1_enu_m, 0.0), *((place, sphere_m) for _, place in route_points(mission)[1:])]
    highest_m = max(place[2] + about_m for place, about_m in places)
    over_m = [(place[2] - ground_up_m(mission, *place[:2]), about_m) for place, about_m in places]  # the ground there
    lowest_over_m = min(up_m - about_m for up_m, about_m in over_m)
    highest_over_m = max(up_m + about_m for up_m, about_m in over_m)
    below_m = lowest_over_m - (mission.sensing.vehicle_radius_m if mission.sensing is not None else 0.0)
    lefts = [  # with what may be flown beyond
        (below_m, 0.0, "above the ground"),
        (mission.fence.altitude_max_m + TOLERATED_M - highest_m, TOLERATED_M, "below the fence's top"),
    ]
    stand = mission.forest.stand
    if stand is not None and highest_over_m < lowest_crown_m(stand):
        lefts.append((lowest_crown_m(stand) - highest_over_m, 0.0, "below the lowest crowns"))
    for left_m, beyond_m, where in lefts:
        if left_m < room_m:
            return (
                f"{left_m - beyond_m:.1f} m {where}: heights by a barometer, wrong by up to {HEIGHT_SD_M:g} m rms, "
                f"want {room_m - beyond_m:.1f} m, or sim.range_finder"
            )
    return ""
