"""What a worker does: the flights of one batch, to figures. It runs in other processes, and on other machines."""

from __future__ import annotations

import functools
import gc
import io
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.judge import estimate_recorder
from sim_bridge.judge.outcome import Outcome
from sim_bridge.judge.progress import Progress
from sim_bridge.lab.study.forest import flight as among_trees
from sim_bridge.lab.study.law import law_module
from sim_bridge.lab.study.point_mass import fly as fly_point_masses
from sim_bridge.lab.study.spec import Backend, Case
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.world import DEFAULT_ORIGIN

GARBAGE = 50_000  # objects between two searches for circles of them: ticks make many objects and hardly a circle


@dataclass(frozen=True, slots=True)
class Done:
    """A batch that was flown: figures in the order of its cases."""

    figures: tuple[dict[str, Any], ...]
    cpu_s: float  # of the whole batch
    wall_s: float


def start_worker() -> None:
    """In each process of a local pool: Ctrl-C ends it at once, and its flight is flown again next time."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    gc.freeze()  # what is imported stays
    gc.set_threshold(GARBAGE)


def fly_batch(cases: tuple[Case, ...]) -> Done:
    """All cases have the same law, backend, mission and parameters; they differ in their seeds."""
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    case = cases[0]
    match case.backend:
        case Backend.POINT_MASS:
            figures = _point_masses(cases)
        case Backend.AGENTS | Backend.JSBSIM:
            figures = [_agents(case.mission, on_jsbsim=case.backend is Backend.JSBSIM) for case in cases]
    return Done(tuple(figures), time.process_time() - cpu_s, time.perf_counter() - wall_s)


def _point_masses(cases: tuple[Case, ...]) -> list[dict[str, Any]]:
    mission, params = cases[0].mission, cases[0].params
    if mission.sensing is not None:
        return [among_trees.fly(case.mission, case.law, case.params, case.gusts_mps).as_dict() for case in cases]
    seeds = [case.mission.sim.seed for case in cases]
    if len(seeds) == 1:
        seeds *= 2  # see point_mass.fly
    law = law_module(cases[0].law)
    if hasattr(law, "fly"):
        flown = law.fly(mission, seeds, params)
    else:
        flown = fly_point_masses(mission, seeds, law.make(mission, len(seeds), params))
    return [figures.as_dict() for figures in flown[: len(cases)]]


def _agents(mission: Mission, *, on_jsbsim: bool) -> dict[str, Any]:
    figures = _stack(mission, on_jsbsim=on_jsbsim)
    return figures if mission.sensing is None else figures | _over_alone(figures, mission, on_jsbsim=on_jsbsim)


def _stack(mission: Mission, *, on_jsbsim: bool) -> dict[str, Any]:
    """One flight of the whole stack."""
    outcome = fly_stack(mission, None, on_jsbsim=on_jsbsim)
    kept = {key: outcome.summary[key] for key in ("ended", "verdict", "trace_hash", *estimate_recorder.definitions())}
    return outcome.metrics.as_dict() | kept


def fly_stack(mission: Mission, folder: Path | None, *, on_jsbsim: bool) -> Outcome:
    """The same, into an empty `folder`, if there is one."""
    if mission.origin is None:
        mission = mission.with_origin(DEFAULT_ORIGIN)
    airframes = (
        None
        if on_jsbsim
        else lambda _frame, place, _seed: PointMass(place, 0.0, drag=mission.sim.drag, ground_down_m=place[2])
    )
    with Progress(io.StringIO()) as progress:
        return fly.fly(mission, folder, progress, in_process=True, airframes=airframes)


def _over_alone(figures: dict[str, Any], mission: Mission, *, on_jsbsim: bool) -> dict[str, Any]:
    """Arrivals over T0: the same vehicle alone on the same route, without trees, wind and errors."""
    alone_s = _alone_s(among_trees.alone(mission).model_dump_json(by_alias=True), on_jsbsim)
    found: dict[str, Any] = {"alone_s": alone_s}
    for who in ("leader", "last"):
        arrival_s = figures[f"arrival_{who}_s"]
        found[f"over_alone_{who}"] = arrival_s / alone_s - 1.0 if arrival_s is not None and alone_s else None
    return found


@functools.lru_cache(maxsize=64)
def _alone_s(mission_json: str, on_jsbsim: bool) -> float | None:
    mission = Mission.model_validate_json(mission_json)
    arrival_s: float | None = _stack(mission, on_jsbsim=on_jsbsim)["arrival_leader_s"]
    return arrival_s


def worker_count() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
