"""The rules of a tick: makes are chosen once, and no stage writes into another's object."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.localisation.gnss_localiser import GnssLocaliser
from companion.core.localisation.makes import build_localiser
from tests.unit.core.core_kit import mission
from tests.unit.core.ranging_kit import ranging_mission

CORE = Path(__file__).parents[3] / "companion" / "core"
SOURCES = sorted(CORE.rglob("*.py"))


def test_where_not_all_receive_gnss_the_localiser_is_the_other_make() -> None:
    assert isinstance(build_localiser(mission(), 1), GnssLocaliser)
    assert isinstance(build_localiser(ranging_mission(), 2), GnssDeniedLocaliser)


def test_the_make_of_localiser_is_chosen_in_one_place() -> None:
    asked = [path.name for path in SOURCES if "flies_by_ranges" in path.read_text(encoding="utf-8")]
    assert asked == ["makes.py"]


@pytest.mark.parametrize("name", ["agent.py", "swarm/swarm.py", "swarm/partition.py", "guidance/movement.py"])
def test_nothing_is_set_on_another_stages_object(name: str) -> None:
    found: list[str] = []
    for node in ast.walk(ast.parse((CORE / name).read_text(encoding="utf-8"))):
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AugAssign) else []
        )
        for target in targets:
            if isinstance(target, ast.Attribute) and not (
                isinstance(target.value, ast.Name) and target.value.id == "self"
            ):
                found.append(f"{node.lineno}: {ast.unparse(target)}")
    assert found == []
