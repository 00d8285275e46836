"""Every figure on flights short enough to know the answer by hand."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest

from companion.core.types import SwarmPhase
from mission.model import CoverageShape, Mission
from sim_bridge.judge import metrics
from sim_bridge.judge.metrics import Metrics, coverage, measure, pairs
from sim_bridge.judge.recording import Recorder, Recording

TRANSIT, COVERAGE = SwarmPhase.TRANSIT, SwarmPhase.COVERAGE
D2 = (100.0, 0.0, 10.0)


def a_mission(*, n: int = 2, way: dict[str, Any] | None = None, **tables: dict[str, Any]) -> Mission:
    """d1 at the origin's east-north, 10 m up; d2 100 m east; 2 m/s; arrival within 5 m; transit range 30 m."""
    route = {"d1_enu_m": (0.0, 0.0, 10.0), "d2_enu_m": D2, "vel_leader_mps": 2.0, "arrival_distance_m": 5.0}
    route |= way or {}
    return Mission.model_validate(
        {"schema": 1, "route": route, "swarm": {"size": n}, "radio": {"transit_range_m": 30.0}, **tables}
    )


def a_recording(enu_m: Any, *, dt_s: float = 1.0, **columns: Any) -> Recording:
    """All alive, in the air and in TRANSIT, vehicle 1 leads; `enu_m` (T, n, 3), `columns` broadcast to (T, n)."""
    enu = np.asarray(enu_m, dtype=np.float64)
    ticks, n = enu.shape[:2]
    values: dict[str, Any] = {
        "on_ground": False,
        "armed": True,
        "agent_alive": True,
        "touched": 0,
        "range_m": 30.0,
        "phase": TRANSIT,
        "acting": np.arange(n) == 0,
        "leader": 1,
        **columns,
    }
    types = {"range_m": np.float64, "phase": np.int8, "leader": np.int16, "touched": np.int8}
    full = {k: np.array(np.broadcast_to(v, (ticks, n)), dtype=types.get(k, np.bool_)) for k, v in values.items()}
    return Recording(
        time_s=np.arange(ticks, dtype=np.float64) * dt_s,
        pos_ned_m=enu[:, :, [1, 0, 2]] * np.array([1.0, 1.0, -1.0]),
        vel_ned_mps=np.zeros((ticks, n, 3)),
        **full,
    )


def column(*values: Any) -> np.ndarray[Any, Any]:
    """(T, 1): one value a tick, the same for every vehicle."""
    return np.array(values)[:, None]


def level(*east_m: float, up_m: float = 10.0) -> list[list[float]]:
    """One tick of vehicles in a row from west to east."""
    return [[e, 0.0, up_m] for e in east_m]


# --- nothing, and alone -----------------------------------------------------------------------------------------------


def test_a_flight_without_a_tick_measures_nothing() -> None:
    result = measure(Recorder().recording(), a_mission(n=3))
    assert result.n == 3
    assert result.lost == ()
    assert not result.arrived
    happened = {k for k, v in result.as_dict().items() if v is not None}
    assert happened == {
        *("n", "lost", "armed", "aloft", "strayed", "landed_early", "absent", "sim_time_s", "arrived", "contacts"),
        "visited",
        *("contacts_vehicles", "contacts_trunks", "contacts_crowns", "contacts_ground", "splits", "longest_gap_s"),
        *("acting_leaders_max", "acting_leaders_overlap_s", "leader_changes", "leaderless_max_s"),
    }


def test_a_vehicle_alone_is_connected_and_has_nobody_to_keep_away_from() -> None:
    result = measure(a_recording([level(0.0), level(50.0), level(96.0)]), a_mission(n=1))
    assert result.arrived
    assert result.connected_fraction_transit == 1.0
    assert result.min_separation_m is None
    assert result.lambda2_mean_transit is None


def test_as_dict_is_json_in_declared_order() -> None:
    result = measure(a_recording([level(0.0, 8.0)] * 3), a_mission())
    values = json.loads(json.dumps(result.as_dict()))
    assert list(values) == [field.name for field in dataclasses.fields(Metrics)]
    assert values["lost"] == []


def test_every_figure_has_a_definition() -> None:
    texts = metrics.definitions()
    assert list(texts) == [field.name for field in dataclasses.fields(Metrics)]
    assert all(text.endswith(".") for text in texts.values())


