"""Where the neighbours are: whose word counts, and what an operator hears of those that fall silent."""

from __future__ import annotations

import pytest

from companion.core.localisation.gnss_denied.localiser import REPORTS_MAX, GnssDeniedLocaliser
from companion.core.localisation.gnss_localiser import GnssLocaliser
from companion.core.localisation.integrity.range_check import NEAR_M
from companion.core.localisation.localiser import BACKLOG_S, Localiser
from companion.core.localisation.peer_reports import majority_of
from companion.core.localisation.peer_table import RANGE_SLACK, TELL_AFTER_S
from companion.core.localisation.silence_reports import REGAINED_S, SAY_AFTER_S
from companion.core.model.beacon import BeaconEcho, PeerReport, RelativeReport
from companion.core.model.events import Ranges
from companion.core.model.states import FlightState
from tests.unit.core.core_kit import heard_beacon, mission
from tests.unit.core.ranging_kit import ranging_mission

ME = 1
HERE = (100.0, 50.0, -8.0)
MISSION = mission(swarm={"size": 4})
REACH_M = RANGE_SLACK * MISSION.radio.full_range_m


def look(localiser: Localiser, now_s: float) -> None:
    localiser.update_peers(HERE, now_s, range_m=MISSION.radio.full_range_m, launched=True)


def texts(localiser: Localiser) -> list[str]:
    said = [say.text for say in localiser.said]
    localiser.said.clear()
    return said


@pytest.mark.parametrize(("distance_m", "counts"), [(REACH_M - 0.1, True), (REACH_M + 0.1, False), (1e4, False)])
def test_vehicle_that_claims_to_be_beyond_reach_takes_no_part_in_movement(distance_m: float, counts: bool) -> None:
    localiser = GnssLocaliser(MISSION, ME)
    assert localiser.receive_beacon(heard_beacon(2, rel_ned_m=(0.0, distance_m, 0.0)), HERE, 10.0)
    look(localiser, 10.1)
    assert [n.id for n in localiser.neighbours] == ([2] if counts else [])


@pytest.mark.parametrize(("distance_m", "counts"), [(REACH_M - 0.1, True), (REACH_M + 0.1, False), (1e4, False)])
def test_word_of_a_silent_vehicle_counts_within_reach_of_this_one(distance_m: float, counts: bool) -> None:
    localiser = GnssLocaliser(MISSION, ME)
    seen = PeerReport(3, (0.0, distance_m - 10.0, 0.0), 5.0, silent=True)  # from the one that tells
    localiser.receive_beacon(heard_beacon(2, rel_ned_m=(0.0, 10.0, 0.0), sighting=seen), HERE, 10.0)
    look(localiser, 10.1)
    assert list(localiser.silent) == ([3] if counts else [])


@pytest.mark.parametrize("vehicle", [0, ME, 2, MISSION.swarm.size + 1])
def test_word_of_this_vehicle_of_its_teller_or_of_no_member_does_not_count(vehicle: int) -> None:
    localiser = GnssLocaliser(MISSION, ME)
    seen = PeerReport(vehicle, (0.0, 10.0, 0.0), 5.0, silent=True)
    localiser.receive_beacon(heard_beacon(2, rel_ned_m=(0.0, 10.0, 0.0), sighting=seen), HERE, 10.0)
    look(localiser, 20.0)
    assert vehicle not in localiser.silent


def flying(time_ms: int) -> object:
    return heard_beacon(2, time_ms=time_ms, airborne=True, state=FlightState.TRANSIT)


def test_after_its_own_stall_a_companion_calls_none_silent_before_it_has_listened_but_keeps_clear() -> None:
    localiser = GnssLocaliser(MISSION, ME)
    localiser.receive_beacon(flying(1000), HERE, 10.0)
    look(localiser, 10.0)
    localiser.handle_stall(13.0)
    look(localiser, 13.0)
    assert list(localiser.silent) == [2]
    look(localiser, 13.0 + SAY_AFTER_S - 0.05)
    assert texts(localiser) == []
    look(localiser, 13.0 + SAY_AFTER_S)
    assert texts(localiser) == ["vehicle 2 link lost in the air: keeping clear"]


