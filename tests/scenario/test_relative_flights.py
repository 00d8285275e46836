"""Neighbours found by odometry and ranges: what is seen, what is known not to be, and what the filter survives."""

from __future__ import annotations

import math
from collections.abc import Callable
from random import Random

import pytest

from companion.core.localisation.gnss_denied.error_state import Errors, Level
from companion.core.localisation.gnss_denied.relative_filter import COASTS_S, RelativeFilter

DT_S = 0.05
START = {1: (0.0, 0.0), 2: (12.0, 1.0), 3: (2.0, -11.0), 4: (-9.0, 6.0), 5: (9.0, 13.0)}
Where = Callable[[int, float], Level]


def rigid(vehicle: int, now_s: float) -> Level:
    north, east = START[vehicle]
    return north + 3.0 * now_s, east


def weaving(vehicle: int, now_s: float) -> Level:
    north, east = rigid(vehicle, now_s)
    period_s = 6.0 + vehicle
    return north, east + 0.5 * period_s / math.tau * math.sin(math.tau * now_s / period_s)


class Flight:
    """Vehicle 1's filter, fed from where all truly are."""

    def __init__(self, where: Where, *, off_m: float = 0.4, shift_m: float = 0.0, seed: int = 1) -> None:
        self.where, self.shift_m, self.rng = where, shift_m, Random(seed)
        self.filter, self.now_s = RelativeFilter(), 0.0
        angle = {k: self.rng.uniform(0.0, math.tau) for k in START}
        places = {
            k: (p[0] + off_m * math.cos(angle[k]), p[1] + off_m * math.sin(angle[k]))
            for k, p in ((k, self.true(k)) for k in START if k != 1)
        }
        self.filter.initialise(places, 0.3)
        self.late_m: Callable[[], float] = lambda: 0.0
        self.mute: set[int] = set()  # of these no odometers, and no ranges
        self.unheard: set[int] = set()  # of these no odometers
        self.air_s: Callable[[], float] = lambda: 0.0  # how long a beacon takes
        self.under_way: list[tuple[float, float, int, tuple[Level, Level]]] = []  # due, made, sender, odometer

    def true(self, vehicle: int) -> Level:
        """Relative to vehicle 1."""
        (n, e), (n0, e0) = self.where(vehicle, self.now_s), self.where(1, self.now_s)
        return n - n0, e - e0

    def odometer(self, vehicle: int) -> tuple[Level, Level]:
        (n, e), (n1, e1) = self.where(vehicle, self.now_s), self.where(vehicle, self.now_s + DT_S)
        return (n + self.shift_m, e - self.shift_m), ((n1 - n) / DT_S, (e1 - e) / DT_S)

    def fly(self, seconds: float, *, bearings: bool = False) -> None:
        for _ in range(round(seconds / DT_S)):
            tick = round(self.now_s / DT_S)
            self.filter.update_odometry(*self.odometer(1), self.now_s)
            for k in START:
                if k != 1 and tick % 2 == k % 2 and k not in self.mute | self.unheard:
                    self.under_way.append((self.now_s + self.air_s(), self.now_s, k, self.odometer(k)))
            self._hear()
            if tick % 2 == 0:
                self._range()
            if bearings and tick % 10 == 0:
                for k in self.filter.ids:
                    n, e = self.true(k)
                    self.filter.update_bearing(k, math.atan2(e, n) + self.rng.gauss(0.0, math.radians(5.0)), self.now_s)
            self.filter.advance(self.now_s)
            self.now_s += DT_S

    def _hear(self) -> None:
        arrived = [one for one in self.under_way if one[0] <= self.now_s]
        self.under_way = [one for one in self.under_way if one[0] > self.now_s]
        for _, made_s, k, told in sorted(arrived):
            self.filter.update_peer_odometry(k, *told, self.now_s - made_s, self.now_s)

    def _range(self) -> None:
        for a in START:
            for b in START:
                if a < b and not {a, b} & self.mute:
                    metres = math.dist(self.true(a), self.true(b)) + self.rng.gauss(0.0, 0.1) + self.late_m()
                    self.filter.update_range(None if a == 1 else a, b, metres, 0.0, self.now_s)

    def off_m(self, vehicle: int) -> float:
        self.now_s -= DT_S  # the filter's now
        found = self.filter.relative(vehicle)
        assert found is not None
        off = math.dist(found.ne_m, self.true(vehicle))
        self.now_s += DT_S
        return off

    def worst_m(self) -> float:
        return max(self.off_m(k) for k in self.filter.ids)