def test_the_constants_in_the_definitions_are_those_in_use() -> None:
    texts = metrics.definitions()
    assert f"{metrics.CONTACT_M} m" in texts["contacts_vehicles"]
    assert f"{metrics.GAP_WINDOW_S:g} s" in texts["coverage_gap_deg"]
    for shape, ratio in metrics.SETTLED_RATIO.items():
        assert f"{ratio} ({shape.value})" in texts["coverage_settled_s"].replace("\n", " ")
    assert f"within {coverage.TOLERANCE_M:g} m or a tenth" in " ".join((metrics.__doc__ or "").split())
    assert coverage.TOLERANCE_SHARE == 0.1


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_position_that_is_no_number_is_refused_by_name(value: float) -> None:
    with pytest.raises(ValueError, match=r"pos_ned_m: vehicle 2 at 1\.00 s"):
        measure(a_recording([level(0.0, 8.0), level(1.0, value)]), a_mission())


def test_time_that_runs_backwards_is_refused() -> None:
    recording = dataclasses.replace(a_recording([level(0.0, 8.0)] * 2), time_s=np.array([1.0, 0.5]))
    with pytest.raises(ValueError, match="time_s"):
        measure(recording, a_mission())


# --- departure and arrival --------------------------------------------------------------------------------------------


def test_times_count_from_departure_and_the_straight_time_from_where_the_leader_was() -> None:
    ticks = [level(0.0, -8.0), level(10.0, 2.0), level(50.0, 42.0), level(95.0, 69.0), level(95.0, 71.0)]
    phase = column(SwarmPhase.GATHER, TRANSIT, TRANSIT, TRANSIT, COVERAGE)
    result = measure(a_recording(ticks, dt_s=20.0, phase=phase), a_mission())
    assert result.straight_time_s == pytest.approx((90.0 - 5.0) / 2.0)  # until it is within 5 m of d2
    assert result.arrival_leader_s == 40.0  # the last is 31 m from d2 then
    assert result.arrival_last_s == 60.0
    assert result.overhead_leader == pytest.approx(40.0 / 42.5 - 1.0)
    assert result.overhead_last == pytest.approx(60.0 / 42.5 - 1.0)
    assert result.arrived


def test_a_follower_out_of_touch_near_d2_has_not_arrived() -> None:
    ticks = [level(0.0, 8.0), level(95.0, 126.0)]  # both near d2, 31 m apart
    result = measure(a_recording(ticks), a_mission())
    assert result.arrival_leader_s == 1.0
    assert result.arrival_last_s is None
    assert not result.arrived


def test_a_swarm_wider_than_the_range_gathers_as_wide_as_it_left_and_no_wider() -> None:
    left = level(0.0, -20.0, -40.0)  # 40 m, and 2 x 5 m
    held = measure(a_recording([left, level(96.0, 76.0, 50.1)]), a_mission(n=3))
    assert held.arrival_last_s == held.arrival_leader_s == 1.0
    drawn_out = measure(a_recording([left, level(96.0, 72.0, 49.9), level(96.0, 76.0, 50.1)]), a_mission(n=3))
    assert (drawn_out.arrival_leader_s, drawn_out.arrival_last_s) == (1.0, 2.0)


def test_those_lost_on_the_way_are_not_waited_for() -> None:
    ticks = [level(0.0, 8.0), level(50.0, 8.0), level(97.0, 8.0)]
    result = measure(a_recording(ticks, agent_alive=[[True, True], [True, False], [True, False]]), a_mission())
    assert result.arrived
    assert result.lost == (2,)


def test_those_that_never_came_are_named_and_those_that_left_again_are_not() -> None:
    ticks = [level(0.0, 8.0, 16.0, 24.0), level(96.0, 88.0, 50.0, 70.0), level(96.0, 20.0, 50.0, 80.0)]
    alive = [[1, 1, 1, 1], [1, 1, 1, 0], [1, 1, 1, 0]]
    result = measure(a_recording(ticks, agent_alive=alive), a_mission(n=4))
    assert not result.arrived
    assert result.absent == (3, 4)  # 4 came near without its companion


def test_nobody_is_missed_where_no_leader_arrived() -> None:
    assert measure(a_recording([level(0.0, 8.0), level(50.0, 8.0)]), a_mission()).absent == ()


