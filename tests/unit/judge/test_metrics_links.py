"""Figures of a flight: whether the swarm is one, as its radio has it, and for how long it was not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from companion.core.model.states import SwarmPhase
from mission.schema.faults import FaultKind
from sim_bridge.judge import metrics
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics import measure
from sim_bridge.judge.page.replay import Verdict, replay
from tests.unit.judge.metrics_kit import COVERAGE, TRANSIT, TREE, a_mission, a_recording, column, level


@pytest.mark.parametrize(("model", "connected"), [("disc", [1, 1, 1]), ("attenuated", [1, 0, 1]), ("cut", [0, 0, 1])])
def test_trunks_between_vehicles_part_them_as_the_radio_has_it(model: str, connected: list[int]) -> None:
    mission = a_mission(forest={"trees": (TREE,)}, sim={"radio_trunks": model})
    recording = a_recording([level(45.0, 55.0), level(40.0, 60.0), level(51.0, 70.0)])  # of 30 m a trunk leaves 15.04
    result = measure(recording, mission)
    assert result.connected_fraction_transit == pytest.approx(sum(connected) / 3)


@pytest.mark.parametrize(
    "gaps", [(0, 1, 0, 1, 1, 1, 0, 0), (0, 1, 1, 1, 0, 1, 0, 0)], ids=["short first", "long first"]
)
def test_splits_are_counted_and_timed_until_the_swarm_is_one_again(gaps: tuple[int, ...]) -> None:
    recording = a_recording([level(0.0, 20.0 + 20.0 * gap) for gap in gaps], dt_s=0.5)
    result = measure(recording, a_mission())
    assert (result.splits, result.longest_gap_s, result.rejoin_s) == (2, 1.5, 1.5)


def test_a_swarm_that_stays_apart_never_rejoined() -> None:
    recording = a_recording([level(0.0, 20.0), level(0.0, 40.0), level(0.0, 41.0), level(0.0, 42.0)])
    result = measure(recording, a_mission())
    assert (result.splits, result.longest_gap_s, result.rejoin_s) == (1, 2.0, None)


def test_a_split_at_a_tree_before_d2_counts() -> None:
    mission = a_mission(way={"stops": [{"pos_enu_m": (50.0, 0.0, 10.0)}]})
    phases = column(TRANSIT, COVERAGE, COVERAGE, COVERAGE, TRANSIT, COVERAGE)
    gaps = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    recording = a_recording([level(50.0, 70.0 + 20.0 * gap) for gap in gaps], phase=phases)
    result = measure(recording, mission)
    assert (result.splits, result.longest_gap_s, result.rejoin_s) == (1, 1.0, 1.0)
    assert result.connected_fraction_coverage == 1.0  # which is of d2


def test_a_split_that_outlasts_the_transit_is_timed_to_its_end() -> None:
    ticks = [level(0.0, 20.0), level(0.0, 40.0), level(0.0, 40.0), level(0.0, 20.0)]
    recording = a_recording(ticks, phase=column(TRANSIT, TRANSIT, SwarmPhase.LAND, SwarmPhase.LAND))
    assert measure(recording, a_mission()).rejoin_s == 2.0


def test_vehicles_that_a_fault_cuts_off_are_a_split_though_in_range() -> None:
    recording = a_recording([level(0.0, 20.0, 28.0)] * 8, dt_s=0.5)
    cut = [FaultEvent(FaultKind.PARTITION, (3,), 0.5, 2.0)]
    result = measure(recording, a_mission(n=3), faults=cut)
    assert (result.splits, result.longest_gap_s, result.rejoin_s) == (1, 2.0, 2.0)
    assert result.connected_fraction_transit == 1.0  # which is of range
    lasting = [FaultEvent(FaultKind.PARTITION, (1, 2), 0.5)]
    assert measure(recording, a_mission(n=3), faults=lasting).rejoin_s is None


def test_a_replay_draws_no_link_that_a_fault_cuts(tmp_path: Path) -> None:
    recording, flown = a_recording([level(0.0, 20.0, 28.0)] * 8, dt_s=0.5), a_mission(n=3)
    cut = [FaultEvent(FaultKind.PARTITION, (3,), 1.0, 2.0)]
    metrics = measure(recording, flown, faults=cut)
    drawn = replay(
        recording, flown, tmp_path, title="", metrics=metrics, verdict=Verdict(None, None), figures={}, faults=cut
    )
    ever, *_ = drawn["links"]
    parted = {(a, b): changes for a, b, *changes in drawn["links"]}
    assert ever == [1, 2, 0]
    assert all(len(parted[pair]) == 3 for pair in ((1, 3), (2, 3)))  # they come, go, and come again


def test_a_fault_that_cuts_off_nobody_alive_is_no_split() -> None:
    recording = a_recording([level(0.0, 20.0, 28.0)] * 4, agent_alive=[1, 1, 0])
    cut = [FaultEvent(FaultKind.PARTITION, (3,), 1.0, 2.0)]
    assert measure(recording, a_mission(n=3), faults=cut).splits == 0


def test_connected_fractions_are_shares_of_the_ticks_of_their_phase() -> None:
    near, far = level(0.0, 29.0), level(0.0, 31.0)
    phase = column(SwarmPhase.GATHER, TRANSIT, TRANSIT, TRANSIT, TRANSIT, COVERAGE, COVERAGE)
    result = measure(a_recording([far, near, far, near, near, far, near], phase=phase), a_mission())
    assert result.connected_fraction_transit == 0.75
    assert result.connected_fraction_coverage == 0.5


def test_a_link_needs_both_ranges() -> None:
    recording = a_recording([level(0.0, 29.0, 58.0)], range_m=[[55.0, 30.0, 28.0]])
    assert metrics.links(recording, 0).tolist() == [[0, 1]]
    assert metrics.links(recording, -1).tolist() == [[0, 1]]
    assert measure(recording, a_mission(n=3)).connected_fraction_transit == 0.0


@pytest.mark.parametrize(
    ("alive", "ground", "connected"),
    [
        ([1, 1, 1], [0, 0, 0], 1.0),
        ([1, 0, 1], [0, 0, 0], 0.0),  # the one in the middle relays no more
        ([1, 1, 0], [0, 0, 0], 1.0),
        ([1, 1, 1], [0, 0, 1], 0.0),
    ],
)
def test_the_dead_neither_relay_nor_count_and_the_grounded_are_apart(
    alive: list[int], ground: list[int], connected: float
) -> None:
    recording = a_recording([level(0.0, 25.0, 50.0)], agent_alive=alive, on_ground=ground)
    assert measure(recording, a_mission(n=3)).connected_fraction_transit == connected


def test_lambda2_of_a_chain_and_of_a_complete_graph() -> None:
    chain, complete, split = level(0.0, 25.0, 50.0), level(0.0, 8.0, 16.0), level(0.0, 8.0, 90.0)
    mission = a_mission(n=3)
    assert measure(a_recording([chain]), mission).lambda2_mean_transit == pytest.approx(1.0)
    assert measure(a_recording([complete]), mission).lambda2_mean_transit == pytest.approx(3.0)
    assert measure(a_recording([chain, complete, split]), mission).lambda2_mean_transit == pytest.approx(4.0 / 3.0)


def test_vertex_connectivity_is_the_least_of_the_last_seconds_of_coverage() -> None:
    chain, complete = level(0.0, 25.0, 50.0), level(0.0, 8.0, 16.0)
    covering = {"phase": SwarmPhase.COVERAGE, "dt_s": 1.0}
    mission = a_mission(n=3)
    late, early = [complete] * 8 + [chain] + [complete], [chain] + [complete] * 9
    assert measure(a_recording(late, **covering), mission).vertex_connectivity_coverage == 1
    assert measure(a_recording(early, **covering), mission).vertex_connectivity_coverage == 2
    alone = [True, False, False]
    assert measure(a_recording(late, agent_alive=alone, **covering), mission).vertex_connectivity_coverage is None
    assert measure(a_recording(late), mission).vertex_connectivity_coverage is None


def test_two_leaders_in_one_component_are_counted_and_those_apart_are_not() -> None:
    rows = [level(0.0, 20.0, 40.0)] * 3 + [level(0.0, 20.0, 90.0)] * 2 + [level(0.0, 20.0, 40.0)] * 2
    both = a_recording(rows, acting=[1, 0, 1])
    assert measure(both, a_mission(n=3)).leaders_together_s == 3.0
    cut = [FaultEvent(FaultKind.PARTITION, (3,), 0.0, 2.0)]
    assert measure(both, a_mission(n=3), faults=cut).leaders_together_s == 1.0
    beside = a_recording(rows, acting=[1, 1, 0])
    assert measure(beside, a_mission(n=3), faults=[replace(cut[0], until_s=None)]).leaders_together_s == 6.0
    assert measure(a_recording(rows, acting=[1, 0, 0]), a_mission(n=3)).leaders_together_s == 0.0


@pytest.mark.parametrize(
    ("place", "exceeded_m"),
    [([50.0, 0.0, 10.0], 0.0), ([50.0, 42.0, 10.0], 2.0), ([143.0, 44.0, 10.0], 5.0), ([50.0, 0.0, 31.5], 1.5)],
)
def test_how_far_a_vehicle_left_the_fence(place: list[float], exceeded_m: float) -> None:
    fence = {"polygon_enu_m": [(-40.0, -40.0), (140.0, -40.0), (140.0, 40.0), (-40.0, 40.0)], "altitude_max_m": 30.0}
    mission = a_mission(n=1, fence=fence)
    flight = a_recording([[[0.0, 0.0, 10.0]], [place], [[0.0, 0.0, 10.0]]])
    assert measure(flight, mission).fence_exceeded_m == pytest.approx(exceeded_m)
    fallen = a_recording([[[0.0, 0.0, 10.0]], [place], [place]], touched=column(0, 1, 1))
    assert measure(fallen, mission).fence_exceeded_m == 0.0
