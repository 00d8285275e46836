"""The neighbour table: which vehicles are heard, how long ago, where they are by now."""

from __future__ import annotations

import pytest

from companion.core.localisation.link_share import SILENCE_MAX_S
from companion.core.localisation.peer_reports import TAKEN_BACK, majority_of
from companion.core.localisation.peer_table import (
    ACCELERATION_MAX_MPS2,
    COAST_S,
    REST_S,
    REST_S2,
    STALE_S,
    TELL_AFTER_S,
    PeerTable,
)
from companion.core.model.beacon import PeerReport
from companion.core.model.states import FlightState, SwarmPhase
from companion.core.model.vectors import ZERO
from mission.common.frames import Vec3
from tests.unit.core.core_kit import heard_beacon, known_of

HERE = (100.0, 50.0, -8.0)


def heard(*beacons_at: tuple[object, float]) -> PeerTable:
    table = PeerTable(size=8)
    for one, at_s in beacons_at:
        assert table.store_beacon(one, HERE, at_s)  # type: ignore[arg-type]
    return table


def test_neighbour_is_known_until_its_beacon_is_stale() -> None:
    table = heard((heard_beacon(2), 10.0))
    assert [n.id for n in table.neighbours(HERE, 10.0 + STALE_S)] == [2]
    assert table.neighbours(HERE, 10.0 + STALE_S + 0.01) == []


def lossy(*, every: int, from_s: float = 10.0, seconds: float = 10.0) -> PeerTable:
    """Of vehicle 2 each `every`-th beacon came, last at `from_s`."""
    table = PeerTable(size=8)
    for k in range(round(seconds * 10.0), -1, -1):
        if k % every == 0:
            at_s = from_s - 0.1 * k
            table.store_beacon(heard_beacon(2, time_ms=round(1e5 + 1e3 * at_s), airborne=True), HERE, at_s)
    return table


def test_neighbour_behind_a_bad_link_is_known_for_longer_and_overdue_when_a_good_one_would_be_silent() -> None:
    table = lossy(every=2)
    (found,) = table.neighbours(HERE, 10.0 + STALE_S)
    assert not found.is_overdue
    assert found.share == pytest.approx(0.5)
    for late_s in (STALE_S + 0.01, SILENCE_MAX_S - 0.01):
        assert [n.is_overdue for n in table.neighbours(HERE, 10.0 + late_s)] == [True]
        assert table.silent_airborne(HERE, 10.0 + late_s, range_m=50.0) == {}
    assert table.neighbours(HERE, 10.0 + SILENCE_MAX_S + 0.01) == []
    assert list(table.silent_airborne(HERE, 10.0 + SILENCE_MAX_S + 0.01, range_m=50.0)) == [2]


def test_who_is_asked_about_a_neighbour_that_is_overdue_does_not_say_that_it_hears_it() -> None:
    """Such words of a majority end others' alarms."""
    for late_s, answers in ((STALE_S, True), (STALE_S + 0.3, False)):
        table, now_s = lossy(every=2), 10.0 + late_s
        table.store_report(3, PeerReport(2, (5.0, 0.0, 0.0), 2.0, silent=True), HERE, now_s)
        found = table.select_report({}, table.neighbours(HERE, now_s), HERE, now_s)
        assert (found is not None and not found.silent) is answers


def test_neighbour_of_a_good_link_is_silent_as_soon_as_ever() -> None:
    table = lossy(every=1)
    assert [n.is_overdue for n in table.neighbours(HERE, 10.0 + STALE_S)] == [False]
    assert table.neighbours(HERE, 10.0 + STALE_S + 0.01) == []


def test_neighbours_come_by_ascending_id_whatever_order_they_were_heard_in() -> None:
    table = heard((heard_beacon(7), 0.0), (heard_beacon(3), 0.1), (heard_beacon(5), 0.2))
    assert [n.id for n in table.neighbours(HERE, 0.2)] == [3, 5, 7]


def test_age_is_the_local_time_since_arrival() -> None:
    (found,) = heard((heard_beacon(2, time_ms=999_999), 10.0)).neighbours(HERE, 10.25)
    assert found.age_s == pytest.approx(0.25)


def test_neighbour_is_carried_on_by_its_velocity() -> None:
    table = heard((heard_beacon(2, rel_ned_m=(10.0, 0.0, 0.0), vel_ned_mps=(1.0, -2.0, 0.5)), 10.0))
    (found,) = table.neighbours(HERE, 10.4)
    assert found.rel_ned_m == pytest.approx((10.4, -0.8, 0.2))


