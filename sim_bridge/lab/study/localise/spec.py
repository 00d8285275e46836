"""A study file of relative localisation: runs, each with a motion and sensors, and what each must reach."""

from __future__ import annotations

import hashlib
import json
import os
from typing import Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from mission.common.problems import MissionError, Problem
from mission.document.load import load_document
from mission.schema.check import validated
from sim_bridge.lab.study.localise.figures import FIGURES, NEES_INSIDE
from sim_bridge.lab.study.localise.sensors import Sensors
from sim_bridge.lab.study.must import STATISTICS


class Motion(BaseModel):
    """How the swarm flies, 3 m/s on average."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["open", "trees"] = "open"  # straight on as one; or our law's flight among trees
    weave_mps: float = Field(default=0.0, ge=0.0, le=2.0)  # rms across the way, in the open
    density_per_ha: float = Field(default=200.0, gt=0.0, le=1000.0)


class Run(BaseModel):
    """One row of the study."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1)
    motion: Motion = Motion()
    sensors: Sensors = Sensors()  # the estimator knows their errors, but not of late ranges
    must: dict[str, dict[str, float]] = {}


class Study(BaseModel):
    """A study file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    localise: Literal[1]  # the version of this kind of study file
    name: str = ""
    size: int = Field(default=8, ge=2, le=16)
    duration_s: float = Field(default=600.0, ge=10.0, le=3600.0)
    seeds: int = Field(default=20, ge=1, le=10_000)
    first_seed: int = Field(default=1000, ge=0)
    paths: int = Field(default=4, ge=1)  # flights among trees; further seeds take the same, with new errors
    bound: bool = True  # solve all measurements at once as well
    run: tuple[Run, ...] = Field(min_length=1)


class Case(NamedTuple):
    """One flight."""

    study: Study
    run: Run
    seed: int

    @property
    def path_seed(self) -> int:
        """Of the flight among trees."""
        first = self.study.first_seed
        return first + (self.seed - first) % self.study.paths

    @property
    def key(self) -> str:
        """Equal for equal flights."""
        study = self.study.model_dump(mode="json", include={"size", "duration_s", "bound"})
        what = [study, self.run.model_dump(mode="json", exclude={"name", "must"}), self.seed, self.path_seed]
        return hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()[:16]


def load(path: str | os.PathLike[str]) -> Study:
    """MissionError with what is wrong, and where."""
    values, place, line_of = load_document(path)
    study = validated(Study, values, place, line_of)
    for index, run in enumerate(study.run):
        for figure, limits in run.must.items():
            at: tuple[str | int, ...] = ("run", index, "must", figure)
            known = (*FIGURES, NEES_INSIDE)
            if figure not in known:
                raise _refused(place, line_of(at), run.name, figure, f"must be one of {', '.join(known)}")
            allowed = ("mean",) if figure == NEES_INSIDE else STATISTICS
            for statistic in limits:
                if statistic not in allowed:
                    raise _refused(place, line_of(at), run.name, statistic, f"must be one of {', '.join(allowed)}")
    return study


def _refused(place: str, line: int | None, run: str, value: str, message: str) -> MissionError:
    return MissionError([Problem(place, line, f"run {run!r}: must", value, message)])