def test_one_that_answers_from_the_ground_has_not_arrived() -> None:
    ticks = [level(0.0, 8.0), level(97.0, 90.0)]
    result = measure(a_recording(ticks, on_ground=[[False, False], [False, True]]), a_mission())
    assert not result.arrived


def test_a_gathering_before_the_leader_is_there_is_no_arrival() -> None:
    ticks = [level(0.0, 8.0), level(80.0, 88.0), level(96.0, 60.0), level(96.0, 88.0)]
    assert measure(a_recording(ticks), a_mission()).arrival_last_s == 3.0


def test_the_leader_that_arrives_need_not_be_the_one_that_departed() -> None:
    ticks = [level(0.0, 8.0), level(50.0, 58.0), level(50.0, 98.0)]
    result = measure(
        a_recording(ticks, acting=[[1, 0], [0, 1], [0, 1]], agent_alive=[[1, 1], [0, 1], [0, 1]]), a_mission()
    )
    assert result.straight_time_s == 47.5
    assert result.arrival_leader_s == 2.0
    assert result.arrived
    assert result.leader_changes == 1


def test_the_last_beacon_of_the_dead_leads_nobody() -> None:
    ticks = [level(0.0, 8.0), level(97.0, 89.0)]
    result = measure(a_recording(ticks, agent_alive=[[1, 1], [0, 1]]), a_mission())
    assert result.arrival_leader_s is None
    assert result.acting_leaders_max == 1
    assert metrics.acting_leader(a_recording(ticks, agent_alive=[[1, 1], [0, 1]])).tolist() == [1, 0]


def test_landing_without_a_transit_is_no_departure() -> None:
    phase = column(SwarmPhase.GATHER, SwarmPhase.LAND, SwarmPhase.LAND)
    result = measure(a_recording([level(0.0, 8.0)] * 3, phase=phase), a_mission())
    assert result.straight_time_s is None
    assert result.overhead_leader is None


# --- where they end ---------------------------------------------------------------------------------------------------


def test_those_armed_and_those_aloft_at_the_end_are_named() -> None:
    recording = a_recording([level(0.0, 8.0, 16.0)] * 2, armed=[[1, 1, 1], [1, 0, 0]], on_ground=[[0, 0, 0], [1, 1, 0]])
    result = measure(recording, a_mission(n=3))
    assert (result.armed, result.aloft) == ((1,), (3,))


@pytest.mark.parametrize(
    ("at_end", "strayed"),
    [
        ("hold", ()),
        ("return", (2, 3)),  # 40 m about d1
        ("land", (1, 2)),  # 42 m about d2: on the ring, give or take
    ],
)
def test_those_on_the_ground_elsewhere_than_the_mission_lands_are_named(at_end: str, strayed: tuple[int, ...]) -> None:
    route = {"d1_enu_m": (0.0, 0.0, 10.0), "d2_enu_m": D2, "vel_leader_mps": 2.0, "at_end": at_end}
    mission = a_mission(n=4, route=route, coverage={"radius_m": 38.0}, radio={"full_range_m": 80.0})
    ticks = [level(0.0, 8.0, 10.0, 12.0), level(20.0, 45.0, 60.0, 50.0, up_m=0.0)]
    recording = a_recording(ticks, on_ground=[[0, 0, 0, 0], [1, 1, 1, 0]])
    assert measure(recording, mission).strayed == strayed


def test_those_that_landed_before_the_landing_are_named() -> None:
    # 1 hovers, 2 lands with the mission, 3 in coverage, 4 too but is dead, 5 has never flown
    ground = [[0, 0, 0, 0, 1], [0, 0, 0, 0, 1], [0, 1, 1, 1, 1]]
    phase = [[COVERAGE] * 5, [COVERAGE] * 5, [COVERAGE, SwarmPhase.LAND, COVERAGE, COVERAGE, COVERAGE]]
    alive = [[1, 1, 1, 1, 1], [1, 1, 1, 1, 1], [1, 1, 1, 0, 1]]
    ticks = [level(0.0, 8.0, 16.0, 24.0, 32.0)] * 3
    recording = a_recording(ticks, on_ground=ground, phase=phase, agent_alive=alive)
    assert measure(recording, a_mission(n=5)).landed_early == (3,)


