"""When the leader takes the swarm on to its next phase, and where it goes meanwhile."""

from __future__ import annotations

import math

import pytest

from companion.core.model.states import SwarmPhase
from companion.core.swarm.phases import CLOSE_UP_LIMIT_S, DWELL_S, GATHER_LIMIT_S, STUCK_LAND_S, TOO_FEW_LAND_S, Phases
from companion.core.swarm.swarm import Swarm
from companion.core.vehicle.operator_orders import OperatorOrders
from mission.common.forming import FORMING_LIMIT_S, GAP_WINDOW_S
from tests.unit.core.core_kit import mission, picture

P = SwarmPhase
START_S = 1000.0
START_TIMEOUT_S, COVERAGE_S, CLIMB_S = 30.0, 60.0, 2.0 * 8.0 / 1.5
ARRIVAL_M = 5.0
ALL = 0b11111111
FIVE = 0b00011111  # a majority of eight
FOUR = 0b00001111


class Leader:
    """A leader at 10 Hz, from 1000 s on."""

    def __init__(self, phase: SwarmPhase = P.ASSEMBLE, **tables: dict[str, object]) -> None:
        self.phases = Phases(mission(**tables), START_S)
        self.now_s = START_S
        if phase is not P.ASSEMBLE:
            self.phases.adopt_phase(phase, START_S)

    @property
    def phase(self) -> SwarmPhase:
        return self.phases.phase

    def lead(self, seconds: float, *, done: int = 0, to_goal_m: float = 0.0, started: bool = True) -> SwarmPhase | None:
        """The phase that was entered meanwhile: it ends there, as the goal is another one from then on."""
        for _ in range(round(seconds * 10)):
            self.now_s += 0.1
            if self.phases.decide_phase(done, to_goal_m=to_goal_m, started=started, now_s=self.now_s):
                return self.phase
        return None


# --- several trees ---

TREES = {"stops": [{"pos_enu_m": (60.0, 20.0, 8.0), "duration_s": 10.0}, {"pos_enu_m": (60.0, 60.0, 8.0)}]}


def test_each_tree_is_gone_to_and_covered_for_its_own_time_and_d2_last() -> None:
    leader = Leader(P.TRANSIT, route={**TREES, "at_end": "return"}, coverage={"duration_s": 30.0})
    seen = []
    for _ in range(3):
        goal = leader.phases.goal()
        assert goal is not None
        assert leader.lead(5.0) is P.COVERAGE
        began_s = leader.now_s
        leader.lead(100.0)
        seen.append((goal[0], round(leader.now_s - began_s)))
    assert seen == [((20.0, 60.0, -8.0), 10), ((60.0, 60.0, -8.0), 30), ((0.0, 130.0, -8.0), 30)]
    assert leader.phase is P.RETURN


@pytest.mark.parametrize(
    ("told", "stop", "followed"),
    [(P.COVERAGE, 0, False), (P.TRANSIT, 1, False), (P.COVERAGE, 1, True), (P.TRANSIT, 2, True), (P.LAND, 0, True)],
)
def test_swarm_goes_on_from_tree_to_tree_and_never_back(told: SwarmPhase, stop: int, followed: bool) -> None:
    phases = Phases(mission(route=TREES), START_S)
    phases.adopt_phase(P.TRANSIT, START_S, 1)
    phases.adopt_phase(told, START_S, stop)
    assert (phases.phase is told and phases.stop == stop) is (followed or (told, stop) == (P.TRANSIT, 1))


def test_stop_that_the_mission_has_not_is_not_followed() -> None:
    phases = Phases(mission(route=TREES), START_S)
    phases.adopt_phase(P.TRANSIT, START_S, 3)
    assert (phases.phase, phases.stop) == (P.ASSEMBLE, 0)


def test_places_ahead_are_the_trees_that_are_left_and_home() -> None:
    phases = Phases(mission(route={**TREES, "at_end": "return"}), START_S)
    phases.adopt_phase(P.COVERAGE, START_S, 1)
    assert phases.stops_ahead() == [(60.0, 60.0, -8.0), (0.0, 130.0, -8.0), (0.0, 0.0, -8.0)]
    phases.adopt_phase(P.RETURN, START_S, 2)
    assert phases.stops_ahead() == [(0.0, 0.0, -8.0)]


# --- until the stand is known ---

SURVEYS = {
    "sensing": {"sensor": "scan-1deg", "range_m": 12.0},
    "survey": {"until": {"basal_area_pct": 10.0, "after_s": 20.0}},
    "route": {"at_end": "land"},
}


