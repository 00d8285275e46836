"""A vehicle's neighbourhood by ranges: whose north it speaks in, how near neighbours may be, and what it tells."""

from __future__ import annotations

import math

import pytest

from companion.core.localisation.gnss_denied.excitation import FROM_RAD, SPEED_MPS, UNTIL_RAD, ExcitationManoeuvre
from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser, rotate_beacon
from companion.core.localisation.gnss_denied.ranging import RangingLocaliser
from companion.core.localisation.gnss_denied.relative_filter import COASTS_S
from companion.core.model.beacon import PeerReport, RelativeReport
from companion.core.model.events import Position
from mission.common.frames import Vec3, enu_to_ned
from tests.unit.core.core_kit import beacon
from tests.unit.core.ranging_kit import STARTS, ranging_mission

DT_S = 0.05
AGE_S = 0.05  # of a beacon: a tick
ME, OTHER = 1, 2
AT = {k: enu_to_ned(place) for k, place in enumerate(STARTS, start=1)}


class Flight:
    """Vehicle 1's neighbourhood; all fly `vel` as one, each with a compass that is off by `yaw` (true less told)."""

    def __init__(self, yaw: dict[int, float], vel: Vec3 = (3.0, 0.0, 0.0)) -> None:
        self.yaw, self.vel, self.now_s, self.tick = yaw, vel, 0.0, 0
        self.here = RangingLocaliser(ranging_mission(), ME)
        self.down_m = {k: -4.0 for k in AT}

    def told(self, vehicle: int, v: Vec3) -> Vec3:
        """A true vector along that vehicle's own north."""
        c, s = math.cos(self.yaw.get(vehicle, 0.0)), math.sin(self.yaw.get(vehicle, 0.0))
        return (c * v[0] + s * v[1], -s * v[0] + c * v[1], v[2])

    def swing(self, vehicle: int, at_s: float) -> tuple[Vec3, Vec3]:
        """Way and velocity, true: as one, and small circles of its own."""
        omega, size = math.tau / (7.0 + vehicle), 0.6
        way = (size * math.sin(omega * at_s), size * (1.0 - math.cos(omega * at_s)), 0.0)
        vel = (size * omega * math.cos(omega * at_s), size * omega * math.sin(omega * at_s), 0.0)
        return (
            (self.vel[0] * at_s + way[0], self.vel[1] * at_s + way[1], 0.0),
            (self.vel[0] + vel[0], self.vel[1] + vel[1], 0.0),
        )

    def place(self, vehicle: int, at_s: float) -> Vec3:
        way, _ = self.swing(vehicle, at_s)
        return (AT[vehicle][0] + way[0], AT[vehicle][1] + way[1], self.down_m[vehicle])

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds / DT_S)):
            self.tick += 1
            self.now_s = self.tick * DT_S
            if self.tick % 2 == 0:
                for k in (2, 3, 4):
                    sent_s = self.now_s - AGE_S
                    way, vel = self.swing(k, sent_s)
                    odo, pairs = self.told(k, way), [j for j in AT if j not in (k, ME)]
                    ranges = tuple((j, math.dist(self.place(k, sent_s), self.place(j, sent_s)), 0.0) for j in pairs)
                    word = RelativeReport(k, self.tick, (odo[0], odo[1]), ranges=ranges)
                    self.here.receive_report(word, self.told(k, vel), self.down_m[k], self.now_s, age_s=AGE_S)
                own = tuple(
                    (j, math.dist(self.place(ME, self.now_s), self.place(j, self.now_s)), 0.0) for j in (2, 3, 4)
                )
                self.here.receive_ranges(own, self.now_s)
            way, vel = self.swing(ME, self.now_s)
            odo = self.told(ME, way)
            told = (AT[ME][0] + odo[0], AT[ME][1] + odo[1], self.down_m[ME])
            self.here.update_odometry(Position(told, self.told(ME, vel)), self.now_s)
            self.here.advance(self.now_s)

    def rel(self, vehicle: int) -> Vec3:
        """The truth, along the own north."""
        a, b = self.place(ME, self.now_s), self.place(vehicle, self.now_s)
        return self.told(ME, (b[0] - a[0], b[1] - a[1], b[2] - a[2]))


def test_neighbours_are_found_along_the_own_compass() -> None:
    yaw = {1: math.radians(0.5), 2: math.radians(-3.0), 4: math.radians(-2.0)}
    flight = Flight(yaw)
    flight.fly(60.0)
    for k in (2, 3, 4):
        place = flight.here.locate_peer(k, flight.down_m[ME], flight.now_s)
        assert place is not None
        assert math.dist(place[0], flight.rel(k)) < 0.25


