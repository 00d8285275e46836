"""A vehicle with an obstacle sensor: what it flies, hands down and looks at."""

from __future__ import annotations

import math
from typing import Any

import pytest

from companion.core.guidance import formation
from companion.core.model.events import ObstacleScan, Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, add, limit, scale, sub
from companion.core.safety.response_model import CREEP_MPS
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission
from tests.unit.core.core_steered import Steered

EAST_GOAL: Vec3 = (0.0, 130.0, -8.0)


def scan(hits: dict[int, float]) -> ObstacleScan:
    ranges = [hits.get(k, math.inf) for k in range(72)]
    return ObstacleScan(0, tuple(ranges), 0.0, math.tau / 72, 0.2, 8.0)


LEADING: dict[str, Any] = {
    "state": FlightState.TRANSIT,
    "phase": SwarmPhase.TRANSIT,
    "route": formation.LEADER_ROUTE,
    "range_m": 30.0,
    "role": Role.LEADER,
    "governor": 1.0,
    "lease_freshness": 1.0,
    "goal": (EAST_GOAL, 4.0),
    "size": 8,
}


def fly(s: float, hits: dict[int, float], *, scans_until_s: float = math.inf, **sensing: Any) -> Steered:
    """The leader on its way east from rest, as a point mass; the scans stay as they are."""
    steered = Steered(mission(sensing=sensing), 1)
    vel: Vec3 = ZERO
    for k in range(round(s / 0.05)):
        now_s, own = 0.05 * k, Position((0.0, 0.0, -8.0), vel)
        if k % 2 == 0 and now_s <= scans_until_s:
            steered.integrate_scan(scan(hits), own, now_s)
        vel = followed(vel, steered.steer(steered.observe(own, now_s), **LEADING))
    return steered


def followed(vel: Vec3, told: Vec3) -> Vec3:
    """A tick on."""
    return add(vel, limit(scale(sub(told, vel), -math.expm1(-0.05 / 0.3)), 3.0 * 0.05))


def test_leader_hands_down_its_course_and_not_its_dodge() -> None:
    movement = fly(2.0, {17: 5.0})  # a trunk a little to the left of the way east
    assert movement.setpoint_ned_mps[0] < -0.2
    assert movement.ref_ned_mps == pytest.approx((0.0, 3.0, 0.0))


def test_without_scans_for_longer_than_stale_it_comes_to_creep_at_most() -> None:
    assert math.hypot(*fly(2.0, {}).setpoint_ned_mps) > 2.5
    assert math.hypot(*fly(4.0, {}, scans_until_s=2.0).setpoint_ned_mps) <= CREEP_MPS + 1e-6


def test_before_its_first_scan_it_creeps_at_most() -> None:
    assert math.hypot(*fly(2.0, {}, scans_until_s=-1.0).setpoint_ned_mps) <= CREEP_MPS + 1e-6


def test_with_a_narrow_view_it_looks_where_it_wants_to_go() -> None:
    """Not where it dodges to: the trunk that it passes stays in view."""
    movement = fly(2.0, {17: 5.0}, field_of_view_deg=120.0)
    assert movement.yaw_rad == pytest.approx(math.pi / 2.0, abs=0.05)


def test_no_wish_is_flown_faster_than_it_stops_within_its_sight() -> None:
    near, far = (_fastest(range_m) for range_m in (8.0, 16.0))
    assert 3.5 < near < 4.5 < far


def _fastest(range_m: float) -> float:
    flown = mission(sensing={"range_m": range_m}, route={"vel_leader_mps": 6.0}, limits={"speed_max_mps": 8.0})
    steered, vel = Steered(flown, 1), ZERO
    for k in range(100):
        own = Position((0.0, 0.0, -8.0), vel)
        steered.integrate_scan(ObstacleScan(0, (math.inf,) * 72, 0.0, math.tau / 72, 0.2, range_m), own, 0.05 * k)
        vel = followed(vel, steered.steer(steered.observe(own, 0.05 * k), **LEADING))
    return math.hypot(*vel)
