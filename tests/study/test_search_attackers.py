"""Attackers that the search draws, and how a failure shrinks: missions and attacks become smaller."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from mission.document.model import Mission
from mission.schema.faults import Fault
from mission.schema.kinds import FaultKind, Lie
from sim_bridge.lab.search import shrink
from sim_bridge.lab.search.attackers import RANGED_SPOOFS, draw_attack
from sim_bridge.lab.search.draw import draw

SEEDS = range(1000, 1300)


@pytest.fixture(scope="module")
def missions() -> list[Mission]:
    return [draw(seed).mission for seed in SEEDS]


def test_half_of_the_flights_have_an_attacker_and_half_are_signed() -> None:
    drawn = [draw(seed) for seed in SEEDS]
    attacked = [one for one in drawn if one.attacker]
    assert 0.4 < len(attacked) / len(drawn) < 0.6
    assert 0.4 < sum(one.signed for one in drawn) / len(drawn) < 0.6
    assert {one.attacker for one in attacked} == {"insider", "outsider", "spoofer"}
    assert {one.mission.sim.faults[-1].lie for one in attacked} | {Lie.TRUNKS} == {None, *Lie}
    kinds = {one.mission.sim.faults[-1].kind for one in attacked}
    assert kinds == {FaultKind.INSIDER, FaultKind.OUTSIDER, *RANGED_SPOOFS}
    assert all(one.signed for one in attacked if one.attacker == "outsider")


@pytest.mark.parametrize(
    ("sensor", "ranging", "lies"),
    [
        ("scan-1deg", True, {"ranges", "trunks"}),
        ("sectors", True, {"ranges"}),
        (None, True, {"ranges"}),
        ("scan-1deg", False, set()),
    ],
)
def test_lies_with_ranges_and_trunks_are_drawn_where_they_are_told(
    sensor: str | None, ranging: bool, lies: set[str]
) -> None:
    tables = {"swarm": {"size": 4}} | ({"ranging": {}} if ranging else {})
    tables |= {} if sensor is None else {"sensing": {"sensor": sensor}}
    drawn = {draw_attack(np.random.default_rng(seed), tables, signed=False).get("lie") for seed in range(600)}
    assert drawn & {"ranges", "trunks"} == lies
    assert drawn | {"ranges", "trunks"} == {None, *Lie}


def test_a_seed_without_its_attacker_is_the_same_mission() -> None:
    """So what an attacker does can be told from what happens anyway."""
    for seed in SEEDS[:40]:
        attacked, without = draw(seed, 1.0), draw(seed, 0.0)
        assert not without.attacker
        assert (attacked.attacker, attacked.signed) != ("", not without.signed)
        if attacked.refused == without.refused:  # else the attack itself was impossible in the first one
            assert attacked.mission.sim.faults[:-1] == without.mission.sim.faults
            sim = without.mission.sim.model_copy(update={"faults": attacked.mission.sim.faults})
            assert without.mission.model_copy(update={"sim": sim}) == attacked.mission


def rows_that_fail_by(fails: Any) -> Any:
    def fly(mission: Mission, **_: Any) -> dict[str, Any]:
        failed = fails(mission)
        return {"grade": "UNSAFE" if failed else "ARRIVED", "causes": ["contact"] if failed else [], "verdict": "shown"}

    return fly


def test_what_does_not_matter_is_taken_away(monkeypatch: pytest.MonkeyPatch, missions: list[Mission]) -> None:
    """It fails while vehicle 2 is stopped and there is any loss."""

    def fails(mission: Mission) -> bool:
        stopped = any(fault.kind is FaultKind.STOP and 2 in (fault.vehicles or ()) for fault in mission.sim.faults)
        return stopped and mission.sim.radio_loss > 0.0

    stop = {"kind": "stop", "vehicles": [2], "phase": "transit", "at_s": 3.0, "for_s": 4.0}
    kill = {"kind": "kill", "vehicles": [3], "at_s": 5.0}
    whole = next(one for one in missions if one.forest.stand is not None and one.swarm.size > 8 and one.sim.radio_loss)
    tables = whole.model_dump(mode="json", by_alias=True)
    tables["sim"]["faults"] = [kill, stop]
    monkeypatch.setattr(shrink, "fly_to_row", rows_that_fail_by(fails))
    small, _ = shrink.shrink(Mission.model_validate(tables), "UNSAFE", "contact", on_jsbsim=False, most_flights=100)
    assert fails(small)
    assert small.swarm.size <= 3
    assert [fault.kind for fault in small.sim.faults] == [FaultKind.STOP]
    assert small.forest.stand is None
    assert (small.sim.radio_delay_s, small.sim.turbulence_mps, small.sim.personalities) == (0.0, 0.0, {})


def attacked_missions(kind: FaultKind) -> Iterator[Mission]:
    return (
        drawn.mission for drawn in map(draw, range(1000, 1500)) if kind in [f.kind for f in drawn.mission.sim.faults]
    )


def shrunk(monkeypatch: pytest.MonkeyPatch, mission: Mission, fails: Any, *, signed: bool = True) -> tuple[Fault, bool]:
    """The attack that is left of it, and whether it is still signed."""
    monkeypatch.setattr(shrink, "fly_to_row", rows_that_fail_by(fails))
    small, with_keys = shrink.shrink(mission, "UNSAFE", "contact", on_jsbsim=False, most_flights=300, signed=signed)
    assert fails(small)
    return small.sim.faults[-1], with_keys


def test_an_insider_shrinks_to_a_plain_lie_that_is_soon_over(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(mission: Mission) -> bool:
        return any(fault.kind is FaultKind.INSIDER for fault in mission.sim.faults)

    attack, signed = shrunk(monkeypatch, next(attacked_missions(FaultKind.INSIDER)), fails)
    assert (attack.lie, attack.at_s, signed) == (Lie.OFFSET, 0.0, False)
    assert attack.for_s is not None
    assert attack.for_s <= 2.5


def test_a_spoofed_position_shrinks_by_its_kind_and_else_by_its_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    mission = next(attacked_missions(FaultKind.POSITION_JUMP))

    def any_spoof(mission: Mission) -> bool:
        return any(fault.kind in RANGED_SPOOFS for fault in mission.sim.faults)

    def a_long_jump(mission: Mission) -> bool:
        return any(fault.jump_m and math.hypot(*fault.jump_m) > 1.0 for fault in mission.sim.faults)

    attack, _ = shrunk(monkeypatch, mission, any_spoof)
    assert attack.kind is FaultKind.POSITION_FREEZE
    attack, _ = shrunk(monkeypatch, mission, a_long_jump)
    assert attack.kind is FaultKind.POSITION_JUMP
    assert attack.jump_m is not None
    assert 1.0 < math.hypot(*attack.jump_m) <= 2.1


def test_what_an_outsider_does_is_looked_for_in_signed_flights_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(mission: Mission) -> bool:
        return any(fault.kind is FaultKind.OUTSIDER for fault in mission.sim.faults)

    assert shrunk(monkeypatch, next(attacked_missions(FaultKind.OUTSIDER)), fails)[1]


def test_shrinking_ends_with_its_flights(monkeypatch: pytest.MonkeyPatch, missions: list[Mission]) -> None:
    flown: list[Mission] = []

    def fly(mission: Mission, **_: Any) -> dict[str, Any]:
        flown.append(mission)
        return {"grade": "UNSAFE", "causes": ["separation"], "verdict": ""}  # another way to fail

    monkeypatch.setattr(shrink, "fly_to_row", fly)
    assert shrink.shrink(missions[0], "UNSAFE", "contact", on_jsbsim=False, most_flights=5) == (missions[0], False)
    assert len(flown) == 5


def test_what_its_faults_explain_is_not_shrunk_to(monkeypatch: pytest.MonkeyPatch, missions: list[Mission]) -> None:
    """Of a smaller swarm the same vehicles that are killed leave no majority."""

    def fly(mission: Mission, **_: Any) -> dict[str, Any]:
        grade = "INCOMPLETE" if mission.swarm.size > 4 else "DEGRADED"
        return {"grade": grade, "causes": ["not arrived"], "verdict": "shown"}

    monkeypatch.setattr(shrink, "fly_to_row", fly)
    whole = next(one for one in missions if one.swarm.size > 6)
    small, _ = shrink.shrink(whole, "INCOMPLETE", "not arrived", on_jsbsim=False, most_flights=100)
    assert small.swarm.size == 5
