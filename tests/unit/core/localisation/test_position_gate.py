"""The gate of the own position: jumps are taken off, and one that freezes goes on by the velocity."""

from __future__ import annotations

import math

import pytest

from companion.core.localisation.integrity.position_gate import GAP_S, JUMP_M, PositionGate
from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from mission.common.frames import Vec3

DT_S = 0.05
EAST_MPS = 2.0


class Flown:
    """Flies east; `off` is what its autopilot tells too much."""

    def __init__(self, *, level: bool = True) -> None:
        self.gate = PositionGate(level=level)
        self.now_s, self.off = 100.0, ZERO
        self.frozen: Vec3 | None = None

    @property
    def true(self) -> Vec3:
        return (0.0, EAST_MPS * (self.now_s - 100.0), -5.0)

    def fly(self, seconds: float, *, airborne: bool = True, trusts: bool = False) -> Position:
        flown = Position(ZERO, ZERO)
        for _ in range(round(seconds / DT_S)):
            self.now_s += DT_S
            true, off = self.true, self.off
            told = self.frozen or (true[0] + off[0], true[1] + off[1], true[2] + off[2])
            position = Position(told, (0.0, EAST_MPS, 0.0), self.now_s)
            flown = self.gate.receive_position(position, self.now_s, airborne=airborne, trusts_jump=trusts)
            self.told = position
        return flown


def test_a_position_that_moves_as_its_velocity_says_is_the_same_object() -> None:
    one = Flown()
    assert one.fly(5.0) is one.told


@pytest.mark.parametrize("off", [(0.0, 6.0, 0.0), (-20.0, 0.0, 0.0), (0.0, 0.0, -10.0)])
def test_a_jump_is_taken_off_at_once_and_said_to_be_what_it_may_be_off(off: Vec3) -> None:
    one = Flown()
    one.fly(1.0)
    one.off = off
    assert math.dist(one.fly(DT_S).pos_ned_m, one.true) < 1e-6
    assert one.gate.jumped_s == one.now_s
    assert one.gate.is_off
    assert math.dist(one.fly(3.0).pos_ned_m, one.true) < 1e-6
    assert one.gate.error_m(one.now_s) == pytest.approx(math.hypot(off[0], off[1]))


def test_one_that_comes_back_is_believed_again_to_the_bit() -> None:
    one = Flown()
    one.fly(1.0)
    one.off = (8.0, 0.0, 0.0)
    one.fly(1.0)
    one.off = (0.4, 0.0, 0.0)
    assert one.fly(1.0) is one.told
    assert not one.gate.is_off


def test_less_than_a_jump_and_what_comes_after_a_gap_or_on_the_ground_is_believed() -> None:
    small, gap, ground, fix = Flown(), Flown(), Flown(), Flown()
    for one in (small, gap, ground, fix):
        one.fly(1.0)
    small.off = (JUMP_M - 0.1, 0.0, 0.0)
    gap.off = ground.off = fix.off = (9.0, 0.0, 0.0)
    gap.now_s += GAP_S
    assert small.fly(1.0) is small.told
    assert gap.fly(1.0) is gap.told
    assert ground.fly(1.0, airborne=False) is ground.told
    assert fix.fly(DT_S, trusts=True) is fix.told


def test_where_ranges_tell_level_positions_only_a_height_is_gated() -> None:
    one = Flown(level=False)
    one.fly(1.0)
    one.off = (9.0, 0.0, -9.0)
    assert one.fly(1.0).pos_ned_m == pytest.approx((9.0, one.true[1], one.true[2]))


def test_a_frozen_position_goes_on_by_the_velocity_and_is_found() -> None:
    one = Flown()
    one.fly(1.0)
    one.frozen = one.true
    assert math.dist(one.fly(2.0).pos_ned_m, one.true) < 1e-6
    assert one.gate.frozen_s(one.now_s) == pytest.approx(2.0)
    assert one.gate.error_m(one.now_s) > 0.0
    one.frozen = None
    assert one.fly(DT_S) is one.told
    assert one.gate.frozen_s(one.now_s) == 0.0


def test_one_that_stands_and_is_not_asked_to_move_may_repeat_its_position() -> None:
    gate = PositionGate(level=True)
    for k in range(100):
        gate.receive_position(Position((1.0, 2.0, -5.0), ZERO, DT_S * k), DT_S * k, airborne=True)
    assert gate.frozen_s(5.0) == 0.0
    gate.commanded_ned_mps = (0.0, 2.0, 0.0)
    for k in range(100, 120):
        gate.receive_position(Position((1.0, 2.0, -5.0), ZERO, DT_S * k), DT_S * k, airborne=True)
    assert gate.frozen_s(6.0) == pytest.approx(1.0, abs=0.11)


def test_back_at_a_fix_what_was_taken_off_before_is_forgotten_as_far_as_it_jumped() -> None:
    one = Flown()
    one.fly(1.0)
    one.off = (5.0, 0.0, -9.0)
    one.fly(1.0)
    one.off = (0.0, 0.0, -9.0)
    one.fly(DT_S, trusts=True)
    assert math.dist(one.fly(1.0).pos_ned_m, one.true) < 1e-6  # its height, which did not come back, is as it was
    one.off = ZERO
    one.fly(DT_S, trusts=True)
    assert one.fly(1.0) is one.told
    assert not one.gate.is_off
