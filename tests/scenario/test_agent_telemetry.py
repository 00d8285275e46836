"""An agent whose autopilot falls silent or is heard late: no setpoint by old positions, and no lead."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import pytest

from companion.core.agent import TICK_S
from companion.core.model.actions import VelocitySetpoint
from companion.core.model.events import Event, HeardBeacon, OperatorOrder, Position
from companion.core.model.states import FlightMode, Order
from companion.core.model.vectors import ZERO, norm
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from tests.unit.core.core_fleet import Aircraft, Fleet
from tests.unit.core.core_kit import mission

pytestmark = pytest.mark.sources

LATE_S = failsafe_engine.row(Cause.TELEMETRY_LATE).delay_s

BOOT_AT_S = 400.0


class Relay:
    """Between one aircraft's autopilot and its agent: stamps positions, and delays all that the autopilot tells."""

    def __init__(self, one: Aircraft) -> None:
        self.late_s = 0.0
        self.cut = False
        self._under_way: deque[tuple[float, Event]] = deque()
        self._hand_on = one.agent.receive
        one.agent.receive = self.receive  # type: ignore[method-assign]

    def receive(self, event: Event, now_s: float) -> None:
        if isinstance(event, HeardBeacon | OperatorOrder):
            self._hand_on(event, now_s)
            return
        if isinstance(event, Position):
            event = replace(event, boot_s=now_s - BOOT_AT_S)
        if not self.cut:
            self._under_way.append((now_s + self.late_s, event))
        while self._under_way and self._under_way[0][0] <= now_s + 1e-9:
            self._hand_on(self._under_way.popleft()[1], now_s)


def in_transit() -> tuple[Fleet, Aircraft, Relay]:
    """Three on their way, the first leading; what its autopilot tells goes through the relay."""
    swarm = Fleet(mission(route={"d2_enu_m": (200.0, 0.0, 8.0)}, swarm={"size": 3}))
    leader = swarm.aircraft[1]
    relay = Relay(leader)
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=60.0)
    swarm.run(2.0)
    assert swarm.acting() == [1]
    assert norm(leader.vel_ned_mps) > 1.0
    return swarm, leader, relay


def velocities(one: Aircraft) -> list[tuple[float, float, float]]:
    return [action.vel_ned_mps for action in one.actions if isinstance(action, VelocitySetpoint)]


def test_leader_with_a_growing_backlog_brakes_says_so_and_another_leads() -> None:
    swarm, leader, relay = in_transit()
    while relay.late_s < 1.5:
        relay.late_s += 0.3 * TICK_S
        swarm.tick()
        if relay.late_s > LATE_S + 0.3 * 0.5:  # half a second after the limit
            assert velocities(leader) == [ZERO]
    assert [text for text in leader.said if "late" in text] == ["telemetry 0.4 s late"]
    swarm.run(3.0)
    assert norm(leader.vel_ned_mps) < 0.05
    assert swarm.acting() == [2]
    relay.late_s = 0.0
    swarm.until("TRANSIT", limit_s=2.5, among=[1])
    swarm.until("COVERAGE", limit_s=120.0)


def test_late_vehicle_does_not_give_way_by_where_it_no_longer_is() -> None:
    swarm, leader, relay = in_transit()
    while relay.late_s < 1.5:
        relay.late_s += 0.3 * TICK_S
        swarm.tick()
    swarm.run(2.0)
    beside = swarm.aircraft[2]
    for _ in range(20):
        beside.pos_ned_m = (leader.pos_ned_m[0] + 2.0, leader.pos_ned_m[1], leader.pos_ned_m[2])
        swarm.tick()
        assert velocities(leader) == [ZERO]


def test_silent_autopilot_gets_no_setpoint_after_a_second_and_the_leader_is_replaced() -> None:
    swarm, leader, relay = in_transit()
    relay.cut = True
    sent = 0
    for _ in range(200):
        swarm.tick()
        sent += len(velocities(leader))
    assert sent <= 20
    assert "autopilot link lost" in "".join(leader.said)
    assert swarm.acting() == [2]
    assert leader.mode is FlightMode.HOLD
    relay.cut = False
    swarm.tick()
    assert velocities(leader) == []
    swarm.until("TRANSIT", limit_s=10.0, among=[1])
    assert leader.mode is FlightMode.OFFBOARD
    swarm.until("COVERAGE", limit_s=120.0)


@pytest.mark.parametrize("late_s", [0.1, 0.3])
def test_small_delay_changes_nothing(late_s: float) -> None:
    swarm, leader, relay = in_transit()
    relay.late_s = late_s
    swarm.run(10.0)
    assert swarm.acting() == [1]
    assert leader.state.name == "TRANSIT"
