"""Beacons for which their sender does not vouch: where a vehicle was when it last did, it may hover still."""

from __future__ import annotations

import pytest

from companion.core.localisation.peer_table import TELL_AFTER_S, PeerTable
from companion.core.model.events import HeardBeacon
from companion.core.model.states import FlightState, SwarmPhase
from companion.core.perception.obstacle_cloud import find_hovering
from mission.common.frames import Vec3
from tests.unit.core.core_kit import beacon

HERE = (100.0, 50.0, -8.0)
THERE, ELSEWHERE = (6.0, 0.0, 0.0), (30.0, 0.0, 0.0)


def hear(table: PeerTable, rel_ned_m: Vec3, at_s: float, *, is_vouched: bool, **says: object) -> None:
    said = beacon(2, time_ms=round(1000.0 * at_s), **says)
    assert table.store_beacon(HeardBeacon(said, rel_ned_m, is_vouched=is_vouched), HERE, at_s)


def spoken_for(*, until_s: float = 20.0, **says: object) -> PeerTable:
    """Vehicle 2 was heard until 10 s; then a member speaks in its name, of another place."""
    table = PeerTable(size=8)
    for k in range(50):
        hear(table, THERE, 5.0 + 0.1 * (k + 1), is_vouched=True, airborne=True)
    for k in range(round(10.0 * (until_s - 10.0))):
        hear(table, ELSEWHERE, 10.1 + 0.1 * k, is_vouched=False, **{"airborne": True, **says})
    return table


def silent_at(table: PeerTable, now_s: float) -> dict[int, Vec3]:
    return {k: seen.rel_ned_m for k, seen in table.silent_airborne(HERE, now_s, range_m=50.0).items()}


def test_where_it_was_it_may_hover_still_and_what_is_told_of_it_is_kept_clear_of_too() -> None:
    table = spoken_for()
    assert silent_at(table, 20.0)[2] == pytest.approx(THERE, abs=0.5)
    assert [n.rel_ned_m for n in table.neighbours(HERE, 20.0)] == [pytest.approx(ELSEWHERE, abs=0.5)]


def test_what_is_told_in_its_name_does_not_take_its_place_among_those_that_hover() -> None:
    table = spoken_for(state=FlightState.RELEASED)
    silent = table.silent_airborne(HERE, 20.0, range_m=50.0)
    neighbours = table.neighbours(HERE, 20.0)
    assert neighbours[0].stands
    assert find_hovering(silent, neighbours)[2].rel_ned_m == pytest.approx(THERE, abs=0.5)


def test_a_landing_that_it_does_not_vouch_for_grounds_it_not() -> None:
    table = spoken_for(airborne=False, state=FlightState.LANDED, phase=SwarmPhase.TRANSIT)
    assert table.contacts().grounded() == 0
    assert list(silent_at(table, 20.0)) == [2]


def test_whoever_is_asked_tells_that_it_is_silent_not_that_it_is_heard() -> None:
    table = spoken_for()
    silent = table.silent_airborne(HERE, 20.0, range_m=50.0)
    assert silent[2].age_s > TELL_AFTER_S
    told = table.select_report(silent, table.neighbours(HERE, 20.0), HERE, 20.0)
    assert told is not None
    assert told.silent


def test_once_it_vouches_again_it_is_where_it_says() -> None:
    table = spoken_for()
    hear(table, ELSEWHERE, 20.1, is_vouched=True, airborne=True)
    assert silent_at(table, 20.2) == {}


def test_the_first_that_is_heard_of_one_needs_no_place_before() -> None:
    table = PeerTable(size=8)
    hear(table, THERE, 10.0, is_vouched=False, airborne=True)
    assert silent_at(table, 10.1) == {}
    assert list(silent_at(table, 12.0)) == [2]
