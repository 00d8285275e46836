"""Figures of a flight: how close vehicles came to one another and to trunks, and what they touched."""

from __future__ import annotations

import math
from typing import Any

import pytest

from sim_bridge.judge import metrics
from sim_bridge.judge.metrics import measure, pairs
from tests.unit.judge.metrics_kit import TREE, a_mission, a_recording, column, level


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
    found = measure(recording, a_mission())
    assert found.min_separation_m == 3.0
    assert (found.closest, found.closest_at_s) == ((1, 2), float(recording.time_s[1]))


def test_in_layers_of_height_the_level_distance_counts_within_a_layer_only() -> None:
    ticks = [
        [[0.0, 0.0, 10.0], [3.0, 0.0, 8.4]],  # above one another
        [[0.0, 0.0, 10.0], [6.0, 0.0, 8.6]],
        [[0.0, 0.0, 10.0], [7.0, 0.0, 10.0]],
    ]
    layered = a_mission(separation={"height_layers": True}, fence={"altitude_min_m": 3.0, "altitude_max_m": 15.0})
    found = measure(a_recording(ticks), layered)
    assert (found.min_separation_m, found.closest_at_s) == (6.0, 1.0)
    assert measure(a_recording(ticks), a_mission()).min_separation_m == pytest.approx(3.4)
    touching = [[[0.0, 0.0, 10.0], [0.5, 0.0, 10.4]]]
    assert measure(a_recording(touching), layered).contacts == 1


def test_a_touch_is_one_contact_however_long_and_the_next_is_another() -> None:
    ticks = [level(0.0, e) for e in (5.0, 0.69, 0.2, 0.71, 0.5)]
    assert measure(a_recording(ticks), a_mission()).contacts == 2


def test_vehicles_touch_by_the_missions_own_hulls() -> None:
    recording = a_recording([level(0.0, 5.0), level(0.0, 1.9)])
    assert measure(recording, a_mission(sensing={"vehicle_radius_m": 1.0})).contacts_vehicles == 1
    assert measure(recording, a_mission(sensing={"vehicle_radius_m": 0.9})).contacts_vehicles == 0


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


def test_who_runs_into_something_with_a_dead_companion_was_not_steered() -> None:
    touched = [[0, 0, 0], [0, 0, 0], [1, 1, 0], [1, 1, 4]]
    alive = [[1, 1, 1], [1, 0, 1], [0, 0, 1], [0, 0, 0]]
    result = measure(a_recording([level(0.0, 20.0, 40.0)] * 4, touched=touched, agent_alive=alive), a_mission(n=3))
    assert (result.contacts_trunks, result.contacts_steered) == (2, 2)


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