# --- separation and contacts ------------------------------------------------------------------------------------------


def test_separation_counts_from_half_the_deployment_height_until_either_touches_the_ground() -> None:
    heights = [0.0, 4.0, 10.0, 4.0, 0.0, 1.0]  # half of d1's is 5 m
    east = [1.0, 2.0, 7.0, 6.0, 3.0, 2.0]
    ticks = [[[0.0, 0.0, up], [e, 0.0, up]] for up, e in zip(heights, east, strict=True)]
    ground = column(True, False, False, False, True, False)
    recording = a_recording(ticks, on_ground=ground)
    assert metrics.separation_m(recording, a_mission()).tolist() == [math.inf, math.inf, 7.0, 6.0, math.inf, math.inf]
    assert measure(recording, a_mission()).min_separation_m == 6.0


def test_separation_counts_a_dead_companions_vehicle() -> None:
    recording = a_recording([level(0.0, 8.0), level(5.0, 8.0)], agent_alive=[[1, 1], [1, 0]])
    assert measure(recording, a_mission()).min_separation_m == 3.0


def test_a_touch_is_one_contact_however_long_and_the_next_is_another() -> None:
    ticks = [level(0.0, e) for e in (5.0, 0.59, 0.2, 0.61, 0.5)]
    assert measure(a_recording(ticks), a_mission()).contacts == 2


@pytest.mark.parametrize(("ground", "contacts"), [([True, True], 0), ([True, False], 1), ([False, False], 1)])
def test_vehicles_parked_close_together_do_not_touch(ground: list[bool], contacts: int) -> None:
    assert measure(a_recording([level(0.0, 0.5, up_m=0.1)], on_ground=[ground]), a_mission()).contacts == contacts


def test_contacts_are_counted_per_pair() -> None:
    assert measure(a_recording([level(0.0, 0.5, 1.0)]), a_mission(n=3)).contacts == 2


@pytest.mark.parametrize("at_once", [1, 2, 7])
def test_a_contact_across_a_chunk_of_ticks_counts_once(monkeypatch: pytest.MonkeyPatch, at_once: int) -> None:
    monkeypatch.setattr(pairs, "PAIRS_AT_ONCE", at_once)
    recording = a_recording([level(0.0, 0.5)] * 6 + [level(0.0, 5.0)] * 2)
    assert measure(recording, a_mission()).contacts == 1
    assert measure(recording, a_mission()).min_separation_m == 0.5


def test_what_vehicles_have_run_into_counts_once_each_and_by_kind() -> None:
    touched = [[0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 2, 3], [1, 1, 2, 3]]
    result = measure(a_recording([level(0.0, 20.0, 40.0, 60.0)] * 4, touched=touched), a_mission(n=4))
    assert (result.contacts_trunks, result.contacts_crowns, result.contacts_ground) == (2, 1, 1)
    assert (result.contacts_vehicles, result.contacts) == (0, 4)


TREE = {"base_enu_m": (50.0, 0.0), "trunk_radius_m": 0.3, "height_m": 20.0}


@pytest.mark.parametrize(
    ("east_m", "up_m", "changes", "expected_m"),
    [
        ((40.0, 46.0, 60.0), 10.0, {}, 3.7),
        ((40.0, 46.0, 60.0), 20.1, {}, None),  # over its top
        ((40.0, 46.0, 60.0), 10.0, {"on_ground": column(False, True, False)}, 9.7),
        ((40.0, 49.5, 49.5), 10.0, {"touched": column(0, 1, 1)}, 9.7),  # what has touched is told as a contact
        ((20.0, 10.0, 0.0), 10.0, {}, None),
    ],
)
def test_least_clearance_to_a_trunk(
    east_m: tuple[float, ...], up_m: float, changes: dict[str, Any], expected_m: float | None
) -> None:
    recording = a_recording([level(e, up_m=up_m) for e in east_m], **changes)
    found_m = measure(recording, a_mission(n=1, forest={"trees": (TREE,)})).trunk_clearance_min_m
    assert found_m is None if expected_m is None else found_m == pytest.approx(expected_m)


