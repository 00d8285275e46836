"""The bounds of the watch on a leader, each from both of its sides."""

from __future__ import annotations

import pytest

from companion.core.model.states import SwarmPhase
from companion.core.model.vectors import add
from companion.core.swarm.phases import LANE_GIVE_UP_S, STUCK_LAND_S, TOO_FEW_LAND_S, Phases
from companion.core.swarm.trust.lead_watch import (
    APART_PERIODS,
    BACK_M,
    CORRIDOR_M,
    FRESH_PERIODS,
    LEFT_PERIODS,
    SLACK_S,
    LeadWatch,
)
from mission.common.forming import FORMING_LIMIT_S
from mission.common.frames import Vec3
from mission.document.model import Mission
from mission.rules.rise_rules import longest_rise_s
from tests.unit.core.core_election_kit import follower_of, leader_of_long_standing, step
from tests.unit.core.core_kit import beacon, lease, mission
from tests.unit.core.swarm.test_lane_phases import LANES

pytestmark = pytest.mark.sources

MISSION = mission(swarm={"size": 6}, route={"at_end": "land"}, coverage={"duration_s": 20.0})
STOPS = mission(
    swarm={"size": 6},
    route={"at_end": "hold", "stops": [{"pos_enu_m": (60.0, 40.0, 8.0), "duration_s": 12.0}]},
    coverage={"duration_s": 20.0},
)
WIDTH_M = CORRIDOR_M + MISSION.radio.transit_range_m
START: Vec3 = (10.0, 20.0, -8.0)
FIRST: Vec3 = (80.0, 60.0, 0.0)  # the vector to the first tree, at d1
ALONG = (80.0 / 100.0, 60.0 / 100.0)
ACROSS = (-ALONG[1], ALONG[0])


def at(along_m: float, across_m: float) -> Vec3:
    """Beside the way from START to the first tree."""
    return add(START, (along_m * ALONG[0] + across_m * ACROSS[0], along_m * ALONG[1] + across_m * ACROSS[1], 3.0))


def set_out(flies: Mission = MISSION) -> tuple[LeadWatch, Phases]:
    """A follower, at START when the swarm sets out at 1 s."""
    watch, phases = LeadWatch(flies), Phases(flies)
    phases.adopt_phase(SwarmPhase.GATHER, 0.0)
    assert watch.find_fault(START, None, phases, 0.0, leader=1) == ""
    phases.adopt_phase(SwarmPhase.TRANSIT, 1.0)
    for now_s in (1.0, 1.1):
        assert watch.find_fault(START, FIRST, phases, now_s, leader=1) == ""
    return watch, phases


@pytest.mark.parametrize(
    ("along_m", "across_m", "leaves"),
    [
        (50.0, WIDTH_M - 0.2, False),
        (50.0, WIDTH_M + 0.2, True),
        (20.0, -WIDTH_M + 0.2, False),
        (20.0, -WIDTH_M - 0.2, True),
        (100.0 + WIDTH_M - 0.2, 0.0, False),  # beyond the tree
        (100.0 + WIDTH_M + 0.2, 0.0, True),
        (-WIDTH_M + 0.2, 0.0, False),  # behind the start
        (-WIDTH_M - 0.2, 0.0, True),
        (100.0, WIDTH_M + 0.2, True),
        (0.0, WIDTH_M - 0.2, False),
    ],
)
def test_way_is_as_wide_as_a_formation_on_all_sides(along_m: float, across_m: float, *, leaves: bool) -> None:
    watch, phases = set_out()
    here = at(along_m, across_m)
    found = [watch.find_fault(here, None, phases, 2.0 + 0.1 * k, leader=1) for k in range(LEFT_PERIODS + 2)]
    assert found == ["leaves the way" if leaves and k >= LEFT_PERIODS else "" for k in range(LEFT_PERIODS + 2)]