def test_one_that_was_stopped_on_the_ground_is_not_said_to_be_in_the_air_but_kept_clear_of() -> None:
    """It was ready when the swarm took off, so it may be in the air by now."""
    localiser = GnssLocaliser(MISSION, ME)
    localiser.receive_beacon(heard_beacon(2, airborne=False, state=FlightState.READY), HERE, 10.0)
    localiser.receive_beacon(heard_beacon(3, airborne=True, state=FlightState.TAKING_OFF), HERE, 10.0)
    look(localiser, 10.0 + SAY_AFTER_S)
    assert list(localiser.silent) == [2, 3]
    assert texts(localiser) == [
        "vehicle 2 link lost on the ground: keeping clear",
        "vehicle 3 link lost in the air: keeping clear",
    ]


def test_what_has_waited_through_a_stall_is_dropped_whatever_it_says() -> None:
    localiser = GnssLocaliser(MISSION, ME)
    localiser.receive_beacon(flying(1000), HERE, 10.0)
    look(localiser, 10.0)
    assert not localiser.receive_beacon(flying(1100), HERE, 26.0)  # before the tick that finds the stall
    localiser.handle_stall(26.0)
    look(localiser, 26.0)
    assert not localiser.receive_beacon(flying(1200), HERE, 26.0 + BACKLOG_S - 0.05)
    look(localiser, 26.0 + BACKLOG_S - 0.05)
    assert localiser.receive_beacon(flying(17_000), HERE, 26.0 + BACKLOG_S)


def test_stall_does_not_withhold_that_a_vehicle_is_heard_again_nor_say_twice_that_it_is_silent() -> None:
    localiser = GnssLocaliser(MISSION, ME)
    localiser.receive_beacon(flying(1000), HERE, 10.0)
    look(localiser, 10.0 + SAY_AFTER_S)
    assert texts(localiser) == ["vehicle 2 link lost in the air: keeping clear"]
    localiser.handle_stall(13.0)
    for now_s in (13.0, 14.0, 15.0):
        look(localiser, now_s)
    assert texts(localiser) == []
    localiser.handle_stall(16.0)
    for k in range(40):
        now_s = 16.0 + BACKLOG_S + 0.1 * k
        localiser.receive_beacon(flying(6000 + 100 * k), HERE, now_s)
        look(localiser, now_s)
        assert not k * 0.1 < REGAINED_S - 0.01 or texts(localiser) == []
    assert texts(localiser) == ["vehicle 2 link regained"]


def test_who_hears_one_that_is_far_from_here_ends_its_own_alarm_too() -> None:
    """Only a place out of reach is of no account: not the word that it is not there."""
    localiser = GnssLocaliser(MISSION, ME)
    alarm = PeerReport(2, (5.0, 0.0, 0.0), 5.0, silent=True)
    localiser.receive_beacon(heard_beacon(3, time_ms=1000, sighting=alarm), HERE, 10.0)
    look(localiser, 10.0)
    assert list(localiser.silent) == [2]
    hears = PeerReport(2, (2.0 * REACH_M, 0.0, 0.0), 0.1, silent=False)
    localiser.receive_beacon(heard_beacon(3, time_ms=1100, sighting=hears), HERE, 10.1)
    look(localiser, 10.1)
    assert localiser.silent == {}


def test_one_that_a_trunk_hides_from_this_vehicle_alone_is_not_called_silent_to_the_operator() -> None:
    """This one asks when it has not heard it for a while; those that hear it answer."""
    localiser = GnssLocaliser(MISSION, ME)
    localiser.receive_beacon(flying(1000), HERE, 10.0)
    asked_s = 10.0 + TELL_AFTER_S
    look(localiser, asked_s)
    asks = localiser.select_report(HERE, asked_s)
    assert asks is not None
    assert (asks.vehicle, asks.silent) == (2, True)
    answer = PeerReport(2, (5.0, 0.0, 0.0), 0.1, silent=False)
    for k in range(majority_of(MISSION.swarm.size)):
        localiser.receive_beacon(heard_beacon(3 + k, sighting=answer), HERE, asked_s + 0.3)
    for seconds in range(1, 10):
        look(localiser, asked_s + 0.3 + seconds)
        assert localiser.silent == {}
    assert texts(localiser) == []