@pytest.mark.parametrize(("model", "connected"), [("disc", [1, 1, 1]), ("attenuated", [1, 0, 1]), ("cut", [0, 0, 1])])
def test_trunks_between_vehicles_part_them_as_the_radio_has_it(model: str, connected: list[int]) -> None:
    mission = a_mission(forest={"trees": (TREE,)}, sim={"radio_trunks": model})
    recording = a_recording([level(45.0, 55.0), level(40.0, 60.0), level(51.0, 70.0)])  # of 30 m a trunk leaves 15.04
    result = measure(recording, mission)
    assert result.connected_fraction_transit == pytest.approx(sum(connected) / 3)


def test_splits_are_counted_and_timed_until_the_swarm_is_one_again() -> None:
    gaps = [0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0]
    recording = a_recording([level(0.0, 20.0 + 20.0 * gap) for gap in gaps], dt_s=0.5)
    result = measure(recording, a_mission())
    assert (result.splits, result.longest_gap_s, result.rejoin_s) == (2, 1.5, 1.5)


def test_a_swarm_that_stays_apart_never_rejoined() -> None:
    recording = a_recording([level(0.0, 20.0), level(0.0, 40.0), level(0.0, 41.0), level(0.0, 42.0)])
    result = measure(recording, a_mission())
    assert (result.splits, result.longest_gap_s, result.rejoin_s) == (1, 2.0, None)


def test_a_split_that_outlasts_the_transit_is_timed_to_its_end() -> None:
    ticks = [level(0.0, 20.0), level(0.0, 40.0), level(0.0, 40.0), level(0.0, 20.0)]
    recording = a_recording(ticks, phase=column(TRANSIT, TRANSIT, SwarmPhase.LAND, SwarmPhase.LAND))
    assert measure(recording, a_mission()).rejoin_s == 2.0


def test_speed_flown_is_that_of_those_who_fly_in_transit() -> None:
    recording = a_recording([level(0.0, 20.0)] * 2, on_ground=[[0, 0], [0, 1]])
    recording.vel_ned_mps[:] = [[[3.0, 4.0, 9.0], [1.0, 0.0, 0.0]], [[0.0, 3.0, 0.0], [7.0, 0.0, 0.0]]]
    assert measure(recording, a_mission()).speed_mean_transit_mps == pytest.approx((5.0 + 1.0 + 3.0) / 3)


# --- the graph --------------------------------------------------------------------------------------------------------


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


# --- several trees ---


def test_two_trees_are_measured_at_the_second_and_the_straight_time_goes_over_both() -> None:
    """One vehicle, 2 m/s: 20 s to the stop, 10 s there, back past d1, and 20 s beyond it to d2."""
    stop = {"pos_enu_m": (40.0, 0.0, 10.0), "duration_s": 10.0}
    mission = a_mission(n=1, way={"stops": [stop], "d2_enu_m": (-40.0, 0.0, 10.0)})
    covering = SwarmPhase.COVERAGE
    east_m = [0.0, 40.0, 40.0, 0.0, -40.0, -25.0, -25.0]
    phases = column(TRANSIT, TRANSIT, covering, TRANSIT, TRANSIT, covering, covering)
    flight = a_recording([level(east) for east in east_m], phase=phases)
    result = measure(flight, mission)
    straight_s = (40.0 + 80.0 - mission.route.arrival_distance_m) / mission.route.vel_leader_mps + 10.0
    assert result.straight_time_s == pytest.approx(straight_s)
    assert result.arrival_leader_s == 4.0
    assert result.coverage_settled_s == 0.0
    assert result.visited == 1  # the second leader announced coverage when it had left d2
    at_both = a_recording([level(east) for east in [0.0, 40.0, 40.0, 0.0, -40.0, -40.0, -25.0]], phase=phases)
    assert measure(at_both, mission).visited == 2


# --- who leads --------------------------------------------------------------------------------------------------------


def test_leaders_changes_overlaps_and_gaps() -> None:
    acting = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0], [0, 0], [0, 1], [1, 0]]
    result = measure(a_recording([level(0.0, 8.0)] * 8, acting=acting, dt_s=0.5), a_mission())
    assert result.acting_leaders_max == 2
    assert result.acting_leaders_overlap_s == 0.5
    assert result.leader_changes == 2  # 1 -> 2 -> 1: a gap alone changes nothing
    assert result.leaderless_max_s == 1.0


