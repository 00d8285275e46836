"""Keys that have new names: the old ones are read, with a warning, and refused beside the new."""

from __future__ import annotations

from pathlib import Path

import pytest

from mission.document.load import MissionError, parse_mission
from mission.document.model import PositionUncertain
from sim_bridge.lab.study.load import load_study
from tests.unit.mission.mission_file_kit import FULL

OLD = FULL.replace("position_error_max_m = 10.0", "place_budget_m = 12.0").replace(
    'position_uncertain = "return"', 'place_lost = "hold"'
)


def test_old_keys_are_read_under_their_new_names_with_a_warning_that_names_the_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    swarm = parse_mission(OLD, "old.toml").swarm
    assert (swarm.position_error_max_m, swarm.position_uncertain) == (12.0, PositionUncertain.HOLD)
    line = OLD.split("place_lost")[0].count("\n") + 1
    said = capsys.readouterr().err
    assert f"old.toml:{line}: swarm.place_lost is deprecated: write position_uncertain\n" in said
    parse_mission(OLD, "old.toml")
    assert capsys.readouterr().err == ""  # once in a process


def test_a_problem_of_a_value_under_its_old_key_has_its_line() -> None:
    line = OLD.split("place_lost")[0].count("\n") + 1
    with pytest.raises(MissionError, match=f"m.toml:{line}: swarm.position_uncertain = 3"):
        parse_mission(OLD.replace('place_lost = "hold"', "place_lost = 3"), "m.toml")


def test_an_old_key_beside_its_new_one_is_refused() -> None:
    both = OLD.replace("place_budget_m = 12.0", "place_budget_m = 12.0\nposition_error_max_m = 12.0")
    with pytest.raises(MissionError, match=r"swarm.place_budget_m = 12.0: unknown key"):
        parse_mission(both, "m.toml")


def test_a_study_may_set_old_keys_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "m.toml").write_text(FULL)
    study = tmp_path / "s.toml"
    study.write_text(
        'schema = 1\nname = "s"\nmissions = ["m.toml"]\nseeds = 1\n[[run]]\nname = "one"\n'
        'backend = "agents"\nset = { swarm.place_lost = "hold" }\n'
    )
    assert len(load_study(study).cases) == 1
    assert "run[0].set.swarm.place_lost is deprecated: write position_uncertain" in capsys.readouterr().err
