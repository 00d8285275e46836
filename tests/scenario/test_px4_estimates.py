"""`sim.estimates = "recorded"` is as wrong as real PX4: the bridge's autopilots hover, and every error is measured.

The table is tests/testdata/px4_estimates.toml. Vehicles fly point masses, as errors do not depend on what flies.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.mavlink import dialect as mav
from mission.document.model import Mission
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.world import DEFAULT_ORIGIN, World

TABLE: dict[str, Any] = tomllib.loads(
    (Path(__file__).parents[1] / "testdata" / "px4_estimates.toml").read_text(encoding="utf-8")
)
WITHIN = 0.25
TICK_S, TICKS_PER_S = 0.05, 20
HOVER_S = 1200
HEIGHT_M = 20.0
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Flown:
    """Told less true, in the air: (T, n) or (T, n, axes), a row every TICK_S."""

    velocity_mps: Floats
    position_m: Floats
    yaw_rad: Floats
    true_down_m: Floats


@pytest.fixture(scope="module")
def flown() -> Flown:
    """As many PX4 as were recorded, in HOLD."""
    n = TABLE["vehicles"]
    mission = Mission.model_validate(
        {
            "schema": 1,
            "route": {"d1_enu_m": (0.0, 0.0, HEIGHT_M), "d2_enu_m": (60.0, 0.0, HEIGHT_M), "vel_leader_mps": 1.0},
            "swarm": {"size": n},
            "sim": {"estimates": "recorded", "seed": 1, "battery_mah": {str(k): 100_000.0 for k in range(1, n + 1)}},
        }
    ).with_origin(DEFAULT_ORIGIN)
    world = World(
        mission,
        lambda _frame, place, _seed: PointMass(place, 0.0),
        links={Link.ONBOARD: StreamProfile.MINIMAL},
        parameters={},
    )
    _fly(world, 5.0)
    codec = mav.MAVLink(None, srcSystem=1, srcComponent=191)
    for k, vehicle in world.vehicles.items():
        up = (22, 0, *[math.nan] * 6, DEFAULT_ORIGIN.alt_m + HEIGHT_M)
        for number, confirmation, *params in (up, (400, 0, 1.0, *[0.0] * 6)):
            message = mav.MAVLink_command_long_message(k, 1, number, confirmation, *params)
            vehicle.autopilot.receive(Link.ONBOARD, message.pack(codec), world.now_s)
    _fly(world, 60.0)
    assert all(v.autopilot.mode == "HOLD" and v.autopilot.armed for v in world.vehicles.values())
    told, true = _fly(world, HOVER_S)
    off = told - true
    return Flown(off[:, :, 3:6], off[:, :, :3], np.remainder(off[:, :, 6] + np.pi, math.tau) - np.pi, true[:, :, 2])


def _fly(world: World, seconds: float) -> tuple[Floats, Floats]:
    """Told and true position, velocity and yaw of all, after each step."""
    rows: list[list[tuple[float, ...]]] = []
    for _ in range(round(seconds * TICKS_PER_S)):
        world.step(TICK_S)
        for airframes in ([v.believed for v in world.vehicles.values()], [v.airframe for v in world.vehicles.values()]):
            states = [airframe.state for airframe in airframes]
            rows.append([(*s.pos_ned_m, *s.vel_ned_mps, s.attitude_rad[2]) for s in states])
    both = np.array(rows)
    return both[::2], both[1::2]


def rms(errors: Floats) -> Floats:
    """Of each vehicle and axis."""
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)))


def left(errors: Floats, after_s: float) -> float:
    """Of an error after that time; the mean over vehicles and axes."""
    lag = round(after_s * TICKS_PER_S)
    return float(np.mean(np.mean(errors[lag:] * errors[:-lag], axis=0) / np.mean(errors**2, axis=0)))


def moved(errors: Floats, within_s: float) -> Floats:
    """Changes of level errors."""
    lag = round(within_s * TICKS_PER_S)
    return np.asarray(errors[lag:, :, :2] - errors[:-lag, :, :2])


def integrated(errors: Floats) -> Floats:
    """Sums from the beginning on, in time."""
    return np.asarray(np.cumsum(errors, axis=0) * TICK_S)


def assert_sizes(sizes: Floats, seen: list[float]) -> None:
    """Each vehicle's within what was seen, and all together as large."""
    assert (1.0 - WITHIN) * seen[0] <= sizes.min()
    assert sizes.max() <= (1.0 + WITHIN) * seen[1]
    assert float(np.mean(sizes)) == pytest.approx(sum(seen) / 2.0, rel=WITHIN)


def assert_left(errors: Floats, wanted: list[list[float]]) -> None:
    for after_s, share in wanted:
        assert left(errors, after_s) == pytest.approx(share, rel=WITHIN, abs=0.03), after_s


def assert_shifts(shifts: Floats, wanted: list[float]) -> None:
    found = np.percentile(np.hypot(shifts[..., 0], shifts[..., 1]), [95.0, 99.9])
    assert found.tolist() == pytest.approx(wanted, rel=WITHIN)


def test_velocity_is_as_wrong(flown: Flown) -> None:
    level, table = flown.velocity_mps[..., :2], TABLE["velocity"]
    assert_sizes(rms(level), table["rms_mps"])
    assert_left(level, table["left"])
    assert_shifts(moved(integrated(flown.velocity_mps), 1.0), table["moved_1s_m"])
    assert_sizes(rms(flown.velocity_mps[..., 2]), TABLE["climb"]["rms_mps"])


def test_position_is_as_wrong(flown: Flown) -> None:
    level, table = flown.position_m[..., :2], TABLE["position"]
    assert_sizes(rms(level), table["rms_m"])
    assert_left(level, table["left"])
    assert_shifts(moved(flown.position_m, 1.0), table["moved_1s_m"])
    assert_shifts(moved(flown.position_m, 4.0), table["moved_4s_m"])


def test_position_goes_with_velocity(flown: Flown) -> None:
    cause, effect = moved(integrated(flown.velocity_mps), 1.0).ravel(), moved(flown.position_m, 1.0).ravel()
    assert float(np.corrcoef(cause, effect)[0, 1]) == pytest.approx(TABLE["together"]["correlation"], rel=WITHIN)
    slope = float(np.mean(cause * effect) / np.mean(cause**2))
    assert slope == pytest.approx(TABLE["together"]["slope"], rel=WITHIN)


def test_height_is_as_wrong_and_what_is_told_is_held(flown: Flown) -> None:
    errors = flown.position_m[..., 2]
    assert_sizes(rms(errors), TABLE["height"]["rms_m"])
    for k in range(errors.shape[1]):
        assert float(np.corrcoef(flown.true_down_m[:, k], errors[:, k])[0, 1]) < -0.8
        held = float(np.std(flown.true_down_m[:, k])) / float(np.std(errors[:, k]))
        assert 0.75 <= held <= 1.5  # the vertical velocity's error comes on top


def test_yaw_is_as_wrong(flown: Flown) -> None:
    means_deg = np.degrees(np.mean(flown.yaw_rad, axis=0))
    most_deg = TABLE["yaw"]["mean_most_deg"]
    assert np.abs(means_deg).max() == pytest.approx(most_deg, rel=WITHIN)
    assert means_deg.min() < 0.0 < means_deg.max()
    assert_sizes(np.degrees(np.std(flown.yaw_rad, axis=0)), TABLE["yaw"]["spread_deg"])
