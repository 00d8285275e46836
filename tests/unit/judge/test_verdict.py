"""What ARRIVED asserts, and what is said when it does not hold."""

from __future__ import annotations

from typing import Any

import pytest

from mission.document.model import Mission
from mission.schema.faults import FaultKind
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics import Metrics
from sim_bridge.judge.page.limits import limits
from sim_bridge.judge.verdict import Grade, judge


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
        "closest": (1, 2),
        "closest_at_s": 30.0,
        "contacts": 0,
        "contacts_vehicles": 0,
        "contacts_trunks": 0,
        "contacts_crowns": 0,
        "contacts_boxes": 0,
        "contacts_ground": 0,
        "contacts_steered": 0,
        "fence_exceeded_m": 0.0,
        "trunk_clearance_min_m": None,
        "box_clearance_min_m": None,
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
        "uncovering": (),
        "acting_leaders_max": 1,
        "acting_leaders_overlap_s": 0.0,
        "leaders_together_s": 0.0,
        "leader_changes": 0,
        "leaderless_max_s": 0.0,
    }
    return Metrics(**{**values, **changes})


def killed(*vehicles: int, at_s: float = 20.0) -> FaultEvent:
    return FaultEvent(FaultKind.KILL, vehicles, at_s)


def a_fault(kind: FaultKind, *vehicles: int, until_s: float | None = 60.0) -> FaultEvent:
    return FaultEvent(kind, vehicles, 20.0, until_s, late_s=2.0 if kind is FaultKind.LATE else None)


DOWN: dict[str, Any] = {"armed": (), "aloft": ()}
TWO_RESTARTS = [
    FaultEvent(FaultKind.RESTART, (1, 3), 10.0, 10.5),
    FaultEvent(FaultKind.RESTART, (4, 5), 60.0, 60.5),
]


def test_a_flight_in_which_everything_holds_has_arrived() -> None:
    verdict = judge(figures(), a_mission(), "coverage complete")
    assert (verdict.succeeded, verdict.text) == (True, "ARRIVED")
    landed = judge(figures(**DOWN), a_mission("land"), "all landed")
    assert (landed.succeeded, landed.text) == (True, "ARRIVED")


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"contacts": 1, "contacts_vehicles": 1}, "1 contact"),
        ({"contacts": 3, "contacts_trunks": 3, "contacts_steered": 3}, "3 contacts (3 with trunks)"),
        ({"contacts": 1, "contacts_trunks": 1}, "1 contact (1 with trunks), with no companion to steer"),
        (
            {"contacts": 4, "contacts_trunks": 2, "contacts_ground": 1, "contacts_steered": 1},
            "4 contacts (2 with trunks, 1 with the ground)",
        ),
        (
            {"min_separation_m": 4.87},
            "separation 4.87 m between vehicles 1, 2 at 30.0 s: must be at least 4.9 (separation.hard_m less 0.1)",
        ),
        ({"coverage_gap_deg": 90.0}, "coverage not formed: gap 90 deg: must be at most 1.5 x 45"),
        ({"coverage_radius_error_m": 2.1}, "coverage not formed: up to 2.1 m off the ring: must be within 2 m"),
        (
            {"coverage_radius_error_m": 2.1, "uncovering": (5, 7)},
            "coverage not formed: vehicles 5, 7 up to 2.1 m off the ring: must be within 2 m",
        ),
        ({"coverage_radius_error_m": None}, "coverage not formed: no vehicle in the air at its end"),
        ({"coverage_gap_deg": None}, "no coverage"),
        ({"coverage_gap_deg": 51.4, "uncovering": (8,)}, "coverage not formed: vehicle 8 did not cover"),
        ({"lost": (3,)}, "lost vehicle 3"),
        ({"fence_exceeded_m": 1.4}, "1.4 m outside of the fence"),
        ({"leaders_together_s": 2.3}, "two acting leaders in one connected part for 2.3 s"),
    ],
)
def test_what_does_not_hold_is_named(changes: dict[str, Any], why: str) -> None:
    verdict = judge(figures(**changes), a_mission(), "coverage complete")
    assert not verdict.succeeded
    assert verdict.text.partition(": ")[2] == why


def test_a_separation_within_centimetres_of_hard_m_is_kept() -> None:
    assert judge(figures(min_separation_m=4.91), a_mission(), "coverage complete").succeeded


