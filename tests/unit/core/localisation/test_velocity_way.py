"""A position that drifts while its velocity is right, under the open sky."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from companion.core.localisation.gnss_denied.global_localisation import GlobalLocalisation
from companion.core.localisation.gnss_localiser import GnssLocaliser
from companion.core.localisation.integrity.fix_monitor import FixMonitor
from companion.core.localisation.integrity.own_position import BY_VELOCITY, OwnPosition
from companion.core.localisation.integrity.velocity_way import BETTER_M2_PER_S, WORST_M2_PER_S, VelocityWay
from companion.core.model.events import Position, Satellites
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_perception import OpenSkyPerception
from companion.core.vehicle.failsafe import Cause
from sim_bridge.world.autopilot.estimates.errors import PX4_SEEN
from sim_bridge.world.autopilot.estimates.noise import Swinging
from tests.unit.core.core_kit import mission

pytestmark = pytest.mark.sources

DT_S = 0.1
EAST_MPS = 2.0
# Vehicle 3 of `sim-bridge search --seed 70074 --flights 1` from take-off on, twice a second
DOUBTED = Path(__file__).parents[3] / "testdata" / "true_position_doubted.csv"


class Flown:
    """Flies east; its position is led north, its velocity may be."""

    def __init__(self, noise: Swinging | None = None) -> None:
        self.own = OwnPosition(mission(), GnssLocaliser(mission(), 1), OpenSkyPerception(mission()))
        self.noise = noise
        self.now_s, self.off_m = 100.0, 0.0
        self.flown = Position(ZERO, ZERO)

    def fly(self, seconds: float, drift_mps: float = 0.0, *, velocity_too: bool = False) -> None:
        for _ in range(round(seconds / DT_S)):
            self.now_s += DT_S
            self.off_m += drift_mps * DT_S
            noise, wrong, off = self.noise, ZERO, ZERO
            if noise is not None:
                noise.step(DT_S)
                wrong, off = noise.velocity_ned_mps, noise.pos_ned_m
            east_m = EAST_MPS * (self.now_s - 100.0)
            pos = (self.off_m + off[0], east_m + off[1], -5.0)
            vel = ((drift_mps if velocity_too else 0.0) + wrong[0], EAST_MPS + wrong[1], 0.0)
            self.told = Position(pos, vel, self.now_s)
            self.flown = self.own.receive(self.told, self.now_s, airborne=True, commanded_ned_mps=ZERO)

    def causes(self) -> list[Cause]:
        return [found.cause for found in self.own.findings(self.now_s, airborne=True, began_aloft=False)]


def px4(seed: int) -> Swinging:
    rng = np.random.default_rng(seed)
    sizes = PX4_SEEN.draw(rng)
    return Swinging(
        velocity_sd_mps=sizes.velocity_noise_mps,
        climb_sd_mps=sizes.climb_noise_mps,
        position_sd_m=sizes.position_noise_m,
        height_sd_m=sizes.height_noise_m,
        yaw_sd_rad=sizes.yaw_noise_rad,
        rng=rng,
    )


@pytest.mark.parametrize("drift_mps", [0.3, 0.5])
def test_a_position_that_leaves_its_velocity_is_dropped_for_the_way_by_that(drift_mps: float) -> None:
    one = Flown()
    one.fly(60.0)
    while not one.causes() and one.off_m < 30.0:
        one.fly(1.0, drift_mps)
    assert one.off_m < 8.0
    assert one.causes() == [Cause.POSITION_DOUBTED]
    one.fly(5.0, drift_mps)
    assert one.causes() == [Cause.GNSS_ASTRAY, Cause.POSITION_DOUBTED]
    assert one.flown.pos_ned_m[0] == pytest.approx(0.0, abs=1.0)
    assert one.flown.pos_ned_m[1] == pytest.approx(EAST_MPS * (one.now_s - 100.0), abs=0.5)
    assert one.own.error_m(one.now_s) > 1.0
    one.fly(15.0, drift_mps)
    assert one.causes()[0] is Cause.POSITION_DOUBTED_LONG


def test_a_drift_of_both_shows_nothing() -> None:
    one = Flown()
    one.fly(60.0)
    one.fly(60.0, 0.3, velocity_too=True)
    assert one.causes() == []
    assert one.flown is one.told


@pytest.mark.parametrize("seed", range(4))
def test_velocities_that_err_as_recorded_alarm_nobody(seed: int) -> None:
    one = Flown(px4(seed))
    for _ in range(30):
        one.fly(10.0)
        assert one.causes() == []


def learnt(error_mps: float, flown_s: float, *, since_s: float, drift_mps: float = 0.0, from_s: float = 0.0) -> float:
    """Drift of the way, should the position have left it at `since_s`; it did at `from_s`."""
    way = VelocityWay()
    for k in range(round(flown_s / DT_S)):
        now_s = k * DT_S
        led_m = drift_mps * max(0.0, now_s - from_s)
        wrong = error_mps * math.copysign(1.0, math.sin(0.4 * now_s))
        way.update(Position((0.0, led_m, -5.0), (wrong, 0.0, 0.0), now_s), now_s)
    return way.walk_since(since_s)


def test_a_velocity_counts_as_the_worst_until_even_the_most_that_it_may_err_by_is_less() -> None:
    assert VelocityWay().walk_since(0.0) == pytest.approx(WORST_M2_PER_S)
    assert learnt(0.0, 20.0, since_s=20.0) == pytest.approx(WORST_M2_PER_S)
    assert learnt(0.0, 60.0, since_s=60.0) < 0.1 * BETTER_M2_PER_S
    assert learnt(0.3, 60.0, since_s=60.0) == pytest.approx(WORST_M2_PER_S)
    assert learnt(3.0, 120.0, since_s=120.0) > WORST_M2_PER_S


def test_a_drift_is_not_learnt_as_an_error_of_the_velocity() -> None:
    assert learnt(0.0, 60.0, drift_mps=0.5, from_s=20.0, since_s=20.0) < 0.1 * BETTER_M2_PER_S
    assert learnt(0.0, 60.0, drift_mps=0.5, from_s=20.0, since_s=50.0) >= WORST_M2_PER_S  # it did before


def test_a_true_position_is_not_doubted_when_velocities_err_more_than_before() -> None:
    """As reported in a flight of the search: what eight spans had shown was a third of these errors' size."""
    way, monitor = VelocityWay(), FixMonitor(BY_VELOCITY)
    for line in DOUBTED.read_text().splitlines()[1:]:
        at_s, north, east, vel_north, vel_east = (float(cell) for cell in line.split(","))
        way.update(Position((north, east, -10.0), (vel_north, vel_east, 0.0), at_s), at_s)
        assert monitor.update((north, east), way.ne_m, at_s, walk_since=way.walk_since) is None


