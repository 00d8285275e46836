"""What ARRIVED asserts, and what is said when it does not hold."""

from __future__ import annotations

from typing import Any

import pytest

from mission.document.model import Mission
from sim_bridge.judge.metrics import Metrics
from sim_bridge.judge.verdict import judge


def a_mission(at_end: str = "hold", *, radius_m: float = 15.0, duration_s: float = 60.0) -> Mission:
    route = {"d1_enu_m": (0.0, 0.0, 10.0), "d2_enu_m": (300.0, 0.0, 10.0), "vel_leader_mps": 2.0, "at_end": at_end}
    coverage = {"radius_m": radius_m, "duration_s": duration_s}
    return Mission.model_validate(
        {"schema": 1, "route": route, "swarm": {"size": 8}, "radio": {"full_range_m": 90.0}, "coverage": coverage}
    )


def figures(**changes: Any) -> Metrics:
    """Of a flight of eight in which everything holds, in the air at the end."""
    values: dict[str, Any] = {
        "n": 8,
        "lost": (),
        "armed": tuple(range(1, 9)),
        "aloft": tuple(range(1, 9)),
        "strayed": (),
        "landed_early": (),
        "sim_time_s": 120.0,
        "arrived": True,
        "absent": (),
        "straight_time_s": 40.0,
        "arrival_leader_s": 41.0,
        "arrival_last_s": 41.0,
        "overhead_leader": 0.02,
        "overhead_last": 0.02,
        "min_separation_m": 6.2,
        "contacts": 0,
        "contacts_vehicles": 0,
        "contacts_trunks": 0,
        "contacts_crowns": 0,
        "contacts_ground": 0,
        "trunk_clearance_min_m": None,
        "speed_mean_transit_mps": 2.9,
        "splits": 0,
        "longest_gap_s": 0.0,
        "rejoin_s": None,
        "connected_fraction_transit": 1.0,
        "connected_fraction_coverage": 1.0,
        "visited": 1,
        "lambda2_mean_transit": 2.0,
        "vertex_connectivity_coverage": 3,
        "coverage_gap_deg": 45.5,
        "coverage_gap_ideal_deg": 45.0,
        "coverage_radius_error_m": 0.1,
        "coverage_settled_s": 10.0,
        "acting_leaders_max": 1,
        "acting_leaders_overlap_s": 0.0,
        "leader_changes": 0,
        "leaderless_max_s": 0.0,
    }
    return Metrics(**{**values, **changes})


DOWN: dict[str, Any] = {"armed": (), "aloft": ()}


def test_a_flight_in_which_everything_holds_has_arrived() -> None:
    verdict = judge(figures(), a_mission(), "coverage complete")
    assert (verdict.succeeded, verdict.text) == (True, "ARRIVED")
    landed = judge(figures(**DOWN), a_mission("land"), "all landed")
    assert (landed.succeeded, landed.text) == (True, "ARRIVED")


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"contacts": 1}, "1 contact"),
        ({"contacts": 3}, "3 contacts"),
        ({"contacts": 4, "contacts_trunks": 2, "contacts_ground": 1}, "4 contacts (2 with trunks, 1 with the ground)"),
        ({"min_separation_m": 4.87}, "separation 4.87 m: must be at least separation.hard_m = 5"),
        ({"coverage_gap_deg": 90.0}, "coverage not formed: gap 90 deg: must be at most 1.5 x 45"),
        ({"coverage_radius_error_m": 2.1}, "coverage not formed: up to 2.1 m off the ring: must be within 2 m"),
        ({"coverage_radius_error_m": None}, "coverage not formed: no vehicle in the air at its end"),
        ({"coverage_gap_deg": None}, "no coverage"),
        ({"lost": (3,)}, "lost vehicle 3"),
    ],
)
def test_what_does_not_hold_is_named(changes: dict[str, Any], why: str) -> None:
    verdict = judge(figures(**changes), a_mission(), "coverage complete")
    assert not verdict.succeeded
    assert verdict.text.partition(": ")[2] == why


def test_a_separation_within_centimetres_of_hard_m_is_kept() -> None:
    assert judge(figures(min_separation_m=4.91), a_mission(), "coverage complete").succeeded


def test_a_ring_far_too_narrow_is_not_formed_however_even() -> None:
    stopped_at_60_m = figures(coverage_radius_error_m=40.0)
    verdict = judge(stopped_at_60_m, a_mission(radius_m=100.0, duration_s=240.0), "coverage complete")
    assert verdict.text == "FAILED: coverage not formed: up to 40.0 m off the ring: must be within 10 m"