# --- what is late ---


def delayed(localiser: Localiser, delay_s: float, vel: tuple[float, float, float]) -> None:
    """Vehicle 2 comes from 20 m ahead; both ways take `delay_s`, and it has echoed that."""
    for k in range(10):
        made_s = 0.1 * k
        rel = (20.0 + vel[0] * made_s, 0.0, 0.0)
        echo = BeaconEcho(ME, round(1000.0 * (made_s - delay_s)) & 0xFFFF, 0.0)
        told = heard_beacon(2, rel_ned_m=rel, vel_ned_mps=vel, time_ms=round(1000.0 * made_s) + 500_000, echo=echo)
        assert localiser.receive_beacon(told, HERE, made_s + delay_s)


@pytest.mark.parametrize("delay_s", [0.1, 0.3])
def test_a_neighbour_is_where_it_has_flown_to_since_it_told(delay_s: float) -> None:
    localiser = GnssLocaliser(MISSION, ME)
    delayed(localiser, delay_s, (-3.0, 0.0, 0.0))
    now_s = 0.9 + delay_s + 0.05
    look(localiser, now_s)
    (there,) = localiser.neighbours
    assert there.rel_ned_m[0] == pytest.approx(20.0 - 3.0 * now_s, abs=0.01)
    assert there.age_s == pytest.approx(0.05)
    assert there.late_s == pytest.approx(delay_s, abs=0.002)


def test_what_a_neighbour_tells_of_a_third_is_about_where_it_was_itself_when_it_told() -> None:
    localiser = GnssLocaliser(MISSION, ME)
    delayed(localiser, 0.3, (-3.0, 0.0, 0.0))
    seen = PeerReport(3, (0.0, 5.0, 0.0), 5.0, silent=True)
    told = heard_beacon(2, rel_ned_m=(17.0, 0.0, 0.0), time_ms=501_000, sighting=seen)
    assert localiser.receive_beacon(told, HERE, 1.3)
    look(localiser, 1.35)
    assert localiser.silent[3].rel_ned_m == pytest.approx((17.0, 5.0, 0.0))


def reports(count: int, first: int = 0) -> list[RelativeReport]:
    return [RelativeReport(2, 1000 + 100 * k, (0.1 * k, 0.0)) for k in range(first, first + count)]


def test_reports_that_come_together_each_go_with_their_beacon() -> None:
    localiser = GnssDeniedLocaliser(ranging_mission(), ME)
    for report in reports(3):
        localiser.receive_ranging(report, 1.0)
    for k in (1, 0, 2):
        localiser.receive_beacon(heard_beacon(2, time_ms=1000 + 100 * k), HERE, 1.0)
    assert localiser._reports[2] == []
    assert localiser.ranging.filter._of[2].odo_n == pytest.approx(0.2)


def test_of_reports_whose_beacons_never_come_few_are_kept() -> None:
    localiser = GnssDeniedLocaliser(ranging_mission(), ME)
    for report in reports(100):
        localiser.receive_ranging(report, 1.0)
    assert len(localiser._reports[2]) == REPORTS_MAX


def test_a_range_brings_a_silent_vehicle_near_and_frees_nothing_where_it_was_told_to_be() -> None:
    localiser = GnssLocaliser(mission(swarm={"size": 4}, ranging={}), ME)
    localiser.receive_beacon(heard_beacon(2, rel_ned_m=(0.0, 14.0, 0.0), airborne=True), HERE, 10.0)
    for k in range(1, 30):
        look(localiser, 10.0 + 0.1 * k)
    localiser.receive_ranging(Ranges(((2, 8.0, 0.0),)), 12.9)
    look(localiser, 13.0)
    near_m = 8.0 + NEAR_M
    assert localiser.silent[2].rel_ned_m == pytest.approx((0.0, near_m, 0.0))
    assert (0.0, 14.0, 0.0) in [pytest.approx(place) for place in localiser.silent[2].elsewhere]
