"""Clearances: who plans or picks a place keeps more than the safety filter cuts at, or vehicles stand cut short."""

from __future__ import annotations

import pytest

from companion.core.perception.obstacle_cloud import ObstacleKind
from companion.core.safety.clearance import ADDED_M, Use, clearance_m

KINDS = sorted({kind for kind, use in ADDED_M if use is Use.FILTER})


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("use", [Use.PLAN, Use.STAY])
def test_nobody_plans_or_stays_nearer_than_the_filter_allows(kind: ObstacleKind, use: Use) -> None:
    if (kind, use) in ADDED_M:
        assert clearance_m(kind, use, 5.0) >= clearance_m(kind, Use.FILTER, 5.0)


@pytest.mark.parametrize("kind", [ObstacleKind.SILENT, ObstacleKind.HOVERING])
def test_place_to_stay_in_is_beyond_what_others_pass_it_at(kind: ObstacleKind) -> None:
    assert clearance_m(kind, Use.STAY, 5.0) > clearance_m(kind, Use.PLAN, 5.0)


def test_course_past_one_that_is_heard_holds_when_it_falls_silent() -> None:
    heard = clearance_m(ObstacleKind.HOVERING, Use.PLAN, 5.0)
    assert heard > clearance_m(ObstacleKind.SILENT, Use.FILTER, 5.0)


def test_use_that_nobody_has_is_refused() -> None:
    with pytest.raises(KeyError):
        clearance_m(ObstacleKind.HIDDEN, Use.FILTER)