@pytest.mark.parametrize(("estimates", "kept"), [("exact", False), ("recorded", True), ("2026-11", True)])
def test_who_flies_by_wrong_positions_may_come_half_a_metre_nearer(estimates: str, *, kept: bool) -> None:
    mission = a_mission().with_estimates(estimates)
    assert judge(figures(min_separation_m=4.55), mission, "coverage complete").succeeded is kept
    limit = f"must be at least {'4.5' if kept else '4.9'} (separation.hard_m less {'0.5' if kept else '0.1'})"
    assert limit in judge(figures(min_separation_m=4.4), mission, "coverage complete").text
    (shown,) = [one for one in limits(figures(min_separation_m=4.55), mission) if one.name == "least separation"]
    assert (shown.allowed, shown.kept) == (f"at least {'4.5' if kept else '4.9'} m", kept)
    assert not judge(figures(min_separation_m=4.45), mission, "coverage complete").succeeded


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        (a_fault(FaultKind.PARTITION, 2, 3), "unheard"),
        (a_fault(FaultKind.PARTITION, 1, 2), "separation"),  # both in one part
        (a_fault(FaultKind.PARTITION, 2, until_s=24.9), "separation"),  # over for more than 5 s
        (a_fault(FaultKind.STOP, 1, until_s=26.0), "unheard"),
        (a_fault(FaultKind.LATE, 1), "separation"),
        (killed(2), "unheard"),
        (killed(3), "separation"),
    ],
)
def test_two_that_a_fault_kept_from_hearing_each_other_have_a_cause_of_their_own(fault: FaultEvent, cause: str) -> None:
    near = figures(min_separation_m=3.0)
    verdict = judge(near, a_mission(), "coverage complete", faults=[fault])
    assert (verdict.grade, verdict.causes[0]) == (Grade.UNSAFE, cause)
    touching = figures(min_separation_m=0.5, contacts=1, contacts_vehicles=1)
    expected = "unheard" if cause == "unheard" else "collision"
    assert judge(touching, a_mission(), "coverage complete", faults=[fault]).causes[0] == expected


@pytest.mark.parametrize(("capacity_mah", "grade"), [(600.0, Grade.DEGRADED), (3300.0, Grade.INCOMPLETE)])
def test_one_that_a_small_battery_lands_explains_itself(capacity_mah: float, grade: Grade) -> None:
    """Seed 10035 of the search: vehicle 5 had been given so little that its autopilot landed it on the way."""
    tables = a_mission("land").model_dump(by_alias=True)
    tables["sim"]["battery_mah"] = {5: capacity_mah}
    early = figures(**DOWN, arrived=False, absent=(5,), landed_early=(5,))
    assert judge(early, Mission.model_validate(tables), "all landed").grade is grade


def test_a_ring_far_too_narrow_is_not_formed_however_even() -> None:
    stopped_at_60_m = figures(coverage_radius_error_m=40.0)
    verdict = judge(stopped_at_60_m, a_mission(radius_m=100.0, duration_s=240.0), "coverage complete")
    assert verdict.text == "INCOMPLETE: coverage not formed: up to 40.0 m off the ring: must be within 10 m"


def test_a_mission_that_asks_for_no_coverage_needs_none() -> None:
    changes = {"coverage_gap_deg": 300.0, "coverage_radius_error_m": 20.0}
    assert judge(figures(**changes), a_mission(duration_s=0.0), "coverage complete").succeeded


def test_everything_that_does_not_hold_is_said_at_once() -> None:
    verdict = judge(
        figures(contacts=2, contacts_vehicles=2, min_separation_m=0.4), a_mission(), "time limit of 300 s reached"
    )
    assert verdict.text == (
        "UNSAFE: 2 contacts; separation 0.40 m between vehicles 1, 2 at 30.0 s: "
        "must be at least 4.9 (separation.hard_m less 0.1); time limit of 300 s reached"
    )
    assert verdict.causes == ("collision", "separation", "unfinished")


def test_those_that_never_came_are_named() -> None:
    changes = {"arrived": False, "arrival_last_s": None, "absent": (2, 5, 7), "lost": (7,)}
    verdict = judge(figures(**changes), a_mission(), "coverage complete", faults=[killed(7)])
    assert verdict.text == "INCOMPLETE without 7: not all arrived: vehicles 2, 5 never came to d2 (coverage complete)"


