"""Whatever rays a sensor of an installed package makes up: nothing raises, and what comes of it are numbers."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.model.events import LidarScan, Position
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_perception import build_perception
from companion.core.vehicle.obstacle_sensor_monitor import NO_SCAN, ObstacleSensorMonitor
from tests.unit.core.core_kit import mission
from tests.unit.sensors.lidar_kit import scan

HERE = Position((0.0, 0.0, -4.0), (1.0, 0.0, 0.0))
BAD = (math.nan, math.inf, -math.inf, -1.0, -0.0, 1e308, -1e308, 1e-308, 1e30, -1e30, 3.0, 12.0, 0.2)
SOUND: dict[str, float] = {
    "elevation_rad": 0.0,
    "start_rad": 0.0,
    "step_rad": math.tau / 360,
    "min_m": 0.2,
    "max_m": 12.0,
    "age_s": 0.1,
    "ray_time_s": 0.1 / 360,
}


def drawn(rng: random.Random, turn: int) -> LidarScan:
    """A piece, about half of whose numbers make no sense."""

    def number() -> float:
        return rng.choice(BAD) if rng.random() < 0.5 else rng.uniform(-20.0, 20.0)

    def attitude() -> tuple[float, float, float]:
        return rng.choice([ZERO, (number(), number(), number())])

    told = {name: value if rng.random() < 0.7 else number() for name, value in SOUND.items()}
    ranges_m = tuple(rng.choice([number(), 5.0, math.inf, math.nan]) for _ in range(rng.choice([0, 1, 2, 90, 360])))
    return scan(
        ranges_m,
        sensor=rng.choice([196, 197, 0, -1, 1000]),
        turn=rng.choice([turn, turn // 4, 300, -1]),
        first_attitude_rad=attitude(),
        last_attitude_rad=attitude(),
        **told,
    )


@given(st.integers(0, 2**32), st.sampled_from(["scan-1deg", "scan-0.5deg", "multi-layer"]))
def test_no_rays_raise_and_all_that_comes_of_them_are_numbers(seed: int, sensor: str) -> None:
    rng, perception = random.Random(seed), build_perception(mission(sensing={"sensor": sensor, "range_m": 12.0}), 1)
    for k in range(12):
        now_s = 10.0 + 0.1 * k
        perception.correct_odometry(HERE, now_s)
        perception.integrate_scan(drawn(rng, k), HERE, now_s, ())
        cloud = perception.observe_obstacles(HERE.pos_ned_m, HERE.pos_ned_m, {}, now_s)
        numbers = (*cloud.norths, *cloud.easts, *cloud.clears_m, cloud.reach_m, cloud.sensor_m)
        assert all(math.isfinite(number) for number in numbers)
        assert all(abs(bias) < 5.0 for bias in perception.velocity_bias(ZERO))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[(name, bad) for name in SOUND for bad in (math.nan, math.inf, -math.inf, 1e308, -1e308)],
        ("step_rad", 1e-308),
        ("step_rad", 1.0),
        ("min_m", 13.0),
        ("max_m", 0.0),
        ("ray_time_s", 1.0),
        ("ranges_m", ()),
        ("ranges_m", (5.0, -1.0)),
        ("ranges_m", (5.0, -math.inf)),
        *[("first_attitude_rad", (0.0, bad, 0.0)) for bad in (math.nan, math.inf, 1e308)],
        *[("last_attitude_rad", (0.0, 0.0, bad)) for bad in (math.nan, -math.inf, -1e308)],
    ],
)
def test_a_piece_that_cannot_be_is_dropped_and_is_no_fresh_scan(name: str, value: Any) -> None:
    fields: dict[str, Any] = {**SOUND, "ranges_m": (3.0,) * 90, "turn": 1}
    assert scan(**fields).can_be
    bad = scan(**fields | {name: value})
    assert not bad.can_be
    perception, monitor = build_perception(mission(sensing={"sensor": "scan-1deg"}), 1), ObstacleSensorMonitor(0.3)
    perception.integrate_scan(bad, HERE, 10.0, ())
    monitor.record_scan(bad, 10.0)
    assert perception.nearest_m(HERE) == math.inf
    assert monitor.missing(10.0) == NO_SCAN


def test_rays_of_any_lidar_can_be() -> None:
    """The finest and the coarsest, of few rays and of many, old ones, one that sees nothing."""
    for rays in (1, 2, 12, 112, 360, 36_000):
        assert scan((math.inf,) * rays, max_m=655.35).can_be
    assert scan((math.nan, 1e9, 0.0), step_rad=-0.5, min_m=0.0, start_rad=-math.tau, age_s=5.0).can_be
