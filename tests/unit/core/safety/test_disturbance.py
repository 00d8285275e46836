"""What the wind adds: told from how a vehicle follows its setpoints, whatever its dead time."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import pytest

from companion.core.model.states import VelocityShaping
from companion.core.safety.disturbance import CALM_MPS, DisturbanceEstimator
from companion.core.safety.response_model import DEAD_S, follow_lagged, follow_shaped

DT_S, LAG_S, MOST_MPS2 = 0.05, 0.3, 3.0
Level = tuple[float, float]


def fly(
    gusts: DisturbanceEstimator, told: Callable[[float], Level], gust: Callable[[float], Level], *, dead: int, s: float
) -> None:
    u_n = u_e = 0.0
    under_way = [(0.0, 0.0)] * dead
    last: Level = (0.0, 0.0)
    for k in range(round(s / DT_S)):
        g_n, g_e = gust(k * DT_S)
        gusts.estimate_disturbance((u_n + g_n, u_e + g_e), last, DT_S, MOST_MPS2)
        last = told(k * DT_S)
        under_way.append(last)
        acts = under_way.pop(0)
        share = -math.expm1(-DT_S / LAG_S)
        d_n, d_e = share * (acts[0] - u_n), share * (acts[1] - u_e)
        size = math.hypot(d_n, d_e)
        cut = min(1.0, MOST_MPS2 * DT_S / size) if size else 1.0
        u_n, u_e = u_n + cut * d_n, u_e + cut * d_e


def weave(now_s: float) -> Level:
    return (3.0, 1.5 if math.sin(1.3 * now_s) > 0.0 else -1.5)


def calm(_: float) -> Level:
    return (0.0, 0.0)


@pytest.mark.parametrize("dead", [0, 1, 3, 5])
def test_turns_of_a_vehicle_in_calm_air_are_no_gusts(dead: int) -> None:
    gusts = DisturbanceEstimator()
    fly(gusts, weave, calm, dead=dead, s=20.0)
    assert math.hypot(*gusts.level_mps) < 0.1
    assert gusts.change_mps == 0.0
    assert (gusts.under_way(DT_S, MOST_MPS2) is None) == (dead * DT_S <= DEAD_S)


def turn_seldom(now_s: float) -> Level:
    """Two seconds of eight; setpoints leave the ones before by no more than the acceleration limit."""
    along_s = now_s % 8.0
    return (3.0, 1.5 * max(0.0, min(1.0, along_s / 0.5, (2.5 - along_s) / 0.5)))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("dead", [0, 3, 5])
def test_dead_time_is_known_in_spite_of_velocities_that_are_told_wrong(dead: int, seed: int) -> None:
    """Most of the way is straight, where all dead times look alike."""
    rng, gusts = random.Random(seed), DisturbanceEstimator()
    told: list[tuple[float, Level]] = [(0.0, (0.0, 0.0))]  # until when, and how wrong
    knows: list[bool] = []

    def wrong(now_s: float) -> Level:
        knows.append((gusts.under_way(DT_S, MOST_MPS2) is None) == (dead * DT_S <= DEAD_S))
        if now_s >= told[-1][0]:
            told.append((now_s + rng.uniform(0.0, 0.1), (rng.gauss(0.0, 0.2), rng.gauss(0.0, 0.2))))
        return told[-1][1]

    fly(gusts, turn_seldom, wrong, dead=dead, s=60.0)
    assert sum(knows[100:]) >= 0.98 * len(knows[100:])


def test_a_make_that_is_known_late_does_not_count_before_it_explains_the_flight() -> None:
    """It had explained nothing yet, and so seemed to explain all of a flight whose velocities are told wrong."""
    rng, gusts = random.Random(1), DisturbanceEstimator()

    def wrong(_: float) -> Level:
        return (rng.gauss(0.0, 0.2), rng.gauss(0.0, 0.2))

    fly(gusts, weave, wrong, dead=5, s=30.0)
    gusts.adopt_shaping(VelocityShaping(dead_s=0.15, acceleration_mps2=2.5, jerk_mps3=7.0, lag_s=0.25))
    fly(gusts, weave, wrong, dead=5, s=5.0)
    assert gusts.dead_s == DEAD_S


@pytest.mark.parametrize("dead", [0, 3, 5])
def test_steady_push_is_found_within_half_a_second(dead: int) -> None:
    gusts = DisturbanceEstimator()
    fly(gusts, weave, lambda now_s: (0.0, 1.0) if now_s > 9.5 else (0.0, 0.0), dead=dead, s=10.0)
    assert gusts.level_mps == pytest.approx((0.0, 1.0), abs=0.1)


def test_turns_of_a_vehicle_that_limits_its_jerk_are_foreseen_by_the_shaping_of_its_make_alone() -> None:
    shaping = VelocityShaping(dead_s=0.15, acceleration_mps2=2.0, jerk_mps3=4.0, lag_s=0.4)
    known, unknown = DisturbanceEstimator(), DisturbanceEstimator()
    known.adopt_shaping(shaping)
    vel, acceleration, last = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
    under_way = [last] * 3
    for k in range(400):
        known.estimate_disturbance(vel, last, DT_S, MOST_MPS2)
        unknown.estimate_disturbance(vel, last, DT_S, MOST_MPS2)
        known.adopt_shaping(shaping)  # once is enough
        last = weave(k * DT_S)
        under_way.append(last)
        vel, acceleration = follow_shaped(vel, acceleration, under_way.pop(0), DT_S, MOST_MPS2, shaping)
    assert math.hypot(*known.level_mps) < 1e-6
    assert known.under_way(DT_S, MOST_MPS2) is not None
    assert known.dead_s == pytest.approx(0.15 + DEAD_S)
    assert unknown.dead_s == DEAD_S


def test_where_setpoints_under_way_lead_a_vehicle_that_follows_late_is_foreseen() -> None:
    """With 0.25 s of dead time, until no more than DEAD_S of it is left."""
    gusts, last, vel = DisturbanceEstimator(), (0.0, 0.0), (0.0, 0.0)
    sent, flown = [last] * 5, list[Level]()
    foreseen = list[tuple[float, float, float, float] | None]()
    for k in range(400):
        gusts.estimate_disturbance(vel, last, DT_S, MOST_MPS2)
        foreseen.append(gusts.under_way(DT_S, MOST_MPS2))
        flown.append(vel)
        last = weave(k * DT_S)
        sent.append(last)
        vel = follow_lagged(vel, sent.pop(0), DT_S, MOST_MPS2)
    for k in range(200, 397):
        ahead = flown[k + 1 : k + 4]
        changed = (ahead[-1][0] - flown[k][0], ahead[-1][1] - flown[k][1])
        moved = (DT_S * sum(n for n, _ in ahead), DT_S * sum(e for _, e in ahead))
        assert foreseen[k] == pytest.approx((*moved, *changed), abs=0.01)


def test_changing_wind_is_worth_the_more_room_the_more_it_changes() -> None:
    found = []
    for rms_mps in (0.0, 0.3, 0.6):
        rng, state = random.Random(1), [0.0, 0.0]

        def gust(_: float, rms_mps: float = rms_mps, rng: random.Random = rng, state: list[float] = state) -> Level:
            kept = math.exp(-DT_S / 1.0)
            for axis in (0, 1):
                state[axis] = kept * state[axis] + rng.gauss(0.0, rms_mps * math.sqrt(1.0 - kept * kept))
            return (state[0], state[1])

        gusts = DisturbanceEstimator()
        fly(gusts, weave, gust, dead=0, s=30.0)
        found.append(gusts.change_mps)
    assert found[0] == 0.0
    assert 0.0 < found[1] < found[2] < 0.8
    assert found[2] > CALM_MPS


def test_no_number_changes_nothing_and_rest_forgets_the_push() -> None:
    gusts = DisturbanceEstimator()
    fly(gusts, weave, lambda _: (0.5, 0.0), dead=1, s=10.0)
    before = gusts.level_mps
    gusts.estimate_disturbance((math.nan, 0.0), (0.0, 0.0), DT_S, MOST_MPS2)
    assert gusts.level_mps == before
    gusts.reset()
    assert gusts.level_mps == (0.0, 0.0)


def test_vehicle_that_rested_for_a_moment_in_flight_takes_its_own_speed_for_no_wind() -> None:
    gusts = DisturbanceEstimator()
    fly(gusts, weave, calm, dead=0, s=10.0)
    gusts.reset()
    speed_mps = 3.0
    for _ in range(20):
        gusts.estimate_disturbance((speed_mps, 0.0), (0.0, 0.0), DT_S, MOST_MPS2)
        assert math.hypot(*gusts.level_mps) < 0.1
        speed_mps -= min(MOST_MPS2 * DT_S, -math.expm1(-DT_S / LAG_S) * speed_mps)
    assert gusts.change_mps == 0.0
