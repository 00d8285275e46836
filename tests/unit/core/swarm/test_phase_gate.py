"""The gate for phases, case by case: how many must say so, and what the mission has when."""

from __future__ import annotations

import pytest

from companion.core.model.beacon import Beacon
from companion.core.model.states import SwarmPhase
from companion.core.swarm.phases import STUCK_LAND_S, Phases
from companion.core.swarm.trust.phase_gate import BACK_SHARE, EARLY_S, EARLY_SHARE, HEARD_PERIODS, PhaseGate
from mission.document.model import Mission
from tests.unit.core.core_kit import beacon, lease, mission
from tests.unit.core.ranging_kit import ranging_mission

pytestmark = pytest.mark.sources

LEADER, ME = 1, 5
LANDS = mission(swarm={"size": 6}, route={"at_end": "land"}, coverage={"duration_s": 20.0})
RETURNS = mission(swarm={"size": 6}, route={"at_end": "return"}, coverage={"duration_s": 20.0})
HOLDS = mission(swarm={"size": 6}, route={"at_end": "hold"}, coverage={"duration_s": 20.0})
TWO_TREES = mission(
    swarm={"size": 6},
    route={"at_end": "return", "stops": [{"pos_enu_m": (60.0, 40.0, 8.0), "duration_s": 50.0}]},
    coverage={"duration_s": 20.0},
)
G, T, C, R, L = (SwarmPhase(k) for k in range(SwarmPhase.GATHER, SwarmPhase.LAND + 1))


def began(flies: Mission, phase: SwarmPhase, stop: int = 0) -> Phases:
    """A follower's that has seen each begin, the last at 0 s."""
    phases = Phases(flies)
    for at in range(stop + 1):
        for one in range(SwarmPhase.GATHER if not at else SwarmPhase.TRANSIT, (C if at < stop else phase) + 1):
            phases.adopt_phase(SwarmPhase(one), 0.0, at)
    assert (phases.phase, phases.stop) == (phase, 0 if phase >= R else stop) or phase >= R
    return phases


def word(sender: int, phase: SwarmPhase, hop: int = 1, *, leader: int = LEADER, stop: int = 0) -> Beacon:
    return beacon(sender, phase=phase, stop=stop, lease=lease(leader, 7, established=True), hop=hop, route_cost=1.0)


# --- how many must say so ---


def test_without_a_leader_or_news_nothing_is_believed() -> None:
    gate, phases = PhaseGate(LANDS, ME), began(LANDS, T)
    assert not gate.is_believed(beacon(LEADER, phase=C, lease=None), phases, 1, 1.0, is_news=True)
    for told in (G, T):
        gate.store(word(LEADER, told, 0), 1.0)
        assert not gate.is_believed(word(LEADER, told, 0), phases, 1, 1.0, is_news=True)
    gate.store(word(LEADER, C, 0), 1.0)
    assert gate.is_believed(word(LEADER, C, 0), phases, 1, 1.0, is_news=True)


def test_who_follows_another_or_nobody_any_more_is_no_witness() -> None:
    gate, phases = PhaseGate(LANDS, ME), began(LANDS, T)
    gate.store(word(2, C), 1.0)
    gate.store(word(3, C, leader=4), 1.0)
    gate.store(word(LEADER, T, 0), 1.0)
    assert not gate.is_believed(word(2, C), phases, 2, 1.0, is_news=True)
    gate.store(word(3, C), 1.0)
    assert gate.is_believed(word(2, C), phases, 2, 1.0, is_news=True)
    gate.store(beacon(3, phase=C, lease=None), 1.0)
    assert not gate.is_believed(word(2, C), phases, 2, 1.0, is_news=True)


@pytest.mark.parametrize(("age_s", "counts"), [(0.1 * HEARD_PERIODS - 0.01, True), (0.1 * HEARD_PERIODS + 0.01, False)])
def test_a_word_counts_for_a_second_and_a_half(age_s: float, *, counts: bool) -> None:
    gate, phases = PhaseGate(LANDS, ME), began(LANDS, T)
    gate.store(word(LEADER, T, 0), 1.0)
    gate.store(word(2, C), 1.0)
    gate.store(word(3, C), 1.0 + age_s)
    assert gate.is_believed(word(3, C), phases, 2, 1.0 + age_s, is_news=False) is counts


@pytest.mark.parametrize(
    ("hops", "own_hop", "is_news", "believed"),
    [
        ({2: 1}, 2, True, True),  # the one way to the leader
        ({2: 1}, 2, False, False),  # its lease is no news: others renew it
        ({2: 1, 3: 1}, 2, True, False),  # another is as near, and says nothing
        ({2: 1, 3: 2}, 2, True, True),  # that one is no nearer than this one
        ({2: 1, 3: 2}, 3, True, False),
        ({2: 0, 3: 0}, 1, True, True),  # nobody is at its leader's place: as if a hop off
    ],
)
def test_who_has_two_ways_to_the_leader_wants_both(
    hops: dict[int, int], own_hop: int, *, is_news: bool, believed: bool
) -> None:
    gate, phases = PhaseGate(LANDS, ME), began(LANDS, T)
    for vehicle, hop in hops.items():
        gate.store(word(vehicle, C if vehicle == 2 else T, hop), 1.0)
    assert gate.is_believed(word(2, C), phases, own_hop, 1.0, is_news=is_news) is believed


