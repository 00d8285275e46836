"""The roll-outs of the response model against the same written in complex numbers: north + i east, call by call."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest

from companion.core.model.events import Position
from companion.core.model.states import VelocityShaping
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_cloud import ObstacleKind
from companion.core.safety.clearance import ADDED_M, Use, clearance_m
from companion.core.safety.disturbance import (
    AHEAD_TICKS,
    CALM_MPS,
    DEAD_TICKS,
    FOLLOW,
    FOLLOWS_S,
    LIMIT_MPS,
    MEMORY_S,
    WIND_S,
    DisturbanceEstimator,
    DisturbanceObserver,
    WindObserver,
    build_disturbance_observer,
)
from companion.core.safety.response_model import (
    BACK_OFF_MAX_MPS,
    BACK_OFF_PER_S,
    BEHIND_S,
    CALM,
    CREEP_MPS,
    DEAD_S,
    ESCAPE_S,
    GUST_SHARE,
    LAG_S,
    REACTION_S,
    STEP_S,
    Disturbance,
    ResponseModel,
    follow_lagged,
    follow_shaped,
)
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from tests.unit.core.core_kit import mission

pytestmark = pytest.mark.sources

MODEL = ResponseModel(3.0, 1.8)
DEAD = round(DEAD_S / STEP_S)
SHAPING = VelocityShaping(acceleration_mps2=2.5, jerk_mps3=5.0, lag_s=0.4, dead_s=0.2)


class Asked:
    """A cloud that says yes, and keeps what it was asked."""

    def __init__(self, *, no_to: int = -1, is_seen: bool = True) -> None:
        self.calls: list[tuple[complex, ...]] = []
        self._no_to, self._is_seen = no_to, is_seen

    def is_way_clear(self, from_n: float, from_e: float, to_n: float, to_e: float) -> bool:
        self.calls.append((complex(from_n, from_e), complex(to_n, to_e)))
        return len(self.calls) - 1 != self._no_to

    def is_seen(self, north_m: float, east_m: float) -> bool:
        self.calls.append((complex(north_m, east_m),))
        return self._is_seen

    def nearest_m2(self, north_m: float, east_m: float) -> float:
        self.calls.append((complex(north_m, east_m),))
        return abs(complex(north_m, east_m) - (2.0 + 3.0j)) ** 2


def cut(v: complex, most: float) -> complex:
    return v * most / abs(v) if abs(v) > most else v


def level(v: complex) -> tuple[float, float]:
    return v.real, v.imag


def follow(u: complex, s: complex) -> tuple[complex, complex]:
    """A step: way, and the velocity after it."""
    d = cut((s - u) * STEP_S / LAG_S, MODEL.acceleration_mps2 * STEP_S)
    return (u + 0.5 * d) * STEP_S, u + d


def ways(
    vel: complex, last: complex, told: complex, hold_s: float, air: Disturbance, *, slews: bool
) -> list[tuple[complex, ...]]:
    """All that a cloud without obstacles is asked."""
    place, u, s = 0j, vel, last
    if air.under_way is not None:
        place, u = complex(*air.under_way[:2]), vel + complex(*air.under_way[2:])
    asked: list[tuple[complex, ...]] = []
    start, steps = place, DEAD + round(hold_s / STEP_S)
    half = DEAD if hold_s <= 2.0 * STEP_S else (steps + 1) // 2
    for k in range(steps):
        if k >= DEAD:
            s = s + cut(told - s, MODEL.acceleration_mps2 * STEP_S) if slews else told
        way, u = follow(u, s)
        place += way
        if k + 1 == half and half < steps:
            asked.append((start, place))
            start = place
    asked.append((start, place))
    if abs(u) < 1e-6:
        return asked
    gust_mps = GUST_SHARE * air.change_mps if abs(u) > CREEP_MPS else 0.0
    end = place + MODEL.way_m(abs(u) + gust_mps) * u / abs(u)
    if abs(u) > CREEP_MPS:
        asked.append((end,))
    return [*asked, (place, end)]


def draw(seed: int) -> tuple[random.Random, complex, complex, complex, Disturbance]:
    rng = random.Random(seed)
    vel, last, told = (complex(rng.uniform(-4.0, 4.0), rng.uniform(-4.0, 4.0)) for _ in range(3))
    under_way = (rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1))
    air = Disturbance(ZERO, rng.uniform(0.0, 1.0), under_way if seed % 2 else None)
    return rng, vel, last, told, air


@pytest.mark.parametrize("hold_s", [0.05, 0.1, 0.15, 0.5, 1.0])
@pytest.mark.parametrize("slews", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_cloud_is_asked_for_each_part_of_the_way_to_a_stop(seed: int, hold_s: float, *, slews: bool) -> None:
    _, vel, last, told, air = draw(seed)
    if seed == 4:  # it creeps
        vel, last, told = 0.2 + 0.1j, 0.2 + 0j, 0.1 + 0.1j
    if seed == 2:
        vel = last = told = 0j
    cloud: Any = Asked()
    assert MODEL.is_clear(cloud, level(vel), level(last), level(told), hold_s, slews=slews, disturbance=air)
    expected = ways(vel, last, told, hold_s, air, slews=slews)
    assert len(cloud.calls) == len(expected)
    for asked, wanted in zip(cloud.calls, expected, strict=True):
        assert asked == pytest.approx(wanted, abs=1e-9)
    for k, wanted in enumerate(expected):
        barred: Any = Asked(no_to=k if len(wanted) == 2 else -1, is_seen=len(wanted) == 2)
        assert not MODEL.is_clear(barred, level(vel), level(last), level(told), hold_s, slews=slews, disturbance=air)


@pytest.mark.parametrize("seed", range(6))
def test_ways_out_are_compared_over_a_second(seed: int) -> None:
    _, vel, last, told, air = draw(seed)
    cloud: Any = Asked()
    found_m = MODEL.find_nearest_m(cloud, level(vel), level(last), level(told), air)
    place, u, s, expected = 0j, vel, last, []
    if air.under_way is not None:
        place, u = complex(*air.under_way[:2]), vel + complex(*air.under_way[2:])
    for k in range(round(ESCAPE_S / STEP_S)):
        way, u = follow(u, told if k >= DEAD else s)
        place += way
        expected.append((place,))
    assert [call[0] for call in cloud.calls] == pytest.approx([one[0] for one in expected], abs=1e-9)
    away_m = [abs(one[0] - (2.0 + 3.0j)) for one in expected]
    assert found_m == pytest.approx((min(away_m), away_m[-1]))
    calm: Any = Asked()
    assert MODEL.find_nearest_m(calm, level(vel), level(last), level(told)) == MODEL.find_nearest_m(
        Asked(),  # type: ignore[arg-type]
        level(vel),
        level(last),
        level(told),
        CALM,
    )


def test_in_calm_air_nothing_is_added() -> None:
    calm = Disturbance()
    assert (calm.vel_ned_mps, calm.change_mps, calm.under_way, calm.dead_s) == (ZERO, 0.0, None, DEAD_S)
    assert Disturbance(change_mps=2.0).gust_mps == 2.0 * GUST_SHARE


def test_way_speed_and_closing_are_their_formulas() -> None:
    for speed_mps in (0.0, 0.7, 3.0):
        way_m = LAG_S * speed_mps + speed_mps**2 / 3.6
        assert MODEL.way_m(speed_mps) == pytest.approx(way_m)
        assert MODEL.speed_mps(way_m) == pytest.approx(speed_mps)
        assert MODEL.speed_mps(way_m + 0.4 * speed_mps, 0.4) == pytest.approx(speed_mps)
    assert (MODEL.speed_mps(0.0), MODEL.speed_mps(-1.0)) == (0.0, 0.0)
    assert MODEL.closing_mps(0.0) == 0.0
    assert MODEL.closing_mps(-0.5) == -0.5 * BACK_OFF_PER_S
    assert MODEL.closing_mps(-9.0) == -BACK_OFF_MAX_MPS
    for speed_mps in (0.5, 2.0):
        assert MODEL.closing_mps(REACTION_S * speed_mps + speed_mps**2 / 3.6) == pytest.approx(speed_mps)


def test_behind_one_that_may_brake_it_is_as_fast_as_it_may_stop_after_it() -> None:
    for its_mps in (0.0, -2.0):
        assert MODEL.behind_mps(3.0, its_mps) == MODEL.closing_mps(3.0) + its_mps
    for its_mps, speed_mps in ((1.0, 1.5), (3.0, 2.0)):
        room_m = BEHIND_S * speed_mps + speed_mps**2 / 6.0 - its_mps**2 / 6.0
        assert MODEL.behind_mps(room_m, its_mps) == pytest.approx(speed_mps)
    assert MODEL.behind_mps(-1.5, 3.0) == 0.0  # its way to a stop is just what is lacking
    assert MODEL.behind_mps(-2.0, 3.0) == MODEL.closing_mps(-0.5)


@pytest.mark.parametrize("seed", range(5))
def test_following_with_a_lag_and_with_limited_jerk(seed: int) -> None:
    rng = random.Random(seed)
    vel, told, acc = (complex(rng.uniform(-3.0, 3.0), rng.uniform(-3.0, 3.0)) for _ in range(3))
    if seed == 4:
        told = vel + 0.01j
    dt_s = rng.choice([0.05, 0.1])
    lagged = vel + cut((1.0 - math.exp(-dt_s / LAG_S)) * (told - vel), 2.0 * dt_s)
    assert complex(*follow_lagged(level(vel), level(told), dt_s, 2.0)) == pytest.approx(lagged)
    for most_mps2 in (1.0, 9.0):
        rest = abs(told - vel)
        ask = min(most_mps2, SHAPING.acceleration_mps2, rest / SHAPING.lag_s, math.sqrt(SHAPING.jerk_mps3 * rest))
        after = acc + cut((told - vel) / rest * ask - acc, SHAPING.jerk_mps3 * dt_s)
        v, a = follow_shaped(level(vel), level(acc), level(told), dt_s, most_mps2, SHAPING)
        assert complex(*a) == pytest.approx(after)
        assert complex(*v) == pytest.approx(vel + after * dt_s)
    v, a = follow_shaped(level(vel), (0.0, 0.0), level(vel), dt_s, 1.0, SHAPING)
    assert (v, a) == (level(vel), (0.0, 0.0))


# --- the observer ---


def test_observer_of_the_wind_is_the_estimator_fed_with_the_level_velocities() -> None:
    rng, seen, alone = random.Random(3), WindObserver(3.0), DisturbanceEstimator()
    alone.adopt_shaping(SHAPING)
    for k in range(80):
        vel = (rng.uniform(-1.0, 1.0), 2.0 + rng.uniform(-1.0, 1.0), 0.3)
        told = (rng.uniform(-1.0, 1.0), 2.0, -0.2)
        found = seen.observe_disturbance(Position(ZERO, vel, None), told, 0.05, SHAPING)
        alone.estimate_disturbance(vel[:2], told[:2], 0.05, 3.0)
        under_way = alone.under_way(STEP_S, 3.0)
        assert found.vel_ned_mps == (*alone.level_mps, 0.0)
        assert (found.change_mps, found.under_way, found.dead_s) == (alone.change_mps, under_way, alone.dead_s), k
    assert found.change_mps > CALM_MPS
    seen.reset()
    alone.reset()
    found = seen.observe_disturbance(Position(ZERO, (1.0, 0.0, 0.0), None), ZERO, 0.05, SHAPING)
    assert found.vel_ned_mps == ZERO


def test_only_a_vehicle_with_an_obstacle_sensor_observes_the_wind() -> None:
    assert type(build_disturbance_observer(mission())) is DisturbanceObserver
    senses = mission(sensing={"range_m": 12.0})
    assert isinstance(build_disturbance_observer(senses), WindObserver)
    assert DisturbanceObserver().observe_disturbance(Position(ZERO, ZERO, None), ZERO, 0.05, None) is CALM


@pytest.mark.parametrize(("kind", "use"), list(ADDED_M))
def test_a_clearance_is_what_an_obstacle_has_and_what_its_use_adds(kind: ObstacleKind, use: Use) -> None:
    added_m = sum(ADDED_M[kind, use])
    assert clearance_m(kind, use) == pytest.approx(added_m)
    assert clearance_m(kind, use, 2.0) == pytest.approx(2.0 + added_m)


class Bare(Asked):
    """Without trunks of the mission."""

    trunks = ()

    def find_way_out(self) -> tuple[float, float, float]:
        return 0.0, 0.0, 0.0

    def widened(self, by_m: float) -> Bare:  # noqa: ARG002
        return self


@pytest.mark.parametrize("seed", range(4))
def test_filter_verifies_what_is_flown_and_not_what_is_told(seed: int) -> None:
    """The wind's part is added to the setpoint before, and to the one that is tried."""
    rng = random.Random(seed)
    vel, last, told, drift = (complex(rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5)) for _ in range(4))
    cloud: Any = Bare()
    own = Position((0.0, 0.0, -8.0), (*level(vel), 0.0), None)
    around = Surroundings(own, (), {}, cloud, bias_ned_mps=(*level(drift), 0.0), commanded_ned_mps=(*level(last), 0.0))
    safety_filter = SafetyFilter.of(mission(sensing={"range_m": 12.0}))
    setpoint = safety_filter.apply((*level(told), 0.0), around, dt_s=0.05)
    tried = complex(*setpoint.vel_ned_mps[:2])
    response = safety_filter.response
    limits = (response.acceleration_mps2, response.braking_mps2)
    assert limits == pytest.approx((MODEL.acceleration_mps2, MODEL.braking_mps2))
    expected = ways(vel, last + drift, tried + drift, 0.05, CALM, slews=False)
    assert len(cloud.calls) == len(expected)
    for asked, wanted in zip(cloud.calls, expected, strict=True):
        assert asked == pytest.approx(wanted, abs=1e-9)