def test_a_gap_s_way_is_guessed_by_the_velocities_beside_it() -> None:
    way = VelocityWay()
    assert not way.update(Position(ZERO, ZERO, 1.0), 1.0)
    assert way.update(Position(ZERO, (2.0, 0.0, 0.0), 1.1), 1.1)
    assert way.guessed_m == 0.0
    assert not way.update(Position(ZERO, (1.0, 0.0, 0.0), 5.1), 5.1)
    assert way.ne_m == pytest.approx((6.1, 0.0))
    assert way.guessed_m == pytest.approx(8.0)  # it may have flown anywhere, so fast
    assert not way.update(Position(ZERO, (1.0, 0.0, 0.0), 0.5), 7.1)  # its autopilot began anew
    assert way.guessed_m == pytest.approx(10.0)


@pytest.mark.parametrize("seed", range(4))
def test_the_one_with_satellites_believes_its_fixes_by_velocities_that_err_as_recorded(seed: int) -> None:
    """Where not all have GNSS. By 0.004 m2/s, of an estimator without errors, each alarmed within 50 s."""
    noise, known = px4(seed), GlobalLocalisation(receives=True)
    for k in range(1500):
        now_s = k * DT_S
        noise.step(DT_S)
        off, wrong = noise.pos_ned_m, noise.velocity_ned_mps
        told = Position((off[0], EAST_MPS * now_s + off[1], -8.0), (wrong[0], EAST_MPS + wrong[1], 0.0), now_s)
        known.receive_satellites(Satellites(used=True, sd_m=0.9), now_s)
        known.note_flown(known.split_position(told, now_s, airborne=True), now_s)
    assert not known.is_astray


@pytest.mark.parametrize(("quiet_s", "most_m"), [(25.0, 5.0), (60.0, 4.0)])
def test_a_fix_that_is_led_away_is_not_learnt_as_an_error_of_the_velocity(quiet_s: float, most_m: float) -> None:
    """By the mean of what was learnt 8.3 m after 25 s, and 5.3 m after 60 s."""
    known, led_m, now_s = GlobalLocalisation(receives=True), 0.0, 0.0
    while not known.is_astray and led_m < 20.0:
        now_s += DT_S
        led_m += 0.3 * DT_S * (now_s > quiet_s)
        told = Position((led_m, EAST_MPS * now_s, -8.0), (0.0, EAST_MPS, 0.0), now_s)
        known.receive_satellites(Satellites(used=True, sd_m=0.9), now_s)
        known.note_flown(known.split_position(told, now_s, airborne=True), now_s)
    assert 1.0 < led_m < most_m


def test_after_a_gap_the_one_with_satellites_holds_its_fixes_against_a_new_way() -> None:
    """Of the 8 m that it flew meanwhile nothing was told: they are no way by which the fix is astray."""
    known = GlobalLocalisation(receives=True)
    for k in range(1200):
        now_s = k * DT_S
        if 60.0 < now_s < 64.0:
            continue
        known.receive_satellites(Satellites(used=True, sd_m=0.9), now_s)
        known.note_flown(
            known.split_position(
                Position((0.0, EAST_MPS * now_s, -8.0), (0.0, EAST_MPS, 0.0), now_s), now_s, airborne=True
            ),
            now_s,
        )
    assert not known.is_astray