@pytest.mark.parametrize(
    ("others", "phase", "following", "believed"),
    [
        ({2: C, 3: T}, T, C, False),  # one of its followers
        ({2: C, 3: C}, T, C, True),
        ({2: C}, T, C, True),  # there is nobody else to say so
        ({2: G, 3: SwarmPhase.ASSEMBLE}, SwarmPhase.ASSEMBLE, G, True),  # on the ground
    ],
)
def test_a_leader_goes_on_when_two_of_its_followers_are_further(
    others: dict[int, SwarmPhase], phase: SwarmPhase, following: SwarmPhase, *, believed: bool
) -> None:
    gate = PhaseGate(LANDS, LEADER)
    phases = Phases(LANDS) if phase < G else began(LANDS, phase)
    for vehicle, told in others.items():
        gate.store(word(vehicle, told), 1.0)
    assert gate.is_believed(word(2, following), phases, 0, 1.0, is_news=True) is believed


@pytest.mark.parametrize(("heard", "believed"), [((), True), ((2,), False), ((2, 3), False)])
def test_who_has_missed_a_phase_takes_no_single_word_for_it(heard: tuple[int, ...], *, believed: bool) -> None:
    """From the climb to the tree: transit has passed without it."""
    gate, phases = PhaseGate(LANDS, ME), began(LANDS, G)
    for vehicle in heard:
        gate.store(word(vehicle, G), 1.0)
    gate.store(word(LEADER, C, 0), 1.0)
    assert gate.is_believed(word(LEADER, C, 0), phases, 1, 1.0, is_news=True) is believed
    gate.store(word(4, C), 1.0)
    assert gate.is_believed(word(LEADER, C, 0), phases, 1, 1.0, is_news=True)
    assert gate.is_believed(word(LEADER, C, 0), Phases(LANDS), 1, 1.0, is_news=True)  # on the ground it may join


def test_another_trees_phase_is_no_step_of_this_one() -> None:
    """Followers of a leader at the second tree, while this one covers the first."""
    gate, phases = PhaseGate(TWO_TREES, ME), began(TWO_TREES, C)
    gate.store(word(2, C, stop=1), 60.0)
    gate.store(word(LEADER, C, 0, stop=1), 60.0)
    assert gate.is_believed(word(LEADER, C, 0, stop=1), phases, 1, 60.0, is_news=True)
    alone = PhaseGate(TWO_TREES, ME)
    alone.store(word(2, C), 60.0)
    alone.store(word(LEADER, C, 0, stop=1), 60.0)
    assert not alone.is_believed(word(LEADER, C, 0, stop=1), phases, 1, 60.0, is_news=True)
    alone.store(word(LEADER, T, 0, stop=1), 60.0)
    assert alone.is_believed(word(LEADER, T, 0, stop=1), phases, 1, 60.0, is_news=True)


def test_to_land_at_once_takes_the_leader_and_one_more() -> None:
    phases = began(LANDS, T)
    for tellers, believed in (((LEADER,), False), ((2, 3), False), ((LEADER, 2), True), ((LEADER, 2, 3), True)):
        gate = PhaseGate(LANDS, ME)
        for vehicle in tellers:
            gate.store(word(vehicle, L, 0 if vehicle == LEADER else 1), 1.0)
        assert gate.is_believed(word(tellers[0], L, 0), phases, 2, 1.0, is_news=True) is believed
    gate = PhaseGate(LANDS, ME)  # of no other phase can that be said
    for vehicle in (LEADER, 2, 3):
        gate.store(word(vehicle, R, 0 if vehicle == LEADER else 1), 1.0)
    assert not gate.is_believed(word(LEADER, R, 0), phases, 2, 1.0, is_news=True)


# --- what the mission has, and when ---

STUCK_S = EARLY_SHARE * STUCK_LAND_S
GATHER_S = EARLY_SHARE * Phases(LANDS).gather_limit_s
COVERS_S = EARLY_SHARE * 20.0 - EARLY_S


@pytest.mark.parametrize(
    ("flies", "phase", "following", "from_s"),
    [
        (LANDS, G, L, GATHER_S),
        (LANDS, T, L, STUCK_S),
        (RETURNS, R, L, STUCK_S),
        (LANDS, C, L, COVERS_S),
        (RETURNS, C, R, COVERS_S),
    ],
)
def test_a_step_is_possible_from_so_much_of_its_time_on(
    flies: Mission, phase: SwarmPhase, following: SwarmPhase, from_s: float
) -> None:
    gate, phases = PhaseGate(flies, ME), began(flies, phase)
    gate.note_position((0.0, 0.0, -8.0), G)
    gate.note_position((130.0, 0.0, -8.0), C)
    assert not gate.is_possible(following, 0, phases, from_s - 1e-6)
    assert gate.is_possible(following, 0, phases, from_s)
    late = Phases(flies)  # who has not seen it begin knows no times
    late.adopt_phase(phase, 0.0)
    assert gate.is_possible(following, 0, late, 0.0) or phase is G