# --- what it sees ---


def test_neighbours_that_weave_are_found() -> None:
    flight = Flight(weaving)
    assert flight.worst_m() > 0.3
    flight.fly(40.0)
    assert flight.worst_m() < 0.35
    assert flight.filter.rotation_sd_rad < math.radians(2.0)


def swerving(vehicle: int, now_s: float) -> Level:
    """As among trunks: 1.2 m/s^2 from side to side, each in its own time."""
    north, east = rigid(vehicle, now_s)
    return north, east + 0.5 * math.sin(1.55 * now_s + 1.3 * vehicle)


@pytest.mark.parametrize("late_s", [0.0, 0.2, 0.6])
def test_what_beacons_bring_late_and_out_of_turn_counts_for_when_it_was_so(late_s: float) -> None:
    """Were ranges taken back along the velocity that was told last, it would be 0.18, 0.14 and 0.16 m."""
    flight, draw, offs_m = Flight(swerving), Random(3), []
    flight.air_s = lambda: draw.uniform(0.0, late_s)
    for _ in range(80):
        flight.fly(0.5)
        offs_m.append(flight.worst_m())
    assert sum(offs_m[20:]) / 60 <= 0.135


def test_an_overtaken_odometer_changes_nothing() -> None:
    flight = Flight(weaving)
    flight.fly(5.0)
    now_s, before = flight.now_s - DT_S, flight.filter.relative(2)
    assert before is not None
    flight.filter.update_peer_odometry(2, (0.0, 0.0), (0.0, 0.0), 0.3, now_s)
    after = flight.filter.relative(2)
    assert after is not None
    assert after.ne_m == before.ne_m


def test_the_turn_of_a_rigid_formation_stays_uncertain_and_its_shape_does_not() -> None:
    flight = Flight(rigid)
    flight.fly(20.0)
    before = flight.filter.rotation_sd_rad
    flight.fly(60.0)
    assert flight.filter.rotation_sd_rad > max(1.5 * before, math.radians(4.0))
    flight.now_s -= DT_S
    for a, b in ((2, 3), (2, 4), (3, 5)):
        one, other = flight.filter.relative(a), flight.filter.relative(b)
        assert one is not None
        assert other is not None
        assert math.dist(one.ne_m, other.ne_m) == pytest.approx(math.dist(flight.true(a), flight.true(b)), abs=0.15)


def test_bearings_hold_the_turn_of_a_rigid_formation() -> None:
    blind, seeing = Flight(rigid), Flight(rigid)
    blind.fly(60.0)
    seeing.fly(60.0, bearings=True)
    assert seeing.filter.rotation_sd_rad < blind.filter.rotation_sd_rad / 2.0
    assert seeing.worst_m() < 0.6


def test_a_compass_that_is_wrong_is_found_out_by_the_others() -> None:
    """The own odometer counts along a north 5 degrees off; the others' are right."""
    flight = Flight(weaving)
    off = math.radians(5.0)
    right = flight.odometer

    def odometer(vehicle: int) -> tuple[Level, Level]:
        odo, vel = right(vehicle)
        if vehicle != 1:
            return odo, vel
        c, s = math.cos(off), math.sin(off)
        return (c * odo[0] + s * odo[1], -s * odo[0] + c * odo[1]), (c * vel[0] + s * vel[1], -s * vel[0] + c * vel[1])

    flight.odometer = odometer  # type: ignore[method-assign]
    flight.filter = RelativeFilter(Errors(yaw_rad=off))
    flight.filter.initialise({k: flight.true(k) for k in START if k != 1}, 0.3)
    flight.fly(60.0)
    found, sd = flight.filter.compass
    # Of one and four others that agree, as likely wrong as it: all but a fifth is laid upon the one.
    assert found == pytest.approx(0.8 * off, abs=2.0 * sd)
    assert found > 0.4 * off


