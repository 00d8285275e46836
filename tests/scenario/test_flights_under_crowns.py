"""Flights in which satellites come and go: the swarm goes on by odometry, another leads, and nobody jumps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from companion.core.agent import Agent
from companion.core.model.states import SwarmPhase
from companion.core.model.vectors import add
from mission.common.frames import Vec3
from mission.document.model import Mission, Personality
from sim_bridge.drive import fly
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.world.autopilot.estimates.aiding import Aided
from tests.flights import flown
from tests.unit.core.ranging_kit import ranging_mission

ANCHOR_M = 0.1  # a tick's share, and what an autopilot's position is off its velocity
D2_M = 80.0  # east of d1


def mission_of(**tables: dict[str, object]) -> Mission:
    """Nothing grows there: `Watched` covers antennas instead."""
    sim = {"satellites": {"crowns": "shade"}, "seed": 1000} | tables.pop("sim", {})
    route = {"d2_enu_m": (D2_M, 0, 4)} | tables.pop("route", {})
    swarm = {"leader_priority": [1]} | tables.pop("swarm", {})
    return ranging_mission(sim=sim, route=route, swarm=swarm, **tables)


@dataclass
class Watched:
    """What is seen of a flight. `cover`: seconds after the transit's beginning -> which receivers hear nothing then."""

    cover: Callable[[float, dict[int, Agent]], set[int]]
    d2_m: float = D2_M
    worst_step_mps: float = 0.0
    worst_anchor_m: float = 0.0  # by which a leader has where d2 is elsewhere in a tick, by its odometer
    leaders: list[int] = field(default_factory=list)
    off_m: float = 0.0  # the last leader's way to d2, against the truth
    off_worst_m: float = 0.0
    track: list[Vec3] = field(default_factory=list)  # the acting leader's true places, NED m
    log: list[tuple[float, int, float]] = field(default_factory=list)  # time, leader, how far it is off
    _began_s: float | None = None
    _before: dict[int, Vec3] = field(default_factory=dict)
    _anchors: dict[int, Vec3] = field(default_factory=dict)

    def __call__(self, flight: fly.Flight) -> None:
        agents: dict[int, Agent] = {}
        for k, companion in flight.lockstep.companions.items():
            assert isinstance(companion, InProcess)
            agents[k] = companion.endpoint.agent
        if self._began_s is None and any(a.swarm.phases.phase >= SwarmPhase.TRANSIT for a in agents.values()):
            self._began_s = flight.world.now_s
        covered = set() if self._began_s is None else self.cover(flight.world.now_s - self._began_s, agents)
        for k, vehicle in flight.world.vehicles.items():
            if vehicle.receiver is not None:
                vehicle.receiver.is_covered = k in covered
        places = flight.world.positions()
        for k, agent in agents.items():
            v, dest = agent.setpoint.vel_ned_mps, agent.localiser.destination.ned_m
            if k in self._before:
                self.worst_step_mps = max(self.worst_step_mps, math.dist(v[:2], self._before[k][:2]))
            self._before[k] = v
            own = agent.flight.vehicle.position
            if not agent.swarm.election.acts or dest is None or own is None:
                self._anchors.pop(k, None)
            else:
                there = add(own.pos_ned_m, dest)
                self.worst_anchor_m = max(self.worst_anchor_m, math.dist(there, self._anchors.get(k, there)))
                self._anchors[k] = there
            if agent.swarm.election.acts and dest is not None and self._began_s is not None:
                if self.leaders[-1:] != [k]:
                    self.leaders.append(k)
                self.off_m = math.hypot(places[k][0] + dest[0], places[k][1] + dest[1] - self.d2_m)
                self.off_worst_m = max(self.off_worst_m, self.off_m)
                self.track.append(places[k])
                self.log.append((flight.world.now_s, k, self.off_m))