def test_without_one_that_a_fault_killed_on_purpose_the_others_arrive() -> None:
    verdict = judge(figures(lost=(3,)), a_mission(), "coverage complete", faults=[killed(3)])
    assert (verdict.succeeded, verdict.text) == (True, "ARRIVED without 3")


def test_a_fault_that_kills_one_excuses_no_other() -> None:
    verdict = judge(figures(lost=(3, 4)), a_mission(), "coverage complete", faults=[killed(3)])
    assert (verdict.succeeded, verdict.text) == (False, "INCOMPLETE without 3, 4: lost vehicle 4")


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
    assert judge(changes, a_mission("return"), "all landed but 3").text == f"INCOMPLETE: {words}"


def test_a_killed_one_that_hangs_in_the_air_is_named_and_excused() -> None:
    changes = figures(lost=(3,), armed=(3,), aloft=(3,))
    verdict = judge(changes, a_mission("land"), "all landed but 3", faults=[killed(3)])
    assert (verdict.succeeded, verdict.text) == (True, "ARRIVED without 3 (vehicle 3 still armed in the air)")


@pytest.mark.parametrize(("at_end", "where"), [("return", "d1"), ("land", "the coverage at d2")])
def test_one_that_landed_elsewhere_is_named(at_end: str, where: str) -> None:
    verdict = judge(figures(**DOWN, strayed=(6,)), a_mission(at_end), "all landed")
    assert verdict.text == f"INCOMPLETE: vehicle 6 landed away from {where}"


def test_landing_where_the_mission_holds_is_no_success() -> None:
    verdict = judge(figures(**DOWN), a_mission("hold"), "all landed")
    assert verdict.text == "INCOMPLETE: all landed, where the mission holds"


def test_a_part_that_landed_where_it_was_is_told_of_as_such_and_not_as_astray() -> None:
    changes = {**DOWN, "lost": (1, 2, 3), "strayed": (1, 4, 5), "landed_early": (4, 5), "coverage_radius_error_m": None}
    verdict = judge(figures(**changes), a_mission("return"), "all landed", faults=[killed(1, 2, 3)])
    assert verdict.text == (
        "INCOMPLETE without 1, 2, 3: vehicles 4, 5 landed before the mission's end; "
        "coverage not formed: no vehicle in the air at its end"
    )


def test_a_part_that_landed_on_the_way_is_told_of() -> None:
    changes = {**DOWN, "arrived": False, "absent": (4, 5), "landed_early": (4, 5)}
    assert judge(figures(**changes), a_mission("land"), "all landed").text == (
        "INCOMPLETE: not all arrived: vehicles 4, 5 never came to d2 (all landed); "
        "vehicles 4, 5 landed before the mission's end"
    )


BEHIND = {"arrived": False, "absent": (2,)}


@pytest.mark.parametrize(
    ("changes", "grade"),
    [
        ({"contacts": 1}, Grade.UNSAFE),
        ({"min_separation_m": 4.8}, Grade.UNSAFE),
        ({"fence_exceeded_m": 1.1}, Grade.UNSAFE),
        ({"leaders_together_s": 2.1}, Grade.UNSAFE),
        ({"contacts": 1, **BEHIND}, Grade.UNSAFE),
        (BEHIND, Grade.INCOMPLETE),
        ({"coverage_gap_deg": 90.0}, Grade.INCOMPLETE),
        ({"lost": (3,)}, Grade.INCOMPLETE),
        ({"fence_exceeded_m": 0.9, "leaders_together_s": 1.9}, Grade.ARRIVED),
    ],
)
def test_the_worst_that_happened_is_the_grade(changes: dict[str, Any], grade: Grade) -> None:
    assert judge(figures(**changes), a_mission(), "coverage complete").grade is grade