def test_way_back_to_where_it_set_out_counts_as_the_way_too() -> None:
    """A triangle of d1 and two trees: each of its sides is flown."""
    watch, phases = set_out(STOPS)
    phases.adopt_phase(SwarmPhase.COVERAGE, 30.0)
    there = add(START, FIRST)
    assert watch.find_fault(there, None, phases, 30.0, leader=1) == ""
    phases.adopt_phase(SwarmPhase.TRANSIT, 60.0, 1)
    for now_s in (60.0, 60.1):
        assert watch.find_fault(there, (-160.0, 120.0, 0.0), phases, now_s, leader=1) == ""
    second = add(there, (-160.0, 120.0, 0.0))
    sides = [(START, there), (there, second), (second, START)]
    for a, b in sides:
        middle = add(a, tuple(0.5 * (q - p) for p, q in zip(a, b, strict=True)))
        assert [watch.find_fault(middle, None, phases, 70.0, leader=1) for _ in range(LEFT_PERIODS + 5)] == [""] * (
            LEFT_PERIODS + 5
        )
    away = add(there, (50.0, 0.0, 0.0))
    assert "leaves the way" in [watch.find_fault(away, None, phases, 80.0, leader=1) for _ in range(30)]


def test_moments_beside_the_way_do_not_add_up() -> None:
    watch, phases = set_out()
    beside, on = at(50.0, WIDTH_M + 1.0), at(50.0, 0.0)
    for k in range(6 * LEFT_PERIODS):
        here = on if k % LEFT_PERIODS == LEFT_PERIODS - 1 else beside
        assert watch.find_fault(here, None, phases, 2.0 + 0.1 * k, leader=1) == ""


def test_without_a_way_that_was_told_nobody_leaves_it() -> None:
    watch, phases = LeadWatch(MISSION), Phases(MISSION)
    phases.adopt_phase(SwarmPhase.GATHER, 0.0)
    watch.find_fault(START, None, phases, 0.0, leader=1)
    phases.adopt_phase(SwarmPhase.TRANSIT, 1.0)
    for k in range(40):
        assert watch.find_fault(at(50.0, 200.0), None, phases, 1.0 + 0.1 * k, leader=1) == ""
    # what comes later than two seconds is no word of when it set out
    assert watch.find_fault(at(50.0, 200.0), FIRST, phases, 9.0, leader=1) == ""
    assert [watch.find_fault(at(50.0, 400.0), None, phases, 9.0, leader=1) for _ in range(40)] == [""] * 40


@pytest.mark.parametrize(
    ("phase", "limit_s", "words"),
    [
        (
            SwarmPhase.GATHER,
            45.0 + 2.0 * 8.0 / MISSION.limits.climb_max_mps + TOO_FEW_LAND_S + SLACK_S,
            "waits too long",
        ),
        (SwarmPhase.TRANSIT, STUCK_LAND_S + SLACK_S, "gets nowhere"),
        (SwarmPhase.COVERAGE, 20.0 + FORMING_LIMIT_S + SLACK_S, "covers too long"),
    ],
)
def test_leader_has_the_missions_times_and_a_minute(phase: SwarmPhase, limit_s: float, words: str) -> None:
    watch, phases = LeadWatch(MISSION), Phases(MISSION)
    for one in range(SwarmPhase.GATHER, phase + 1):
        phases.adopt_phase(SwarmPhase(one), 0.0)
        watch.find_fault(START, FIRST, phases, 0.0, leader=1)
    assert watch.find_fault(START, None, phases, limit_s, leader=1) == ""
    assert watch.find_fault(START, None, phases, limit_s + 0.1, leader=1) == words


def test_a_leader_barred_at_two_ends_of_lanes_has_its_time_at_each() -> None:
    """It gives up the one after 90 s, and lands the swarm after 120 s before the other."""
    watch, phases = LeadWatch(LANES), Phases(LANES)
    for one in (SwarmPhase.GATHER, SwarmPhase.TRANSIT):
        phases.adopt_phase(one, 0.0)
        watch.find_fault(START, FIRST, phases, 0.0, leader=1)
    assert watch.find_fault(START, None, phases, LANE_GIVE_UP_S, leader=1) == ""
    phases.adopt_phase(SwarmPhase.TRANSIT, LANE_GIVE_UP_S, 1)
    for ended_s in (LANE_GIVE_UP_S + 0.1, LANE_GIVE_UP_S + STUCK_LAND_S):
        assert watch.find_fault(START, None, phases, ended_s, leader=1) == ""


