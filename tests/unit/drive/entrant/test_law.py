"""A foreign law: what is loaded, what it is asked, and what is said of one that answers no velocity."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any

import pytest

from companion.core.guidance.formation import NOWHERE
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.stages import FLIGHT_STAGES
from sim_bridge.drive.entrant.law import LawError, find_law, load_law
from sim_bridge.drive.entrant.stages import Entrant
from tests.unit.core.core_kit import mission
from tests.unit.core.core_surroundings import surroundings

STILL = "def start(mission, vehicle_id):\n    return []\n\n\ndef transit(memory, view):\n    return {}\n"


def law_file(folder: Path, answer: str, more: str = "") -> Path:
    file = folder / "mine.py"
    file.write_text(STILL.format(answer) + more, encoding="utf-8")
    return file


def guided(entrant: Entrant, **changes: Any) -> Any:
    """A vehicle's guidance, and an input for it."""
    at = {"state": FlightState.TRANSIT, "phase": SwarmPhase.TRANSIT, "role": Role.LEADER, **changes}
    now = GuidanceInput(
        surroundings(Position((0.0, 10.0, -8.0), (1.0, 0.0, 0.0))),
        route=NOWHERE,
        range_m=30.0,
        governor=0.5,
        lease_freshness=1.0,
        goal=((0.0, 60.0, -8.0), 2.0),
        size=4,
        **at,
    )
    return entrant.stages().build_guidance(mission(), 1), now


def test_a_law_is_known_by_its_name_and_the_digest_of_its_file(tmp_path: Path) -> None:
    file = law_file(tmp_path, "(1.0, 0.0, 0.0)")
    found = find_law("mine.py", tmp_path)
    assert (found.name, found.path) == ("mine", file)
    assert found.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()
    entrant = Entrant(found, safety_filter=False)
    assert entrant.figures() == {
        "flown_by": f"law mine, sha256 {found.sha256[:12]}; WITHOUT SAFETY FILTER",
        "law": "mine",
        "law_sha256": found.sha256,
        "safety_filter": False,
    }
    file.write_text(STILL.format("(2.0, 0.0, 0.0)"), encoding="utf-8")
    with pytest.raises(LawError, match=r"mine\.py has changed since the start"):
        load_law(found)


def test_a_law_may_be_a_module_that_can_be_imported() -> None:
    assert find_law("sim_bridge.drive.entrant.law").name == "law"
    with pytest.raises(
        LawError, match=r"^law sim_bridge\.drive\.entrant\.law: has no function start\(mission, vehicle_id\)"
    ):
        load_law(find_law("sim_bridge.drive.entrant.law"))
    for wrong in ("no.such.module", "nowhere.py", "math", "..x"):
        with pytest.raises(LawError, match=f"^law {wrong}: "):
            find_law(wrong)


