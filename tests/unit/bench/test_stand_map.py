"""A stem map against the trees: pairs, false stems, errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.stand.products.write import write_products
from companion.stand.records import StoredRecord
from companion.survey.observation import STEM_KIND, encode
from sim_bridge.judge.run_folder import MISSION_NAME
from tests.bench.__main__ import main
from tests.bench.stand_map import compare
from tests.unit.stand.stand_kit import said
from tests.unit.stand.test_products import TEXT, mission

TREES = np.asarray([(0.0, 0.0, 0.3), (5.0, 0.0, 0.2), (9.0, 0.0, 0.05)])


def test_a_tree_belongs_to_one_stem_and_the_other_is_false() -> None:
    told = np.asarray([(0.1, 0.0, 0.31, 0.01), (0.4, 0.0, 0.30, 0.01), (5.0, 0.2, 0.17, 0.01)])
    found = compare(told, TREES)
    assert (found.stems, found.trees) == (3, 2)
    assert found.dbh_off_m.tolist() == pytest.approx([0.01, -0.03])
    assert found.off_m.ravel().tolist() == pytest.approx([0.1, 0.0, 0.0, 0.2])
    assert found.tree.tolist() == [0, 1]
    assert "3 counted stems: 2 are trees, 1 none" in found.said()
    assert "bias -1.00 cm, 50% within" in found.said()


def test_a_stem_beside_no_tree_or_a_thin_one_is_false() -> None:
    found = compare(np.asarray([(9.0, 0.0, 0.1, 0.01), (2.5, 0.0, 0.3, 0.01)]), TREES)
    assert found.said() == "2 counted stems: 0 are trees, 2 none"


def test_a_runs_folder_is_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trees = "[forest]\ntrees = [{ base_enu_m = [20.0, 9.0], trunk_radius_m = 0.15, height_m = 20.0 }]\n"
    (tmp_path / MISSION_NAME).write_text(TEXT + trees)
    told = [said(1, north_m=9.0, east_m=20.1), said(1, north_m=30.0, east_m=20.0)]
    records = [StoredRecord(1, 7, k, STEM_KIND, 9.0, encode(o)) for k, o in enumerate(told, start=1)]
    write_products(records, mission(), tmp_path / "stand")
    assert main(["stand-map", str(tmp_path)]) == 0
    assert "2 counted stems: 1 are trees, 1 none" in capsys.readouterr().out