@pytest.mark.parametrize(("moved_m", "stays"), [(4.9, True), (5.1, False)])
def test_who_gets_on_is_got_somewhere(moved_m: float, *, stays: bool) -> None:
    watch, phases = set_out()
    half_s = 1.0 + STUCK_LAND_S
    assert watch.find_fault((*at(moved_m, 0.0)[:2], START[2]), None, phases, half_s, leader=1) == ""
    said = watch.find_fault((*at(moved_m, 0.0)[:2], START[2]), None, phases, 1.1 + STUCK_LAND_S + SLACK_S, leader=1)
    assert said == ("gets nowhere" if stays else "")


def test_last_tree_of_a_mission_that_holds_is_covered_for_ever_and_the_first_is_not() -> None:
    for stop, words in ((0, "covers too long"), (1, "")):
        watch, phases = set_out(STOPS)
        phases.adopt_phase(SwarmPhase.COVERAGE, 30.0, 0)
        if stop:
            phases.adopt_phase(SwarmPhase.TRANSIT, 50.0, 1)
            watch.find_fault(START, None, phases, 50.0, leader=1)
            phases.adopt_phase(SwarmPhase.COVERAGE, 60.0, 1)
        watch.find_fault(START, None, phases, 60.0, leader=1)
        assert watch.find_fault(START, None, phases, 9e3, leader=1) == words
    watch, phases = set_out(STOPS)
    phases.adopt_phase(SwarmPhase.COVERAGE, 30.0, 0)
    watch.find_fault(START, None, phases, 30.0, leader=1)
    limit_s = 30.0 + 12.0 + FORMING_LIMIT_S + SLACK_S
    assert watch.find_fault(START, None, phases, limit_s, leader=1) == ""
    assert watch.find_fault(START, None, phases, limit_s + 0.1, leader=1) == "covers too long"


def test_who_does_not_follow_or_came_late_finds_no_fault() -> None:
    watch, phases = set_out()
    for k in range(30):
        assert watch.find_fault(at(50.0, 200.0), None, phases, 2.0 + 0.1 * k, leader=0) == ""
    assert watch.find_fault(at(50.0, 200.0), None, phases, 6.0, leader=1) == ""  # counted anew
    late = Phases(MISSION)
    late.adopt_phase(SwarmPhase.COVERAGE, 0.0)
    assert LeadWatch(MISSION).find_fault(START, None, late, 9e3, leader=1) == ""


def test_who_takes_over_far_from_the_way_did_not_lead_there() -> None:
    """The first that was elected after a usurper was given up within 2 s, and the next, until none was left to lead."""
    watch, phases = set_out()
    far = [at(50.0, WIDTH_M + 20.0) for _ in range(LEFT_PERIODS + 1)]
    found = [watch.find_fault(here, None, phases, 2.0 + 0.1 * k, leader=1) for k, here in enumerate(far)]
    assert found[-1] == "leaves the way"

    def follow(across_m: float, since_s: float) -> str:
        here = at(50.0, WIDTH_M + across_m)
        return [watch.find_fault(here, None, phases, since_s + 0.1 * k, leader=2) for k in range(3 * LEFT_PERIODS)][-1]

    assert follow(20.0, 5.0) == ""
    assert follow(20.0 + BACK_M - 0.2, 20.0) == ""
    assert follow(8.0, 30.0) == ""
    assert follow(8.0 + BACK_M + 0.2, 40.0) == "leaves the way"  # it was nearer, and has led it off again
    assert follow(-0.2, 50.0) == ""
    assert follow(BACK_M - 0.2, 60.0) == ""
    back = [watch.find_fault(at(50.0, 0.0), None, phases, 70.0 + 0.1 * k, leader=2) for k in range(3)]
    assert back == [""] * 3
    assert follow(0.2, 80.0) == "leaves the way"