@pytest.mark.parametrize(
    ("changes", "faults", "grade"),
    [
        (BEHIND, [a_fault(FaultKind.LATE, 2)], Grade.DEGRADED),  # its own telemetry was seconds late
        (BEHIND, [a_fault(FaultKind.LATE, 3)], Grade.INCOMPLETE),  # another's was
        (BEHIND, [a_fault(FaultKind.LATE, 3, until_s=None)], Grade.DEGRADED),  # and still is
        (BEHIND, [a_fault(FaultKind.LATE, 3, until_s=95.0)], Grade.DEGRADED),  # and was a moment ago
        (BEHIND, [killed(4)], Grade.INCOMPLETE),
        (BEHIND, [killed(4, at_s=100.0)], Grade.DEGRADED),
        (BEHIND, [killed(1, 3, 4, 5)], Grade.DEGRADED),  # no majority is left: all land
        (BEHIND, [a_fault(FaultKind.PARTITION, 2, 3)], Grade.DEGRADED),
        (BEHIND, [a_fault(FaultKind.PARTITION, 1, 3, 4, 5, 6, 7, 8)], Grade.DEGRADED),  # it was cut off alone
        (BEHIND, [a_fault(FaultKind.PARTITION, 1, 2, 3, 4, 5)], Grade.INCOMPLETE),  # with the majority
        ({"landed_early": (2, 3)}, [a_fault(FaultKind.STOP, 2, 3)], Grade.DEGRADED),
        ({"landed_early": (2, 3)}, [a_fault(FaultKind.STOP, 2)], Grade.INCOMPLETE),
        ({"coverage_gap_deg": 90.0}, [a_fault(FaultKind.BLIND, 2)], Grade.INCOMPLETE),  # there was time
        ({"coverage_gap_deg": 90.0, "uncovering": (2,)}, [a_fault(FaultKind.MOTOR, 2)], Grade.DEGRADED),
        ({"coverage_gap_deg": 90.0, "uncovering": (2, 3)}, [a_fault(FaultKind.MOTOR, 2)], Grade.INCOMPLETE),
        ({"uncovering": (2,)}, [a_fault(FaultKind.MOTOR, 2)], Grade.DEGRADED),
        ({"coverage_gap_deg": 90.0}, [killed(2, at_s=110.0)], Grade.DEGRADED),  # the gap was just torn
        ({"contacts": 1}, [a_fault(FaultKind.BLIND, 2)], Grade.UNSAFE),  # no fault excuses a contact
        (BEHIND, [a_fault(FaultKind.PILOT, 3, until_s=None)], Grade.INCOMPLETE),  # the others go on
        (BEHIND, [a_fault(FaultKind.PILOT, 2, until_s=None)], Grade.DEGRADED),
        (BEHIND, [a_fault(FaultKind.RESTART, 1, 3, 4, 5, until_s=20.5)], Grade.DEGRADED),  # no majority is left
        (BEHIND, TWO_RESTARTS, Grade.INCOMPLETE),  # never at one time
        (BEHIND, [a_fault(FaultKind.INSIDER, 3)], Grade.DEGRADED),  # 40 s long, over for 60
        (BEHIND, [a_fault(FaultKind.INSIDER, 3, until_s=25.0)], Grade.INCOMPLETE),  # 5 s long, over for 95
        (BEHIND | {"landed_early": (2,)}, [a_fault(FaultKind.INSIDER, 3, until_s=25.0)], Grade.DEGRADED),  # for good
        ({"contacts": 1}, [a_fault(FaultKind.INSIDER, 3)], Grade.UNSAFE),
        (
            BEHIND,
            [a_fault(FaultKind.OUTSIDER, 2, until_s=None)],
            Grade.INCOMPLETE,
        ),  # it has no key: it is to do nothing
        (BEHIND, [a_fault(FaultKind.BASE_LOST, 2, until_s=None)], Grade.INCOMPLETE),
    ],
)
def test_faults_excuse_those_that_they_struck_and_no_danger(
    changes: dict[str, Any], faults: list[FaultEvent], grade: Grade
) -> None:
    assert judge(figures(**changes), a_mission(), "coverage complete", faults=faults).grade is grade


