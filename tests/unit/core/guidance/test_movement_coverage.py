"""Around the tree: by whom a vehicle is pushed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pytest

from companion.core.guidance import formation
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.movement import Guidance
from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission, neighbour

LOST_HERE: Vec3 = (0.0, -3.0, 0.0)


@pytest.mark.parametrize("age_s", [5.0, 20.0])
def test_around_the_tree_nobody_is_pushed_by_others_word_alone(monkeypatch: pytest.MonkeyPatch, age_s: float) -> None:
    """Beside one that is stranded, which this vehicle has lost itself."""
    pushing: list[Vec3] = []
    separation = formation.separation

    def watched(neighbours: Any, silent: Sequence[Vec3], **named: Any) -> Vec3:
        pushing.extend(silent)
        return separation(neighbours, silent, **named)

    monkeypatch.setattr(formation, "separation", watched)
    hovering = {
        4: PeerReport(4, LOST_HERE, 20.0, silent=True),
        5: PeerReport(5, (0.0, 2.0, 0.0), age_s, silent=True, received=True),
    }
    own = Position((15.0, 0.0, -8.0), ZERO)
    Guidance(mission(swarm={"size": 6}), 1).find_desired(
        GuidanceInput(
            Surroundings(own, (), hovering, LocalObstacleCloud(math.inf, (False,))),
            state=FlightState.COVERAGE,
            phase=SwarmPhase.COVERAGE,
            route=formation.NOWHERE,
            range_m=55.0,
            role=Role.FOLLOWER,
            governor=1.0,
            lease_freshness=1.0,
            goal=None,
            size=6,
            dest_ned_m=(-15.0, 0.0, 0.0),
        )
    )
    assert pushing == [LOST_HERE]


@pytest.mark.parametrize("is_told", [False, True])
def test_around_the_tree_nobody_goes_to_where_others_have_one_that_is_stranded(is_told: bool) -> None:
    """Courses led round that place, off the ring and back."""
    elsewhere = ((0.0, -8.0, 0.0),) if is_told else ()  # west of it, nearer than it has it itself
    hovering = {4: PeerReport(4, (-7.0, -14.0, 0.0), 20.0, silent=True, elsewhere=elsewhere)}
    north, east = 15.0 * math.cos(math.radians(150.0)), 15.0 * math.sin(math.radians(150.0))
    heard = neighbour(2, (north - 15.0, east, 0.0), state=FlightState.COVERAGE, airborne=True)
    own = Position((15.0, 0.0, -8.0), ZERO)
    desired = Guidance(mission(swarm={"size": 6}), 1).find_desired(
        GuidanceInput(
            Surroundings(own, [heard], hovering, LocalObstacleCloud(math.inf, (False,))),
            state=FlightState.COVERAGE,
            phase=SwarmPhase.COVERAGE,
            route=formation.NOWHERE,
            range_m=55.0,
            role=Role.FOLLOWER,
            governor=1.0,
            lease_freshness=1.0,
            goal=None,
            size=6,
            dest_ned_m=(-15.0, 0.0, 0.0),
        )
    )
    west_mps = -desired[1]
    assert west_mps < 1.2 if is_told else west_mps > 1.5