def test_a_leader_whose_satellites_come_back_elsewhere_takes_the_swarm_there_without_a_jump(tmp_path: Path) -> None:
    """Its autopilot goes on by odometry, and at last says that it is some 10 m away from there."""
    jumps: list[float] = []
    told: list[Vec3] = []

    def cover(since_s: float, agents: dict[int, Agent]) -> set[int]:
        del agents
        return {1} if 5.0 < since_s < 50.0 else set()

    seen = Watched(cover)

    def watch(flight: fly.Flight) -> None:
        seen(flight)
        vehicle = flight.world.vehicles[1]
        assert vehicle.receiver is not None
        if vehicle.receiver.is_covered:
            vehicle.receiver._wander = (14.0, -15.0)  # its next fix is so many times as wrong as they mostly are
        told.append(vehicle.believed.state.pos_ned_m)
        jumps.append(math.dist(told[-1], told[-2]) if len(told) > 1 else 0.0)

    outcome, shown = flown(mission_of(coverage={"duration_s": 60.0}), tmp_path, watch=watch)
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.min_separation_m >= 4.5
    assert max(jumps) > 6.0, shown  # the told position does
    assert seen.off_worst_m > 4.0  # the swarm follows
    assert seen.leaders == [1]
    assert seen.worst_step_mps <= 0.3
    assert seen.worst_anchor_m <= ANCHOR_M


@pytest.mark.parametrize("personality", list(Personality))
def test_a_leader_that_hears_no_satellites_any_more_is_succeeded_by_one_that_does(
    tmp_path: Path, personality: Personality
) -> None:
    """By the mission's own order the first leads; and does so again when it has heard them for long enough."""
    seen = Watched(lambda since_s, _: {1} if 4.0 < since_s < 22.0 else set())
    mission = mission_of(
        swarm={"gnss": [1, 3]},
        route={"d2_enu_m": (110, 0, 4)},
        sim={"personality": personality, "odometry": {"velocity_bias_mps": 0.2}},
    )
    seen.d2_m = 110.0
    outcome, shown = flown(mission, tmp_path, watch=seen)
    assert outcome.metrics.contacts == 0, shown
    assert seen.leaders == [1, 3, 1]
    first_s = next(now_s for now_s, leader, _ in seen.log if leader == 3) - seen.log[0][0]
    assert 4.0 + 7.0 <= first_s <= 4.0 + 10.0  # hysteresis, and the hand-over
    assert outcome.metrics.leaderless_max_s <= 0.5
    assert seen.worst_step_mps <= 0.3
    assert seen.worst_anchor_m <= ANCHOR_M
    assert seen.off_worst_m <= 4.0


def test_satellites_that_come_and_go_do_not_make_leaders_come_and_go(tmp_path: Path) -> None:
    seen = Watched(lambda since_s, _: {1} if since_s % 16.0 > 4.0 else set())
    outcome, shown = flown(mission_of(swarm={"gnss": [1, 3]}), tmp_path, watch=seen)
    assert outcome.metrics.contacts == 0, shown
    assert seen.leaders == [1, 3]
    assert seen.worst_step_mps <= 0.3
    assert seen.worst_anchor_m <= ANCHOR_M


def test_where_all_lose_their_satellites_at_once_the_leader_leads_on(tmp_path: Path) -> None:
    seen = Watched(lambda since_s, _: {1, 3} if since_s > 4.0 else set())
    outcome, shown = flown(mission_of(swarm={"gnss": [1, 3]}), tmp_path, watch=seen)
    assert outcome.metrics.contacts == 0, shown
    assert seen.leaders == [1]
    assert seen.worst_step_mps <= 0.3
    assert seen.worst_anchor_m <= ANCHOR_M


def with_heirs_fix_off(tmp_path: Path, from_s: float, off_ne_m: tuple[float, float]) -> tuple[Watched, str]:
    """The leader falls silent on the way, and 3 is the only other one with satellites. `off_ne_m`: of its fix."""
    seen = Watched(lambda _since_s, _: set())

    def watch(flight: fly.Flight) -> None:
        seen(flight)
        third = flight.world.vehicles[3]
        assert third.receiver is not None
        assert isinstance(third.believed, Aided)
        if flight.world.now_s > from_s:
            if third.receiver._wander != off_ne_m:
                third.believed._off = off_ne_m  # its autopilot resets its position to such a fix
            third.receiver._wander = off_ne_m

    faults = [{"kind": "kill", "vehicles": [1], "phase": "transit", "at_s": 12.0}]
    mission = mission_of(swarm={"gnss": [1, 3]}, sim={"faults": faults}, coverage={"duration_s": 30.0})
    outcome, shown = flown(mission, tmp_path, watch=watch)
    assert outcome.metrics.contacts == 0, shown
    return seen, shown