def test_the_common_error_of_all_compasses_stays_uncertain() -> None:
    flight = Flight(weaving)
    flight.fly(80.0)
    common = Errors().yaw_rad / math.sqrt(len(START))
    assert flight.filter.rotation_sd_rad > common
    assert flight.filter.compass[1] > common


def test_where_the_odometers_began_does_not_matter() -> None:
    here, there = Flight(weaving), Flight(weaving, shift_m=1024.0)
    here.fly(5.0)
    there.fly(5.0)
    for k in here.filter.ids:
        one, other = here.filter.relative(k), there.filter.relative(k)
        assert one is not None
        assert other is not None
        assert one.ne_m == pytest.approx(other.ne_m, abs=1e-9)


# --- what it survives ---


def test_ranges_round_trunks_hardly_pull() -> None:
    flight = Flight(weaving)
    flight.late_m = lambda: flight.rng.uniform(0.3, 1.2) if flight.rng.random() < 0.15 else 0.0
    flight.fly(60.0)
    assert flight.worst_m() < 0.45
    assert flight.filter.gate.dropped > 0


def test_a_neighbour_that_is_somewhere_else_is_found_again() -> None:
    flight = Flight(weaving)
    flight.fly(20.0)
    right = flight.where

    def moved(vehicle: int, now_s: float) -> Level:
        n, e = right(vehicle, now_s)
        return (n + 2.5, e - 2.0) if vehicle == 3 else (n, e)

    odometer = flight.odometer
    flight.odometer = lambda k: (  # type: ignore[method-assign]
        odometer(k) if k != 3 else ((lambda o: ((o[0][0] - 2.5, o[0][1] + 2.0), o[1]))(odometer(k)))
    )
    flight.where = moved
    flight.fly(0.5)
    assert flight.off_m(3) > 2.0
    flight.fly(20.0)
    assert flight.off_m(3) < 0.6


def test_an_odometer_that_begins_anew_moves_nobody() -> None:
    flight = Flight(weaving)
    flight.fly(20.0)
    odometer = flight.odometer
    flight.odometer = lambda k: (  # type: ignore[method-assign]
        odometer(k) if k not in (1, 4) else ((lambda o: ((o[0][0] - 300.0, o[0][1]), o[1]))(odometer(k)))
    )
    flight.fly(1.0)
    assert flight.worst_m() < 1.0
    flight.fly(20.0)
    assert flight.worst_m() < 0.45


def test_a_silent_neighbour_grows_uncertain_and_is_taken_to_fly_along() -> None:
    flight = Flight(rigid)
    flight.fly(10.0)
    known = flight.filter.relative(2)
    flight.mute = {2}
    flight.fly(COASTS_S + 2.0)
    silent = flight.filter.relative(2)
    assert known is not None
    assert silent is not None
    assert silent.sd_m > known.sd_m + 1.0
    assert flight.filter.has_lost(2)
    assert flight.off_m(2) < 1.0


def strays(vehicle: int, at_s: float) -> Level:
    """As `weaving`; vehicle 2 goes aside from 20 s to 30 s."""
    north, east = weaving(vehicle, at_s)
    return north, east + (1.5 * min(10.0, max(0.0, at_s - 20.0)) if vehicle == 2 else 0.0)


def test_one_that_is_not_heard_pulls_nobody_along_and_is_where_it_says_as_soon_as_it_is_heard() -> None:
    """The others go on to range to it, as in a wide swarm that not all hear."""
    flight = Flight(strays)
    flight.fly(19.0)
    turn_sd = flight.filter.rotation_sd_rad
    flight.unheard = {2}
    flight.fly(16.0)
    assert flight.filter.has_lost(2)
    assert max(flight.off_m(k) for k in flight.filter.ids if k != 2) < 0.5
    assert flight.filter.rotation_sd_rad > 0.5 * turn_sd
    flight.unheard = set()
    flight.fly(0.1)
    assert flight.off_m(2) < 1.0
    flight.fly(10.0)
    assert flight.worst_m() < 0.45


