"""Coverage beside one that was killed and hovers on the ring: two that keep clear of it leave it a gap."""

from __future__ import annotations

import pytest

from sim_bridge.judge.page.limits import limits
from sim_bridge.judge.verdict import judge
from tests.unit.judge.test_verdict import a_mission, figures, killed

LEAST_DEG = 48.5  # 4 asin(6.3 / 30): of a ring of 15 m whose members keep 5 m, and 1.3 m, from one that is silent


@pytest.mark.parametrize(
    ("gap_deg", "aloft", "is_formed"),
    [
        (LEAST_DEG, True, True),
        (1.09 * LEAST_DEG, True, True),
        (1.11 * LEAST_DEG, True, False),
        (LEAST_DEG, False, False),  # it has come down: nothing keeps them apart
    ],
)
def test_a_gap_about_one_that_hangs_on_the_ring_is_no_more_than_it_must_be(
    gap_deg: float, aloft: bool, is_formed: bool
) -> None:
    """Seed 11037 of the search: eleven of twelve, 52 degrees where 49 were asked for, on a ring of 14 m."""
    up = tuple(k for k in range(1, 9) if aloft or k != 3)
    flown = figures(lost=(3,), aloft=up, coverage_gap_deg=gap_deg, coverage_gap_ideal_deg=30.0)
    verdict = judge(flown, a_mission(), "coverage complete", faults=[killed(3)])
    assert verdict.succeeded is is_formed, verdict.text
    gap = next(limit for limit in limits(flown, a_mission()) if limit.name == "coverage gap")
    assert gap.kept is is_formed


def test_a_gap_that_is_too_wide_even_so_is_told_with_its_limit() -> None:
    flown = figures(lost=(3,), coverage_gap_deg=60.0, coverage_gap_ideal_deg=30.0)
    text = judge(flown, a_mission(), "coverage complete", faults=[killed(3)]).text
    assert text.endswith("coverage not formed: gap 60 deg: must be at most 53 beside one that hovers silent")