def test_leaderless_time_counts_only_between_departure_and_the_end_of_coverage() -> None:
    phase = column(SwarmPhase.GATHER, SwarmPhase.GATHER, TRANSIT, COVERAGE, SwarmPhase.LAND, SwarmPhase.LAND)
    result = measure(a_recording([level(0.0, 8.0)] * 6, phase=phase, acting=False), a_mission())
    assert result.leaderless_max_s == 2.0


def test_a_flight_that_ends_without_a_leader_counts_to_its_last_tick() -> None:
    acting = [[1, 0], [0, 0], [0, 0], [0, 0]]
    assert measure(a_recording([level(0.0, 8.0)] * 4, acting=acting), a_mission()).leaderless_max_s == 2.0


def test_the_phase_is_the_leaders_or_else_the_highest_that_anybody_alive_announces() -> None:
    phase = [[2, 3], [2, 3], [2, 3], [-1, -1]]
    acting = [[1, 0], [0, 0], [0, 0], [0, 0]]
    alive = [[1, 1], [1, 1], [1, 0], [1, 1]]
    recording = a_recording([level(0.0, 8.0)] * 4, phase=phase, acting=acting, agent_alive=alive)
    assert metrics.swarm_phase(recording).tolist() == [2, 3, 2, -1]


# --- coverage ---------------------------------------------------------------------------------------------------------


def ring(*azimuth_deg: float, radius_m: float = 15.0) -> list[list[float]]:
    """One tick of vehicles on a ring about d2."""
    rad = np.radians(azimuth_deg)
    return [[D2[0] + radius_m * math.sin(a), D2[1] + radius_m * math.cos(a), D2[2]] for a in rad]


def test_ring_gap_is_the_mean_of_the_last_five_seconds_of_coverage() -> None:
    even, uneven = ring(10.0, 130.0, 250.0), ring(0.0, 90.0, 180.0)
    ticks = [uneven] * 3 + [even] * 4 + [uneven, even, uneven]
    phase = column(TRANSIT, *[COVERAGE] * 8, SwarmPhase.LAND)
    result = measure(a_recording(ticks, phase=phase), a_mission(n=3))
    assert result.coverage_gap_ideal_deg == 120.0
    assert result.coverage_gap_deg == pytest.approx((5 * 120.0 + 180.0) / 6)
    assert result.coverage_settled_s == 7.0  # the lapse at 7 s starts it anew


def test_a_ring_never_settled() -> None:
    result = measure(a_recording([ring(0.0, 120.0, 240.0), ring(0.0, 90.0, 180.0)], phase=COVERAGE), a_mission(n=3))
    assert result.coverage_settled_s is None


def test_a_gap_is_between_those_on_the_ring() -> None:
    wide, narrow = ring(0.0, 120.0, 240.0), [*ring(0.0, 120.0), *ring(240.0, radius_m=12.9)]
    result = measure(a_recording([narrow] * 2 + [wide] * 2, phase=COVERAGE), a_mission(n=3))
    assert result.coverage_gap_deg == pytest.approx((2 * 240.0 + 2 * 120.0) / 4)
    assert result.coverage_settled_s == 2.0
    assert result.coverage_radius_error_m == pytest.approx(2.1)


def test_a_ring_that_stays_too_narrow_never_settles_however_even() -> None:
    mission = a_mission(n=3, coverage={"radius_m": 100.0}, radio={"full_range_m": 400.0})
    result = measure(a_recording([ring(0.0, 120.0, 240.0, radius_m=60.0)] * 9, phase=COVERAGE), mission)
    assert result.coverage_settled_s is None
    assert result.coverage_gap_deg == 360.0
    assert result.coverage_radius_error_m == pytest.approx(40.0)
    near = measure(a_recording([ring(0.0, 120.0, 240.0, radius_m=90.5)] * 9, phase=COVERAGE), mission)
    assert near.coverage_settled_s == 0.0  # within a tenth


def test_one_alone_settles_when_it_is_on_the_ring() -> None:
    result = measure(a_recording([ring(90.0, radius_m=9.0), ring(90.0), ring(90.0)], phase=COVERAGE), a_mission(n=1))
    assert result.coverage_settled_s == 1.0