def test_own_movement_shortens_the_way_to_a_neighbour() -> None:
    (found,) = heard((heard_beacon(2, rel_ned_m=(10.0, 0.0, 0.0)), 10.0)).neighbours((103.0, 51.0, -9.0), 10.1)
    assert found.rel_ned_m == pytest.approx((7.0, -1.0, 1.0))


def test_only_differences_of_the_own_position_count() -> None:
    far, near = PeerTable(size=8), PeerTable(size=8)
    for table, shift in ((far, 4096.0), (near, 0.0)):
        table.store_beacon(heard_beacon(2, vel_ned_mps=(1.0, 0.0, 0.0)), (shift, 0.0, 0.0), 0.0)
    (seen_far,), (seen_near,) = far.neighbours((4097.5, 0.0, 0.0), 0.3), near.neighbours((1.5, 0.0, 0.0), 0.3)
    assert known_of(seen_far) == known_of(seen_near)


def test_destination_is_the_neighbours_word_less_the_own_movement() -> None:
    """The destination stands still: the neighbour's velocity does not carry it along."""
    table = heard(
        (heard_beacon(2, rel_ned_m=(10.0, 0.0, 0.0), dest_ned_m=(50.0, 5.0, -0.25), vel_ned_mps=(3.0, 0.0, 0.0)), 0.0)
    )
    (found,) = table.neighbours((102.0, 49.0, -8.5), 0.4)
    assert found.dest_ned_m == pytest.approx((58.0, 6.0, 0.25))


def test_neighbour_that_knows_no_destination_tells_none() -> None:
    (found,) = heard((heard_beacon(2), 0.0)).neighbours(HERE, 0.0)
    assert found.dest_ned_m is None


@pytest.mark.parametrize("time_ms", [1000, 999, 0], ids=["repeated", "overtaken", "far older"])
def test_repeated_or_overtaken_beacon_is_refused(time_ms: int) -> None:
    table = heard((heard_beacon(2, time_ms=1000, rel_ned_m=(10.0, 0.0, 0.0)), 10.0))
    assert not table.store_beacon(heard_beacon(2, time_ms=time_ms, rel_ned_m=(99.0, 0.0, 0.0)), HERE, 10.1)
    (found,) = table.neighbours(HERE, 10.2)
    assert found.rel_ned_m == (10.0, 0.0, 0.0)
    assert found.age_s == pytest.approx(0.2)


def test_newer_beacon_replaces_the_older() -> None:
    table = heard(
        (heard_beacon(2, time_ms=1000), 10.0), (heard_beacon(2, time_ms=1100, rel_ned_m=(9.0, 0.0, 0.0)), 10.1)
    )
    (found,) = table.neighbours(HERE, 10.1)
    assert found.rel_ned_m == (9.0, 0.0, 0.0)


def test_clocks_of_different_senders_are_never_compared() -> None:
    table = heard((heard_beacon(2, time_ms=4_000_000_000), 10.0))
    assert table.store_beacon(heard_beacon(3, time_ms=1), HERE, 10.0)


def test_sender_restarted_with_its_clock_at_zero_is_heard_again_once_stale() -> None:
    table = heard((heard_beacon(2, time_ms=500_000), 10.0))
    assert not table.store_beacon(heard_beacon(2, time_ms=50), HERE, 10.0 + STALE_S)
    assert table.store_beacon(heard_beacon(2, time_ms=150), HERE, 10.0 + STALE_S + 0.1)


def silent(table: PeerTable, now_s: float, *, here: Vec3 = HERE, range_m: float = 30.0) -> dict[int, Vec3]:
    return {k: s.rel_ned_m for k, s in table.silent_airborne(here, now_s, range_m=range_m).items()}


def test_neighbour_that_falls_silent_in_the_air_hangs_where_it_coasted_to() -> None:
    table = heard((heard_beacon(2, airborne=True, rel_ned_m=(10.0, 0.0, 0.0), vel_ned_mps=(2.0, 0.0, 0.0)), 10.0))
    assert silent(table, 10.0 + STALE_S) == {}
    assert silent(table, 15.0) == {2: pytest.approx((10.0 + 2.0 * COAST_S, 0.0, 0.0))}
    assert silent(table, 25.0)[2][0] == pytest.approx(10.0 + COAST_S + REST_S)  # half way there
    assert silent(table, 30.0) == {2: pytest.approx((10.0 + 2.0 * REST_S, 0.0, 0.0))}
    assert silent(table, 30.0, here=(105.0, 50.0, -8.0)) == {2: pytest.approx((5.0 + 2.0 * REST_S, 0.0, 0.0))}


