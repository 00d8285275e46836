"""A study file of relative localisation: runs, each with a motion and sensors, and what each must reach."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from mission.common.problems import MissionError, Problem
from mission.schema.check import LineOf
from sim_bridge.lab.study.case import Backend, Case
from sim_bridge.lab.study.localise.sensors import Sensors
from sim_bridge.lab.study.results.figures import ESTIMATOR
from sim_bridge.lab.study.results.must import STATISTICS

KIND = "localise"  # the key that such a file has
FILTER = "relative-filter"  # in the place of a law


class Motion(BaseModel):
    """Motion of the swarm, 3 m/s on average."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["open", "trees"] = Field(
        default="open", description="Straight on as one; or our law's flight among trees."
    )
    weave_mps: float = Field(default=0.0, ge=0.0, le=2.0, description="Rms across the way, in the open.")
    density_per_ha: float = Field(default=200.0, gt=0.0, le=1000.0)


class Run(BaseModel):
    """One row of the study."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1, description="For people: heads its rows. No two runs have one.")
    motion: Motion = Motion()
    sensors: Sensors = Field(default=Sensors(), description="The estimator knows their errors, but not of late ranges.")
    must: dict[str, dict[str, float]] = Field(
        default={}, description="What it must reach: figure = { mean, worst, p95 }."
    )


class Study(BaseModel):
    """A study file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    localise: Literal[1] = Field(description="Version of this layout.")
    name: str = Field(default="", description="For people.")
    size: int = Field(default=8, ge=2, le=16, description="Vehicles.")
    duration_s: float = Field(default=600.0, ge=10.0, le=3600.0, description="Of each flight.")
    seeds: int = Field(default=20, ge=1, le=10_000, description="How many, for every run.")
    first_seed: int = Field(default=1000, ge=0, description="The seeds count up from here.")
    paths: int = Field(
        default=4, ge=1, description="Flights among trees; further seeds take the same, with new errors."
    )
    bound: bool = Field(default=True, description="Solve all measurements at once as well.")
    run: tuple[Run, ...] = Field(min_length=1, description="What flies.")


@dataclass(frozen=True, slots=True)
class EstimatorCase(Case):
    """One flight whose measurements the relative filter gets."""

    duration_s: float
    path_seed: int  # of the flight among trees
    bound: bool
    motion: Motion
    sensors: Sensors


def cross(study: Study, most_seeds: int | None = None) -> Iterator[EstimatorCase]:
    """Every flight of the study, of each run at most `most_seeds`."""
    first = study.first_seed
    for run in study.run:
        for seed in range(first, first + min(study.seeds, most_seeds or study.seeds)):
            path_seed = first + (seed - first) % study.paths
            yield EstimatorCase(
                key=_key(study, run, seed, path_seed),
                run=run.name,
                law=FILTER,
                backend=Backend.ESTIMATOR,
                n=study.size,
                seed=seed,
                settings={},
                duration_s=study.duration_s,
                path_seed=path_seed,
                bound=study.bound,
                motion=run.motion,
                sensors=run.sensors,
            )


def _key(study: Study, run: Run, seed: int, path_seed: int) -> str:
    """Equal for equal flights of a run."""
    whole = study.model_dump(mode="json", include={"size", "duration_s", "bound"})
    what = [whole, run.model_dump(mode="json", exclude={"must"}), seed, path_seed]
    return hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()[:16]


def check_limits(study: Study, place: str, line_of: LineOf) -> None:
    """MissionError for a limit of what is no figure, or no statistic of it."""
    known = {figure.name: figure for figure in ESTIMATOR}
    for index, run in enumerate(study.run):
        for name, limits in run.must.items():
            at: tuple[str | int, ...] = ("run", index, "must", name)
            if name not in known:
                raise _refused(place, line_of(at), run.name, name, f"must be one of {', '.join(known)}")
            allowed = STATISTICS if known[name].of_case is None else ("mean",)
            for statistic in limits:
                if statistic not in allowed:
                    raise _refused(place, line_of(at), run.name, statistic, f"must be one of {', '.join(allowed)}")


def _refused(place: str, line: int | None, run: str, value: str, message: str) -> MissionError:
    return MissionError([Problem(place, line, f"run {run!r}: must", value, message)])
