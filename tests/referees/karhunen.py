"""The protocol of Karhunen et al. (arXiv 2512.14340): repeated flights of one vehicle through two forests, by speed.

The flights are those of mission/studies/karhunen.toml, flown by the study's own backend: `sim-bridge study` has the
same rows.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any, Final, cast

from mission.stand.stand import stand_of
from sim_bridge.lab.study.backends import BACKENDS
from sim_bridge.lab.study.case import MissionCase
from sim_bridge.lab.study.load import load_study
from tests.referees.referee import Case, Row

STUDY: Final = Path(__file__).parents[2] / "mission/studies/karhunen.toml"
KEPT: Final = ("arrival_leader_s", "speed_mean_transit_mps", "contacts", "trunk_clearance_min_m", "verdict")


@functools.cache
def _flights() -> dict[Case, MissionCase]:
    """The study's, by our names."""
    return {_case(flight): flight for flight in cast("tuple[MissionCase, ...]", load_study(STUDY).cases)}


def _case(flight: MissionCase) -> Case:
    mission = flight.mission
    name = f"{flight.run} {mission.route.vel_leader_mps:g} m/s"
    return Case(name, flight.n, flight.seed, mission.sim.estimates.value)


def cases() -> list[Case]:
    """Every flight of the study."""
    return list(_flights())


def fly_through(case: Case) -> Row:
    """As the study flies it. Its grade: clear (arrived, by the verdict), contact, or not arrived."""
    flight = _flights()[case]
    figures = BACKENDS[flight.backend].fly([flight])[0]
    grade = "contact" if figures["contacts"] else "clear" if figures["grade"] == "ARRIVED" else "not arrived"
    return case.row(grade, **{name: figures[name] for name in (*KEPT, "trace_hash")}, **complexity(flight))


def complexity(flight: MissionCase) -> dict[str, Any]:
    """Of the stand that it flies through: stems, and how far one flies straight on, on average, before it meets one."""
    mission = flight.mission
    assert mission.sensing is not None
    assert mission.forest.stand is not None
    trees = stand_of(mission).trees
    density_per_ha = mission.forest.stand.density_per_ha
    dbh_m = sum(2.0 * tree.radius_m for tree in trees) / len(trees)
    free_m = 1e4 / (density_per_ha * (dbh_m + 2.0 * mission.sensing.vehicle_radius_m))
    return {"density_per_ha": density_per_ha, "dbh_m": dbh_m, "free_m": free_m}
