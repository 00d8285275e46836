"""When the simulated operator allows the flight."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.model.states import FlightState
from sim_bridge.drive.operator import ORDERS, PATIENCE_S, REPEAT_S, Operator
from tests.unit.core.core_kit import mission

TICK_S = 0.05


class Keyholder:
    """As much of a `SignedOperator`, and its station, as is asked."""

    def __init__(self) -> None:
        self.station, self.proven = self, {1, 2}

    def named(self) -> set[int]:
        return self.proven


class Heard:
    """As much of a beacon as the operator looks at."""

    def __init__(self, state: FlightState) -> None:
        self.flight_state = int(state)


def times_s(states_from_s: dict[int, float], alive: set[int], until_s: float = 100.0, **sim: Any) -> list[float]:
    """When the order goes out; `states_from_s`: when each vehicle becomes ready (it waits before)."""
    operator = Operator(mission(swarm={"size": 3}, sim=sim))
    found = []
    for tick in range(round(until_s / TICK_S)):
        now_s = tick * TICK_S
        heard: Any = {
            k: Heard(FlightState.READY if now_s >= ready_s else FlightState.WAITING)
            for k, ready_s in states_from_s.items()
        }
        if operator.orders_start(now_s, alive, heard):
            found.append(now_s)
    return found


def test_the_order_goes_out_when_the_last_is_ready_and_again_as_it_may_be_lost() -> None:
    found = times_s({1: 4.5, 2: 4.5, 3: 6.0}, {1, 2, 3})
    assert found == pytest.approx([6.0 + k * REPEAT_S for k in range(ORDERS)])


def test_nobody_waits_for_a_companion_that_is_gone() -> None:
    assert times_s({1: 4.5, 2: 4.5}, {1, 2})[0] == pytest.approx(4.5)


@pytest.mark.parametrize("silent", [True, False])
def test_patience_ends(silent: bool) -> None:
    ready_s = {1: 4.5, 2: 4.5} if silent else {1: 4.5, 2: 4.5, 3: 1e9}
    assert times_s(ready_s, {1, 2, 3})[0] == pytest.approx(PATIENCE_S["px4"])


def test_a_mixed_swarm_is_given_the_time_of_its_slowest() -> None:
    found = times_s({1: 4.5, 2: 4.5, 3: 42.0}, {1, 2, 3}, personalities={2: "ardupilot"})
    assert found[0] == pytest.approx(42.0)
    assert times_s({}, {1, 2, 3}, personality="ardupilot")[0] == pytest.approx(PATIENCE_S["ardupilot"])


def test_with_a_key_it_goes_out_when_it_names_all_and_not_before() -> None:
    """A vehicle whose proof has not come refuses it, and stays on the ground."""
    keyholder: Any = Keyholder()
    operator = Operator(mission(swarm={"size": 3}), keyholder)
    heard: Any = {k: Heard(FlightState.READY) for k in (1, 2, 3)}
    assert not operator.orders_start(5.0, {1, 2, 3}, heard)
    keyholder.proven.add(3)
    assert operator.orders_start(5.2, {1, 2, 3}, heard)


def test_with_a_key_patience_ends_too() -> None:
    keyholder: Any = Keyholder()
    operator = Operator(mission(swarm={"size": 3}), keyholder)
    heard: Any = {k: Heard(FlightState.READY) for k in (1, 2, 3)}
    assert operator.orders_start(PATIENCE_S["px4"], {1, 2, 3}, heard)
