"""The model of who decides: which beacons are no trace of it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from companion.core.model.states import SwarmPhase
from companion.core.swarm.roster import DECIDES_AFTER_S
from companion.mavlink.own_messages import AIRBORNE, QUORUM
from mission.document.model import Mission
from mission.schema.kinds import FaultKind
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.lab.search.authority import KNOWN_S, PERIODS_S, Authority
from sim_bridge.lab.search.invariants import INVARIANTS, OneDecides
from tests.flights import short_mission

TRANSIT, COVERAGE, RETURN = SwarmPhase.TRANSIT, SwarmPhase.COVERAGE, SwarmPhase.RETURN
LONG_S = DECIDES_AFTER_S + 1.0


def said(leader: int, phase: SwarmPhase = TRANSIT, *, quorum: bool = True, stop: int = 0) -> Any:
    return SimpleNamespace(
        acting_leader=leader, swarm_phase=int(phase), stop=stop, flags=AIRBORNE | (QUORUM if quorum else 0)
    )


def under_way(mission: Mission | None = None) -> Authority:
    """Vehicle 1 has led three on their way for long."""
    model = Authority(mission or short_mission())
    for now_s in (0.0, LONG_S):
        assert step(model, now_s, said(1), said(1), said(1)) == ""
    assert model.deciding(LONG_S) == [1]
    return model


def step(model: Authority, now_s: float, *beacons: Any, liars: tuple[int, ...] = ()) -> str:
    told = {k: one for k, one in enumerate(beacons, start=1) if one is not None}
    return model.judge_tick(now_s, told, tuple(told), set(liars))


def test_a_leader_decides_and_the_others_follow() -> None:
    model = under_way()
    assert step(model, LONG_S + 1.0, said(1, COVERAGE), said(1), said(1)) == ""
    assert step(model, LONG_S + 1.1, said(1, COVERAGE), said(1, COVERAGE), said(1, COVERAGE)) == ""


def test_one_that_is_started_again_does_not_go_back_from_what_it_said_before() -> None:
    """It answers a tick before its first beacon: its last one, of COVERAGE, still stood there (search, seed 12034)."""
    model = under_way()
    before = said(1, COVERAGE)
    assert step(model, LONG_S + 1.0, before, said(1), said(1)) == ""
    told = {1: before, 2: said(1, COVERAGE), 3: said(1, COVERAGE)}
    assert model.judge_tick(LONG_S + 1.1, told, (2, 3), set()) == ""
    assert model.judge_tick(LONG_S + 1.7, told, (1, 2, 3), set()) == ""
    anew = said(0, SwarmPhase.ASSEMBLE, quorum=False)
    assert model.judge_tick(LONG_S + 1.75, told | {1: anew}, (1, 2, 3), set()) == ""
    back = model.judge_tick(LONG_S + 1.8, told | {1: anew, 2: said(1, TRANSIT)}, (1, 2, 3), set())
    assert back == "vehicle 2 goes back from COVERAGE to TRANSIT"


@pytest.mark.parametrize("quorum", [True, False])
def test_two_that_lead_the_majority_for_long_decide_at_once(quorum: bool) -> None:
    model = under_way()
    assert step(model, LONG_S + 1.0, said(1), said(2, quorum=quorum), said(2, quorum=quorum)) == ""
    found = step(model, 2 * LONG_S + 1.1, said(1), said(2, quorum=quorum), said(2, quorum=quorum))
    assert (found == "vehicles 1, 2 decide at once") is quorum


def test_a_new_leader_that_does_not_wait_is_found() -> None:
    model = under_way()
    assert step(model, LONG_S + 1.0, None, said(2), said(2)) == ""
    found = step(model, LONG_S + DECIDES_AFTER_S - PERIODS_S + 0.5, None, said(2, COVERAGE), said(2))
    assert found == "vehicle 2 enters COVERAGE, and has led the majority for 4.2 s"


def test_one_that_has_waited_is_a_trace() -> None:
    model = under_way()
    assert step(model, LONG_S + 1.0, None, said(2), said(2)) == ""
    assert step(model, 2 * LONG_S + 1.0, None, said(2, COVERAGE), said(2)) == ""


def test_a_phase_by_nobodys_word_is_found() -> None:
    assert step(under_way(), LONG_S + 1.0, said(1), said(1), said(1, COVERAGE)).startswith("vehicle 3 enters COVERAGE")


def test_a_step_that_the_table_has_not_is_found() -> None:
    model = under_way()
    assert step(model, LONG_S + 1.0, said(1, TRANSIT, stop=1), said(1), said(1)).endswith("that is no step")


def test_the_next_lane_is_a_step_and_the_one_after_it_is_none() -> None:
    area = [[0.0, -20.0], [40.0, -20.0], [40.0, 20.0], [0.0, 20.0]]
    lanes = short_mission(sensing={"sensor": "scan-1deg"}, survey={"area_enu_m": area, "lane_m": 8.0})
    assert len(lanes.visits) > 4
    model = under_way(lanes)
    assert step(model, LONG_S + 1.0, said(1, TRANSIT, stop=1), said(1), said(1)) == ""
    assert step(model, LONG_S + 2.0, *[said(1, TRANSIT, stop=1)] * 3) == ""
    assert step(model, LONG_S + 3.0, said(1, TRANSIT, stop=3), *[said(1, TRANSIT, stop=1)] * 2).endswith("no step")


def test_a_phase_is_not_decided_without_knowing_the_newest() -> None:
    model = under_way()
    assert step(model, LONG_S + 1.0, said(1, COVERAGE), said(2), said(2)) == ""
    lost = said(0, COVERAGE)
    assert step(model, LONG_S + 1.1, lost, said(2), said(2)) == ""
    found = step(model, 2 * LONG_S + KNOWN_S, lost, said(2, SwarmPhase.LAND), said(2))
    assert found == "vehicle 2 enters LAND from TRANSIT, though vehicle 1 has told COVERAGE before"


def test_nobody_goes_back_but_one_that_was_started_again() -> None:
    model = under_way()
    assert "goes back" in step(model, LONG_S + 0.1, said(1), said(1, SwarmPhase.GATHER), said(1))
    model = under_way()
    assert step(model, LONG_S + 0.1, said(1), None, said(1)) == ""
    assert step(model, LONG_S + 0.2, said(1), said(0, SwarmPhase.ASSEMBLE), said(1)) == ""


def test_before_takeoff_a_leader_decides_at_once() -> None:
    model = Authority(short_mission())
    ready, off = said(1, SwarmPhase.ASSEMBLE), said(1, SwarmPhase.GATHER)
    ready.flags = off.flags = QUORUM
    assert step(model, 0.0, ready, ready) == ""
    assert step(model, 0.1, off, ready) == ""


def test_the_search_holds_every_flight_to_it_but_not_its_liars(a_mission: Mission) -> None:
    assert OneDecides in INVARIANTS
    invariant, happened = OneDecides(a_mission), list[FaultEvent]()
    for now_s, third in ((0.0, said(1)), (LONG_S, said(1)), (LONG_S + 1.0, said(1, COVERAGE))):
        tick = SimpleNamespace(time_s=now_s, said={1: said(1), 2: said(1), 3: third}, answered=(1, 2, 3))
        flight: Any = SimpleNamespace(last=tick, faults=SimpleNamespace(happened=happened))
        invariant.check_flight(flight)
    assert invariant.violation == "vehicle 3 enters COVERAGE, and has led the majority for 0.0 s, at 7.0 s"
    happened.append(FaultEvent(FaultKind.INSIDER, (3,), 0.0))
    innocent = OneDecides(a_mission)
    for now_s, third in ((0.0, said(1)), (1.0, said(1, COVERAGE))):
        tick = SimpleNamespace(time_s=now_s, said={1: said(1), 2: said(1), 3: third}, answered=(1, 2, 3))
        innocent.check_flight(SimpleNamespace(last=tick, faults=SimpleNamespace(happened=happened)))  # type: ignore[arg-type]
    assert innocent.violation == ""


@pytest.fixture
def a_mission() -> Mission:
    from tests.unit.core.core_kit import mission

    return mission(swarm={"size": 3})