def test_a_mission_that_asks_for_no_coverage_needs_none() -> None:
    changes = {"coverage_gap_deg": 300.0, "coverage_radius_error_m": 20.0}
    assert judge(figures(**changes), a_mission(duration_s=0.0), "coverage complete").succeeded


def test_everything_that_does_not_hold_is_said_at_once() -> None:
    verdict = judge(figures(contacts=2, min_separation_m=0.4), a_mission(), "time limit of 300 s reached")
    assert verdict.text == (
        "FAILED: time limit of 300 s reached; 2 contacts; separation 0.40 m: must be at least separation.hard_m = 5"
    )


def test_those_that_never_came_are_named() -> None:
    changes = {"arrived": False, "arrival_last_s": None, "absent": (2, 5, 7), "lost": (7,)}
    verdict = judge(figures(**changes), a_mission(), "coverage complete", silenced=(7,))
    assert verdict.text == "FAILED without 7: not all arrived: vehicles 2, 5 never came to d2 (coverage complete)"


def test_without_one_that_a_fault_killed_on_purpose_the_others_arrive() -> None:
    verdict = judge(figures(lost=(3,)), a_mission(), "coverage complete", silenced={3})
    assert (verdict.succeeded, verdict.text) == (True, "ARRIVED without 3")


def test_a_fault_that_kills_one_excuses_no_other() -> None:
    verdict = judge(figures(lost=(3, 4)), a_mission(), "coverage complete", silenced={3})
    assert (verdict.succeeded, verdict.text) == (False, "FAILED without 3, 4: lost vehicle 4")


@pytest.mark.parametrize(
    ("armed", "aloft", "words"),
    [
        ((3,), (3,), "vehicle 3 still armed in the air"),
        ((3,), (), "vehicle 3 still armed on the ground"),
        ((), (3,), "vehicle 3 in the air, disarmed"),
        ((3, 4), (3, 4), "vehicles 3, 4 still armed in the air"),
    ],
)
def test_where_the_mission_lands_one_that_does_not_is_named(
    armed: tuple[int, ...], aloft: tuple[int, ...], words: str
) -> None:
    changes = figures(armed=armed, aloft=aloft)
    assert judge(changes, a_mission("return"), "all landed but 3").text == f"FAILED: {words}"


def test_a_killed_one_that_hangs_in_the_air_is_named_and_excused() -> None:
    changes = figures(lost=(3,), armed=(3,), aloft=(3,))
    verdict = judge(changes, a_mission("land"), "all landed but 3", silenced={3})
    assert (verdict.succeeded, verdict.text) == (True, "ARRIVED without 3 (vehicle 3 still armed in the air)")


@pytest.mark.parametrize(("at_end", "where"), [("return", "d1"), ("land", "the coverage at d2")])
def test_one_that_landed_elsewhere_is_named(at_end: str, where: str) -> None:
    verdict = judge(figures(**DOWN, strayed=(6,)), a_mission(at_end), "all landed")
    assert verdict.text == f"FAILED: vehicle 6 landed away from {where}"


def test_landing_where_the_mission_holds_is_no_success() -> None:
    verdict = judge(figures(**DOWN), a_mission("hold"), "all landed")
    assert verdict.text == "FAILED: all landed, where the mission holds"


def test_a_part_that_landed_where_it_was_is_told_of_as_such_and_not_as_astray() -> None:
    changes = {**DOWN, "lost": (1, 2, 3), "strayed": (1, 4, 5), "landed_early": (4, 5), "coverage_radius_error_m": None}
    verdict = judge(figures(**changes), a_mission("return"), "all landed", silenced=(1, 2, 3))
    assert verdict.text == (
        "FAILED without 1, 2, 3: vehicles 4, 5 landed before the mission's end; "
        "coverage not formed: no vehicle in the air at its end"
    )


def test_a_part_that_landed_on_the_way_is_told_of() -> None:
    changes = {**DOWN, "arrived": False, "absent": (4, 5), "landed_early": (4, 5)}
    assert judge(figures(**changes), a_mission("land"), "all landed").text == (
        "FAILED: not all arrived: vehicles 4, 5 never came to d2 (all landed); "
        "vehicles 4, 5 landed before the mission's end"
    )
