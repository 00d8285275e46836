"""The compared laws against their papers' equations, worked out by hand for few vehicles."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from companion.core.guidance import formation
from sim_bridge.lab.laws import olfati_saber, route, vasarhelyi
from sim_bridge.lab.laws.vasarhelyi import braking_curve
from sim_bridge.lab.study import point_mass
from sim_bridge.lab.study.law import View, law_module
from sim_bridge.lab.study.point_mass import LAG_S
from tests.unit.core.core_kit import mission

MISSION = mission(swarm={"size": 2})


def view(places: list[tuple[float, ...]], speeds: list[tuple[float, ...]], *, to_goal: tuple[float, ...]) -> View:
    """One flight of vehicles that hear one another, and a leader out of reach; `to_goal` from the first."""
    pos, vel = np.array([[*places, (0.0, -500.0, 8.0)]]), np.array([[*speeds, (0.0, 0.0, 0.0)]])
    rel = pos[:, None, :, :] - pos[:, :, None, :]
    distance_m = np.sqrt((rel * rel).sum(axis=3))
    own = np.eye(len(places) + 1, dtype=np.bool_)
    distance_m[:, own] = np.inf
    heard = ~own[None]
    heard[:, -1, :] = heard[:, :, -1] = False
    leads = np.zeros((1, len(places) + 1), dtype=np.bool_)
    leads[0, -1] = True
    goal, stop_m, cruise = pos[:, 0] + np.array([to_goal]) - pos[:, -1], np.array([4.0]), np.array([3.0])
    departed = np.array([True])
    return View(0.1, pos, vel, rel, distance_m, heard, vel, leads, [MISSION], departed, goal, stop_m, cruise)


ORIGIN = (0.0, 0.0, 0.0)
AT_REST = [ORIGIN] * 2
FAR = (1000.0, 0.0, 0.0)


def test_braking_curve_is_linear_then_a_root_and_smooth_between() -> None:
    found = braking_curve(np.array([-1.0, 0.0, 0.1, 0.40625, 2.0, np.inf]), 4.16, 3.2)
    assert found[:4] == pytest.approx([0.0, 0.0, 0.32, 1.3])
    assert found[4] == pytest.approx(math.sqrt(2 * 4.16 * 2.0 - 1.69))
    assert found[5] == 0.0  # nobody there


@given(
    st.tuples(*[st.floats(-200.0, 200.0)] * 3).filter(lambda v: math.hypot(*v) > 1e-6),
    st.floats(0.1, 10.0),
    st.floats(0.0, 50.0),
)
def test_compared_laws_brake_before_the_goal_as_our_leader_does(
    to_goal: tuple[float, float, float], cruise_mps: float, stop_m: float
) -> None:
    told = replace(
        view([ORIGIN], [ORIGIN], to_goal=to_goal), cruise_mps=np.array([cruise_mps]), stop_m=np.array([stop_m])
    )
    expected = formation.approach(to_goal, cruise_mps=cruise_mps, stop_m=stop_m)
    assert route.approach(np.array([[to_goal]]), told)[0, 0] == pytest.approx(expected, abs=1e-9)


def test_vasarhelyi_repels_within_its_range_and_not_beyond() -> None:
    law = vasarhelyi.make(MISSION, 1, vasarhelyi.Params())
    near = law.velocity(view([(0.0, 0.0, 8.0), (0.0, 15.0, 8.0)], AT_REST, to_goal=FAR))[0]
    assert near[0] == pytest.approx((3.0, -0.13 * 10.6, 0.0), abs=1e-6)
    assert near[1][1] == pytest.approx(0.13 * 10.6 - 3.0 * 15.0 / math.hypot(1000.0, 15.0), abs=1e-6)
    beyond = law.velocity(view([(0.0, 0.0, 8.0), (0.0, 26.0, 8.0)], AT_REST, to_goal=FAR))[0]
    assert beyond[0] == pytest.approx((3.0, 0.0, 0.0), abs=1e-6)


def test_vasarhelyi_aligns_what_differs_by_more_than_the_slack() -> None:
    law = vasarhelyi.make(MISSION, 1, vasarhelyi.Params())
    apart = [(0.0, 0.0, 8.0), (0.0, 26.0, 8.0)]
    pulled = law.velocity(view(apart, [(0.0, 0.0, 0.0), (0.0, 2.63, 0.0)], to_goal=FAR))[0]
    assert pulled[0] == pytest.approx((3.0, 0.05 * 2.0, 0.0), abs=1e-6)
    slack = law.velocity(view(apart, [(0.0, 0.0, 0.0), (0.0, 0.6, 0.0)], to_goal=FAR))[0]
    assert slack[0] == pytest.approx((3.0, 0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("b_over_a", [1.0, 3.0])
@pytest.mark.parametrize(("distance_m", "sign"), [(5.0, -1), (7.0, 0), (8.0, 1), (8.4, 0), (20.0, 0)])
def test_olfati_saber_repels_below_d_attracts_above_and_ends_at_r(
    distance_m: float, sign: int, b_over_a: float
) -> None:
    params = olfati_saber.Params(c1=1e-12, c2=1e-12, b_over_a=b_over_a)
    law = olfati_saber.make(MISSION, 1, params)
    speed = law.velocity(view([(0.0, 0.0, 8.0), (0.0, distance_m, 8.0)], AT_REST, to_goal=FAR))[0, 0, 1]
    assert np.sign(round(float(speed), 9)) == sign


def test_olfati_saber_action_is_that_of_the_paper_at_half_the_distance() -> None:
    law = olfati_saber.make(MISSION, 1, olfati_saber.Params(c1=1e-12, c2=1e-12))
    found = law.velocity(view([(0.0, 0.0, 8.0), (0.0, 3.5, 8.0)], AT_REST, to_goal=FAR))[0, 0, 1]

    def sigma(x: float) -> float:
        return (math.sqrt(1 + 0.1 * x * x) - 1) / 0.1

    z = sigma(3.5) / sigma(8.4)
    bump = 0.5 * (1 + math.cos(math.pi * (z - 0.2) / 0.8))
    s = sigma(3.5) - sigma(7.0)
    action = bump * 5.0 * s / math.sqrt(1 + s * s)
    assert found == pytest.approx(LAG_S * action * 3.5 / math.sqrt(1 + 0.1 * 3.5**2))


def test_olfati_saber_refuses_more_attraction_than_repulsion() -> None:
    with pytest.raises(ValidationError, match="b_over_a"):
        olfati_saber.Params(b_over_a=0.99)


def test_olfati_saber_is_pulled_to_the_gamma_agent_and_its_velocity() -> None:
    law = olfati_saber.make(MISSION, 1, olfati_saber.Params(c1=0.01, c2=0.5))
    found = law.velocity(view([(0.0, 0.0, 8.0), (0.0, 40.0, 8.0)], [(1.0, 0.0, 0.0), (0.0, 0.0, 0.0)], to_goal=FAR))
    assert found[0, 0] == pytest.approx((1.0 - LAG_S * 0.5, -LAG_S * 0.01 * 500.0, 0.0))


@pytest.mark.parametrize("name", ["olfati-saber", "vasarhelyi"])
def test_the_leader_flies_its_route_whatever_the_others_do(name: str) -> None:
    pair = mission(route={"d2_enu_m": (60.0, 0.0, 8.0)}, swarm={"size": 2})
    module: Any = law_module(name)
    (flown,) = point_mass.fly(pair, [1], module.make(pair, 1, module.Params()))
    assert flown.overhead_leader == pytest.approx(0.05, abs=0.03)


@pytest.mark.parametrize("name", ["olfati-saber", "vasarhelyi"])
def test_a_flight_does_not_depend_on_the_others_in_its_batch(name: str) -> None:
    module: Any = law_module(name)
    short = mission(swarm={"size": 4}, route={"d2_enu_m": (40.0, 0.0, 8.0)})
    params = module.Params()
    both = point_mass.fly(short, [1, 2], module.make(short, 2, params))
    assert point_mass.fly(short, [2], module.make(short, 1, params)) == both[1:]