def test_neighbour_that_falls_silent_while_it_gains_speed_hangs_farther_on() -> None:
    """Killed at 2 m/s, on its way to more or to rest."""
    for gain_mps2 in (2.0, -2.0):
        table = PeerTable(size=8)
        for k in range(11):
            back_s = 0.1 * (10 - k)
            way_m = 2.0 * back_s - 0.5 * gain_mps2 * back_s**2
            said = heard_beacon(
                2,
                time_ms=1000 + 100 * k,
                airborne=True,
                rel_ned_m=(10.0 - way_m, 0.0, 0.0),
                vel_ned_mps=(2.0 - gain_mps2 * back_s, 0.0, 0.0),
            )
            table.store_beacon(said, HERE, 10.0 - back_s)
        rest_m = 2.0 * REST_S + gain_mps2 * REST_S2
        assert silent(table, 30.0)[2] == pytest.approx((10.0 + rest_m, 0.0, 0.0), abs=0.1)


def test_acceleration_that_nobody_has_moves_no_silent_vehicle_farther_than_it_could_have_flown() -> None:
    table = PeerTable(size=8, speed_max_mps=5.0)
    for k in range(2):
        velocity = (-5.0 + 10.0 * k, 0.0, 0.0)
        said = heard_beacon(2, time_ms=1000 + 100 * k, airborne=True, rel_ned_m=(10.0, 0.0, 0.0), vel_ned_mps=velocity)
        table.store_beacon(said, HERE, 10.0 + 0.1 * k)
    assert silent(table, 30.0)[2][0] <= 10.0 + 5.0 * REST_S + ACCELERATION_MAX_MPS2 * REST_S2


def test_acceleration_is_not_taken_over_a_silence() -> None:
    table = PeerTable(size=8, corrects_velocity=False)
    for time_ms, speed_mps in ((1000, 0.0), (1600, 2.0)):
        said = heard_beacon(
            2, time_ms=time_ms, airborne=True, rel_ned_m=(10.0, 0.0, 0.0), vel_ned_mps=(speed_mps, 0.0, 0.0)
        )
        table.store_beacon(said, HERE, 9.0 + time_ms / 1000.0)
    assert silent(table, 40.0) == {2: pytest.approx((10.0 + 2.0 * REST_S, 0.0, 0.0))}


def test_neighbour_that_fell_silent_stays_an_obstacle_until_it_is_heard_again() -> None:
    table = heard((heard_beacon(2, airborne=True), 10.0))
    assert list(silent(table, 10_000.0)) == [2]
    table.store_beacon(heard_beacon(2, airborne=True, time_ms=5), HERE, 10_000.0)
    assert silent(table, 10_000.0) == {}
    assert [n.id for n in table.neighbours(HERE, 10_000.0)] == [2]


@pytest.mark.parametrize(("own_range_m", "its_range_m"), [(30.0, 55.0), (55.0, 30.0), (30.0, 30.0)])
def test_neighbour_that_falls_silent_near_the_end_of_the_range_has_left_it(
    own_range_m: float, its_range_m: float
) -> None:
    for distance_m, count in ((28.4, 1), (28.6, 0)):
        table = heard((heard_beacon(2, airborne=True, rel_ned_m=(0.0, distance_m, 0.0), range_m=its_range_m), 10.0))
        assert len(silent(table, 20.0, range_m=own_range_m)) == count


def test_neighbour_that_falls_silent_on_the_ground_is_not_in_the_way() -> None:
    table = heard((heard_beacon(2, airborne=False), 10.0))
    assert silent(table, 20.0) == {}


@pytest.mark.parametrize(
    ("state", "phase", "grounded"),
    [
        (FlightState.READY, SwarmPhase.ASSEMBLE, False),  # it may be flying somewhere by now
        (FlightState.TAKING_OFF, SwarmPhase.GATHER, False),
        (FlightState.LANDED, SwarmPhase.GATHER, True),
        (FlightState.READY, SwarmPhase.TRANSIT, True),  # the swarm has left without it
    ],
)
def test_who_has_landed_is_told_from_who_may_have_taken_off(
    state: FlightState, phase: SwarmPhase, grounded: bool
) -> None:
    table = heard((heard_beacon(2, airborne=False, state=state, phase=phase), 10.0))
    assert table.contacts().grounded() == (0b10 if grounded else 0)
    assert heard((heard_beacon(2, airborne=True, state=state, phase=phase), 10.0)).contacts().grounded() == 0


