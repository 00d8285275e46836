"""Flies the whole stack in lockstep (agents, codec, radio, autopilots), on point masses or JSBSim quadrotors."""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.drive.entrant.stages import BY_OURS, Entrant
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.judge import estimate_recorder
from sim_bridge.judge.metrics import stems
from sim_bridge.judge.outcome import Outcome
from sim_bridge.judge.progress import Progress
from sim_bridge.lab.study.backends.base import FlightBackend
from sim_bridge.lab.study.backends.point_mass import vehicle_seconds
from sim_bridge.lab.study.case import MissionCase
from sim_bridge.lab.study.forest import flight as among_trees
from sim_bridge.world.airframe.point_mass import point_mass_airframes
from sim_bridge.world.world import DEFAULT_ORIGIN

COST_S, COST_JSBSIM_S = 0.6, 1.0  # of a vehicle-second, relatively


class AgentsBackend(FlightBackend[MissionCase]):
    """`on_jsbsim`: what `sim-bridge fly` flies."""

    def __init__(self, *, on_jsbsim: bool) -> None:
        self.on_jsbsim = on_jsbsim

    def fly(self, cases: Sequence[MissionCase]) -> list[dict[str, Any]]:
        """See FlightBackend."""
        return [self._figures(case.mission, case.entrant) for case in cases]

    def estimate_cost(self, case: MissionCase) -> float:
        """See FlightBackend."""
        return (COST_JSBSIM_S if self.on_jsbsim else COST_S) * vehicle_seconds(case)

    def fly_into(self, case: MissionCase, folder: Path | None) -> Outcome:
        """One flight, into an empty `folder`, if there is one."""
        return fly_stack(case.mission, folder, on_jsbsim=self.on_jsbsim, entrant=case.entrant)

    def _figures(self, mission: Mission, entrant: Entrant) -> dict[str, Any]:
        figures = _fly_to_figures(mission, entrant, on_jsbsim=self.on_jsbsim)
        if mission.sensing is None:
            return figures
        return figures | _over_alone(figures, mission, on_jsbsim=self.on_jsbsim)


def _fly_to_figures(mission: Mission, entrant: Entrant, *, on_jsbsim: bool) -> dict[str, Any]:
    outcome = fly_stack(mission, None, on_jsbsim=on_jsbsim, entrant=entrant)
    names = ("ended", "verdict", "grade", "trace_hash", *estimate_recorder.definitions())
    kept = {name: outcome.summary[name] for name in names}
    kept |= {name: outcome.summary[name] for name in stems.definitions() if name in outcome.summary}
    return outcome.metrics.as_dict() | kept | entrant.figures()


def fly_stack(
    mission: Mission,
    folder: Path | None,
    *,
    on_jsbsim: bool,
    watch: Callable[[fly.Flight], None] | None = None,
    entrant: Entrant = BY_OURS,
    signed: bool = False,
) -> Outcome:
    """One flight of the whole stack, into an empty `folder`, if there is one. `watch`, `entrant`: as for `fly.fly`.

    `signed`: its radio has keys, drawn by the mission's seed.
    """
    if mission.origin is None:
        mission = mission.with_origin(DEFAULT_ORIGIN)
    airframes = None if on_jsbsim else point_mass_airframes(mission)
    keys = FleetKeys(mission) if signed else None
    with Progress(io.StringIO()) as progress:
        return fly.fly(
            mission, folder, progress, in_process=True, airframes=airframes, watch=watch, entrant=entrant, keys=keys
        )


def _over_alone(figures: dict[str, Any], mission: Mission, *, on_jsbsim: bool) -> dict[str, Any]:
    """Arrivals over T0: one of ours alone on the same route, without trees, wind and errors, whatever flew else."""
    alone_s = _alone_s(among_trees.alone(mission).model_dump_json(by_alias=True), on_jsbsim)
    found: dict[str, Any] = {"alone_s": alone_s}
    for who in ("leader", "last"):
        arrival_s = figures[f"arrival_{who}_s"]
        found[f"over_alone_{who}"] = arrival_s / alone_s - 1.0 if arrival_s is not None and alone_s else None
    return found


@functools.lru_cache(maxsize=64)
def _alone_s(mission_json: str, on_jsbsim: bool) -> float | None:
    mission = Mission.model_validate_json(mission_json)
    arrival_s: float | None = _fly_to_figures(mission, BY_OURS, on_jsbsim=on_jsbsim)["arrival_leader_s"]
    return arrival_s