# --- the estimator ---


class Reference:
    """The estimator for vehicles that follow with a lag, in complex numbers."""

    def __init__(self) -> None:
        self.models = [
            {"under_way": [0j] * dead, "u": 0j, "off": 0j, "mean": 0j, "misses2": 0.0} for dead in DEAD_TICKS
        ]
        self.level, self.square, self.past, self.begins = 0j, 0.0, [], True

    def estimate(self, vel: complex, told: complex, dt_s: float, most_mps2: float) -> None:
        if self.begins:
            self.begins = False
            for model in self.models:
                model |= {"under_way": [0j] * len(model["under_way"]), "u": vel, "off": 0j, "mean": 0j}
            return
        for model in self.models:
            model["under_way"].append(told)
            acts = model["under_way"].pop(0)
            model["u"] += cut((1.0 - math.exp(-dt_s / LAG_S)) * (acts - model["u"]), most_mps2 * dt_s)
            off = vel - model["u"]
            model["off"] = off
            model["mean"] += min(1.0, dt_s / WIND_S) * (off - model["mean"])
            model["misses2"] += min(1.0, dt_s / FOLLOWS_S) * (abs(off - model["mean"]) ** 2 - model["misses2"])
        off = min(self.models, key=lambda model: model["misses2"])["off"]
        self.level = cut(self.level + FOLLOW * (off - self.level), LIMIT_MPS)
        self.past.append(self.level)
        if len(self.past) > AHEAD_TICKS:
            square = abs(off - self.past.pop(0)) ** 2
            self.square += min(1.0, dt_s / MEMORY_S) * (square - self.square)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("gust_mps", [0.3, 5.0])
