"""How a swarm goes on from lane to lane: by its leader's word, each end once, and what of it a follower believes."""

from __future__ import annotations

import math

import pytest

from companion.core.model.states import SwarmPhase
from companion.core.swarm.phases import LANE_GIVE_UP_S, LANE_WAIT_S, STUCK_LAND_S, Phases
from companion.core.swarm.trust.phase_gate import EARLY_S, EARLY_SHARE, PhaseGate
from mission.document.model import Mission
from mission.lanes.spread import PASS_M
from tests.unit.core.core_kit import mission

P, T = SwarmPhase, SwarmPhase.TRANSIT
START_S = 1000.0
ARRIVAL_M = 5.0


def surveys(**survey: object) -> Mission:
    """Two lanes, four ends."""
    return mission(
        route={"d2_enu_m": (0.0, 30.0, 8.0), "at_end": "land"},
        swarm={"size": 2},
        coverage={"duration_s": 0.0},
        sensing={"sensor": "scan-1deg", "range_m": 8.0},
        survey={
            "area_enu_m": [[20.0, -10.0], [60.0, -10.0], [60.0, 10.0], [20.0, 10.0]],
            "lane_m": 15.0,
            **survey,
        },
    )


LANES, UNTIL = surveys(), surveys(until={"basal_area_pct": 10.0})


class Leader:
    """A leader at 10 Hz, on its way to the lanes."""

    def __init__(self, flies: Mission = LANES) -> None:
        assert len(flies.lanes) == 2
        self.phases, self.now_s = Phases(flies, START_S), START_S
        self.phases.adopt_phase(T, START_S)

    def lead(self, seconds: float, *, to_goal_m: float) -> tuple[SwarmPhase, int]:
        """Until something has changed, at most; the phase and the visit then."""
        for _ in range(round(seconds * 10)):
            self.now_s += 0.1
            if self.phases.decide_phase(0, to_goal_m=to_goal_m, started=True, now_s=self.now_s):
                break
        return self.phases.phase, self.phases.stop


def test_each_end_of_a_lane_is_passed_and_d2_is_arrived_at() -> None:
    leader = Leader()
    seen = [leader.lead(0.1, to_goal_m=PASS_M) for _ in range(4)]
    assert seen == [(T, 1), (T, 2), (T, 3), (T, 4)]
    assert leader.lead(5.0, to_goal_m=ARRIVAL_M + 0.1) == (T, 4)
    assert leader.lead(0.1, to_goal_m=ARRIVAL_M) == (P.COVERAGE, 4)


def test_a_leader_does_not_slow_down_for_the_end_of_a_lane() -> None:
    leader = Leader()
    assert [leader.phases.goal()[1] for _ in range(1)] == [0.0]  # type: ignore[index]
    for _ in range(4):
        leader.lead(0.1, to_goal_m=0.0)
    goal = leader.phases.goal()
    assert goal is not None
    assert goal[1] > 0.0


def test_an_end_that_a_trunk_bars_is_passed_beside_it_after_a_moment() -> None:
    leader = Leader()
    assert leader.lead(LANE_WAIT_S, to_goal_m=ARRIVAL_M) == (T, 0)
    assert leader.lead(0.3, to_goal_m=ARRIVAL_M) == (T, 1)


def test_one_end_that_cannot_be_reached_is_given_up_and_two_in_succession_land_the_swarm() -> None:
    leader, far_m = Leader(), ARRIVAL_M + 20.0
    assert leader.lead(LANE_GIVE_UP_S, to_goal_m=far_m) == (T, 0)
    assert leader.lead(0.3, to_goal_m=far_m) == (T, 1)
    assert leader.lead(LANE_GIVE_UP_S + 1.0, to_goal_m=far_m) == (T, 1)
    assert leader.lead(STUCK_LAND_S - LANE_GIVE_UP_S, to_goal_m=far_m) == (P.LAND, 1)


def test_after_an_end_that_was_reached_another_one_may_be_given_up() -> None:
    leader, far_m = Leader(), ARRIVAL_M + 20.0
    assert leader.lead(LANE_GIVE_UP_S + 1.0, to_goal_m=far_m) == (T, 1)
    assert leader.lead(0.1, to_goal_m=0.0) == (T, 2)
    assert leader.lead(LANE_GIVE_UP_S + 1.0, to_goal_m=far_m) == (T, 3)


