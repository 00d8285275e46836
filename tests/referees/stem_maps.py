"""Real stands: the mapped plots waka, longleaf and spruces, read from Debian's r-cran-spatstat.data by R.

The package is under the GPL, so its data are read where it is installed, and none are kept here. Ten straight lines
cross each plot, five eastward and five northward, at the same shares of its sides, from 20 m before to 20 m behind.
"""

from __future__ import annotations

import csv
import functools
import io
import math
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from mission.common.plane import Point
from mission.document.model import Mission
from mission.schema.kinds import SensorClass
from mission.schema.trees import StandTree
from mission.stand.stand import stand_of
from sim_bridge.lab.study.backends.agents import fly_stack
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.referees.grid import Disc, shortest_way_m
from tests.referees.referee import Case, Row
from tests.referees.way import Way

ESTIMATES: Final = "recorded"
RAW, SECTORS = SensorClass.SCAN_1DEG.value, SensorClass.SECTORS.value
FLOWN: Final = ((RAW, 1), (RAW, 4), (RAW, 8), (SECTORS, 1))  # sensors and sizes; sectors beside what rays tell
SHARES: Final = (0.2, 0.35, 0.5, 0.65, 0.8)  # of the plot's side: where lines cross it
BEYOND_M: Final = 20.0
UP_M: Final = 3.0
TIME_LIMIT_S: Final = 300.0  # 47 to 80 s are needed
ENDS_M: Final = 25.0  # of each vehicle from d2, at the end: the ring has 15 m, and the leader stood off by 5
FILE: Final = "stems.csv"


@dataclass(frozen=True, slots=True)
class Plot:
    """A mapped plot of the package: a rectangle from 0, 0."""

    east_m: float
    north_m: float
    to_cm: float  # of its diameters
    species: str  # whose curves give heights and crowns


PLOTS: Final = {
    "waka": Plot(100.0, 100.0, 1.0, "broadleaf"),
    "longleaf": Plot(200.0, 200.0, 1.0, "pine"),
    "spruces": Plot(56.0, 38.0, 100.0, "spruce"),
}


def missing() -> str:
    """What is not installed; "": nothing."""
    if shutil.which("Rscript") is None or not _asked('cat(system.file(package = "spatstat.data"))'):
        return "the plots are in Debian's package r-cran-spatstat.data, which is not installed"
    return ""


def _asked(expression: str) -> str:
    """What R prints."""
    told = subprocess.run(["Rscript", "--vanilla", "-e", expression], capture_output=True, text=True, check=False)
    return told.stdout if told.returncode == 0 else ""


@functools.cache
def stems_csv(name: str) -> str:
    """A plot as a stem map."""
    plot = f"spatstat.data::{name}"
    return as_stems(
        _asked(f"p <- {plot}; write.csv(data.frame(x = p$x, y = p$y, d = p$marks), row.names = FALSE)"), PLOTS[name]
    )


def as_stems(table: str, plot: Plot) -> str:
    """The plot's table of x, y and diameter, to our columns. Of stems in one place, to 1 cm, the thickest is kept."""
    dbh_cm: dict[tuple[float, float], float] = {}
    for row in csv.DictReader(io.StringIO(table)):
        at = round(float(row["x"]), 2), round(float(row["y"]), 2)
        dbh_cm[at] = max(dbh_cm.get(at, 0.0), plot.to_cm * float(row["d"]))
    stems = [f"{east_m:.2f},{north_m:.2f},{thick:.2f},{plot.species}" for (east_m, north_m), thick in dbh_cm.items()]
    return "\n".join(["east_m,north_m,dbh_cm,species", *stems, ""])


def cases() -> list[Case]:
    """Every line of every plot."""
    names = [f"{plot} {way} {k}" for plot in PLOTS for way in ("east", "north") for k in range(1, len(SHARES) + 1)]
    return [Case(name, n, 1, ESTIMATES, sensor) for sensor, n in FLOWN for name in names]


def line(name: str) -> tuple[Point, Point]:
    """From where to where, east and north: `waka east 1` is the first line eastward."""
    plot, way, number = name.split()
    east_m, north_m, share = PLOTS[plot].east_m, PLOTS[plot].north_m, SHARES[int(number) - 1]
    if way == "east":
        return (-BEYOND_M, share * north_m), (east_m + BEYOND_M, share * north_m)
    return (share * east_m, -BEYOND_M), (share * east_m, north_m + BEYOND_M)


def mission_of(case: Case) -> Mission:
    """Along its line, by what is scanned, at a height over the ground."""
    d1, d2 = line(case.name)
    route = {"d1_enu_m": (*d1, UP_M), "d2_enu_m": (*d2, UP_M), "vel_leader_mps": 3.0, "at_end": "land"}
    sim = {"seed": case.seed, "estimates": case.estimates, "placement": "ring", "time_limit_s": TIME_LIMIT_S}
    sim |= {"range_finder": True}
    tables: dict[str, Any] = {"route": route, "swarm": {"size": case.n}, "forest": {"file": FILE}, "sim": sim}
    tables |= {"sensing": {"range_m": 12.0, "sensor": case.sensor}, "coverage": {"duration_s": 30.0}}
    tables |= {"fence": {"altitude_min_m": 1.5, "altitude_max_m": 6.0}}
    return Mission.model_validate({"schema": 1, "name": case.name, **tables}).with_origin(DEFAULT_ORIGIN)


def discs_of(tree: StandTree, clear_m: float) -> list[Disc]:
    """What a planner that knew the stand would keep out of at the height of flight."""
    if tree.height_m < UP_M:
        return []
    wide_m = max(tree.radius_m, tree.crown_radius_m) if tree.crown_base_m <= UP_M else tree.radius_m
    return [Disc(tree.east_m, tree.north_m, wide_m + clear_m)]


def fly_line(case: Case) -> Row:
    """On JSBSim, all companions in this process. Its grade: contact, not arrived, late (not all arrived) or clear."""
    mission = mission_of(case)
    assert mission.sensing is not None
    way = Way(mission)
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / FILE).write_text(stems_csv(case.name.split()[0]), encoding="utf-8")
        outcome = fly_stack(mission, folder, on_jsbsim=True, watch=lambda flight: way.look(flight.last))
        stand = stand_of(mission, folder)
    clear_m = mission.sensing.vehicle_radius_m + mission.sensing.margin_m
    discs = [disc for tree in stand.trees for disc in discs_of(tree, clear_m)]
    d1, d2 = line(case.name)
    came = way.began is not None and way.ended is not None
    shortest_m = shortest_way_m(way.began or d1, way.ended or d2, discs) if came else shortest_way_m(d1, d2, discs)
    metrics = outcome.metrics
    if metrics.contacts:
        grade = "contact"
    elif way.way_m is None:
        grade = "not arrived"
    else:
        grade = "clear" if way.all_arrived(ENDS_M) else "late"
    return case.row(
        grade,
        contacts=metrics.contacts,
        contacts_crowns=metrics.contacts_crowns,
        contacts_trunks=metrics.contacts_trunks,
        contacts_vehicles=metrics.contacts_vehicles,
        separation_m=metrics.min_separation_m,
        clearance_m=metrics.trunk_clearance_min_m,
        straight_m=math.dist(d1, d2),
        way_m=way.way_m,  # of whoever led, from transit until it had arrived
        shortest_m=None if math.isinf(shortest_m) else shortest_m,  # between the same two places
        sim_time_s=metrics.sim_time_s,
        verdict=outcome.summary["verdict"],
        trace_hash=outcome.summary["trace_hash"],
    )