def test_an_heir_with_satellites_takes_the_swarm_to_where_they_say_without_a_jump(tmp_path: Path) -> None:
    """By its fix d2 is 2.8 m from where its predecessor had it: as a receiver may be from the ground on."""
    seen, shown = with_heirs_fix_off(tmp_path, 3.0, (2.0, -2.0))
    assert seen.leaders == [1, 3], shown
    assert seen.worst_step_mps <= 0.3
    assert seen.worst_anchor_m <= ANCHOR_M


def test_one_whose_fix_has_left_its_odometer_is_no_heir(tmp_path: Path) -> None:
    """By 15 m at once, in the air: the swarm goes on by odometers, and turns back when they get unsure."""
    seen, shown = with_heirs_fix_off(tmp_path, 20.0, (10.0, -11.0))
    assert "vehicle 3: position doubted: GNSS led astray" in shown
    assert seen.leaders == [1, 2], shown
    assert seen.worst_step_mps <= 0.3


def test_a_swarm_that_has_lost_its_place_comes_home_along_its_leaders_own_way(tmp_path: Path) -> None:
    """Nobody has a GNSS fix any more: it goes on by odometry as far as the mission allows."""
    seen = Watched(lambda since_s, _: {1} if since_s > 4.0 else set())
    mission = mission_of(swarm={"position_error_max_m": 5.0})
    outcome, shown = flown(mission, tmp_path, watch=seen)
    assert "position uncertain: backtracking to d1" in shown
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.min_separation_m >= 4.5
    assert seen.off_worst_m <= 5.0  # the budget
    assert 30.0 < max(place[1] for place in seen.track) < 60.0  # it had gone on meanwhile
    assert seen.leaders == [1]
    assert math.hypot(*seen.track[-1][:2]) < 4.0  # landed at d1
    assert "all landed" in str(outcome.summary["verdict"])
    assert seen.worst_step_mps <= 0.3


def test_where_the_mission_says_so_it_holds_until_a_leader_hears_satellites_again(tmp_path: Path) -> None:
    seen = Watched(lambda since_s, _: {1} if 4.0 < since_s < 50.0 else set())
    mission = mission_of(
        swarm={"position_error_max_m": 4.0, "position_uncertain": "hold"},
        sim={"seed": 1001},
        coverage={"duration_s": 30.0},
    )
    outcome, shown = flown(mission, tmp_path, watch=seen)
    assert "hold: position uncertain" in shown
    assert outcome.metrics.arrived, shown
    assert outcome.metrics.contacts == 0
    held = [place for place in seen.track if 20.0 < place[1] < 35.0]
    assert len(held) > 30.0 / 0.05  # it stood there for that long
    assert seen.worst_step_mps <= 0.3
    assert seen.worst_anchor_m <= ANCHOR_M


def test_an_heir_without_satellites_wanders_about_d2_no_farther_than_the_mission_allows(tmp_path: Path) -> None:
    """With 10 minutes of coverage: it leaves when it may be too far off, and takes the others home."""
    seen = Watched(lambda _since_s, _: set())
    faults = [{"kind": "kill", "vehicles": [1], "phase": "coverage", "at_s": 12.0}]
    mission = mission_of(
        swarm={"position_error_max_m": 6.0}, sim={"faults": faults, "seed": 1002}, coverage={"duration_s": 600.0}
    )
    outcome, shown = flown(mission, tmp_path, watch=seen)
    assert "position uncertain: backtracking to d1" in shown
    assert outcome.metrics.contacts == 0
    assert seen.leaders == [1, 2]
    assert seen.off_worst_m <= 6.0
    assert math.hypot(*seen.track[-1][:2]) < 15.0  # where it left d1, beside the leader
    assert "all landed" in str(outcome.summary["verdict"])
    assert seen.worst_step_mps <= 0.3


def test_the_way_home_past_one_that_hangs_silent_keeps_clear_of_it_by_its_measured_distance(tmp_path: Path) -> None:
    """It was heard last more than half a minute ago: by odometry alone it was passed at 2.7 m."""
    faults = [{"kind": "kill", "vehicles": [1], "phase": "transit", "at_s": 25.0}]
    mission = mission_of(
        swarm={"position_error_max_m": 6.0}, sim={"faults": faults, "seed": 1001}, coverage={"duration_s": 60.0}
    )
    outcome, shown = flown(mission, tmp_path)
    assert "position uncertain: backtracking to d1" in shown
    assert "all landed" in str(outcome.summary["verdict"])
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.min_separation_m >= 4.5