def test_what_others_tell_is_turned_to_the_own_compass() -> None:
    yaw = {2: math.radians(-4.0)}
    flight = Flight(yaw)
    flight.fly(60.0)
    dest = (100.0, 20.0, 0.0)
    seen = PeerReport(3, flight.told(2, (10.0, 0.0, 0.0)), 0.5, silent=True)
    by_rad = flight.here.filter.compass_of(2) - flight.here.filter.compass[0]
    said = rotate_beacon(beacon(2, dest_ned_m=flight.told(2, dest), sighting=seen), by_rad)
    assert said.dest_ned_m is not None
    assert math.dist(said.dest_ned_m, flight.told(1, dest)) < 1.0  # unturned it would be 7 m off
    assert said.sighting is not None
    assert math.dist(said.sighting.rel_ned_m, flight.told(1, (10.0, 0.0, 0.0))) < 0.1


def test_a_neighbour_is_kept_clear_of_as_if_nearer_by_what_is_not_known() -> None:
    flight = Flight({})
    flight.fly(30.0)
    place = flight.here.locate_peer(OTHER, flight.down_m[ME], flight.now_s)
    assert place is not None
    there, near = place
    true_m = math.hypot(*flight.rel(OTHER)[:2])
    assert math.hypot(*near[:2]) < min(true_m, math.hypot(*there[:2]))
    assert math.hypot(*near[:2]) > 0.9 * true_m
    assert math.atan2(near[1], near[0]) == pytest.approx(math.atan2(there[1], there[0]))
    flight.here.receive_ranges(((OTHER, 3.0, 0.0),), flight.now_s)  # of range and estimate the nearer counts, at once
    place = flight.here.locate_peer(OTHER, flight.down_m[ME], flight.now_s)
    assert place is not None
    assert math.hypot(*place[1][:2]) < 3.0


def test_a_near_neighbour_is_called_unsure_of_by_the_covariance_until_ranges_have_found_it_again() -> None:
    flight = Flight({})
    flight.fly(30.0)
    flight.here.locate_peer(OTHER, flight.down_m[ME], flight.now_s)
    assert flight.here.uncertain_peers == set()
    for far_m in (300.0, -300.0, 300.0):  # its odometer begins anew, and anew
        flight.here.receive_report(
            RelativeReport(OTHER, 1, (far_m, 0.0)), (3.0, 0.0, 0.0), flight.down_m[OTHER], flight.now_s
        )
    flight.here.advance(flight.now_s)
    flight.here.locate_peer(OTHER, flight.down_m[ME], flight.now_s)
    assert flight.here.uncertain_peers == {OTHER}
    flight.fly(5.0)
    place = flight.here.locate_peer(OTHER, flight.down_m[ME], flight.now_s)
    assert flight.here.uncertain_peers == set()
    assert place is not None
    assert math.dist(place[0], flight.rel(OTHER)) < 1.0


def test_one_that_has_not_told_where_it_is_for_a_while_has_no_place() -> None:
    flight = Flight({})
    flight.fly(10.0)
    assert flight.here.locate_peer(OTHER, flight.down_m[ME], flight.now_s) is not None
    flight.here.advance(flight.now_s + COASTS_S + 0.1)
    assert flight.here.locate_peer(OTHER, flight.down_m[ME], flight.now_s + COASTS_S + 0.1) is None


def test_ranges_are_slant_and_steep_ones_say_nothing() -> None:
    """Two vehicles are 4 m higher than the others: what radios measure between them is longer than it is level."""
    flight = Flight({})
    flight.down_m = {1: -4.0, 2: -8.0, 3: -4.0, 4: -8.0}
    flight.fly(40.0)
    place = flight.here.locate_peer(OTHER, flight.down_m[ME], flight.now_s)
    assert place is not None
    assert math.dist(place[0], flight.rel(OTHER)) < 0.3
    assert place[0][2] == pytest.approx(-4.0)
    waiting = len(flight.here.filter._waiting)
    flight.here.receive_ranges(((3, 8.0, 0.0),), flight.now_s)
    assert len(flight.here.filter._waiting) == waiting + 1
    flight.down_m[3] = -30.0
    flight.here.receive_report(RelativeReport(3, 1, (0.0, 0.0)), (0.0, 0.0, 0.0), -30.0, flight.now_s)
    flight.here.receive_ranges(((3, 27.0, 0.0),), flight.now_s)
    assert len(flight.here.filter._waiting) == waiting + 1


