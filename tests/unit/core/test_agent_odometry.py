"""ODOMETRY of a companion to its autopilot: sent where the mission asks for it, and what is seen tells the motion."""

from __future__ import annotations

import pytest

from companion.core.agent import TICK_S, Agent
from companion.core.model.actions import SendOdometry
from companion.core.model.events import Position
from tests.unit.core.core_kit import mission
from tests.unit.core.perception.scan_kit import sectors
from tests.unit.core.perception.test_scan_odometry import stand
from tests.unit.core.test_agent import fed

OFF_MPS = (0.25, -0.2)  # reported velocity less the true one


def flown(*, sends: bool, sees: bool = True, lasts_s: float = 6.0) -> list[SendOdometry]:
    """North at 1 m/s through a stand, reported wrongly; what it sends in the last second."""
    agent = fed(Agent(mission(sensing={"sends_odometry": sends}), 1), 10.0)
    sent: list[SendOdometry] = []
    ticks = round(lasts_s / TICK_S)
    for k in range(ticks):
        now_s, north_m = 10.0 + k * TICK_S, 1.0 * k * TICK_S
        vel = (1.0 + OFF_MPS[0], OFF_MPS[1], 0.0)
        pos = (vel[0] * k * TICK_S, vel[1] * k * TICK_S, -4.0)
        agent.receive(Position(pos, vel, now_s), now_s)
        if sees and k % 2 == 0:
            agent.receive(sectors(stand(), (north_m, 0.0), 0.0), now_s)
        actions = [action for action in agent.tick(now_s) if isinstance(action, SendOdometry)]
        sent += actions if k >= ticks - 20 else []
    return sent


def test_the_autopilot_is_told_the_velocity_that_trunks_show() -> None:
    sent = flown(sends=True)
    assert len(sent) == 10  # of each turn
    for odometry in sent:
        assert odometry.vel_ned_mps == pytest.approx((1.0, 0.0, 0.0), abs=0.15)


@pytest.mark.parametrize(("sends", "sees"), [(False, True), (True, False)])
def test_it_is_told_nothing_where_nothing_asks_for_it_or_nothing_is_seen(sends: bool, sees: bool) -> None:
    assert flown(sends=sends, sees=sees) == []
