"""Figures of a flight: departure and arrival, which vehicles are missing, which lead. Short enough to know by hand."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from companion.core.model.states import SwarmPhase
from mission.common import forming
from sim_bridge.judge import metrics
from sim_bridge.judge.metrics import Metrics, measure
from sim_bridge.judge.recording import Recorder
from tests.unit.judge.metrics_kit import COVERAGE, D2, TRANSIT, a_mission, a_recording, column, level

# Nothing, and alone


def test_a_flight_without_a_tick_measures_nothing() -> None:
    result = measure(Recorder().recording(), a_mission(n=3))
    assert result.n == 3
    assert result.lost == ()
    assert not result.arrived
    happened = {k for k, v in result.as_dict().items() if v is not None}
    assert happened == {
        *("n", "lost", "armed", "aloft", "strayed", "landed_early", "absent", "sim_time_s", "arrived", "contacts"),
        "visited",
        *("contacts_vehicles", "contacts_trunks", "contacts_crowns", "contacts_boxes", "contacts_ground"),
        "contacts_steered",
        *("splits", "longest_gap_s"),
        *("acting_leaders_max", "acting_leaders_overlap_s", "leaders_together_s", "leader_changes", "leaderless_max_s"),
        *("fence_exceeded_m", "closest", "uncovering"),
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
    assert [figure.name for figure in metrics.FIGURES] == [field.name for field in dataclasses.fields(Metrics)]
    assert all(figure.text.endswith(".") for figure in metrics.FIGURES)


def test_the_constants_in_the_definitions_are_those_in_use() -> None:
    texts = {figure.name: figure.text for figure in metrics.FIGURES}
    assert f"{metrics.CONTACT_M} m" in texts["contacts_vehicles"]
    assert f"{forming.GAP_WINDOW_S:g} s" in texts["coverage_gap_deg"]
    for shape, ratio in metrics.SETTLED_RATIO.items():
        assert f"{ratio} ({shape.value})" in texts["coverage_settled_s"].replace("\n", " ")
    assert f"within {forming.TOLERANCE_M:g} m or a tenth" in " ".join((metrics.__doc__ or "").split())
    assert forming.TOLERANCE_SHARE == 0.1


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_position_that_is_no_number_is_refused_by_name(value: float) -> None:
    with pytest.raises(ValueError, match=r"pos_ned_m: vehicle 2 at 1\.00 s"):
        measure(a_recording([level(0.0, 8.0), level(1.0, value)]), a_mission())


def test_time_that_runs_backwards_is_refused() -> None:
    recording = dataclasses.replace(a_recording([level(0.0, 8.0)] * 2), time_s=np.array([1.0, 0.5]))
    with pytest.raises(ValueError, match="time_s"):
        measure(recording, a_mission())


# Departure and arrival


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


def test_a_leader_that_goes_by_its_estimate_may_truly_be_half_a_metre_further_away() -> None:
    for estimates, off_m, arrived in (("recorded", 0.4, True), ("recorded", 0.6, False), ("exact", 0.1, False)):
        there_m = 100.0 - 5.0 - off_m
        ticks = [level(0.0, 8.0), level(there_m, there_m - 8.0)]
        result = measure(a_recording(ticks), a_mission(sim={"estimates": estimates}))
        assert result.arrived is arrived, (estimates, off_m)


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


def test_speed_flown_is_that_of_those_that_fly_in_transit() -> None:
    recording = a_recording([level(0.0, 20.0)] * 2, on_ground=[[0, 0], [0, 1]])
    recording.vel_ned_mps[:] = [[[3.0, 4.0, 9.0], [1.0, 0.0, 0.0]], [[0.0, 3.0, 0.0], [7.0, 0.0, 0.0]]]
    assert measure(recording, a_mission()).speed_mean_transit_mps == pytest.approx((5.0 + 1.0 + 3.0) / 3)


# Where they end


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


def test_one_that_gave_up_has_landed_early_whatever_it_hears_on_the_ground() -> None:
    """1 lands with the mission; 2 gave up before, and takes the phase of 1; 3 came down and flew on, to land with 1."""
    land = SwarmPhase.LAND
    ground = [[0, 0, 0], [0, 1, 1], [0, 1, 0], [1, 1, 1]]
    phase = [[COVERAGE] * 3, [COVERAGE] * 3, [COVERAGE] * 3, [land] * 3]
    recording = a_recording([level(0.0, 8.0, 16.0)] * 4, on_ground=ground, phase=phase)
    assert measure(recording, a_mission(n=3)).landed_early == (2,)
    phase[1][1] = land  # announced while it came down: with the mission
    recording = a_recording([level(0.0, 8.0, 16.0)] * 4, on_ground=ground, phase=phase)
    assert measure(recording, a_mission(n=3)).landed_early == ()


def test_what_comes_after_the_end_is_neither_coverage_nor_early_but_dangers_count() -> None:
    """2 comes down while records are on their way to the base station, and then the others come near."""
    rows = [level(85.0, 115.0, 100.0)] * 3 + [level(85.0, 90.0, 100.0)]
    mission = a_mission(n=3, coverage={"radius_m": 15.0})
    recording = a_recording(rows, phase=COVERAGE, on_ground=[[0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 1, 1]])
    whole, ended = measure(recording, mission), measure(recording, mission, end_s=2.0)
    assert (whole.landed_early, ended.landed_early) == ((2,), ())
    assert (whole.uncovering, ended.uncovering) == ((2, 3), (3,))
    rows[3] = level(85.0, 88.0, 100.0)
    assert measure(a_recording(rows, phase=COVERAGE), mission, end_s=2.0).min_separation_m == 3.0


# Several trees


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


# Which leads


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
