"""The UAV Testing Competition's layouts: two boxes each, which made PX4-Avoidance fly nearer than 1.5 m to one.

uav_testing_layouts.csv has the figures of 30 published tests (skhatiri/UAV-Testing-Competition, snippets/good_tests
at commit b9b6e63): middles, sizes and heights of boxes, in metres from the take-off point; names are theirs. A hard
fail is a contact, a soft one a flight nearer than 1.5 m to a box, from the vehicle's centre.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from companion.core.model.states import SwarmPhase
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.judge.progress import Progress
from sim_bridge.judge.tick import Tick
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.referees.shortest import shortest_m

LAYOUTS: Final = Path(__file__).with_name("uav_testing_layouts.csv")
SOFT_M: Final = 1.5
UP_M: Final = 5.0  # theirs is 10 m, as high as the lowest boxes, over which a lidar 0.25 m up would look
ARRIVAL_M: Final = 3.0  # of the leader at a place, by its own estimate
ESTIMATE_M: Final = 1.0  # and so much more by the truth
ENDS_M: Final = 15.0  # of each vehicle from the last place, at the end
WAYS: Final = {  # east, north; the missions of the layouts, by number
    1: ((0.0, 0.0), (53.0, 3.7)),
    2: ((0.0, 0.0), (54.0, -6.8), (0.1, -12.3)),
    3: ((0.0, 0.0), (53.0, 3.7), (54.0, -14.3), (0.9, -17.4)),
}
SETTINGS: Final[dict[str, Any]] = {
    "sensing": {"range_m": 12.0, "margin_m": 1.2},  # and 0.35 m: 1.55 m are kept from a box
    "coverage": {"keep_out_m": 1.6, "radius_m": 6.0, "duration_s": 30.0},  # a small ring: no trunk stands in it
    "fence": {"altitude_min_m": 2.0, "altitude_max_m": 8.0},  # nobody flies over a box
}


@dataclass(frozen=True, slots=True)
class Flown:
    """One layout, flown once."""

    layout: str
    n: int
    seed: int
    estimates: str
    grade: str  # hard fail, soft fail, late (not all arrived), clear
    clearance_m: float  # least, from a vehicle's centre to a box
    separation_m: float | None
    contacts_boxes: int
    contacts: int
    way_m: float | None  # of the acting leader, level, until it has arrived; None: it never did
    shortest_m: float  # with SOFT_M kept
    sim_time_s: float
    verdict: str
    trace_hash: str


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


def mission_of(layout: str, n: int, seed: int, estimates: str = "recorded") -> Mission:
    """As our companions fly it: level, over the same places, and land at the last."""
    number, boxes = layouts()[layout]
    first, *stops, last = [(*place, UP_M) for place in WAYS[number]]
    route = {
        "d1_enu_m": first,
        "stops": [{"pos_enu_m": stop, "duration_s": 0.0} for stop in stops],
        "d2_enu_m": last,
        "vel_leader_mps": 3.0,
        "arrival_distance_m": ARRIVAL_M,
        "at_end": "land",
    }
    sim = {"seed": seed, "estimates": estimates, "placement": "ring", "time_limit_s": 900.0}
    tables = {"route": route, "swarm": {"size": n}, "forest": {"boxes": boxes}, "sim": sim, **SETTINGS}
    return Mission.model_validate({"schema": 1, "name": layout, **tables}).with_origin(DEFAULT_ORIGIN)


class _Way:
    """How far whoever leads has flown, until it has arrived."""

    def __init__(self, mission: Mission) -> None:
        self._d2 = mission.route.d2_enu_m
        self._last = len(mission.visits) - 1
        self._was: Tick | None = None
        self._flown_m = 0.0
        self.way_m: float | None = None  # None: not arrived yet

    def look(self, tick: Tick) -> None:
        before, self._was = self._was, tick
        leader, phase = tick.leader(tick.alive), tick.phase(tick.alive)
        if self.way_m is not None or before is None or leader is None or phase < SwarmPhase.TRANSIT:
            return
        self._flown_m += math.dist(tick.pos_ned_m[leader - 1][:2], before.pos_ned_m[leader - 1][:2])
        there = self._off_m(tick, leader) <= ARRIVAL_M + ESTIMATE_M
        if there and phase is SwarmPhase.COVERAGE and tick.stop(tick.alive) == self._last:
            self.way_m = self._flown_m

    def all_arrived(self) -> bool:
        """The leader has arrived, and at the end all are there."""
        last = self._was
        if self.way_m is None or last is None:
            return False
        return all(self._off_m(last, k) <= ENDS_M for k in range(1, len(last.pos_ned_m) + 1))

    def _off_m(self, tick: Tick, vehicle_id: int) -> float:
        """How far from the last place it is, level."""
        north_m, east_m, _ = tick.pos_ned_m[vehicle_id - 1]
        return math.dist((east_m, north_m), self._d2[:2])


def fly_layout(layout: str, n: int, seed: int, estimates: str = "recorded") -> Flown:
    """On JSBSim, all companions in this process."""
    mission = mission_of(layout, n, seed, estimates)
    way = _Way(mission)
    with Progress(io.StringIO()) as progress:
        outcome = fly.fly(mission, None, progress, in_process=True, watch=lambda flight: way.look(flight.last))
    metrics = outcome.metrics
    clear_m = metrics.box_clearance_min_m
    assert clear_m is not None
    places = WAYS[layouts()[layout][0]]
    # Who turns round, or stops, as near to a place as it has arrived there need not go on to it
    cut_m = ARRIVAL_M * (2 * (len(places) - 2) + 1)
    if metrics.contacts:
        grade = "hard fail"
    elif clear_m < SOFT_M:
        grade = "soft fail"
    else:
        grade = "clear" if way.all_arrived() else "late"
    return Flown(
        layout=layout,
        n=n,
        seed=seed,
        estimates=estimates,
        grade=grade,
        clearance_m=clear_m,
        separation_m=metrics.min_separation_m,
        contacts_boxes=metrics.contacts_boxes,
        contacts=metrics.contacts,
        way_m=way.way_m,
        shortest_m=shortest_m(places, [box.block for box in mission.forest.boxes], SOFT_M) - cut_m,
        sim_time_s=metrics.sim_time_s,
        verdict=outcome.summary["verdict"],
        trace_hash=outcome.summary["trace_hash"],
    )


def as_row(flown: Flown) -> dict[str, Any]:
    """For a file of rows."""
    return asdict(flown)