def test_what_is_no_python_is_told_so_with_what_a_law_must_be(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("# Words\n", encoding="utf-8")
    must = r"must be a \.py file, the name of an installed law \(.*\), or a module that can be imported$"
    for wrong in ("README.md", "."):
        with pytest.raises(LawError, match=rf"^law {wrong}: is no Python module: {must}"):
            find_law(wrong, tmp_path)
    for wrong in ("NOTES.md", "./law", "no/such/law", "no.such.module"):
        with pytest.raises(LawError, match=rf"^law {wrong}: no such module: {must}"):
            find_law(wrong, tmp_path)


def test_a_module_that_lacks_something_else_says_what(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lacks_it").mkdir()
    (tmp_path / "lacks_it" / "__init__.py").write_text("import nothing_of_that_name\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(LawError, match=r"^law lacks_it\.law: No module named 'nothing_of_that_name'$"):
        find_law("lacks_it.law")


def test_what_breaks_down_when_it_is_imported_is_told_with_its_line(tmp_path: Path) -> None:
    file = law_file(tmp_path, "None", "\n\n1 / 0\n")
    with pytest.raises(LawError, match="cannot be imported: ZeroDivisionError: division by zero, line 9"):
        load_law(find_law(str(file)))


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ("None", "transit returned None: must be three numbers"),
        ("(1.0, 2.0)", r"transit returned \(1\.0, 2\.0\): must be three numbers"),
        ("(1.0, 2.0, 3.0, 4.0)", "must be three numbers"),
        ("'fast'", "transit returned 'fast': must be three numbers"),
        ("[[1.0, 0.0, 0.0]] * 3", "must be three numbers"),
        ("(float('nan'), 0.0, 0.0)", r"transit returned \(nan, 0\.0, 0\.0\): must be finite"),
        ("(0.0, 0.0, float('-inf'))", "must be finite"),
        ("(0.0, 1e9, 0.0)", "must be within 1000 m/s"),
        ("memory[0]", "transit: IndexError: list index out of range, line 6"),
    ],
)
def test_what_is_no_velocity_names_module_function_and_value(tmp_path: Path, answer: str, message: str) -> None:
    guidance, now = guided(Entrant(find_law(str(law_file(tmp_path, answer)))))
    with pytest.raises(LawError, match=f"^law .*mine.py: .*{message}"):
        guidance.guide(now, dt_s=0.05)


@pytest.mark.parametrize("answer", ["(1, 2.0, -0.5)", "[1.0, 2, -0.5]", "__import__('numpy').array((1.0, 2.0, -0.5))"])
def test_a_velocity_is_flown_handed_down_and_faced(tmp_path: Path, answer: str) -> None:
    guidance, now = guided(Entrant(find_law(str(law_file(tmp_path, answer)))))
    desired = guidance.guide(now, dt_s=0.05)
    assert desired.vel_ned_mps == desired.ref_ned_mps == guidance.ref_ned_mps == (1.0, 2.0, -0.5)
    assert desired.yaw_rad == pytest.approx(math.atan2(2.0, 1.0))
    guidance.reset()
    assert guidance.ref_ned_mps == (0.0, 0.0, 0.0)


def test_a_law_sees_the_way_to_its_goal_and_no_place(tmp_path: Path) -> None:
    file = law_file(tmp_path, "memory.append(view) or view.goal_ned_m")
    file.write_text(file.read_text().replace("    return []", "    return SEEN") + "\n\nSEEN = []\n")
    guidance, now = guided(Entrant(find_law(str(file))))
    assert guidance.guide(now, dt_s=0.05).vel_ned_mps == (0.0, 50.0, 0.0)
    (view,) = load_law(find_law(str(file))).start(mission(), 1)
    assert (view.state, view.leads, view.stop_m, view.size, view.dt_s) == ("transit", True, 2.0, 4, 0.05)
    assert view.cruise_mps == 0.5 * mission().route.vel_leader_mps
    assert view.points_ne_m.shape == (0, 2)


def test_memory_lasts_until_the_vehicle_is_not_steered(tmp_path: Path) -> None:
    file = law_file(tmp_path, "memory.append(1) or (float(len(memory)), 0.0, 0.0)")
    guidance, now = guided(Entrant(find_law(str(file))))
    flown = [guidance.guide(now, dt_s=0.05).vel_ned_mps[0] for _ in range(3)]
    guidance.reset()
    assert [*flown, guidance.guide(now, dt_s=0.05).vel_ned_mps[0]] == [1.0, 2.0, 3.0, 1.0]


@pytest.mark.parametrize("state", [FlightState.HOLD, FlightState.SEEKING, FlightState.COVERAGE])
def test_ours_flies_where_the_law_is_not_asked(tmp_path: Path, state: FlightState) -> None:
    ours, now = guided(Entrant(), state=state)
    foreign, _ = guided(Entrant(find_law(str(law_file(tmp_path, "(9.0, 9.0, 9.0)")))))
    assert foreign.guide(now, dt_s=0.05) == ours.guide(now, dt_s=0.05)


def test_without_a_safety_filter_the_speed_limits_are_left() -> None:
    flown = mission()
    around = surroundings(Position((0.0, 0.0, -2.0), (0.0, 0.0, 0.0)))
    free = Entrant(safety_filter=False).stages().build_safety_filter(flown)
    assert free.apply((30.0, 0.0, 0.0), around, dt_s=0.05).vel_ned_mps == (flown.limits.speed_max_mps, 0.0, 0.0)
    assert free.apply((0.0, 0.0, 4.0), around, dt_s=0.05).vel_ned_mps[2] == flown.limits.climb_max_mps
    assert free.apply((math.nan, 0.0, 0.0), around, dt_s=0.05).vel_ned_mps == (0.0, 0.0, 0.0)


def test_by_default_all_is_ours() -> None:
    stages = Entrant().stages()
    assert (stages.build_guidance, stages.build_safety_filter) == (
        FLIGHT_STAGES.build_guidance,
        FLIGHT_STAGES.build_safety_filter,
    )
    assert (Entrant().figures(), Entrant().note()) == ({}, "")