def test_a_known_stand_leaves_out_the_lanes_after_the_first() -> None:
    leader = Leader(UNTIL)
    leader.phases.note_stand(9.0)
    assert leader.lead(0.1, to_goal_m=0.0) == (T, 1)
    assert leader.lead(5.0, to_goal_m=30.0) == (T, 1)
    assert leader.lead(0.1, to_goal_m=0.0) == (T, 2)
    assert leader.lead(0.1, to_goal_m=30.0) == (T, 4)


@pytest.mark.parametrize("pct", [None, 10.1])
def test_a_stand_that_is_not_known_well_enough_leaves_out_none(pct: float | None) -> None:
    leader = Leader(UNTIL)
    leader.phases.note_stand(pct)
    assert [leader.lead(0.1, to_goal_m=0.0) for _ in range(4)] == [(T, 1), (T, 2), (T, 3), (T, 4)]


def test_without_until_a_known_stand_leaves_out_none() -> None:
    leader = Leader(LANES)
    leader.phases.note_stand(0.1)
    assert [leader.lead(0.1, to_goal_m=0.0) for _ in range(4)] == [(T, 1), (T, 2), (T, 3), (T, 4)]


def test_who_follows_never_goes_back_to_an_earlier_lane() -> None:
    phases = Phases(LANES)
    phases.adopt_phase(T, START_S, 2)
    for stop in (0, 1, 2):
        phases.adopt_phase(T, START_S + 1.0, stop)
        assert phases.stop == 2
    phases.adopt_phase(T, START_S + 1.0, 3)
    assert phases.stop == 3


@pytest.mark.parametrize(
    ("flies", "at", "phase", "stop", "step", "possible"),
    [
        (LANES, 0, T, 1, True, True),
        (LANES, 0, T, 2, False, False),  # it has missed one: of that two must tell
        (LANES, 0, P.COVERAGE, 0, True, False),  # no tree is covered there
        (LANES, 2, T, 4, False, False),  # the mission leaves out none
        (LANES, 4, P.COVERAGE, 4, True, True),
        (UNTIL, 1, T, 4, False, False),  # the first lane has not been flown, or its end was missed
        (UNTIL, 2, T, 4, True, True),
        (UNTIL, 3, T, 4, True, True),
        (UNTIL, 4, T, 5, False, False),
    ],
)
def test_a_follower_believes_the_next_end_and_that_lanes_are_left_out_once_the_first_is_flown(
    flies: Mission, at: int, phase: SwarmPhase, stop: int, step: bool, possible: bool
) -> None:
    phases, gate = Phases(flies), PhaseGate(flies, 2)
    phases.adopt_phase(T, START_S, at)
    phases.saw_begin = True
    assert phases.is_step(phase, stop) is step
    assert (step and gate.is_possible(phase, stop, phases, START_S + LANE_GIVE_UP_S)) is possible


# Along a lane: its turns are too short here to be bounded
@pytest.mark.parametrize(("flies", "at"), [(LANES, 1), (LANES, 3), (UNTIL, 1)])
def test_no_end_is_passed_before_a_leader_could_have_flown_there(flies: Mission, at: int) -> None:
    """A leader that lies would have all lanes behind it within a second."""
    phases, gate = Phases(flies), PhaseGate(flies, 2)
    phases.adopt_phase(T, START_S, at)
    phases.saw_begin = True
    way_m = math.dist(*flies.way_enu_m[at : at + 2]) - 2.0 * ARRIVAL_M
    least_s = EARLY_SHARE * way_m / flies.limits.speed_max_mps - EARLY_S
    assert least_s > 0.0
    assert not gate.is_possible(T, at + 1, phases, START_S + least_s - 0.01)
    assert gate.is_possible(T, at + 1, phases, START_S + least_s + 0.01)


def test_an_end_that_is_given_up_is_possible_however_far_it_is() -> None:
    far = surveys(area_enu_m=[[2000.0, -10.0], [2040.0, -10.0], [2040.0, 10.0], [2000.0, 10.0]])
    phases, gate = Phases(far), PhaseGate(far, 2)
    phases.adopt_phase(T, START_S, 0)
    phases.saw_begin = True
    assert gate.is_possible(T, 1, phases, START_S + LANE_GIVE_UP_S)
