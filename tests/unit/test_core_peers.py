"""The neighbour table: who is heard, how old it is, where it is by now."""

from __future__ import annotations

import pytest
from core_kit import beacon

from companion.core.peers import COAST_S, FALLEN_S, STALE_S, PeerTable
from companion.core.types import ZERO

HERE = (100.0, 50.0, -8.0)


def heard(*beacons_at: tuple[object, float]) -> PeerTable:
    table = PeerTable()
    for one, at_s in beacons_at:
        assert table.hear(one, HERE, at_s)  # type: ignore[arg-type]
    return table


def test_neighbour_is_known_until_its_beacon_is_stale() -> None:
    table = heard((beacon(2), 10.0))
    assert [n.id for n in table.neighbours(HERE, 10.0 + STALE_S)] == [2]
    assert table.neighbours(HERE, 10.0 + STALE_S + 0.01) == []


def test_neighbours_come_by_ascending_id_whatever_order_they_were_heard_in() -> None:
    table = heard((beacon(7), 0.0), (beacon(3), 0.1), (beacon(5), 0.2))
    assert [n.id for n in table.neighbours(HERE, 0.2)] == [3, 5, 7]


def test_age_is_the_local_time_since_arrival() -> None:
    (found,) = heard((beacon(2, time_ms=999_999), 10.0)).neighbours(HERE, 10.25)
    assert found.age_s == pytest.approx(0.25)


def test_neighbour_is_carried_on_by_its_velocity() -> None:
    table = heard((beacon(2, rel_ned_m=(10.0, 0.0, 0.0), vel_ned_mps=(1.0, -2.0, 0.5)), 10.0))
    (found,) = table.neighbours(HERE, 10.4)
    assert found.rel_ned_m == pytest.approx((10.4, -0.8, 0.2))


def test_own_movement_shortens_the_way_to_a_neighbour() -> None:
    (found,) = heard((beacon(2, rel_ned_m=(10.0, 0.0, 0.0)), 10.0)).neighbours((103.0, 51.0, -9.0), 10.1)
    assert found.rel_ned_m == pytest.approx((7.0, -1.0, 1.0))


def test_only_differences_of_the_own_position_count() -> None:
    far, near = PeerTable(), PeerTable()
    for table, shift in ((far, 4096.0), (near, 0.0)):
        table.hear(beacon(2, vel_ned_mps=(1.0, 0.0, 0.0)), (shift, 0.0, 0.0), 0.0)
    assert far.neighbours((4097.5, 0.0, 0.0), 0.3) == near.neighbours((1.5, 0.0, 0.0), 0.3)


def test_destination_is_the_neighbours_word_less_the_own_movement() -> None:
    """The destination stands still: the neighbour's velocity does not carry it along."""
    table = heard(
        (beacon(2, rel_ned_m=(10.0, 0.0, 0.0), dest_ned_m=(50.0, 5.0, -0.25), vel_ned_mps=(3.0, 0.0, 0.0)), 0.0)
    )
    (found,) = table.neighbours((102.0, 49.0, -8.5), 0.4)
    assert found.dest_ned_m == pytest.approx((58.0, 6.0, 0.25))


def test_neighbour_that_knows_no_destination_tells_none() -> None:
    (found,) = heard((beacon(2), 0.0)).neighbours(HERE, 0.0)
    assert found.dest_ned_m is None


@pytest.mark.parametrize("time_ms", [1000, 999, 0], ids=["repeated", "overtaken", "far older"])
def test_repeated_or_overtaken_beacon_is_refused(time_ms: int) -> None:
    table = heard((beacon(2, time_ms=1000, rel_ned_m=(10.0, 0.0, 0.0)), 10.0))
    assert not table.hear(beacon(2, time_ms=time_ms, rel_ned_m=(99.0, 0.0, 0.0)), HERE, 10.1)
    (found,) = table.neighbours(HERE, 10.2)
    assert found.rel_ned_m == (10.0, 0.0, 0.0)
    assert found.age_s == pytest.approx(0.2)


def test_newer_beacon_replaces_the_older() -> None:
    table = heard((beacon(2, time_ms=1000), 10.0), (beacon(2, time_ms=1100, rel_ned_m=(9.0, 0.0, 0.0)), 10.1))
    (found,) = table.neighbours(HERE, 10.1)
    assert found.rel_ned_m == (9.0, 0.0, 0.0)


def test_clocks_of_different_senders_are_never_compared() -> None:
    table = heard((beacon(2, time_ms=4_000_000_000), 10.0))
    assert table.hear(beacon(3, time_ms=1), HERE, 10.0)


def test_sender_restarted_with_its_clock_at_zero_is_heard_again_once_stale() -> None:
    table = heard((beacon(2, time_ms=500_000), 10.0))
    assert not table.hear(beacon(2, time_ms=50), HERE, 10.0 + STALE_S)
    assert table.hear(beacon(2, time_ms=150), HERE, 10.0 + STALE_S + 0.1)


def test_neighbour_that_falls_silent_in_the_air_is_kept_clear_of_where_it_coasted_to() -> None:
    table = heard((beacon(2, airborne=True, rel_ned_m=(10.0, 0.0, 0.0), vel_ned_mps=(2.0, 0.0, 0.0)), 10.0))
    assert table.fallen(HERE, 10.0 + STALE_S, range_m=30.0) == []
    assert table.fallen(HERE, 30.0, range_m=30.0) == [pytest.approx((10.0 + 2.0 * COAST_S, 0.0, 0.0))]
    assert table.fallen((105.0, 50.0, -8.0), 30.0, range_m=30.0) == [pytest.approx((5.0 + 2.0 * COAST_S, 0.0, 0.0))]


@pytest.mark.parametrize(("own_range_m", "its_range_m"), [(30.0, 55.0), (55.0, 30.0), (30.0, 30.0)])
def test_neighbour_that_falls_silent_near_the_end_of_the_range_has_left_it(
    own_range_m: float, its_range_m: float
) -> None:
    for distance_m, fallen in ((26.9, 1), (27.1, 0)):
        table = heard((beacon(2, airborne=True, rel_ned_m=(0.0, distance_m, 0.0), range_m=its_range_m), 10.0))
        assert len(table.fallen(HERE, 20.0, range_m=own_range_m)) == fallen


def test_neighbour_that_falls_silent_on_the_ground_is_not_in_the_way() -> None:
    assert heard((beacon(2, airborne=False), 10.0)).fallen(HERE, 20.0, range_m=30.0) == []


def test_fallen_neighbour_that_speaks_again_is_a_neighbour_again() -> None:
    table = heard((beacon(2, airborne=True), 10.0))
    table.hear(beacon(2, airborne=True, time_ms=5), HERE, 20.0)
    assert table.fallen(HERE, 20.0, range_m=30.0) == []
    assert [n.id for n in table.neighbours(HERE, 20.0)] == [2]


def test_fallen_neighbour_is_forgotten_at_last() -> None:
    table = heard((beacon(2, airborne=True), 10.0))
    table.forget(10.0 + FALLEN_S)
    assert len(table.fallen(HERE, 10.0 + FALLEN_S, range_m=30.0)) == 1
    table.forget(10.1 + FALLEN_S)
    assert table.fallen(HERE, 10.1 + FALLEN_S, range_m=30.0) == []


def test_table_holds_one_entry_for_each_sender_at_most() -> None:
    table = PeerTable()
    for k in range(5000):
        table.hear(beacon(k % 255 + 1, time_ms=k), ZERO, k * 0.001)
    assert len(table._heard) == 255