def test_who_is_let_lead_again_has_to_bring_back_whom_it_lost() -> None:
    """One that was pushed off the way gave the same leader up at once, again and again."""
    watch, phases = set_out()
    far = at(50.0, WIDTH_M + 20.0)
    found = [watch.find_fault(far, None, phases, 2.0 + 0.1 * k, leader=1) for k in range(2 * LEFT_PERIODS)]
    assert found[-1] == "leaves the way"
    watch.forgive(1)
    again = [watch.find_fault(far, None, phases, 20.0 + 0.1 * k, leader=1) for k in range(2 * LEFT_PERIODS)]
    assert not any(again)
    farther = at(50.0, WIDTH_M + 20.2 + BACK_M)
    away = [watch.find_fault(farther, None, phases, 30.0 + 0.1 * k, leader=1) for k in range(2 * LEFT_PERIODS)]
    assert away[-1] == "leaves the way"
    watch.forgive(2)  # another one
    assert watch.find_fault(farther, None, phases, 40.0, leader=1) == "leaves the way"


@pytest.mark.parametrize("phase", [SwarmPhase.GATHER, SwarmPhase.TRANSIT, SwarmPhase.COVERAGE])
def test_who_takes_over_late_has_a_minute(phase: SwarmPhase) -> None:
    watch, phases = LeadWatch(MISSION), Phases(MISSION)
    for one in range(SwarmPhase.GATHER, phase + 1):
        phases.adopt_phase(SwarmPhase(one), 0.0)
        watch.find_fault(START, FIRST, phases, 0.0, leader=1)
    assert watch.find_fault(START, None, phases, 900.0, leader=1) != ""
    assert watch.find_fault(START, None, phases, 901.0, leader=2) == ""
    assert watch.find_fault(START, None, phases, 901.0 + SLACK_S, leader=2) == ""
    assert watch.find_fault(START, None, phases, 901.1 + SLACK_S + STUCK_LAND_S, leader=2) != ""


# --- how one came to lead ---


def test_who_follows_nobody_or_that_one_or_nobody_that_is_heard_of_believes_a_claim() -> None:
    told = beacon(3, lease=lease(1, 500, established=True))
    claim = beacon(3, lease=lease(3, 900, established=True))

    def is_believed(leader: int = 1, *, established: bool = True, periods: int = 0) -> bool:
        watch, election = LeadWatch(MISSION), follower_of(lease(leader, 500, established=established))
        step(election, periods)
        watch.note_claim(told, election, 1.0)
        return watch.note_claim(claim, election, 1.1)

    assert not is_believed()
    assert is_believed(3)
    assert is_believed(established=False)
    assert not is_believed(periods=FRESH_PERIODS)
    assert is_believed(periods=FRESH_PERIODS + 1)


def test_acting_leader_does_not_believe_one_that_it_heard_follow() -> None:
    watch, election = LeadWatch(MISSION), leader_of_long_standing(1)
    watch.note_claim(beacon(3, lease=lease(1, 500, established=True)), election, 1.0)
    assert not watch.note_claim(beacon(3, lease=lease(3, 900, established=True)), election, 1.1)
    assert not watch.may_lead(3)
    assert watch.may_lead(2)


@pytest.mark.parametrize(
    ("after_s", "believed"), [(0.1 * APART_PERIODS - 0.01, False), (0.1 * APART_PERIODS + 0.01, True)]
)
def test_apart_is_who_was_not_heard_for_a_second_and_a_half(after_s: float, *, believed: bool) -> None:
    watch, election = LeadWatch(MISSION), follower_of(lease(1, 500, established=True))
    watch.note_claim(beacon(3, lease=lease(1, 500, established=True)), election, 1.0)
    assert watch.note_claim(beacon(3, lease=lease(3, 900, established=True)), election, 1.0 + after_s) is believed


@pytest.mark.parametrize(("heir", "ends", "believed"), [(3, 1, True), (3, 0, False), (2, 10, False)])
def test_heir_takes_over_once_its_leader_has_announced_it(heir: int, ends: int, *, believed: bool) -> None:
    watch, election = LeadWatch(MISSION), follower_of(lease(1, 0, established=True, heir=heir, ends=ends))
    watch.note_claim(beacon(3, lease=lease(1, 0, established=True)), election, 1.0)
    assert watch.note_claim(beacon(3, lease=lease(3, 900, established=True)), election, 1.1) is believed


