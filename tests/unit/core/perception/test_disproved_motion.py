"""A motion that what was taken for trunks did not tell: as if nothing had been seen, but that no place jumps."""

from __future__ import annotations

import math

import pytest

from companion.core.model.events import Position
from companion.core.perception.own_motion import OwnMotion
from companion.core.perception.scan_odometry import MISSED_MAX
from tests.unit.core.perception.scan_kit import FINE, level_scan
from tests.unit.core.perception.test_scan_odometry import STEP_S, Flight, fly, stand

TOLD_OTHERWISE = (0.1, 0.2, 0.3)


class Watched(Flight):
    """In a swarm of more vehicles than there are trunks: these may be vehicles that fly along."""

    def __init__(self, *, is_odometry: bool = False) -> None:
        super().__init__(stand())
        self.motion = OwnMotion(FINE, turns_with_yaw=False, is_odometry=is_odometry, hull_m=0.35, others=99)

    def scan(self) -> None:
        placed = self.motion.odometry.correct_place(self.reported.pos_ned_m)
        scan = level_scan(self.stems, self.true_m, turned_rad=self.yaw_off_rad + self.motion.turn_rad)
        for k in range(len(scan.eyes_north_m)):
            scan.eyes_north_m[k], scan.eyes_east_m[k] = placed[0], placed[1]
        self.motion.integrate_turn(scan, 0.0, Position(placed, (0.0, 0.0, 0.0)), (), self.now_s)

    def placed_m(self) -> float:
        """How far north the flight has the vehicle."""
        return self.motion.receive_position(self.reported, self.now_s).pos_ned_m[0]

    def goes_by_sight(self) -> bool:
        return self.motion.velocity_bias_ne_mps is not None

    def knows_nothing(self) -> bool:
        odometry = self.motion.odometry
        return not odometry.is_corrected(self.now_s) and odometry.shift_sd_m(self.now_s) == math.inf


@pytest.mark.parametrize("is_odometry", [False, True])
def test_once_what_is_taken_for_trunks_is_known_to_move_it_tells_nothing(is_odometry: bool) -> None:
    """For half a second it still corrected the pose, and for 4 s a velocity that began at 0, at the least margin."""
    flight = Watched(is_odometry=is_odometry)
    flight.off_m = (0.5, 0.0)
    fly(flight, 3.0)
    flight.off_m = (0.8, 0.0)
    fly(flight, 1.0)
    assert flight.goes_by_sight()
    flight.off_mps = (1.1, 0.0)
    steps = 0
    while flight.goes_by_sight() and steps < 15:
        before_m, steps = flight.placed_m(), steps + 1
        fly(flight, STEP_S)
        assert flight.placed_m() - before_m == pytest.approx(2.0 * STEP_S, abs=0.1)
    assert flight.knows_nothing()
    assert abs(flight.motion.odometry.shift_m[0]) > 0.2
    assert flight.motion.setpoint_bias(TOLD_OTHERWISE) == TOLD_OTHERWISE


@pytest.mark.parametrize("is_odometry", [False, True])
def test_after_trunks_that_were_missing_all_is_as_never_seen_until_some_are_good(is_odometry: bool) -> None:
    flight = Watched(is_odometry=is_odometry)
    flight.off_mps = (0.3, 0.0)
    fly(flight, 4.0)
    assert flight.goes_by_sight()
    flight.yaw_off_rad, before_m = math.radians(40.0), flight.placed_m()
    fly(flight, STEP_S * MISSED_MAX)
    assert flight.knows_nothing()
    assert not flight.goes_by_sight()
    assert flight.placed_m() - before_m == pytest.approx(2.0 * STEP_S * MISSED_MAX, abs=0.1)
    flight.yaw_off_rad = 0.0
    fly(flight, 4.0)
    bias = flight.motion.velocity_bias_ne_mps
    assert bias is not None
    assert math.dist(bias, (-0.3, 0.0)) < 0.06
    assert flight.motion.odometry.shift_sd_m(flight.now_s) < 0.1


def test_a_mere_gap_disproves_nothing() -> None:
    flight = Watched()
    fly(flight, 4.0)
    corrected_s = flight.motion.odometry.corrected_s
    flight.now_s += 1.5
    flight.motion.receive_position(flight.reported, flight.now_s)
    assert not flight.motion.odometry.trunks
    assert flight.motion.odometry.corrected_s == corrected_s
    assert 0.1 < flight.motion.odometry.shift_sd_m(flight.now_s) < 0.2
