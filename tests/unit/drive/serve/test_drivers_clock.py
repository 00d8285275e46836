"""The clock by which drivers of a served world stamp: when, by the wall clock, it was at a simulated time."""

from __future__ import annotations

import pytest

from sim_bridge.drive.serve.drivers_clock import REMEMBERED_S, DriversClock

STEP_S = 0.01


def stepped(walls_s: list[float], sim_s: float = 5.0) -> DriversClock:
    clock = DriversClock(STEP_S)
    for k, wall_s in enumerate(walls_s):
        clock.note_step(sim_s + k * STEP_S, wall_s)
    return clock


def test_in_time_stamps_are_simulated_time() -> None:
    clock = stepped([1000.0 + k * STEP_S for k in range(900)])
    last_s = 5.0 + 899 * STEP_S
    for ago_s in (0.0, 0.0042, 0.1, 2.0, REMEMBERED_S + 1.0):
        assert clock.stamp_s(last_s - ago_s) == pytest.approx(last_s - ago_s)


def test_stamps_tell_how_the_world_fell_behind_and_never_go_back() -> None:
    walls_s = [1000.0, 1000.01, 1000.02, 1001.02, 1001.03]  # it stood still for a second
    clock = stepped(walls_s)
    assert [clock.stamp_s(5.0 + k * STEP_S) for k in range(5)] == pytest.approx([5.0, 5.01, 5.02, 6.02, 6.03])
    stamps_s = [clock.stamp_s(4.99 + 0.001 * k) for k in range(51)]
    assert stamps_s == sorted(stamps_s)
    assert clock.stamp_s(5.025) == pytest.approx(5.52)