@pytest.mark.parametrize("state", [FlightState.READY, FlightState.TAKING_OFF])
def test_one_that_falls_silent_as_the_swarm_takes_off_may_be_at_every_height(state: FlightState) -> None:
    table = heard((heard_beacon(2, airborne=False, state=state, rel_ned_m=(10.0, 0.0, 7.0)), 10.0))
    assert silent(table, 20.0) == {}
    found = table.silent_airborne(HERE, 20.0, range_m=30.0, launched=True)
    assert found[2].rel_ned_m == (10.0, 0.0, 0.0)
    assert table.contacts().ready(14.9) == 0b10
    assert table.contacts().ready(15.1) == 0


@pytest.mark.parametrize("state", [FlightState.TAKING_OFF, FlightState.LANDING])
def test_one_that_falls_silent_on_its_way_up_or_down_is_at_every_height(state: FlightState) -> None:
    table = heard((heard_beacon(2, airborne=True, state=state, rel_ned_m=(10.0, 0.0, 7.0)), 10.0))
    assert silent(table, 20.0) == {2: (10.0, 0.0, 0.0)}


# --- what others tell ---


def told(vehicle: int, rel: Vec3 = (8.0, 0.0, 0.0), *, age_s: float = 5.0, silent: bool = True) -> PeerReport:
    return PeerReport(vehicle, rel, age_s, silent)


def test_silent_vehicle_that_only_others_heard_is_an_obstacle_too() -> None:
    table = PeerTable(size=8)
    table.store_report(1, told(3), HERE, 100.0)
    assert silent(table, 100.0) == {3: (8.0, 0.0, 0.0)}
    assert silent(table, 900.0, here=(101.0, 50.0, -8.0)) == {3: (7.0, 0.0, 0.0)}


def test_one_that_left_the_range_is_an_obstacle_when_a_nearer_one_says_that_it_fell_silent() -> None:
    table = heard((heard_beacon(3, airborne=True, rel_ned_m=(0.0, 29.0, 0.0)), 95.0))
    assert silent(table, 100.0) == {}
    table.store_report(1, told(3, (0.0, 28.0, 0.0), age_s=4.9), HERE, 100.0)
    assert silent(table, 100.0) == {3: (0.0, 28.0, 0.0)}


def test_who_is_heard_is_not_silent_whatever_others_say() -> None:
    table = heard((heard_beacon(3, airborne=True), 100.0))
    table.store_report(1, told(3), HERE, 100.1)
    assert silent(table, 100.2) == {}


def test_one_that_this_vehicle_lost_is_an_obstacle_until_a_majority_has_heard_it_since() -> None:
    table = heard((heard_beacon(3, airborne=True), 95.0))
    for k in range(majority_of(8)):
        assert list(silent(table, 100.0)) == [3]
        table.store_report(4 + k, told(3, age_s=0.1, silent=False), HERE, 100.0)
    assert silent(table, 100.0) == {}
    table.store_beacon(heard_beacon(3, airborne=True, time_ms=5000), HERE, 104.0)
    assert list(silent(table, 110.0)) == [3]


def test_where_a_later_word_has_a_vehicle_hover_elsewhere_both_places_are_obstacles() -> None:
    """It was heard here last at one place, and by another later at another."""
    table = heard((heard_beacon(3, airborne=True, rel_ned_m=(10.0, 0.0, 0.0)), 90.0))
    table.store_report(1, told(3, (0.0, 20.0, 0.0)), HERE, 100.0)
    found = table.silent_airborne(HERE, 100.0, range_m=30.0)[3]
    assert (found.rel_ned_m, found.elsewhere, found.received) == ((10.0, 0.0, 0.0), ((0.0, 20.0, 0.0),), False)


def test_what_others_heard_before_this_vehicle_did_is_no_place_of_it() -> None:
    table = heard((heard_beacon(3, airborne=True, rel_ned_m=(10.0, 0.0, 0.0)), 99.0))
    table.store_report(1, told(3, (0.0, 20.0, 0.0)), HERE, 100.0)
    assert table.silent_airborne(HERE, 101.0, range_m=30.0)[3].elsewhere == ()


def test_one_that_falls_silent_after_it_was_seen_alive_is_an_obstacle() -> None:
    table = PeerTable(size=8)
    table.store_report(1, told(3, age_s=0.1, silent=False), HERE, 100.0)
    table.store_report(1, told(3, age_s=TELL_AFTER_S, silent=True), HERE, 100.0 + TELL_AFTER_S)
    assert list(silent(table, 102.0)) == [3]