@pytest.mark.parametrize(
    ("basal_area_pct", "ends_s"),
    [(9.9, 20.0), (10.0, 20.0), (10.1, COVERAGE_S), (None, COVERAGE_S)],
    ids=["well enough", "just so", "not quite", "not at all"],
)
def test_coverage_ends_when_the_stand_is_known_and_never_before_its_least_time(
    basal_area_pct: float | None, ends_s: float
) -> None:
    leader = Leader(P.COVERAGE, coverage={"duration_s": COVERAGE_S}, **SURVEYS)
    leader.phases.note_stand(basal_area_pct)
    assert leader.lead(200.0) is P.LAND
    assert leader.now_s - START_S == pytest.approx(ends_s, abs=0.2)


def test_coverage_ends_as_soon_as_the_stand_is_known_later_on() -> None:
    leader = Leader(P.COVERAGE, coverage={"duration_s": COVERAGE_S}, **SURVEYS)
    assert leader.lead(30.0) is None
    leader.phases.note_stand(8.0)
    assert leader.lead(0.1) is P.LAND


def test_a_known_stand_ends_no_coverage_of_a_mission_that_does_not_ask_for_it() -> None:
    leader = Leader(P.COVERAGE, coverage={"duration_s": COVERAGE_S}, route={"at_end": "land"})
    leader.phases.note_stand(0.1)
    assert leader.lead(COVERAGE_S - 0.2) is None


def test_a_ring_that_is_not_formed_is_waited_for_though_the_stand_is_known() -> None:
    leader = Leader(P.COVERAGE, coverage={"duration_s": COVERAGE_S}, **SURVEYS)
    leader.phases.note_stand(8.0)
    assert leader.lead(19.9) is None
    assert leader.phases.is_near_end(leader.now_s)
    leader.phases.note_unformed(leader.now_s)
    assert leader.lead(GAP_WINDOW_S) is None
    assert leader.lead(0.3) is P.LAND


def test_trees_on_the_way_are_left_by_it_too() -> None:
    tables = {**SURVEYS, "route": {**TREES, "at_end": "return"}}
    leader = Leader(P.TRANSIT, coverage={"duration_s": 30.0}, **tables)
    leader.phases.note_stand(8.0)
    seen = []
    for _ in range(3):
        assert leader.lead(5.0) is P.COVERAGE
        began_s = leader.now_s
        leader.lead(100.0)
        seen.append(round(leader.now_s - began_s))
    assert seen == [10, 20, 20]


# --- assemble ---


def test_nothing_starts_before_the_operator_says_so() -> None:
    assert Leader().lead(300.0, done=ALL, started=False) is None


def test_complete_swarm_starts_after_a_moments_dwell() -> None:
    leader = Leader()
    leader.lead(5.0, done=ALL, started=False)
    assert leader.lead(DWELL_S - 0.2, done=ALL) is None
    assert leader.lead(0.5, done=ALL) is P.GATHER


def test_dwell_begins_anew_when_someone_drops_out() -> None:
    leader = Leader()
    leader.lead(0.8, done=ALL)
    leader.lead(0.2, done=FIVE)
    assert leader.lead(DWELL_S - 0.2, done=ALL) is None
    assert leader.lead(0.5, done=ALL) is P.GATHER


def test_majority_starts_without_the_missing_when_the_time_is_up() -> None:
    leader = Leader()
    leader.lead(5.0, started=False)
    assert leader.lead(START_TIMEOUT_S - 0.5, done=FIVE) is None
    assert leader.lead(1.0, done=FIVE) is P.GATHER


def test_half_of_the_swarm_never_starts() -> None:
    leader = Leader()
    leader.lead(5.0, started=False)
    assert leader.lead(10 * START_TIMEOUT_S, done=FOUR) is None


def test_time_for_the_missing_counts_from_the_order_to_start() -> None:
    leader = Leader()
    leader.lead(10 * START_TIMEOUT_S, done=FIVE, started=False)
    assert leader.lead(START_TIMEOUT_S - 0.5, done=FIVE) is None


def test_leader_that_comes_late_to_a_started_swarm_gives_the_missing_their_time() -> None:
    """Its clock of the phase has run since it was switched on, long ago."""
    leader = Leader()
    leader.now_s += 10 * START_TIMEOUT_S
    assert leader.lead(START_TIMEOUT_S - 0.5, done=FIVE) is None
    assert leader.lead(1.0, done=FIVE) is P.GATHER


def test_swarm_of_one_starts_alone() -> None:
    leader = Leader(swarm={"size": 1})
    leader.lead(1.0, started=False)
    assert leader.lead(DWELL_S + 0.2, done=1) is P.GATHER


# --- gather ---


def test_gathered_swarm_departs() -> None:
    assert Leader(P.GATHER).lead(DWELL_S + 0.2, done=ALL, to_goal_m=ARRIVAL_M) is P.TRANSIT


