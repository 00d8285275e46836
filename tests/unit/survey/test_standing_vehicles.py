"""Places where vehicles stand in the air: held for a while, bounded, and moved with the vehicle."""

from __future__ import annotations

from companion.survey.standing_vehicles import APART_M, HELD_S, PLACES_MAX, StandingVehicles


def test_a_place_counts_as_far_as_a_hull_may_be_off() -> None:
    standing = StandingVehicles()
    standing.note([(5.0, -3.0)], 0.0)
    assert standing.is_near(5.0, -3.0 + 0.99 * APART_M)
    assert not standing.is_near(5.0, -3.0 + 1.01 * APART_M)
    assert not StandingVehicles().is_near(5.0, -3.0)


def test_a_place_that_is_told_no_more_is_held_for_a_while() -> None:
    standing = StandingVehicles()
    standing.note([(5.0, -3.0)], 0.0)
    standing.note([], HELD_S)
    assert standing.is_near(5.0, -3.0)
    standing.note([], HELD_S + 0.1)
    assert not standing.is_near(5.0, -3.0)


def test_a_vehicle_that_drifts_has_its_newest_place() -> None:
    standing = StandingVehicles()
    for k in range(20):
        standing.note([(5.0 + 0.2 * k, 0.0)], 0.05 * k)
    assert standing.is_near(5.0 + 3.8, 0.0)
    assert not standing.is_near(5.0, 0.0)


def test_places_are_bounded() -> None:
    standing = StandingVehicles()
    for k in range(PLACES_MAX + 1):
        standing.note([(10.0 * k, 0.0)], 0.05 * k)
    assert not standing.is_near(0.0, 0.0)
    assert standing.is_near(10.0, 0.0)
    assert standing.is_near(10.0 * PLACES_MAX, 0.0)
