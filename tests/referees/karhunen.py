"""The protocol of Karhunen et al. (arXiv 2512.14340): repeated flights of one vehicle through two forests, by speed.

The flights are those of mission/studies/karhunen.toml; who has arrived is told as for the other referees: by its own
estimate, with what that may be wrong by.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any, Final, cast

from mission.document.model import Mission
from mission.stand.stand import stand_of
from sim_bridge.lab.study.backends.agents import fly_stack
from sim_bridge.lab.study.case import MissionCase
from sim_bridge.lab.study.load import load_study
from tests.referees.referee import Case, Row
from tests.referees.way import Way

STUDY: Final = Path(__file__).parents[2] / "mission/studies/karhunen.toml"


@functools.cache
def _flights() -> dict[Case, MissionCase]:
    """The study's, by our names."""
    return {_case(flight): flight for flight in cast("tuple[MissionCase, ...]", load_study(STUDY).cases)}


def _case(flight: MissionCase) -> Case:
    mission = flight.mission
    name = f"{flight.run} {mission.route.vel_leader_mps:g} m/s"
    assert mission.sensing is not None
    return Case(name, flight.n, flight.seed, mission.sim.estimates.value, mission.sensing.sensor.value)


def cases() -> list[Case]:
    """Every flight of the study."""
    return list(_flights())


def fly_through(case: Case) -> Row:
    """On JSBSim. Its grade: contact, not arrived, or clear: there by its own estimate, and by the truth but for 1 m."""
    mission = _flights()[case].mission
    way = Way(mission)
    outcome = fly_stack(mission, None, on_jsbsim=True, watch=lambda flight: way.look(flight.last))
    metrics = outcome.metrics
    grade = "contact" if metrics.contacts else "not arrived" if way.way_m is None else "clear"
    return case.row(
        grade,
        way_m=way.way_m,
        time_s=way.time_s,  # from departure
        contacts=metrics.contacts,
        clearance_m=metrics.trunk_clearance_min_m,
        verdict=outcome.summary["verdict"],
        trace_hash=outcome.summary["trace_hash"],
        **complexity(mission),
    )


def complexity(mission: Mission) -> dict[str, Any]:
    """Of the stand that it flies through: stems, and how far one flies straight on, on average, before it meets one."""
    assert mission.sensing is not None
    assert mission.forest.stand is not None
    trees = stand_of(mission).trees
    density_per_ha = mission.forest.stand.density_per_ha
    dbh_m = sum(2.0 * tree.radius_m for tree in trees) / len(trees)
    free_m = 1e4 / (density_per_ha * (dbh_m + 2.0 * mission.sensing.vehicle_radius_m))
    return {"density_per_ha": density_per_ha, "dbh_m": dbh_m, "free_m": free_m}