def test_leaders_own_word_is_its_last_beacon_while_that_is_fresh() -> None:
    watch, election = LeadWatch(MISSION), follower_of(lease(1, 500, established=True))
    assert watch.find_own_word(1, 1.0) is None
    watch.note_claim(beacon(1, lease=None), election, 1.0)
    assert watch.find_own_word(1, 1.0) is None
    watch.note_claim(beacon(1, lease=lease(2, 7)), election, 1.0)
    assert watch.find_own_word(1, 1.0) is None
    own = lease(1, 500, established=True)
    watch.note_claim(beacon(1, lease=own), election, 1.0)
    assert watch.find_own_word(1, 1.0 + 0.1 * APART_PERIODS - 1e-6) == own
    assert watch.find_own_word(1, 1.0 + 0.1 * APART_PERIODS + 1e-6) is None


@pytest.mark.parametrize("until_s", [1.0, 2.1])
def test_where_it_leads_is_what_was_told_last_in_the_first_two_seconds(until_s: float) -> None:
    """One that hands down what is not so is found after 1.1 s."""
    watch, phases = LeadWatch(MISSION), Phases(MISSION)
    phases.adopt_phase(SwarmPhase.GATHER, 0.0)
    watch.find_fault(START, None, phases, 0.0, leader=1)
    phases.adopt_phase(SwarmPhase.TRANSIT, 1.0)
    for k in range(round((until_s - 1.0) * 10.0) + 1):
        watch.find_fault(START, (0.0, 900.0, 0.0), phases, 1.0 + 0.1 * k, leader=1)  # not so,
    watch.find_fault(START, FIRST, phases, until_s + 0.1, leader=1)  # and taken back
    on = [watch.find_fault(at(90.0, 0.0), None, phases, 3.1 + 0.1 * k, leader=1) for k in range(LEFT_PERIODS + 2)]
    assert not any(on)
    beside = add(START, (0.0, 300.0, 0.0))
    found = [watch.find_fault(beside, None, phases, 6.0 + 0.1 * k, leader=1) for k in range(LEFT_PERIODS + 2)]
    assert found[-1] == "leaves the way"


def test_where_the_way_to_a_visit_was_not_told_nobody_leaves_it() -> None:
    """What is told in the first period is still of the visit before: its vector has not been replaced."""
    watch, phases = set_out(STOPS)
    there = add(START, FIRST)
    phases.adopt_phase(SwarmPhase.COVERAGE, 30.0)
    watch.find_fault(there, (0.0, 0.0, 0.0), phases, 30.0, leader=1)
    phases.adopt_phase(SwarmPhase.TRANSIT, 60.0, 1)
    watch.find_fault(there, (0.0, 0.0, 0.0), phases, 60.0, leader=1)
    on = add(there, (-160.0, 120.0, 0.0))
    found = [watch.find_fault(on, None, phases, 60.1 + 0.1 * k, leader=1) for k in range(2 * LEFT_PERIODS)]
    assert not any(found)


def test_who_follows_anew_has_all_of_the_periods_anew() -> None:
    watch, phases = set_out()
    beside = at(50.0, 200.0)
    for k in range(LEFT_PERIODS):
        assert watch.find_fault(beside, None, phases, 2.0 + 0.1 * k, leader=1) == ""
    assert watch.find_fault(beside, None, phases, 5.0, leader=0) == ""
    found = [watch.find_fault(beside, None, phases, 5.0 + 0.1 * k, leader=1) for k in range(LEFT_PERIODS + 1)]
    assert found == [*[""] * LEFT_PERIODS, "leaves the way"]


def test_a_leader_that_may_rise_covers_for_so_much_longer() -> None:
    rises = mission(
        swarm={"size": 6},
        route={"at_end": "land"},
        coverage={"duration_s": 20.0},
        fence={"altitude_max_m": 10.0},
        sensing={"sensor": "multi-layer", "range_m": 40.0},
        survey={"rise_to_m": 25.0},
    )
    watch, phases = set_out(rises)
    phases.adopt_phase(SwarmPhase.COVERAGE, 30.0)
    watch.find_fault(START, None, phases, 30.0, leader=1)
    limit_s = 30.0 + 20.0 + FORMING_LIMIT_S + SLACK_S + longest_rise_s(rises)
    assert watch.find_fault(START, None, phases, limit_s, leader=1) == ""
    assert watch.find_fault(START, None, phases, limit_s + 0.1, leader=1) == "covers too long"
