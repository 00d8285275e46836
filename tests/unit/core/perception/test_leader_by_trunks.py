"""The leader of a swarm by ranges among trees: it has satellites, and its flight goes by what its scans correct."""

from __future__ import annotations

import math

import pytest

from companion.core.agent import Agent
from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.model.events import Position, Satellites
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_perception import SensingPerception
from tests.unit.core.perception.scan_kit import Stem
from tests.unit.core.perception.test_scan_odometry import Reckoning, fly, stand
from tests.unit.core.ranging_kit import ranging_mission


class Leading(Reckoning):
    """The leader of a swarm by ranges: what its flight goes by, as the agent asks for it."""

    def __init__(self, stems: list[Stem]) -> None:
        super().__init__(stems)
        self.agent = Agent(ranging_mission(sensing={"sensor": "scan-0.5deg", "vehicle_radius_m": 0.35}), 1)
        perception = self.agent.perception
        assert isinstance(perception, SensingPerception)
        self.motion = perception.motion

    def receive(self) -> Position:
        self.agent.localiser.receive_satellites(Satellites(used=True, sd_m=0.9), self.now_s)
        return self.agent.own_position.receive(self.reported, self.now_s, airborne=True, commanded_ned_mps=ZERO)


def test_a_leader_by_which_others_know_where_they_are_does_not_follow_a_fix_that_wanders() -> None:
    """Recorded ones wandered by 1.2 m in 2 s, and the way to d2 with them."""
    flight = Leading(stand())
    fly(flight, 4.0)
    for k, _ in enumerate(flight.run(4.0)):
        flight.off_m, flight.off_mps = (0.03 * k, 0.0), (0.3, 0.0)
    assert flight.off_m[0] > 1.0
    assert math.dist(flight.placed.pos_ned_m[:2], flight.true_m) < 0.2
    assert flight.motion.correct_place(flight.placed.pos_ned_m) == flight.placed.pos_ned_m  # scans are placed alike
    assert flight.placed.vel_ned_mps[0] == pytest.approx(flight.speed_mps, abs=0.1)


@pytest.mark.parametrize("seen", ["trunks", "trunks that begin anew", "one trunk", "nothing"])
def test_a_fix_that_jumps_does_not_move_a_leader_whatever_it_sees(seen: str) -> None:
    """It goes on as its velocity says, and trunks that it comes among tell no other place."""
    flight = Leading({"nothing": [], "one trunk": [(1.5, 2.0, 0.2)]}.get(seen, stand()))
    fly(flight, 4.0 if seen.startswith("trunks") else 0.5)
    if seen == "trunks that begin anew":
        flight.motion.odometry.restart(flight.now_s)
    flight.off_m = (-3.0, 4.0)
    fly(flight, 0.3)
    flight.stems = stand()
    fly(flight, 3.0)
    assert math.dist(flight.placed.pos_ned_m[:2], flight.true_m) < 0.2


def test_a_leader_whose_fix_has_jumped_tells_trunks_where_they_stand() -> None:
    """It told them by as much off, and was refused by all."""
    flight = Leading([])
    fly(flight, 1.0)
    flight.off_m = (-3.0, 4.0)
    fly(flight, 0.5)
    flight.stems = stand()
    fly(flight, 4.0)
    localiser = flight.agent.localiser
    assert isinstance(localiser, GnssDeniedLocaliser)
    assert localiser.trunks is not None
    report = localiser.trunks.make_report(1, 0, flight.now_s)
    assert report is not None
    for north, east, _ in report.trunks:
        at = (flight.true_m[0] + north, flight.true_m[1] + east)
        assert min(math.dist(at, stem[:2]) for stem in flight.stems) < 1.2  # it flies at 2 m/s since it looked
