"""Reads a study file, of whichever kind: of flights (`schema = 1`), or of the estimator (`localise = 1`)."""

from __future__ import annotations

import os
from pathlib import Path

from mission.common.files import refused
from mission.common.problems import MissionError, Problem, shown
from mission.document.load import load_document
from mission.schema.check import LineOf, validated
from sim_bridge.lab.study.case import Case, LoadedStudy
from sim_bridge.lab.study.case import Study as AnyStudy
from sim_bridge.lab.study.crossing import Reader
from sim_bridge.lab.study.localise.spec import KIND, check_limits, cross
from sim_bridge.lab.study.localise.spec import Study as EstimatorStudy
from sim_bridge.lab.study.spec import Study


def load_study(path: str | os.PathLike[str], *, most_seeds: int | None = None) -> LoadedStudy:
    """The study in the TOML file `path`; MissionError with what is wrong, and where.

    `most_seeds`: of each case at most so many, the first ones.
    """
    values, place, line_of = load_document(path)
    if "route" in values:  # rather than that each of its keys is unknown
        told = 'is a mission, and no study: `sim-bridge fly` flies it, and a study names it: missions = ["FILE"]'
        raise refused(place, None, told)
    study: AnyStudy
    cases: tuple[Case, ...]
    if KIND in values:
        study = of_estimator = validated(EstimatorStudy, values, place, line_of)
        _check_names(study, place, line_of)
        check_limits(of_estimator, place, line_of)
        cases = tuple(cross(of_estimator, most_seeds))
    else:
        study = of_flights = validated(Study, values, place, line_of)
        _check_names(study, place, line_of)
        cases = tuple(Reader(of_flights, Path(path).parent, place, line_of, most_seeds).cases())
    return LoadedStudy(study, tuple({case.key: case for case in cases}.values()))


def _check_names(study: AnyStudy, place: str, line_of: LineOf) -> None:
    """MissionError for a name that two runs have: their rows would be one case, judged by the limits of one of them."""
    names: list[str] = []
    for index, run in enumerate(study.run):
        if run.name in names:
            line, key = line_of(("run", index, "name")), f"run[{index}].name"
            raise MissionError([Problem(place, line, key, shown(run.name), "is another run's: must be new")])
        names.append(run.name)