def test_dwell_is_each_phases_own() -> None:
    leader = Leader()
    assert leader.lead(DWELL_S + 0.5, done=ALL) is P.GATHER
    assert leader.lead(DWELL_S - 0.2, done=ALL, to_goal_m=0.0) is None


def test_swarm_does_not_depart_before_the_leader_is_at_d1() -> None:
    assert Leader(P.GATHER).lead(100.0, done=ALL, to_goal_m=ARRIVAL_M + 0.1) is None


def test_majority_departs_without_those_that_do_not_gather() -> None:
    leader = Leader(P.GATHER)
    assert leader.lead(GATHER_LIMIT_S + CLIMB_S - 0.5, done=FIVE) is None
    assert leader.lead(1.0, done=FIVE) is P.TRANSIT


def test_half_of_the_swarm_waits_at_d1_for_a_stated_time_and_lands() -> None:
    leader = Leader(P.GATHER)
    assert leader.lead(GATHER_LIMIT_S + CLIMB_S - 0.5, done=FOUR) is None
    assert not leader.phases.overdue(leader.now_s)
    assert leader.lead(TOO_FEW_LAND_S - 1.0, done=FOUR) is None
    assert leader.phases.overdue(leader.now_s)
    assert leader.lead(3.0, done=FOUR) is P.LAND


def test_higher_deployment_is_given_longer_to_climb_to() -> None:
    high = {"d1_enu_m": (0.0, 0.0, 20.0)}
    assert Leader(P.GATHER, route=high).lead(GATHER_LIMIT_S + CLIMB_S + 10.0, done=FIVE) is None


# --- transit, coverage and after ---


def test_swarm_covers_once_its_leader_has_arrived() -> None:
    leader = Leader(P.TRANSIT)
    assert leader.lead(100.0, done=ALL, to_goal_m=ARRIVAL_M + 0.1) is None
    entered = leader.lead(CLOSE_UP_LIMIT_S + 1.0, done=ALL, to_goal_m=ARRIVAL_M - 0.1)
    assert entered is P.COVERAGE


def test_stragglers_do_not_keep_an_arrived_swarm_from_covering() -> None:
    assert Leader(P.TRANSIT).lead(CLOSE_UP_LIMIT_S + 1.0, done=0b1, to_goal_m=1.0) is P.COVERAGE


@pytest.mark.parametrize(("at_end", "after"), [("hold", None), ("land", P.LAND), ("return", P.RETURN)])
def test_after_coverage_the_mission_says_what_comes(at_end: str, after: SwarmPhase | None) -> None:
    leader = Leader(P.COVERAGE, route={"at_end": at_end})
    assert leader.lead(COVERAGE_S - 0.5, done=ALL) is None
    assert leader.lead(5.0, done=0, to_goal_m=99.0) is after
    if after is None:
        assert leader.lead(5 * COVERAGE_S, done=ALL) is None
        assert leader.phase is P.COVERAGE


@pytest.mark.parametrize(("at_end", "after"), [("land", P.LAND), ("return", P.RETURN)])
def test_coverage_goes_on_until_the_ring_has_formed(at_end: str, after: SwarmPhase) -> None:
    leader = Leader(P.COVERAGE, route={"at_end": at_end})
    assert leader.lead(COVERAGE_S - 3.0) is None
    for _ in range(100):  # somebody was lost just before the end
        leader.phases.note_unformed(leader.now_s)
        assert leader.lead(0.1) is None
    assert leader.lead(GAP_WINDOW_S - 0.2) is None
    assert leader.lead(0.3) is after


def test_ring_that_does_not_form_ends_coverage_a_while_after_its_time() -> None:
    leader = Leader(P.COVERAGE, route={"at_end": "land"})
    entered = None
    while entered is None:
        leader.phases.note_unformed(leader.now_s)
        entered = leader.lead(0.1)
    assert leader.now_s - START_S == pytest.approx(COVERAGE_S + FORMING_LIMIT_S, abs=0.11)


def test_ring_counts_at_the_last_tree_and_the_end_of_its_time_alone() -> None:
    leader = Leader(P.TRANSIT, route={**TREES, "at_end": "land"})
    for stop, stay_s in enumerate((10.0, COVERAGE_S)):
        assert leader.lead(5.0) is P.COVERAGE
        leader.phases.note_unformed(leader.now_s)
        assert not leader.phases.is_near_end(leader.now_s)
        began_s = leader.now_s
        assert leader.phases.is_near_end(began_s + stay_s - 4.0) is (stop == 1)
        if stop == 0:
            leader.phases.note_unformed(began_s + stay_s)
            leader.lead(100.0)
            assert leader.now_s - began_s == pytest.approx(stay_s, abs=0.11)
            leader.phases.adopt_phase(P.TRANSIT, leader.now_s, 2)