def test_what_came_down_by_a_lie_stays_down_and_a_tree_that_was_left_out_is_left_out() -> None:
    lie = [a_fault(FaultKind.INSIDER, 3, until_s=25.0)]
    landed = figures(**DOWN, arrived=False, absent=tuple(range(1, 9)))
    assert judge(landed, a_mission("return"), "all landed", faults=lie).grade is Grade.DEGRADED
    assert judge(landed, a_mission("return"), "all landed").grade is Grade.INCOMPLETE
    tables = a_mission().model_dump(by_alias=True)
    tables["route"]["stops"] = [{"pos_enu_m": (150.0, 0.0, 10.0), "duration_s": 10.0}]
    two_trees = Mission.model_validate(tables)
    assert judge(figures(visited=1), two_trees, "coverage complete", faults=lie).grade is Grade.DEGRADED
    assert judge(figures(visited=1), two_trees, "coverage complete").grade is Grade.INCOMPLETE


MISSING: dict[str, Any] = {"arrived": False, "arrival_last_s": None, "absent": (3,)}


@pytest.mark.parametrize(
    ("changes", "ended", "grade", "causes"),
    [
        ({"uncovering": (3,)}, "coverage complete", Grade.DEGRADED, ("not arrived", "coverage")),
        ({"uncovering": (3, 4)}, "coverage complete", Grade.INCOMPLETE, ("coverage", "not arrived")),
        ({"coverage_gap_deg": 200.0}, "coverage complete", Grade.INCOMPLETE, ("coverage", "not arrived")),
        ({}, "time limit of 600 s reached", Grade.INCOMPLETE, ("unfinished", "not arrived")),
    ],
)
def test_the_rest_of_the_mission_is_asked_of_the_others_where_a_struck_one_stays_behind(
    changes: dict[str, Any], ended: str, grade: Grade, causes: tuple[str, ...]
) -> None:
    struck = [a_fault(FaultKind.MOTOR, 3, until_s=None)]
    verdict = judge(figures(**MISSING, **changes), a_mission(), ended, faults=struck)
    assert (verdict.grade, verdict.causes) == (grade, causes), verdict.text


@pytest.mark.parametrize(
    ("up", "grade"), [((3,), Grade.DEGRADED), ((3, 5), Grade.INCOMPLETE), ((1, 2, 4, 5, 6, 7, 8), Grade.INCOMPLETE)]
)
@pytest.mark.parametrize("changes", [MISSING, {}])
def test_where_the_mission_lands_one_that_its_pilot_keeps_up_is_waited_for_and_excused_but_no_other(
    up: tuple[int, ...], grade: Grade, changes: dict[str, Any]
) -> None:
    taken = [a_fault(FaultKind.PILOT, 3, until_s=None)]
    flown = figures(**changes, armed=up, aloft=up, sim_time_s=600.0)
    verdict = judge(flown, a_mission("return"), "time limit of 600 s reached", faults=taken)
    assert verdict.grade is grade, verdict.text
    assert {"unfinished", "landing"} <= set(verdict.causes)


@pytest.mark.parametrize(
    ("kind", "struck", "gnss", "grade"),
    [
        (FaultKind.POSITION_FREEZE, 1, "leader", Grade.DEGRADED),
        (FaultKind.MOTOR, 1, "leader", Grade.DEGRADED),
        (FaultKind.GNSS_OUTAGE, 1, "leader", Grade.INCOMPLETE),  # from these it recovers
        (FaultKind.POSITION_JUMP, 1, "leader", Grade.INCOMPLETE),
        (FaultKind.POSITION_FREEZE, 2, "leader", Grade.INCOMPLETE),  # it has none
        (FaultKind.WIND, 1, "leader", Grade.INCOMPLETE),
        (FaultKind.POSITION_FREEZE, 1, "all", Grade.INCOMPLETE),  # another one leads
        (FaultKind.POSITION_FREEZE, 1, [1, 2], Grade.INCOMPLETE),
    ],
)
def test_where_the_one_position_of_satellites_is_gone_for_good_nobody_knows_the_way(
    kind: FaultKind, struck: int, gnss: str | list[int], grade: Grade
) -> None:
    starts = [[8.0 * k, 0.0, 0.0] for k in range(8)]
    tables = a_mission().model_dump(by_alias=True)
    swarm = tables["swarm"] | {"size": 8, "gnss": gnss, "leader_priority": [1, 2]}
    mission = Mission.model_validate(tables | {"swarm": swarm, "ranging": {"start_enu_m": starts}})
    faults = [a_fault(kind, struck)]
    behind = {"arrived": False, "absent": tuple(range(1, 9))}
    assert judge(figures(**behind), mission, "all landed", faults=faults).grade is grade