def test_of_each_pair_one_tells_the_range() -> None:
    mission = ranging_mission()
    told: dict[frozenset[int], int] = {}
    for me in (1, 2, 3, 4):
        here = RangingLocaliser(mission, me)
        here.receive_ranges(tuple((k, 8.0, 0.0) for k in (1, 2, 3, 4) if k != me), 1.0)
        for vehicle, _, _ in here.make_report(0, 1, 1.1).ranges:
            told[frozenset((me, vehicle))] = told.get(frozenset((me, vehicle)), 0) + 1
    assert told == {frozenset(pair): 1 for pair in ((1, 2), (1, 3), (1, 4), (2, 3), (2, 4), (3, 4))}


def test_a_word_tells_each_range_once_and_how_old_it_is() -> None:
    here = RangingLocaliser(ranging_mission(), 1)
    here.receive_ranges(((3, 8.0, 0.02),), 1.0)
    assert here.make_report(0, 1, 1.1).ranges == ((3, 8.0, pytest.approx(0.12)),)
    assert here.make_report(0, 2, 1.2).ranges == ()


def test_ranges_to_strangers_are_passed_over() -> None:
    here = RangingLocaliser(ranging_mission(), 1)
    here.receive_ranges(((9, 8.0, 0.0), (1, 5.0, 0.0)), 1.0)
    assert here.make_report(0, 1, 1.1).ranges == ()
    here.receive_report(RelativeReport(9, 1, (0.0, 0.0), ranges=((2, 8.0, 0.0),)), (0.0, 0.0, 0.0), 0.0, 1.0)
    assert here.locate_peer(9, 0.0, 1.0) is None


# --- weaving ---


def test_a_vehicle_weaves_while_its_formations_turn_is_uncertain_and_not_by_the_clock() -> None:
    weave = ExcitationManoeuvre(2)
    assert weave.velocity(0.9 * FROM_RAD, 1.0) == (0.0, 0.0, 0.0)
    assert weave.velocity(1.1 * FROM_RAD, 2.0) != (0.0, 0.0, 0.0)
    assert weave.velocity(0.9 * FROM_RAD, 500.0) != (0.0, 0.0, 0.0)  # not sure enough yet
    assert weave.velocity(0.9 * UNTIL_RAD, 501.0) == (0.0, 0.0, 0.0)


def test_weaving_comes_back_to_where_it_began_and_no_two_weave_alike() -> None:
    ways = {}
    for me in range(1, 13):
        weave, north, east, far_m = ExcitationManoeuvre(me), 0.0, 0.0, 0.0
        for tick in range(2400):
            v = weave.velocity(1.0, tick * DT_S)
            assert math.hypot(v[0], v[1]) == pytest.approx(SPEED_MPS)
            north, east = north + v[0] * DT_S, east + v[1] * DT_S
            far_m = max(far_m, math.hypot(north, east))
        assert far_m < 1.5
        ways[me] = weave._period_s
    assert len({round(period_s, 2) for period_s in ways.values()}) == 12


def test_places_of_a_silent_vehicle_that_no_range_reaches_stay_where_they_are() -> None:
    localiser = GnssDeniedLocaliser(ranging_mission(), ME)
    silent = PeerReport(OTHER, (3.0, 0.0, 0.0), 9.0, silent=True, elsewhere=((0.0, 3.0, 0.0), (0.0, 0.0, 3.0)))
    assert localiser._correct_silent({OTHER: silent}, 100.0) == {OTHER: silent}


def test_one_that_fell_silent_is_as_near_as_the_own_radio_measures_and_never_farther_than_it_was() -> None:
    flight = Flight({})
    flight.fly(5.0)
    apart_m = math.dist(flight.place(ME, flight.now_s), flight.place(OTHER, flight.now_s))
    near, strayed = (0.0, 3.0, 0.0), (0.0, 300.0, 0.0)  # odometry has it there by now
    assert flight.here.scale_to_range(OTHER, near, flight.now_s) is near  # a range may be wrong, or made by somebody
    held = flight.here.scale_to_range(OTHER, strayed, flight.now_s)
    assert held == pytest.approx((0.0, apart_m, 0.0), abs=0.5)  # it flies: the last range is 0.1 s old
    assert flight.here.scale_to_range(OTHER, strayed, flight.now_s + 5.0) is strayed
    assert flight.here.scale_to_range(9, strayed, flight.now_s) is strayed
