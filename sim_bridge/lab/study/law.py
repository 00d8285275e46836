"""Interface of movement laws to the point-mass harness, and the table of laws.

A law steers B flights of n vehicles at once, as arrays: a hundred flights cost little more than one. What one flight
does must not depend on the others in the batch, to the bit: element by element, sums over the last axes only, no BLAS.
Ours is the exception: it is flown by the flight software's own functions, one vehicle after the other.
ENU metres, as in the paper; `[b, i, j]` is vehicle i's view of vehicle j in flight b.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from mission.common.problems import MissionError, Problem, dotted, shown
from mission.document.model import Mission
from mission.schema.check import LineOf, no_line, validated

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class View:
    """Knowledge of the vehicles at a tick. What is heard is one beacon period old; the rest is now."""

    dt_s: float  # one beacon period: the control tick
    pos_enu_m: Floats  # (B, n, 3) own position. Rule 5: followers may only use differences of it
    vel_enu_mps: Floats  # (B, n, 3) own velocity
    rel_enu_m: Floats  # (B, n, n, 3) from i to where j was when it sent its beacon
    distance_m: Floats  # (B, n, n) norm of rel_enu_m; inf on the diagonal
    heard: Bools  # (B, n, n) in range; False on the diagonal
    vel_heard_enu_mps: Floats  # (B, n, 3) velocity in j's beacon
    leads: Bools  # (B, n) exactly one in each flight
    routes: Sequence[Mission]  # (B,) whose route the leader flies: where it is to go may change on the way
    departed: Bools  # (B,) on the way to d2; until then the swarm gathers at d1
    to_goal_enu_m: Floats  # (B, 3) from the leader to where it goes: d1 until departure, then d2
    stop_m: Floats  # (B,) how far before that the leader comes to rest
    cruise_mps: Floats  # (B,) the leader's greatest speed on the way there


class Law(Protocol):
    """One law for one batch: it may keep state from tick to tick."""

    def velocity(self, view: View) -> Floats:
        """(B, n, 3) velocity commands, ENU m/s. The point mass follows them with its lag and acceleration limit."""


class Params(BaseModel):
    """Base of a law's parameters: every one has a default, its published or tuned value."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


class LawModule(Protocol):
    """A module with a law in it."""

    Params: type[BaseModel]

    def make(self, mission: Mission, flights: int, params: Any) -> Law:
        """The law for a batch of `flights` flights of the same mission."""


# Law -> module, which has `Params` and one of: `make(mission, flights, params) -> Law`, for the point-mass harness;
# `fly(mission, seeds, params) -> list[Figures]`, for a law that is no point-mass controller (Algorithm 1);
# `stage(mission, params) -> study.forest.crew.Stage`, for a law to pass trees in place of ours.
LAWS: dict[str, str] = {
    "ours": "sim_bridge.lab.study.ours",
    "algorithm1": "sim_bridge.lab.paper.algorithm1",
    "olfati-saber": "sim_bridge.lab.laws.olfati_saber",
    "vasarhelyi": "sim_bridge.lab.laws.vasarhelyi",
    "heading-scan": "sim_bridge.lab.laws.heading_scan",
    "potential-field": "sim_bridge.lab.laws.potential_field",
}


def law_module(name: str) -> Any:
    """The module of a law of LAWS."""
    return importlib.import_module(LAWS[name])


def law_params(name: str, values: Mapping[str, Any], place: str, line_of: LineOf = no_line) -> BaseModel:
    """A law's parameters; MissionError names each that is wrong."""
    model: type[BaseModel] = law_module(name).Params
    if values and not model.model_fields:
        nothing = f'law "{name}" has no parameters'
        raise MissionError(Problem(place, line_of((k,)), dotted((k,)), shown(v), nothing) for k, v in values.items())
    return validated(model, values, place, line_of)
