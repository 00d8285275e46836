"""Two and three vehicles that meet at one gap between rows of trunks: all come through, and nobody comes too near."""

from __future__ import annotations

import pytest

from tests.bench.meetings import KINDS, meet

HARD_M = 5.0
HULL_M = 0.35
LATEST_S = 75.0  # of 160 drawn ones the last was through after 67.5 s


@pytest.mark.parametrize("seed", [7000, 7001])
@pytest.mark.parametrize("kind", KINDS)
def test_vehicles_that_meet_at_a_gap_all_come_through(kind: str, seed: int) -> None:
    met = meet(seed, kind=kind)
    assert met.through_s is not None
    assert met.through_s < LATEST_S
    assert met.least_m > HARD_M
    assert met.bark_m > HULL_M
