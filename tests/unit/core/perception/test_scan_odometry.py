"""Scan odometry: trunks that stand still correct what is reported of place, heading and motion."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator

import pytest

from companion.core.model.events import Position
from companion.core.perception.landmarks.trunk_tracks import TRACKS_MAX
from companion.core.perception.own_motion import FADES_S, OwnMotion
from companion.core.perception.scan_odometry import FRESH_S, ScanOdometry
from mission.common.frames import Vec3
from tests.unit.core.perception.scan_kit import FINE, SECTORS, Stem, level_scan, ring

STEP_S = 0.1
Course = Callable[[float], tuple[float, float]]


def stand(seed: int = 1, count: int = 60) -> list[Stem]:
    """Stems 2 to 9 m beside a way north of 40 m, none nearer to another than 2 m."""
    rng, stems = random.Random(seed), list[Stem]()
    while len(stems) < count:
        north, east = rng.uniform(-8.0, 48.0), rng.uniform(2.0, 9.0) * rng.choice((-1.0, 1.0))
        if all(math.dist((north, east), stem[:2]) > 2.0 for stem in stems):
            stems.append((north, east, rng.uniform(0.08, 0.3)))
    return stems


class Flight:
    """Flies north at 2 m/s, and reports it wrongly."""

    def __init__(self, stems: list[Stem], *, speed_mps: float = 2.0) -> None:
        self.stems = stems
        self.peers: list[Vec3] = []
        self.unheard = 0
        self.motion = OwnMotion(FINE, turns_with_yaw=False, hull_m=0.35, others=7)
        self.speed_mps = speed_mps
        self.now_s = 100.0
        self.true_m = (0.0, 0.0)
        self.off_m = (0.0, 0.0)  # reported less true
        self.off_mps = (0.0, 0.0)
        self.yaw_off_rad = 0.0

    def run(self, lasts_s: float, *, sees: bool = True) -> Iterator[None]:
        """One scan after the other."""
        for _ in range(round(lasts_s / STEP_S)):
            for _ in range(2):
                self.now_s += STEP_S / 2.0
                self.true_m = (self.true_m[0] + self.speed_mps * STEP_S / 2.0, self.true_m[1])
                self.motion.receive_position(self.reported, self.now_s)
            if sees:
                self.scan()
            yield

    @property
    def reported(self) -> Position:
        return Position(
            (self.true_m[0] + self.off_m[0], self.true_m[1] + self.off_m[1], -4.0),
            (self.speed_mps + self.off_mps[0], self.off_mps[1], 0.0),
            self.now_s,
        )

    def scan(self) -> None:
        placed = self.motion.correct_position(self.reported)
        scan = level_scan(self.stems, self.true_m, turned_rad=self.yaw_off_rad + self.motion.turn_rad)
        for k in range(len(scan.eyes_north_m)):
            scan.eyes_north_m[k], scan.eyes_east_m[k] = placed.pos_ned_m[0], placed.pos_ned_m[1]
        self.motion.integrate_turn(scan, 0.0, placed, self.peers, self.now_s, unheard=self.unheard)

    @property
    def strayed_m(self) -> tuple[float, float]:
        """Of the corrected place from the true one."""
        at = self.motion.correct_place(self.reported.pos_ned_m)
        return at[0] - self.true_m[0], at[1] - self.true_m[1]


def fly(flight: Flight, lasts_s: float, *, sees: bool = True) -> None:
    for _ in flight.run(lasts_s, sees=sees):
        pass


def test_a_position_that_wanders_is_held_by_the_trunks() -> None:
    flight = Flight(stand())
    for k, _ in enumerate(flight.run(15.0)):
        flight.off_m = (0.4 * math.sin(0.03 * k), 0.1 * math.sin(0.03 * k))
    assert math.hypot(*flight.off_m) > 0.25
    assert math.hypot(*flight.strayed_m) < 0.15
    assert flight.motion.odometry.is_corrected(flight.now_s)


def test_a_velocity_that_is_wrong_is_told_by_how_the_trunks_pass() -> None:
    flight = Flight(stand())
    flight.off_mps = (0.3, -0.2)
    fly(flight, 6.0)
    bias = flight.motion.velocity_bias_ne_mps
    assert bias is not None
    assert math.dist(bias, (-0.3, 0.2)) < 0.06


def test_a_velocity_more_wrong_than_ever_is_told_by_more_trunks_than_there_are_vehicles() -> None:
    """It was taken for a formation that flies along, and for a second nothing was told."""
    flight = Flight(stand())
    fly(flight, 3.0)
    flight.off_mps = (0.95, 0.0)
    fly(flight, 2.0)
    for _ in flight.run(3.0):
        bias = flight.motion.velocity_bias_ne_mps
        assert bias is not None
        assert math.dist(bias, (-0.95, 0.0)) < 0.15


def test_a_yaw_that_turns_away_is_turned_back() -> None:
    flight = Flight(stand())
    fly(flight, 3.0)
    for k, _ in enumerate(flight.run(8.0)):
        flight.yaw_off_rad = math.radians(4.0) * min(1.0, k / 60.0)
    assert flight.motion.turn_rad == pytest.approx(-math.radians(4.0), abs=math.radians(1.0))


def test_a_yaw_that_was_wrong_from_the_start_is_found_by_flying() -> None:
    """Trunks alone do not tell where north is: that the way reported goes another way than theirs does."""
    flight = Flight(stand())
    flight.yaw_off_rad = math.radians(4.0)
    flight.speed_mps = 0.0
    fly(flight, 1.0)
    assert abs(flight.motion.turn_rad) < math.radians(0.5)
    flight.speed_mps = 2.0
    fly(flight, 17.0)
    assert flight.motion.turn_rad == pytest.approx(-math.radians(4.0), abs=math.radians(0.7))


def test_without_trunks_all_is_as_reported_to_the_bit() -> None:
    flight = Flight([])
    fly(flight, 5.0)
    assert flight.motion.correct_place((1.25, 2.5, -3.0)) == (1.25, 2.5, -3.0)
    assert flight.motion.velocity_bias_ne_mps is None
    assert flight.motion.turn_rad == 0.0


def test_one_trunk_alone_corrects_nothing() -> None:
    flight = Flight([(5.0, 3.0, 0.2)])
    flight.off_mps = (0.3, 0.0)
    fly(flight, 3.0)
    assert flight.motion.velocity_bias_ne_mps is None


def test_in_the_open_again_the_bias_fades_and_nothing_jumps() -> None:
    flight = Flight(stand())
    flight.off_mps = (0.3, 0.0)
    fly(flight, 5.0)
    before = flight.motion.correct_place((0.0, 0.0, 0.0))
    fly(flight, FRESH_S + 0.2, sees=False)
    assert not flight.motion.odometry.is_corrected(flight.now_s)
    assert flight.motion.correct_place((0.0, 0.0, 0.0)) == before
    assert flight.motion.velocity_bias_ne_mps is not None
    fly(flight, FADES_S, sees=False)
    assert flight.motion.velocity_bias_ne_mps is None


def test_an_estimator_that_is_reset_moves_no_trunk() -> None:
    flight = Flight(stand())
    fly(flight, 4.0)
    flight.off_m = (2.0, -1.5)
    fly(flight, 0.1)
    assert math.hypot(*flight.strayed_m) < 0.15
    fly(flight, 3.0)
    assert math.hypot(*flight.strayed_m) < 0.15


def test_a_gap_of_seconds_begins_anew_and_ends_well() -> None:
    flight = Flight(stand())
    fly(flight, 4.0)
    flight.now_s += 6.0
    flight.off_m = (0.5, 0.5)
    for k, _ in enumerate(flight.run(4.0)):
        flight.off_m = (0.5 + 0.01 * k, 0.5)
    moved = flight.strayed_m
    fly(flight, 2.0)
    assert math.dist(flight.strayed_m, moved) < 0.06


def test_trunks_that_are_all_missing_begin_the_map_anew() -> None:
    """A heading that jumps by 40 degrees, and back: what is expected is not there any more."""
    flight = Flight(stand())
    fly(flight, 4.0)
    flight.yaw_off_rad = math.radians(40.0)
    fly(flight, 2.0)
    flight.yaw_off_rad, flight.off_mps = 0.0, (0.3, 0.0)
    fly(flight, 5.0)
    bias = flight.motion.velocity_bias_ne_mps
    assert bias is not None
    assert math.dist(bias, (-0.3, 0.0)) < 0.06


@pytest.mark.parametrize("speed_mps", [0.9, 2.0, 3.0])
def test_vehicles_that_fly_along_correct_nothing_for_long(speed_mps: float) -> None:
    """Three hulls that keep their distance as they fly: each stands still relative to this one, and no trunk does."""
    flight = Flight([], speed_mps=speed_mps)
    for _ in range(80):
        flight.stems = [(flight.true_m[0] + n, e, 0.35) for n, e in ((4.0, 4.0), (-4.0, 4.0), (4.0, -5.0))]
        fly(flight, STEP_S)
    assert flight.motion.velocity_bias_ne_mps is None
    assert flight.motion.correct_place((0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("thin", [1, 2])
def test_a_vehicle_that_creeps_unheard_corrects_nothing(thin: int) -> None:
    """It hovers by its own estimate: beside one trunk it looked like the second, and the own velocity was wrong."""
    trunks = [(11.0, 2.0, 0.12), (-9.0, -4.0, 0.12)][:thin]
    flight = Flight([], speed_mps=0.0)
    flight.unheard = 1
    for k in range(80):
        flight.stems = [*trunks, (7.0, -6.0 - 0.04 * k, 0.35)]
        fly(flight, STEP_S)
    bias = flight.motion.velocity_bias_ne_mps
    if thin == 1:
        assert bias is None
    else:
        assert bias is not None
        assert math.hypot(*bias) < 0.05


def test_among_trunks_as_thick_as_hulls_more_are_seen_than_vehicles_are_unheard() -> None:
    flight = Flight([(north, east, 0.35) for north, east, _ in stand()])
    flight.unheard, flight.off_mps = 2, (0.3, -0.2)
    fly(flight, 6.0)
    bias = flight.motion.velocity_bias_ne_mps
    assert bias is not None
    assert math.dist(bias, (-0.3, 0.2)) < 0.06
    flight.unheard = 60
    fly(flight, FRESH_S + 0.2)
    assert not flight.motion.odometry.is_corrected(flight.now_s)


def test_a_neighbour_far_off_is_no_trunk_though_the_heading_places_it_beside_its_report() -> None:
    """A yaw that is 8 degrees wrong, as recorded ones are at times, has a hull 1.4 m from where it is, 10 m off."""
    flight = Flight([(10.0, 0.0, 0.35), (0.0, -10.0, 0.35)], speed_mps=0.0)
    flight.peers = [(10.0, 0.0, 0.0), (0.0, -10.0, 0.0)]
    flight.yaw_off_rad = math.radians(8.0)
    fly(flight, 3.0)
    assert flight.motion.velocity_bias_ne_mps is None
    assert not flight.motion.odometry.is_corrected(flight.now_s)


def test_all_trunks_of_a_dense_stand_are_tracked() -> None:
    motion = ScanOdometry(FINE)
    for k in range(8):
        motion.receive_position(Position((0.0, 0.0, -4.0), (0.0, 0.0, 0.0)), 0.1 * k)
        motion.integrate_scan(level_scan(ring(90, 16.0, 0.15), rays=1440, max_m=20.0), 0.0, (), 0.1 * k)
    assert sum(trunk.is_good for trunk in motion.trunks) == 90


def test_tracks_are_bounded() -> None:
    motion = ScanOdometry(SECTORS)
    rng = random.Random(3)
    for k in range(200):
        stems = [(rng.uniform(-11.0, 11.0), rng.uniform(-11.0, 11.0), 0.1) for _ in range(30)]
        motion.receive_position(Position((0.0, 0.0, -4.0), (0.0, 0.0, 0.0)), 0.1 * k)
        motion.integrate_scan(level_scan(stems), 0.0, (), 0.1 * k)
        assert len(motion._tracks.trunks) <= TRACKS_MAX
        assert all(map(math.isfinite, (*motion.shift_m, motion.turn_rad)))


def test_where_motion_is_measured_in_the_vehicles_axes_a_wrong_yaw_turns_it_back() -> None:
    """Odometry without GNSS: the reported way turns with the yaw, and so the corrected one must not."""
    stems, motion = stand(), ScanOdometry(FINE, turns_with_yaw=True)
    reported, true_m = (0.0, 0.0), (0.0, 0.0)
    for k in range(150):
        now_s, yaw_off = 10.0 + STEP_S * k, math.radians(5.0) * min(1.0, k / 80.0)
        step_m = 2.0 * STEP_S
        true_m = (true_m[0] + step_m, 0.0)
        reported = (reported[0] + step_m * math.cos(yaw_off), reported[1] + step_m * math.sin(yaw_off))
        vel = (2.0 * math.cos(yaw_off), 2.0 * math.sin(yaw_off), 0.0)
        own = Position((*reported, -4.0), vel)
        motion.receive_position(own, now_s)
        placed = motion.correct_place(own.pos_ned_m)
        scan = level_scan(stems, true_m, turned_rad=yaw_off + motion.turn_rad)
        for ray in range(len(scan.eyes_north_m)):
            scan.eyes_north_m[ray], scan.eyes_east_m[ray] = placed[0], placed[1]
        motion.integrate_scan(scan, yaw_off, (), now_s)
    assert math.dist(reported, true_m) > 1.5
    assert math.dist(motion.correct_place((*reported, 0.0))[:2], true_m) < 0.3
    assert motion.turn_rad == pytest.approx(-math.radians(5.0), abs=math.radians(0.8))


class Reckoning(Flight):
    """From now on it has lost its fix: its velocity, and its position with it, drift away."""

    reckons = False
    placed = Position((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def run(self, lasts_s: float, *, sees: bool = True) -> Iterator[None]:
        for _ in range(round(lasts_s / STEP_S)):
            for _ in range(2):
                self.now_s += STEP_S / 2.0
                self.true_m = (self.true_m[0] + self.speed_mps * STEP_S / 2.0, self.true_m[1])
                if self.reckons:
                    self.off_mps = (self.off_mps[0] + 0.1 * STEP_S / 2.0, self.off_mps[1] - 0.15 * STEP_S / 2.0)
                    self.off_m = (
                        self.off_m[0] + self.off_mps[0] * STEP_S / 2.0,
                        self.off_m[1] + self.off_mps[1] * STEP_S / 2.0,
                    )
                self.placed = self.receive()
            if sees:
                self.scan()
            yield

    def receive(self) -> Position:
        return self.motion.receive_position(self.reported, self.now_s, reckons=self.reckons)

    def scan(self) -> None:
        placed = self.motion.correct_position(self.placed)
        scan = level_scan(self.stems, self.true_m, turned_rad=self.motion.turn_rad)
        for k in range(len(scan.eyes_north_m)):
            scan.eyes_north_m[k], scan.eyes_east_m[k] = placed.pos_ned_m[0], placed.pos_ned_m[1]
        self.motion.integrate_turn(scan, 0.0, placed, (), self.now_s)


def test_without_its_fix_a_vehicle_goes_by_trunks_from_the_last_good_position_on() -> None:
    flight = Reckoning(stand())
    flight.off_m = (3.0, -2.0)  # of the satellites: all neighbours' are off alike
    fly(flight, 4.0)
    assert flight.placed.pos_ned_m == flight.reported.pos_ned_m
    flight.reckons = True
    fly(flight, 6.0)
    assert math.dist(flight.off_m, (3.0, -2.0)) > 2.5
    meant_m = (flight.true_m[0] + 3.0, flight.true_m[1] - 2.0)
    placed = flight.placed.pos_ned_m
    assert math.dist(placed[:2], meant_m) < 0.35
    assert math.dist(flight.motion.correct_place(placed)[:2], meant_m) < 0.35  # scans are placed alike
    bias = flight.motion.velocity_bias((0.0, 0.0, 0.0))
    assert bias[:2] == pytest.approx((-flight.off_mps[0], -flight.off_mps[1]), abs=0.15)


def test_with_the_fix_back_it_goes_by_what_is_reported() -> None:
    flight = Reckoning(stand())
    fly(flight, 4.0)
    flight.reckons = True
    fly(flight, 5.0)
    flight.off_m, flight.off_mps = (0.0, 0.0), (0.0, 0.0)  # the estimator jumps to its fix
    placed = flight.placed.pos_ned_m
    flight.motion.receive_position(flight.reported, flight.now_s + 0.05, reckons=True)
    still = flight.motion.receive_position(flight.reported, flight.now_s + 0.1, reckons=True)
    assert math.dist(still.pos_ned_m[:2], placed[:2]) < 0.4  # it has not jumped with it
    back = flight.motion.receive_position(flight.reported, flight.now_s + 0.15, reckons=False)
    assert back.pos_ned_m == flight.reported.pos_ned_m


def test_where_there_is_nothing_to_see_a_lost_fix_changes_nothing() -> None:
    flight = Reckoning([])
    flight.reckons = True
    fly(flight, 3.0)
    assert flight.placed.pos_ned_m == flight.reported.pos_ned_m