def test_a_silent_vehicle_that_hangs_on_the_ring_covers_nothing() -> None:
    recording = a_recording([ring(0.0, 90.0, 180.0, 270.0)] * 2, phase=COVERAGE, agent_alive=[1, 1, 1, 0])
    result = measure(recording, a_mission(n=4))
    assert result.coverage_gap_deg == pytest.approx(180.0)
    assert result.coverage_gap_ideal_deg == 120.0
    assert result.coverage_settled_s is None


def test_height_counts_on_a_sphere_and_not_on_a_ring() -> None:
    high = [[D2[0] + 7.0, D2[1], D2[2] + 3.0]]
    for shape, error_m in (("ring", 0.0), ("sphere", math.hypot(7.0, 3.0) - 7.0)):
        mission = a_mission(n=1, coverage={"shape": shape, "radius_m": 7.0})
        result = measure(a_recording([high], phase=COVERAGE), mission)
        assert result.coverage_radius_error_m == pytest.approx(error_m)


def test_coverage_is_by_those_alive() -> None:
    recording = a_recording(
        [ring(0.0, 180.0, 90.0)] * 2, phase=COVERAGE, agent_alive=[[1, 1, 1], [1, 1, 0]], acting=[1, 0, 0]
    )
    result = measure(recording, a_mission(n=3))
    assert result.coverage_gap_deg == pytest.approx(180.0)
    assert result.coverage_gap_ideal_deg == 180.0
    assert result.coverage_settled_s == 1.0


def test_a_vehicle_on_the_ground_covers_nothing_but_is_still_expected_to() -> None:
    recording = a_recording([ring(0.0, 120.0, 240.0)], phase=COVERAGE, on_ground=[0, 0, 1])
    result = measure(recording, a_mission(n=3))
    assert result.coverage_gap_deg == pytest.approx(240.0)
    assert result.coverage_gap_ideal_deg == 120.0


def test_an_octahedron_leaves_the_middles_of_its_faces() -> None:
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]) * 7.0 + np.array(D2)
    mission = a_mission(n=6, coverage={"shape": "sphere", "radius_m": 7.0})
    result = measure(a_recording([corners], phase=COVERAGE), mission)
    assert result.coverage_gap_deg == pytest.approx(54.7356, abs=1e-4)
    assert result.coverage_settled_s == 0.0


@pytest.mark.parametrize(
    ("points", "gap_deg"),
    [
        ([], 180.0),
        ([[0.0, 0.0, 0.0]], 180.0),  # at d2 it covers no direction
        ([[3.0, 0.0, 0.0]], 180.0),
        ([[1.0, 0.0, 0.0], [5.0, 0.0, 0.0]], 180.0),  # behind one another
        ([[1.0, 0.0, 0.0], [-2.0, 0.0, 0.0]], 90.0),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 135.0),
        ([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 90.0),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], 180.0 - math.degrees(math.acos(3**-0.5))),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], 90.0),  # flat, through d2
        ([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [-1.0, 0.0, 1.0], [0.0, -1.0, 1.0]], 135.0),  # flat, beside it
        ([[math.cos(a), math.sin(a), 0.0] for a in (0.0, 0.3, 0.7, 1.0)], 180.0 - math.degrees(0.5)),  # an arc
    ],
)
def test_sphere_gap_where_the_points_are_few_flat_or_on_one_side(points: list[list[float]], gap_deg: float) -> None:
    assert metrics.sphere_gap_deg(np.array(points).reshape(-1, 3)) == pytest.approx(gap_deg, abs=1e-6)


@pytest.mark.parametrize("n", range(3, 21))
def test_no_covering_in_the_table_beats_the_bound(n: int) -> None:
    best = metrics.ideal_gap_deg(CoverageShape.SPHERE, n)
    assert metrics.sphere_covering_bound_deg(n) <= best + 5e-5
    if n in (3, 4, 6, 12):  # the bound is met by the regular solids of triangles
        assert metrics.sphere_covering_bound_deg(n) == pytest.approx(best, abs=5e-5)


def test_ideal_gaps_fall_with_the_number_of_vehicles() -> None:
    sphere = [metrics.ideal_gap_deg(CoverageShape.SPHERE, n) for n in range(2, 60)]
    assert sphere == sorted(sphere, reverse=True)
    assert [metrics.ideal_gap_deg(CoverageShape.RING, n) for n in (1, 8)] == [360.0, 45.0]