def test_estimator_is_the_same_in_complex_numbers(seed: int, gust_mps: float) -> None:
    rng, estimator, reference = random.Random(seed), DisturbanceEstimator(), Reference()
    assert estimator.level_mps == (0.0, 0.0)
    told = 0j
    for k in range(200):
        if k % 20 == 0:
            told = complex(rng.uniform(-2.0, 2.0), rng.uniform(-2.0, 2.0))
        vel = told + gust_mps * complex(rng.uniform(-1.0, 1.0), rng.uniform(0.0, 1.0))
        estimator.estimate_disturbance(level(vel), level(told), 0.05, 3.0)
        reference.estimate(vel, told, 0.05, 3.0)
        assert complex(*estimator.level_mps) == pytest.approx(reference.level, abs=1e-9)
        assert estimator.change_mps == pytest.approx(max(0.0, math.sqrt(reference.square) - CALM_MPS))


def test_what_is_under_way_is_where_the_shaped_vehicle_drifts_until_a_setpoint_acts() -> None:
    """It flies as its make shapes it, and wind adds a constant."""
    estimator, wind = DisturbanceEstimator(), 0.4 - 0.3j
    estimator.adopt_shaping(SHAPING)
    rng, v, a = random.Random(5), (0.0, 0.0), (0.0, 0.0)
    waits = [(0.0, 0.0)] * round(SHAPING.dead_s / STEP_S)
    estimator.estimate_disturbance((0.0, 0.0), (0.0, 0.0), STEP_S, 3.0)
    told = (0.0, 0.0)
    for k in range(400):
        if k % 15 == 0:
            told = (rng.uniform(-2.0, 2.0), rng.uniform(-2.0, 2.0))
        waits.append(told)
        v, a = follow_shaped(v, a, waits.pop(0), STEP_S, 3.0, SHAPING)
        estimator.estimate_disturbance(level(complex(*v) + wind), told, STEP_S, 3.0)
    assert estimator.dead_s == SHAPING.dead_s + DEAD_S
    assert complex(*estimator.level_mps) == pytest.approx(wind, abs=0.02)
    place, u, b = 0j, v, a
    for acts in waits:
        u, b = follow_shaped(u, b, acts, STEP_S, 3.0, SHAPING)
        place += (complex(*u) + wind) * STEP_S
    found = estimator.under_way(STEP_S, 3.0)
    assert found is not None
    assert complex(*found[:2]) == pytest.approx(place, abs=1e-6)
    assert complex(*found[2:]) == pytest.approx(complex(*u) - complex(*v), abs=1e-6)
