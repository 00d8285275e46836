"""Defects that a benchmark plants to see whether the search finds them: they can still be planted."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim_bridge.judge.verdict import CAUSES
from tests.bench.planted_defects import DEFECTS, Defect, plant
from tests.bench.turns import ROOT, pure_copy


@pytest.mark.parametrize("defect", DEFECTS, ids=lambda defect: defect.name)
def test_a_defect_changes_the_copy_and_is_looked_for_by_a_cause_of_verdicts(defect: Defect) -> None:
    assert defect.cause in CAUSES
    with pure_copy(ROOT) as copy:
        plant(defect, copy)
        assert (copy / defect.file).read_text() != (ROOT / defect.file).read_text()
        compile((copy / defect.file).read_text(), defect.file, "exec")


def test_what_does_not_stand_there_once_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("x = 1\nx = 1\n")
    with pytest.raises(ValueError, match="'x = 1' stands there 2 times"):
        plant(Defect("twice", "a.py", (("x = 1", "x = 2"),), "fence"), tmp_path)
