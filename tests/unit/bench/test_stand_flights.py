"""Drawn surveys whose maps are compared: their missions, and errors of place that stems have in common."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench.stand_flights import STARTS_M, Case, mission_of, relative_m
from tests.bench.stand_map import compare


@pytest.mark.parametrize("gnss", ["all", "leader"])
def test_missions_are_valid_and_drawn(gnss: str) -> None:
    flown = [mission_of(Case(400.0, len(STARTS_M), gnss, seed)) for seed in (61, 62)]
    assert [mission.swarm.gnss for mission, _ in flown] == [gnss] * 2
    assert flown[0][1] != flown[1][1]


def test_what_stems_side_by_side_have_in_common_is_no_relative_error() -> None:
    """Two groups far apart, each shifted alike, one stem of the second by 0.3 m more."""
    trees = np.array([(x, y, 0.3) for x in (0.0, 60.0) for y in (0.0, 4.0, 8.0)])
    told = np.column_stack((trees, np.full(6, 0.01)))
    told[:3, 0] += 0.5
    told[3:, 1] -= 0.4
    told[5, 0] += 0.3
    off_m = relative_m(compare(told, trees))
    assert off_m[:5] == pytest.approx(np.zeros((5, 2)))
    assert off_m[5] == pytest.approx([0.3, 0.0])
