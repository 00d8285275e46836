"""Missions that a search found to fail, shrunk, are flown again: `tests/testdata/found`. Open: docs/reliability.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mission.document.load import load_mission
from sim_bridge.lab.search.flight import fly_to_row

FOUND = sorted((Path(__file__).parents[1] / "testdata" / "found").glob("*.toml"))


@pytest.mark.parametrize("file", FOUND, ids=lambda file: file.stem)
def test_a_mission_that_failed_ends_as_its_file_says(file: Path) -> None:
    expected = re.search(r"^# verdict: (\w+)$", file.read_text(encoding="utf-8"), re.MULTILINE)
    assert expected is not None
    row = fly_to_row(load_mission(file), on_jsbsim=True)
    assert row["grade"] == expected[1], row["verdict"]