def test_returned_swarm_lands_when_all_are_there_or_have_had_their_time() -> None:
    assert Leader(P.RETURN).lead(100.0, done=ALL, to_goal_m=ARRIVAL_M + 1.0) is None
    assert Leader(P.RETURN).lead(0.5, done=ALL, to_goal_m=1.0) is P.LAND
    leader = Leader(P.RETURN)
    assert leader.lead(CLOSE_UP_LIMIT_S - 0.5, done=FIVE, to_goal_m=1.0) is None
    assert leader.lead(1.0, done=FIVE, to_goal_m=1.0) is P.LAND


def test_landing_is_the_end() -> None:
    assert Leader(P.LAND).lead(1000.0, done=ALL) is None


# --- following ---


@pytest.mark.parametrize("now", list(SwarmPhase))
@pytest.mark.parametrize("said", list(SwarmPhase))
def test_follower_goes_on_with_its_leader_and_never_back(now: SwarmPhase, said: SwarmPhase) -> None:
    leader = Leader(now)
    leader.phases.adopt_phase(said, START_S + 1.0)
    assert leader.phase is max(now, said)


def test_repeated_announcement_does_not_restart_the_phases_clock() -> None:
    leader = Leader(P.COVERAGE, route={"at_end": "land"})
    for k in range(590):
        leader.phases.adopt_phase(P.COVERAGE, START_S + 0.1 * k)
    leader.now_s = START_S + 59.0
    assert leader.lead(1.5) is P.LAND


def test_new_leader_goes_on_with_the_time_that_it_has_seen_pass() -> None:
    """A follower's clock of the phase runs since it heard of it: coverage is not begun anew with each leader."""
    leader = Leader(P.COVERAGE, route={"at_end": "land"})
    leader.now_s = START_S + COVERAGE_S - 1.0
    assert leader.lead(1.5) is P.LAND


# --- where the leader goes ---


@pytest.mark.parametrize(
    ("phase", "goal_ned_m"),
    [
        (P.ASSEMBLE, None),
        (P.GATHER, (20.0, 10.0, -8.0)),
        (P.TRANSIT, (40.0, 130.0, -9.0)),
        (P.COVERAGE, None),
        (P.RETURN, (20.0, 10.0, -8.0)),
        (P.LAND, None),
    ],
)
def test_leaders_goal_in_each_phase(phase: SwarmPhase, goal_ned_m: tuple[float, float, float] | None) -> None:
    goal = Leader(phase, route={"d1_enu_m": (10.0, 20.0, 8.0), "d2_enu_m": (130.0, 40.0, 9.0)}).phases.goal()
    if goal_ned_m is None:
        assert goal is None
    else:
        assert goal is not None
        assert goal[0] == goal_ned_m


def test_leader_comes_to_rest_inside_of_the_arrival_distance() -> None:
    for phase in (P.GATHER, P.TRANSIT, P.RETURN):
        goal = Leader(phase).phases.goal()
        assert goal is not None
        assert 0.0 <= goal[1] < ARRIVAL_M
        assert not math.isnan(goal[1])


@pytest.mark.parametrize("phase", [P.TRANSIT, P.RETURN])
def test_leader_that_comes_no_nearer_lands_the_swarm_after_a_stated_time(phase: SwarmPhase) -> None:
    leader = Leader(phase)
    assert leader.lead(STUCK_LAND_S - 5.0, to_goal_m=30.0) is None
    assert leader.lead(STUCK_LAND_S - 5.0, to_goal_m=28.0) is None  # a little nearer: its time begins anew
    assert leader.lead(10.0, to_goal_m=28.0) is P.LAND


def test_leader_that_held_for_a_while_has_its_time_anew() -> None:
    leader = Leader(P.TRANSIT)
    leader.lead(STUCK_LAND_S - 5.0, to_goal_m=30.0)
    leader.now_s += 50.0
    assert leader.lead(STUCK_LAND_S - 5.0, to_goal_m=30.0) is None


def test_the_time_in_which_a_leader_waits_for_others_counts_for_no_landing() -> None:
    """Four lost one after the other, each waited for: the swarm landed, as stuck, before the wait was over."""
    swarm = Swarm(mission(), 1, OperatorOrders())
    swarm.phases.adopt_phase(P.TRANSIT, 0.0)
    landed_s: list[float] = []
    for now_s in range(300):
        swarm.partition.waits_for = [2] if 50.0 < now_s <= 150.0 else []
        swarm.decide_phase(picture(now_s=float(now_s)), 30.0)
        landed_s += [now_s] if swarm.phases.phase is P.LAND else []
    assert landed_s[0] == pytest.approx(STUCK_LAND_S + 100.0, abs=2.0)
