"""The UAV Testing Competition's layouts: two boxes each, which made PX4-Avoidance fly nearer than 1.5 m to one.

uav_testing_layouts.csv has the figures of 30 published tests (skhatiri/UAV-Testing-Competition, snippets/good_tests
at commit b9b6e63): middles, sizes and heights of boxes, in metres from the take-off point; names are theirs. A hard
fail is a contact, a soft one a flight nearer than 1.5 m to a box, from the vehicle's centre.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any, Final

from mission.document.model import Mission
from sim_bridge.lab.study.backends.agents import fly_stack
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.referees.referee import Case, Row
from tests.referees.shortest import shortest_m
from tests.referees.way import Way

LAYOUTS: Final = Path(__file__).with_name("uav_testing_layouts.csv")
SOFT_M: Final = 1.5
SIZES: Final = (1, 4)
ESTIMATES: Final = ("recorded", "2026-11")
UP_M: Final = 5.0  # theirs is 10 m, as high as the lowest boxes, over which a lidar 0.25 m up would look
ARRIVAL_M: Final = 3.0  # of the leader at a place, by its own estimate
ENDS_M: Final = 15.0  # of each vehicle from the last place, at the end
WAYS: Final = {  # east, north; the missions of the layouts, by number
    1: ((0.0, 0.0), (53.0, 3.7)),
    2: ((0.0, 0.0), (54.0, -6.8), (0.1, -12.3)),
    3: ((0.0, 0.0), (53.0, 3.7), (54.0, -14.3), (0.9, -17.4)),
}
SETTINGS: Final[dict[str, Any]] = {
    "sensing": {
        "range_m": 12.0,
        "margin_m": 1.5,
    },  # and 0.35 m: 1.85 m are kept: estimates err by 0.3
    "coverage": {"keep_out_m": 1.9, "radius_m": 6.0, "duration_s": 30.0},  # a small ring: no trunk stands in it
    "fence": {"altitude_min_m": 2.0, "altitude_max_m": 8.0},  # nobody flies over a box
}


def layouts() -> dict[str, tuple[int, list[dict[str, Any]]]]:
    """By name: the number of its mission, and its boxes as a mission file has them."""
    found: dict[str, tuple[int, list[dict[str, Any]]]] = {}
    with LAYOUTS.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            number, boxes = found.setdefault(row["test"], (int(row["mission"]), []))
            box = {
                "centre_enu_m": (float(row["centre_east_m"]), float(row["centre_north_m"])),
                "length_m": float(row["size_east_m"]),
                "width_m": float(row["size_north_m"]),
                "height_m": float(row["height_m"]),
                "rotation_deg": float(row["rotation_deg"]),
            }
            assert number == int(row["mission"])
            boxes.append(box)
    return found


def mission_of(case: Case) -> Mission:
    """As our companions fly it: level, over the same places, and land at the last."""
    number, boxes = layouts()[case.name]
    first, *stops, last = [(*place, UP_M) for place in WAYS[number]]
    route = {
        "d1_enu_m": first,
        "stops": [{"pos_enu_m": stop, "duration_s": 0.0} for stop in stops],
        "d2_enu_m": last,
        "vel_leader_mps": 3.0,
        "arrival_distance_m": ARRIVAL_M,
        "at_end": "land",
    }
    sim = {"seed": case.seed, "estimates": case.estimates, "placement": "ring", "time_limit_s": 900.0}
    tables = {"route": route, "swarm": {"size": case.n}, "forest": {"boxes": boxes}, "sim": sim, **SETTINGS}
    return Mission.model_validate({"schema": 1, "name": case.name, **tables}).with_origin(DEFAULT_ORIGIN)


def cases() -> list[Case]:
    """Every layout, by one vehicle and by four, with both kinds of estimates."""
    return [Case(name, n, 1, kind) for kind in ESTIMATES for n in SIZES for name in layouts()]


def fly_layout(case: Case) -> Row:
    """On JSBSim, all companions in this process. Its grade: hard fail, soft fail, late (not all arrived) or clear."""
    mission = mission_of(case)
    way = Way(mission)
    outcome = fly_stack(mission, None, on_jsbsim=True, watch=lambda flight: way.look(flight.last))
    metrics = outcome.metrics
    clear_m = metrics.box_clearance_min_m
    assert clear_m is not None
    places = WAYS[layouts()[case.name][0]]
    # Who turns round, or stops, as near to a place as it has arrived there need not go on to it
    cut_m = ARRIVAL_M * (2 * (len(places) - 2) + 1)
    if metrics.contacts:
        grade = "hard fail"
    elif clear_m < SOFT_M:
        grade = "soft fail"
    else:
        grade = "clear" if way.all_arrived(ENDS_M) else "late"
    return case.row(
        grade,
        clearance_m=clear_m,  # least, from a vehicle's centre to a box
        separation_m=metrics.min_separation_m,
        contacts_boxes=metrics.contacts_boxes,
        contacts=metrics.contacts,
        way_m=way.way_m,  # of the acting leader, level, until it has arrived; None: it never did
        shortest_m=shortest_m(places, [box.block for box in mission.forest.boxes], SOFT_M) - cut_m,  # SOFT_M kept
        sim_time_s=metrics.sim_time_s,
        verdict=outcome.summary["verdict"],
        trace_hash=outcome.summary["trace_hash"],
    )
