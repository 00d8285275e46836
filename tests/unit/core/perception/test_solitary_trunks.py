"""Trunks that may be told to others: solitary, seen often, standing still, in sight."""

from __future__ import annotations

import pytest

from companion.core.perception.landmarks.solitary_trunks import ALONE_M, FRESH_S, SIGHTINGS, find_solitary
from companion.core.perception.landmarks.trunk_tracks import Trunk

NOW_S = 20.0


def trunk(north_m: float, east_m: float, *, sightings: int = SIGHTINGS, seen_s: float = NOW_S) -> Trunk:
    made = Trunk(north_m, east_m, (0.01, 0.0, 0.01), 0.15, 10.0)
    made.sightings, made.seen_s = sightings, seen_s
    return made


def test_one_that_stands_alone_and_was_seen_often_is_told_with_its_diameter() -> None:
    assert find_solitary([trunk(3.0, 4.0)], NOW_S) == [(3.0, 4.0, pytest.approx(0.3))]


def test_one_that_was_seen_too_seldom_or_too_long_ago_is_not() -> None:
    assert find_solitary([trunk(3.0, 4.0, sightings=SIGHTINGS - 1)], NOW_S) == []
    assert find_solitary([trunk(3.0, 4.0, seen_s=NOW_S - FRESH_S - 0.1)], NOW_S) == []


def test_one_whose_sightings_do_not_agree_is_not() -> None:
    wanders = trunk(3.0, 4.0)
    wanders.chi2 = 4.5
    assert find_solitary([wanders], NOW_S) == []


def test_leaves_beside_one_another_are_not_told_whether_they_are_sure_or_not() -> None:
    beside = trunk(3.0 + ALONE_M - 0.1, 4.0, sightings=1)
    assert find_solitary([trunk(3.0, 4.0), beside], NOW_S) == []
    assert len(find_solitary([trunk(3.0, 4.0), trunk(3.0 + ALONE_M + 0.1, 4.0)], NOW_S)) == 2
