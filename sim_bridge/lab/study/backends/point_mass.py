"""Flies a law alone on point masses: seeds of a case at once in the open, agents one by one among trees."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from sim_bridge.lab.study.backends.base import FlightBackend
from sim_bridge.lab.study.case import MissionCase
from sim_bridge.lab.study.forest import flight as among_trees
from sim_bridge.lab.study.law import law_module
from sim_bridge.lab.study.point_mass import fly as fly_point_masses

COST_S = 0.01  # of a vehicle-second, relatively
OURS = 7.0  # times as dear as a law over arrays


class PointMassBackend(FlightBackend[MissionCase]):
    """See `point_mass` (in the open) and `forest` (missions with [sensing])."""

    def fly(self, cases: Sequence[MissionCase]) -> list[dict[str, Any]]:
        """See FlightBackend."""
        mission, params = cases[0].mission, cases[0].params
        if mission.sensing is not None:
            return [among_trees.fly(case.mission, case.law, case.params, case.gusts_mps).as_dict() for case in cases]
        seeds = [case.seed for case in cases]
        if len(seeds) == 1:
            seeds *= 2  # see point_mass.fly
        law = law_module(cases[0].law)
        if hasattr(law, "fly"):
            flown = law.fly(mission, seeds, params)
        else:
            flown = fly_point_masses(mission, seeds, law.make(mission, len(seeds), params))
        return [figures.as_dict() for figures in flown[: len(cases)]]

    def estimate_cost(self, case: MissionCase) -> float:
        """See FlightBackend."""
        return COST_S * (OURS if case.law == "ours" else 1.0) * vehicle_seconds(case)

    def batch_key(self, case: MissionCase) -> str:
        """In the open all seeds of a case."""
        if case.mission.sensing is not None:
            return case.key
        unseeded = case.mission.model_dump_json(exclude={"sim": {"seed"}})
        return json.dumps([case.run, case.law, unseeded, case.params.model_dump_json()])


def vehicle_seconds(case: MissionCase) -> float:
    """Steps that a flight has, about."""
    mission = case.mission
    sim_s = 60.0 + mission.coverage.duration_s + mission.route.length_m / mission.route.vel_leader_mps
    return mission.swarm.size * sim_s