def test_silence_is_passed_on_when_it_is_no_burst_of_losses_any_more() -> None:
    table = heard((heard_beacon(2, airborne=True), 10.0))
    for now_s, passed_on in ((10.0 + TELL_AFTER_S - 0.1, False), (10.0 + TELL_AFTER_S + 0.1, True)):
        found = table.silent_airborne(HERE, now_s, range_m=30.0)
        said = table.select_report(found, [], HERE, now_s)
        assert (said is not None) is passed_on
    assert said is not None
    assert (said.vehicle, said.silent) == (2, True)


def test_several_silent_ones_are_told_in_turn() -> None:
    table = heard(*((heard_beacon(k, airborne=True), 10.0) for k in (2, 5, 9)))
    found = table.silent_airborne(HERE, 20.0, range_m=30.0)
    turn = [table.select_report(found, [], HERE, 20.0) for _ in range(6)]
    assert [said.vehicle for said in turn if said is not None] == [2, 5, 9, 2, 5, 9]


def test_one_called_silent_that_is_heard_here_is_answered_for_a_while() -> None:
    table = heard((heard_beacon(3, airborne=True), 100.0))
    table.store_report(1, told(3), HERE, 100.1)
    answer = table.select_report({}, table.neighbours(HERE, 100.2), HERE, 100.2)
    assert answer is not None
    assert (answer.vehicle, answer.silent) == (3, False)
    table.store_beacon(heard_beacon(3, airborne=True, time_ms=5000), HERE, 104.0)
    assert table.select_report({}, table.neighbours(HERE, 104.0), HERE, 104.0) is None


def test_answer_is_passed_on_by_those_that_a_majority_told_and_by_nobody_else() -> None:
    table = PeerTable(size=8)
    table.store_report(1, told(3), HERE, 100.0)
    for k in range(majority_of(8)):
        assert table.select_report({}, [], HERE, 100.1) is None
        table.store_report(4 + k, told(3, (9.0, 0.0, 0.0), age_s=0.2, silent=False), HERE, 100.1)
    said = table.select_report({}, [], HERE, 100.2)
    assert said is not None
    assert (said.vehicle, said.silent, said.relays, said.rel_ned_m) == (3, False, 1, (9.0, 0.0, 0.0))


def test_alarm_that_was_told_on_is_taken_back_when_there_is_no_place_any_more() -> None:
    table = PeerTable(size=8)
    table.store_report(1, told(3), HERE, 100.0)
    said = table.select_report(table.silent_airborne(HERE, 100.1, range_m=30.0), [], HERE, 100.1)
    assert said is not None
    assert (said.silent, said.relays) == (True, 1)
    table.store_report(1, told(3, age_s=0.1, silent=False), HERE, 100.2)
    said = table.select_report(table.silent_airborne(HERE, 100.3, range_m=30.0), [], HERE, 100.3)
    assert said is not None
    assert (said.vehicle, said.silent, said.relays) == (3, False, TAKEN_BACK)


# --- beacons that are rare, and velocities that lie ---


def test_rare_beacons_are_not_stale_before_some_are_missed() -> None:
    table = PeerTable(size=8, beacon_period_s=1.0)
    table.store_beacon(heard_beacon(2), HERE, 10.0)
    assert [n.id for n in table.neighbours(HERE, 12.9)] == [2]
    assert table.neighbours(HERE, 13.1) == []


def test_claimed_velocity_is_corrected_by_how_the_position_changes() -> None:
    table = PeerTable(size=8)
    for k in range(100):  # says that it stands, and comes nearer by 0.4 m/s
        at_s = 10.0 + 0.1 * k
        table.store_beacon(heard_beacon(2, time_ms=100 * (k + 1), rel_ned_m=(20.0 - 0.04 * k, 0.0, 0.0)), HERE, at_s)
    (found,) = table.neighbours(HERE, at_s)
    assert found.vel_ned_mps == pytest.approx((-0.4, 0.0, 0.0), abs=0.03)


def test_nobody_is_faster_than_the_limit_whatever_it_claims() -> None:
    table = PeerTable(size=8, speed_max_mps=5.0)
    table.store_beacon(heard_beacon(2, vel_ned_mps=(60.0, 80.0, 0.0)), HERE, 10.0)
    (found,) = table.neighbours(HERE, 10.1)
    assert found.vel_ned_mps == pytest.approx((3.0, 4.0, 0.0))


def test_table_holds_one_entry_for_each_sender_at_most() -> None:
    table = PeerTable(size=8)
    for k in range(5000):
        table.store_beacon(heard_beacon(k % 255 + 1, time_ms=k), ZERO, k * 0.001)
    assert len(table._heard) == 255
