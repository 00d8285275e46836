"""Agents in small fleets: a part that does not hear the majority flies in a layer of height of its own."""

from __future__ import annotations

import math

import pytest

from companion.core.model.states import FlightState, Order
from companion.core.swarm.partition import LAYER_AFTER_S, REJOINED_S, STANDS_S, TURN_S, TURNS, WAIT_IN_LAYERS_S
from mission.document.height_layers import SAME_HEIGHT_M
from tests.unit.core.core_fleet import Fleet
from tests.unit.core.core_kit import mission

OWN_M, BELOW_M, LOWEST_M = 8.0, 6.0, 4.0
HELD_M = 0.2
REAR = {2, 3}
CHANGES_S = 5.0  # two metres at a metre a second, and until it is noticed


def on_the_way(size: int = 5, *, layers: bool = True) -> Fleet:
    swarm = Fleet(
        mission(
            route={"d2_enu_m": (130.0, 0.0, OWN_M), "at_end": "hold"},
            swarm={"size": size, "leader_priority": (4,)},
            coverage={"duration_s": 20.0},
            separation={"height_layers": layers},
            sensing={},
        ),
        range_m=55.0,
    )
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=60.0)
    swarm.run(4.0)
    return swarm


def heights_m(swarm: Fleet, among: set[int]) -> list[float]:
    return [swarm.aircraft[k].altitude_m for k in sorted(among)]


def least_level_m(swarm: Fleet, seconds: float) -> float:
    """Least level distance in that time of two in the air whose heights differ by less than between layers."""
    least_m = math.inf
    for _ in range(round(seconds / 0.05)):
        swarm.tick()
        places = [one.pos_ned_m for one in swarm.aircraft.values()]
        for k, (north, east, down) in enumerate(places):
            for other in places[:k]:
                if abs(other[2] - down) < SAME_HEIGHT_M:
                    least_m = min(least_m, math.hypot(other[0] - north, other[1] - east))
    return least_m


def test_part_without_the_majority_has_a_height_of_its_own_until_it_is_back() -> None:
    swarm = on_the_way()
    front = swarm.aircraft.keys() - REAR
    swarm.apart |= REAR
    swarm.run(3.0 + LAYER_AFTER_S + CHANGES_S)
    lowered = heights_m(swarm, REAR)
    assert any(lowered == pytest.approx([layer_m] * 2, abs=HELD_M) for layer_m in (BELOW_M, LOWEST_M))
    assert heights_m(swarm, front) == pytest.approx([OWN_M] * 3, abs=HELD_M)
    swarm.apart.clear()
    swarm.run(20.0)
    assert heights_m(swarm, set(swarm.aircraft)) == pytest.approx([OWN_M] * 5, abs=HELD_M)
    told = [swarm.aircraft[k].said for k in sorted(REAR)]
    (layer_m,) = {BELOW_M, LOWEST_M} & {round(height_m) for height_m in lowered}
    assert [[text for text in texts if text.startswith(("to layer", "back to"))] for texts in told] == [
        [f"to layer {layer_m:.1f} m: no quorum", f"back to {OWN_M:.1f} m: quorum"]
    ] * 2
    assert not [text for k in front for text in swarm.aircraft[k].said if "layer" in text]
    swarm.until("COVERAGE", limit_s=90.0)
    assert swarm.least_m >= 5.0


def test_part_comes_back_only_when_it_has_heard_the_others_for_a_while() -> None:
    swarm = on_the_way()
    swarm.apart |= REAR
    swarm.run(12.0)
    before = heights_m(swarm, REAR)
    swarm.apart.clear()
    swarm.run(REJOINED_S - 0.5)
    assert heights_m(swarm, REAR) == pytest.approx(before, abs=HELD_M)


def test_two_parts_that_hear_nobody_pass_each_other_in_different_layers() -> None:
    """Of four, halves: none has the majority, and each leaves the mission's height by its leader's id."""
    swarm = on_the_way(4)
    swarm.apart |= {1, 2}
    assert least_level_m(swarm, STANDS_S + TURN_S * TURNS + 10.0) >= 4.5
    one, other = (heights_m(swarm, part) for part in ({1, 2}, {3, 4}))
    assert max(*one, *other) <= BELOW_M + HELD_M
    assert all(swarm.aircraft[k].state is FlightState.SEEKING for k in swarm.aircraft)


def test_part_that_has_the_majority_again_goes_on_only_when_it_leaves_its_layer() -> None:
    """Others that it does not hear may stand there."""
    swarm = on_the_way(4)
    swarm.apart |= {1, 2}
    swarm.run(20.0)
    swarm.apart -= {2}
    before = {k: swarm.aircraft[k].pos_ned_m for k in (2, 3, 4)}
    while max(heights_m(swarm, {2, 3, 4})) < BELOW_M + HELD_M:
        swarm.run(0.1)
        assert all(math.dist(before[k][:2], swarm.aircraft[k].pos_ned_m[:2]) <= 1.5 for k in before)
    swarm.until("COVERAGE", limit_s=90.0, among={2, 3, 4})


def test_parts_stand_until_a_cut_is_over_and_nobody_has_looked_for_the_others() -> None:
    """The majority went on after 10 s, and those that it had left behind landed."""
    swarm = on_the_way()
    swarm.apart |= REAR
    swarm.run(LAYER_AFTER_S + 12.0)
    before = {k: one.pos_ned_m for k, one in swarm.aircraft.items()}
    swarm.run(STANDS_S - LAYER_AFTER_S - 14.0)
    assert all(math.dist(before[k][:2], one.pos_ned_m[:2]) <= 3.0 for k, one in swarm.aircraft.items())
    assert all(swarm.aircraft[k].state is FlightState.HOLD for k in REAR)
    swarm.apart.clear()
    swarm.until("TRANSIT", limit_s=5.0)


def test_majority_in_layers_goes_on_without_those_that_are_lost_for_good() -> None:
    swarm = on_the_way()
    swarm.hung |= REAR
    swarm.run(WAIT_IN_LAYERS_S)
    here_m = max(one.pos_ned_m[1] for one in swarm.aircraft.values())
    assert here_m <= 60.0
    swarm.until("COVERAGE", limit_s=60.0, among=swarm.aircraft.keys() - REAR)


def test_without_layers_nobody_leaves_the_missions_height() -> None:
    swarm = on_the_way(layers=False)
    swarm.apart |= REAR
    swarm.run(15.0)
    assert heights_m(swarm, set(swarm.aircraft)) == pytest.approx([OWN_M] * 5, abs=HELD_M)