@pytest.mark.parametrize(
    ("flies", "following", "possible"),
    [(LANDS, R, False), (RETURNS, L, False), (HOLDS, L, False), (HOLDS, R, False), (LANDS, T, False)],
)
def test_after_the_last_tree_comes_what_the_mission_says(
    flies: Mission, following: SwarmPhase, *, possible: bool
) -> None:
    gate, phases = PhaseGate(flies, ME), began(flies, C)
    assert gate.is_possible(following, 1 if following is T else 0, phases, 1e3) is possible


def test_after_the_first_tree_comes_the_second_and_nothing_else() -> None:
    gate, phases = PhaseGate(TWO_TREES, ME), began(TWO_TREES, C)
    soon_s = EARLY_SHARE * 50.0 - EARLY_S
    assert gate.is_possible(T, 1, phases, soon_s)
    assert not gate.is_possible(T, 1, phases, soon_s - 0.1)
    assert not gate.is_possible(T, 2, phases, 1e3)
    assert not gate.is_possible(R, 0, phases, 1e3)
    assert not gate.is_possible(L, 0, phases, 1e3)
    last = began(TWO_TREES, C, 1)
    assert gate.is_possible(R, 0, last, COVERS_S)
    assert not gate.is_possible(T, 2, last, 1e3)


def test_only_a_swarm_that_may_lose_its_position_turns_back() -> None:
    gate, phases = PhaseGate(RETURNS, ME), began(RETURNS, T)
    assert not gate.is_possible(R, 0, phases, 1e3)
    assert not gate.is_possible(R, 0, began(RETURNS, C), 1.0)
    gate.may_turn_back = True
    assert gate.is_possible(R, 0, phases, 0.0)
    assert gate.is_possible(R, 0, began(RETURNS, C), 1.0)
    assert not gate.is_possible(L, 0, began(RETURNS, C), 1.0)


@pytest.mark.parametrize(
    ("away_m", "back"),
    [(BACK_SHARE * 200.0 - 0.1, True), (BACK_SHARE * 200.0 + 0.1, False)],
)
def test_back_is_who_is_as_near_as_a_share_of_its_way(away_m: float, *, back: bool) -> None:
    gate, phases = PhaseGate(RETURNS, ME), began(RETURNS, R)
    gate.note_position((500.0, 5.0, -8.0), G)
    gate.note_position((7.0, 5.0, -8.0), G)  # where the swarm left d1
    gate.note_position((207.0, 5.0, -8.0), C)
    gate.note_position((107.0, 5.0, -8.0), C)
    gate.note_position((7.0 + away_m, 5.0, -8.0), R)
    assert gate.is_possible(L, 0, phases, 1.0) is back


def test_near_d1_the_radios_range_is_near_enough() -> None:
    gate, phases = PhaseGate(RETURNS, ME), began(RETURNS, R)
    reach_m = RETURNS.radio.full_range_m
    gate.note_position((0.0, 0.0, -8.0), G)
    gate.note_position((reach_m + 1.0, 0.0, -8.0), R)
    assert not gate.is_possible(L, 0, phases, 1.0)
    gate.note_position((reach_m - 1.0, 0.0, -8.0), R)
    assert gate.is_possible(L, 0, phases, 1.0)
    assert PhaseGate(RETURNS, ME).is_possible(L, 0, phases, 1.0)  # it does not know


@pytest.mark.parametrize(
    ("phase", "told", "stop", "after_s", "foul"),
    [
        (T, T, 0, 1.0, False),  # no news
        (T, G, 0, 1.0, False),
        (T, C, 0, 1.0, False),  # a step, and possible
        (T, L, 0, 1.0, True),
        (T, L, 0, STUCK_S, False),
        (T, R, 0, 1.0, True),
        (C, L, 0, 1.0, True),
        (C, L, 0, 20.0, False),
        (G, C, 0, 1.0, False),  # no step: it may be of another part
        (R, L, 0, 1.0, False),  # whether it is back, a straggler cannot see
    ],
)
def test_a_foul_is_a_step_that_the_mission_does_not_have_now(
    phase: SwarmPhase, told: SwarmPhase, stop: int, after_s: float, *, foul: bool
) -> None:
    flies = RETURNS if phase is R else LANDS
    gate, phases = PhaseGate(flies, ME), began(flies, phase)
    gate.note_position((0.0, 0.0, -8.0), G)
    gate.note_position((130.0, 0.0, -8.0), C)
    assert gate.is_foul(word(LEADER, told, 0, stop=stop), phases, after_s) is foul


@pytest.mark.parametrize(("gnss", "turns_back"), [([1, 2, 3], True), ([1, 2, 3, 4], False), ([2, 3, 4], True)])
def test_a_swarm_of_which_any_may_lose_its_position_may_turn_back(gnss: list[int], *, turns_back: bool) -> None:
    table = {"gnss": gnss if len(gnss) < 4 else "all", "position_uncertain": "return", "leader_priority": [2, 3]}
    assert PhaseGate(ranging_mission(swarm=table), ME).may_turn_back is turns_back
