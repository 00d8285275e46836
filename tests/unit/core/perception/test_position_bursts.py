"""Positions that come late and all at once, after a hiccup of the companion or of a link: no jump, no velocity."""

from __future__ import annotations

import math

import pytest

from companion.core.model.events import Position
from companion.core.perception.own_motion import OwnMotion
from tests.unit.core.perception.scan_kit import FINE, level_scan
from tests.unit.core.perception.test_scan_odometry import stand

SPEED_MPS = 3.0
POSITIONS_HZ, SCANS_EVERY = 30, 3
BEGINS_S, ENDS_S = 4.0, 6.5
BOOTED_S = 55.0  # later than the companion


class BurstFlight:
    """North at 3 m/s, reported without an error; what comes in the gap is read when it ends."""

    def __init__(self, gap_s: float, *, has_boot: bool = True, jump_m: float = 0.0) -> None:
        self.motion = OwnMotion(FINE, turns_with_yaw=False, hull_m=0.35, others=7)
        self.stems = stand()
        self.gap_s, self.has_boot, self.jump_m = gap_s, has_boot, jump_m
        self.largest_bias_mps = 0.0

    def reported(self, at_s: float) -> Position:
        jump_m = self.jump_m if at_s > BEGINS_S + 0.5 * self.gap_s else 0.0
        boot_s = at_s + BOOTED_S if self.has_boot else None
        return Position((SPEED_MPS * at_s + jump_m, 0.0, -4.0), (SPEED_MPS, 0.0, 0.0), boot_s)

    def fly(self) -> float:
        """Metres by which the corrected place is off at the end."""
        own = self.reported(0.0)
        for k in range(round(ENDS_S * POSITIONS_HZ)):
            at_s = k / POSITIONS_HZ
            is_late = BEGINS_S < at_s <= BEGINS_S + self.gap_s
            now_s = BEGINS_S + self.gap_s if is_late else at_s
            own = self.reported(at_s)
            self.motion.receive_position(own, now_s)
            bias = self.motion.velocity_bias_ne_mps
            if now_s >= BEGINS_S and bias is not None:
                self.largest_bias_mps = max(self.largest_bias_mps, math.hypot(*bias))
            if k % SCANS_EVERY == 0 and not is_late:
                self._scan(own, at_s)
        placed = self.motion.correct_place(own.pos_ned_m)
        return math.dist(placed[:2], (SPEED_MPS * at_s, 0.0))

    def _scan(self, own: Position, at_s: float) -> None:
        placed = self.motion.correct_position(own)
        scan = level_scan(self.stems, (SPEED_MPS * at_s, 0.0), turned_rad=self.motion.turn_rad)
        for k in range(len(scan.eyes_north_m)):
            scan.eyes_north_m[k], scan.eyes_east_m[k] = placed.pos_ned_m[0], placed.pos_ned_m[1]
        self.motion.integrate_turn(scan, 0.0, placed, (), at_s)


@pytest.mark.parametrize("gap_s", [0.05, 0.2, 0.25, 0.3, 0.35])
def test_positions_that_come_at_once_are_no_jump_and_no_velocity(gap_s: float) -> None:
    """Told apart by arrival, a gap of 0.3 s left the place 0.86 m wrong and the velocity 0.97 m/s."""
    flight = BurstFlight(gap_s)
    assert flight.fly() < 0.1
    assert flight.largest_bias_mps < 0.1
    assert flight.motion.odometry.shift_sd_m(ENDS_S) < 0.1


def test_a_jump_among_positions_that_come_at_once_is_one() -> None:
    flight = BurstFlight(0.3, jump_m=2.0)
    assert flight.fly() < 0.1
    assert flight.motion.odometry.shift_m[0] == pytest.approx(-2.0, abs=0.1)


def test_without_the_autopilots_time_a_gap_of_the_scans_rate_is_harmless() -> None:
    flight = BurstFlight(0.05, has_boot=False)
    assert flight.fly() < 0.1
    assert flight.largest_bias_mps < 0.1