@pytest.mark.parametrize("metres", [math.nan, math.inf, -1.0, 0.0, 1e300])
def test_impossible_ranges_change_nothing(metres: float) -> None:
    flight = Flight(rigid)
    flight.fly(2.0)
    before = (flight.filter.relative(2), flight.filter.gate.used, flight.filter.gate.dropped)
    for _ in range(5):
        flight.filter.update_range(None, 2, metres, 0.0, flight.now_s - DT_S)
        flight.filter.update_range(3, 2, 10.0, math.nan, flight.now_s - DT_S)
        flight.filter.update_range(2, 2, 10.0, 0.0, flight.now_s - DT_S)
        flight.filter.update_range(77, 2, 10.0, 0.0, flight.now_s - DT_S)
        flight.filter.update_range(None, 77, 10.0, 0.0, flight.now_s - DT_S)
    after = (flight.filter.relative(2), flight.filter.gate.used, flight.filter.gate.dropped)
    assert after == before


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300])
def test_impossible_odometers_and_bearings_change_nothing(value: float) -> None:
    flight = Flight(rigid)
    flight.fly(2.0)
    before = flight.filter.relative(2)
    now_s = flight.now_s - DT_S
    flight.filter.update_peer_odometry(2, (0.0, 0.0), (value, 0.0), 0.0, now_s)
    flight.filter.update_peer_odometry(2, (0.0, 0.0), (0.0, 0.0), value, now_s)
    flight.filter.update_peer_odometry(77, (0.0, 0.0), (0.0, 0.0), 0.0, now_s)
    flight.filter.update_bearing(77, 0.0, now_s)
    if not math.isfinite(value):
        flight.filter.update_peer_odometry(2, (value, 0.0), (0.0, 0.0), 0.0, now_s)
        flight.filter.update_bearing(2, value, now_s)
    assert flight.filter.relative(2) == before


# --- who is there ---


def test_neighbours_come_and_go_and_the_others_stay() -> None:
    flight = Flight(weaving)
    flight.fly(20.0)
    before = {k: flight.filter.relative(k) for k in (3, 4, 5)}
    flight.filter.remove_peer(2)
    assert flight.filter.relative(2) is None
    assert {k: flight.filter.relative(k) for k in (3, 4, 5)} == before
    place = flight.true(2)
    flight.filter.add_peer(2, (place[0] + 0.8, place[1] - 0.5), 1.0)
    assert {k: flight.filter.relative(k) for k in (3, 4, 5)} == before
    added = flight.filter.relative(2)
    assert added is not None
    assert added.sd_m > 0.9
    flight.fly(20.0)
    assert flight.worst_m() < 0.4


def test_one_alone_flies_and_takes_the_first_that_comes() -> None:
    me = RelativeFilter()
    for tick in range(30):
        me.update_odometry((0.0, 0.0), (0.0, 0.0), tick * DT_S)
        me.advance(tick * DT_S)
    assert me.ids == []
    assert me.rotation_sd_rad == math.inf
    me.add_peer(9, (10.0, 0.0), 0.5)
    for tick in range(30, 100):
        now_s = tick * DT_S
        me.update_odometry((0.0, 0.0), (0.0, 0.0), now_s)
        me.update_peer_odometry(9, (0.0, 0.0), (0.0, 0.0), 0.0, now_s)
        me.update_range(None, 9, 10.4, 0.0, now_s)
        me.advance(now_s)
    found = me.relative(9)
    assert found is not None
    assert found.ne_m[0] == pytest.approx(10.4, abs=0.1)


def test_the_covariance_of_all_holds_that_of_each() -> None:
    flight = Flight(weaving)
    flight.fly(10.0)
    whole = flight.filter.covariance_m2
    for slot, k in enumerate(flight.filter.ids):
        found = flight.filter.relative(k)
        assert found is not None
        i = 2 * slot
        assert (found.var_nn_m2, found.var_ne_m2, found.var_ee_m2) == pytest.approx(
            (whole[i][i], whole[i][i + 1], whole[i + 1][i + 1]), abs=1e-12
        )
        assert whole[i + 1][i] == pytest.approx(whole[i][i + 1], abs=1e-12)
