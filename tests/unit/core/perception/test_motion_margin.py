"""More is kept from what is seen the less well the own motion is known."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from companion.core.perception.level_scan import ScanClass
from companion.core.perception.motion_margin import ACTS_S, COVERED_M, POINT_M, find_wider_m, velocity_error_mps
from mission.schema.kinds import SensorClass
from tests.unit.core.perception.scan_kit import FINE, SECTORS


@pytest.mark.parametrize("sensor", SensorClass)
def test_by_trunks_all_around_the_missions_own_margin_covers_what_is_left(sensor: SensorClass) -> None:
    kind = ScanClass(sensor)
    assert find_wider_m(kind, 0.035, COVERED_M) == 0.0
    assert math.hypot(POINT_M, ACTS_S * velocity_error_mps(kind, 0.035)) <= COVERED_M


@pytest.mark.parametrize("sensor", SensorClass)
def test_the_margin_follows_without_a_step(sensor: SensorClass) -> None:
    kind = ScanClass(sensor)
    wider_m = [find_wider_m(kind, 0.002 * k, COVERED_M) for k in range(200)]
    steps_m = [after_m - before_m for before_m, after_m in pairwise(wider_m)]
    assert min(steps_m) >= 0.0
    assert max(steps_m) < 0.005
    assert find_wider_m(kind, math.inf, COVERED_M) == wider_m[-1]
    assert 0.28 < wider_m[-1] < 0.32  # as was kept while nothing told the own motion, before it followed


def test_sectors_that_tell_the_velocity_less_well_get_more() -> None:
    assert find_wider_m(SECTORS, 0.15, COVERED_M) > find_wider_m(FINE, 0.15, COVERED_M) > 0.05


@pytest.mark.parametrize("kind", [FINE, SECTORS])
def test_of_a_smaller_margin_as_much_is_kept_as_of_the_default_where_it_is_needed(kind: ScanClass) -> None:
    assert 0.1 + find_wider_m(kind, 0.2, 0.1) == pytest.approx(COVERED_M + find_wider_m(kind, 0.2, COVERED_M))
    assert find_wider_m(kind, 0.2, 1.5) == find_wider_m(kind, 0.2, COVERED_M)
