"""The vector to d2: how far a leader's is from what GNSS says, and that it has not arrived by that much."""

from __future__ import annotations

import pytest

from companion.core.agent import Agent
from companion.core.localisation.destination import Destination
from companion.core.model.events import Position
from companion.core.model.states import SwarmPhase
from companion.core.model.vectors import ZERO
from tests.unit.core.core_kit import picture
from tests.unit.core.ranging_kit import ranging_mission

HERE = (0.0, 0.0, -4.0)
OFF_M = 14.0


def lagging() -> Destination:
    """A leader's that GNSS has OFF_M farther west all at once."""
    destination = Destination(ranging_mission())
    destination.update_anchored_leader(HERE, 0, HERE, 0.0)
    destination.update_anchored_leader(HERE, 0, (0.0, -OFF_M, -4.0), 0.5)
    return destination


def test_lag_is_what_a_leader_has_still_to_go_over_to_its_fix() -> None:
    assert lagging().lag_m == pytest.approx(OFF_M - 0.5)


def test_lag_is_none_without_a_fix_and_of_a_follower() -> None:
    leads, follows = lagging(), lagging()
    leads.update_anchored_leader(HERE, 0, None, 0.5)
    follows.update_follower(HERE, 0, ())
    assert (leads.lag_m, follows.lag_m) == (0.0, 0.0)


def test_leader_whose_vector_lags_behind_gnss_has_that_much_farther_to_go() -> None:
    """In flight: seed 10026 of the first campaign arrived 8.9 m from d2, where 5 m are asked for."""
    agent = Agent(ranging_mission(), 1)
    agent.swarm.phases.phase = SwarmPhase.TRANSIT
    at = picture(own=Position(HERE, ZERO))
    before_m = agent._to_goal_m(at)
    agent.localiser.destination.lag_m = OFF_M
    assert before_m > 0.0
    assert agent._to_goal_m(at) == pytest.approx(before_m + OFF_M)
