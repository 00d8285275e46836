"""Stem maps as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mission.common.frames import Wgs84
from mission.common.problems import MissionError, Problem
from mission.document.model import Mission
from mission.stems.stem_map import read_stems

HEADER = "east_m,north_m,dbh_cm,height_m,species\n"
ORIGIN = Wgs84(47.0, 8.0, 400.0)


def problems_of(file: Path, **options: Any) -> tuple[Problem, ...]:
    with pytest.raises(MissionError) as caught:
        read_stems(file, **options)
    return caught.value.problems


def says(file: Path, **options: Any) -> str:
    """The only problem, without its folder."""
    (problem,) = problems_of(file, **options)
    return str(problem).replace(f"{file.parent}/", "")


def mission_with(origin: dict[str, float] | None = None, **forest: Any) -> Mission:
    route = {"d1_enu_m": (0.0, 0.0, 4.0), "d2_enu_m": (60.0, 0.0, 4.0), "vel_leader_mps": 3.0}
    return Mission.model_validate(
        {"schema": 1, "route": route, "origin": origin, "swarm": {"size": 1}, "sensing": {}, "forest": forest}
    )
