"""Third-party guidance laws: the example entrant beside ours, with the safety filter and without.

They fly the same missions and seeds. The whole stack flies on point masses: agents, codec, radio, simulated autopilots.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mission.document.load import load_mission
from mission.document.model import Mission
from sim_bridge.drive.entrant.law import find_law
from sim_bridge.drive.entrant.stages import Entrant
from sim_bridge.drive.fly import Flight
from sim_bridge.lab.study.backends.agents import fly_stack
from tests.referees.referee import Case, Row
from tests.referees.way import Way

ROOT: Final = Path(__file__).parents[2]
ENTRANT: Final = "docs/examples/velocity_obstacles.py"
LONE, FOREST = "lone tree", "200 trees/ha"
MISSIONS: Final = {LONE: "mission/examples/lone_tree.toml", FOREST: "mission/studies/through_trees.toml"}
DENSITY_PER_HA: Final = 200.0
COVERAGE_S: Final = 20.0  # long enough for all to come, too
ENDS_M: Final = 25.0  # of each vehicle from d2, at the end
LAWS: Final = {"ours": None, "velocity obstacles": ENTRANT}
FILTERS: Final = {"with": True, "without": False}  # the safety filter
SIZES: Final = (4, 8)
SEEDS: Final = range(1, 6)
ESTIMATES: Final = "recorded"
KEPT: Final = ("contacts", "min_separation_m", "trunk_clearance_min_m", "verdict", "trace_hash")


def cases() -> list[Case]:
    """Each mission, size, law and filter, five seeds; the name says mission, law and filter."""
    names = [f"{mission}, {law}, {how}" for mission in MISSIONS for law in LAWS for how in FILTERS]
    return [Case(name, n, seed, ESTIMATES) for seed in SEEDS for n in SIZES for name in names]


def entrant_of(name: str) -> Entrant:
    """What flies in a case of that name."""
    _, law, how = name.split(", ")
    file = LAWS[law]
    return Entrant(None if file is None else find_law(file, ROOT), FILTERS[how])


def mission_of(case: Case) -> Mission:
    """What it flies."""
    name = case.name.split(", ")[0]
    values = load_mission(ROOT / MISSIONS[name]).model_dump(by_alias=True)
    values["sim"] |= {"seed": case.seed, "estimates": case.estimates}
    values["swarm"]["size"] = case.n
    values["coverage"]["duration_s"] = COVERAGE_S
    if name == FOREST:
        values["forest"]["stand"]["density_per_ha"] = DENSITY_PER_HA
    return Mission.model_validate(values)


def fly_law(case: Case) -> Row:
    """Its grade: contact, unsafe (else, by the verdict), not arrived, late (not all arrived) or clear."""
    mission, entrant = mission_of(case), entrant_of(case.name)
    way = Way(mission)
    timed = _Timed(way)
    outcome = fly_stack(mission, None, on_jsbsim=False, watch=timed.look, entrant=entrant)
    if outcome.metrics.contacts:
        grade = "contact"
    elif outcome.summary["grade"] == "UNSAFE":
        grade = "unsafe"
    elif way.way_m is None:
        grade = "not arrived"
    else:
        grade = "clear" if way.all_arrived(ENDS_M) else "late"
    kept = {name: outcome.summary[name] for name in KEPT}
    return case.row(grade, **kept, way_m=way.way_m, arrival_s=timed.arrival_s)


class _Timed:
    """When whoever leads arrives, from when transit began."""

    def __init__(self, way: Way) -> None:
        self._way = way
        self._began_s: float | None = None
        self.arrival_s: float | None = None

    def look(self, flight: Flight) -> None:
        """After each tick."""
        tick = flight.last
        self._way.look(tick)
        if self._began_s is None and self._way.began is not None:
            self._began_s = tick.time_s
        if self.arrival_s is None and self._way.way_m is not None and self._began_s is not None:
            self.arrival_s = tick.time_s - self._began_s
