"""`from sim_bridge import fly`: the flight of the program, its table, its replay, and a notebook that uses it."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mission.common.problems import MissionError
from mission.document.load import dump_mission
from sim_bridge import Result, cli, fly
from sim_bridge.judge.page.coding import unpack
from tests.flights import short_mission
from tests.report import browser_kit
from tests.report.browser_kit import Browser

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "docs" / "how-to" / "fly-from-python.ipynb"
TWO = short_mission(swarm={"size": 2}, sim={"time_limit_s": 30.0})


@pytest.fixture(scope="module")
def flown() -> Result:
    return fly(TWO)


def test_it_is_the_flight_of_the_program_to_the_bit_from_a_file_a_mission_or_a_dict(
    flown: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "two.toml"
    file.write_text(dump_mission(TWO))
    cli.main(["fly", str(file), "--agents", "in-process", "--out", str(tmp_path / "run"), "--json"])
    program = json.loads(capsys.readouterr().out)
    for result in (flown, fly(file), fly(TWO.model_dump(mode="json", by_alias=True, exclude_none=True))):
        assert result.summary["trace_hash"] == program["trace_hash"]
        assert result.metrics.as_dict() == {name: program[name] for name in result.metrics.as_dict()}
        assert result.succeeded is False
        assert program["verdict"] in repr(result)


def test_a_wrong_mission_is_refused_with_every_problem(tmp_path: Path) -> None:
    with pytest.raises(MissionError) as refused:
        fly({"schema": 1, "swarm": {"size": 0}})
    assert {"route.d1_enu_m", "swarm.size"} <= {problem.key for problem in refused.value.problems}
    with pytest.raises(MissionError, match="no such file"):
        fly(tmp_path / "absent.toml")


def test_a_folder_keeps_the_flight_and_one_that_holds_something_is_refused(tmp_path: Path) -> None:
    fly(TWO, folder=tmp_path / "run")
    assert cli.main(["export", str(tmp_path / "run"), "--gpx"]) == 0
    with pytest.raises(FileExistsError, match="not an empty folder"):
        fly(TWO, folder=tmp_path / "run")


def test_the_frame_has_a_row_for_each_vehicle_and_tick(flown: Result) -> None:
    pytest.importorskip("pandas")
    told = flown.recording
    table = flown.frame()
    assert len(table) == told.on_ground.size
    second = table[table.vehicle == 2]
    north, east, down = told.pos_ned_m[:, 1].T
    for name, values in (("east_m", east), ("north_m", north), ("up_m", -down), ("time_s", told.time_s)):
        assert np.array_equal(second[name], values)
    assert np.array_equal(second.vel_up_mps, -told.vel_ned_mps[:, 1, 2])
    assert set(table.phase) <= {"", "assemble", "gather", "transit"}
    assert table.phase.iloc[-1] != ""
    assert not table.touched.any()


def test_without_pandas_the_frame_says_what_to_install(flown: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match=re.escape("in the checkout, pip install -e '.[sim,pandas]'")):
        flown.frame()


def test_the_report_is_the_page_of_the_flight(flown: Result, tmp_path: Path) -> None:
    file = flown.report(tmp_path / "two.html")
    found = re.search(r'id="data">([^<]*)', file.read_text())
    assert found is not None
    document = unpack(found[1])
    assert document["figures"]["trace_hash"] == flown.summary["trace_hash"]
    assert [vehicle["id"] for vehicle in document["vehicles"]] == [1, 2]
    with pytest.raises(OSError, match="cannot be written"):
        flown.report(tmp_path / "absent" / "two.html")


@pytest.mark.skipif(browser_kit.WHY_NOT is not None, reason=str(browser_kit.WHY_NOT))
def test_a_notebook_shows_the_replay_offline_in_a_frame_that_cannot_reach_it(flown: Result, tmp_path: Path) -> None:
    notebook = tmp_path / "cell.html"
    notebook.write_text(f"<html data-ready='1'><body><script>secret = 7</script>{flown._repr_html_()}</body></html>")
    with Browser() as browser:
        browser.open(notebook)
        assert browser.run("return document.querySelector('iframe').contentDocument") is None  # another origin
        browser.frame(0)
        browser.wait("document.documentElement.dataset.ready !== undefined")
        assert browser.run("return document.querySelectorAll('canvas').length") > 0
        assert browser.run("try { return parent.secret } catch { return 'refused' }") == "refused"
        assert browser.requests() == []
        assert browser.console() == []


def test_the_package_loads_nothing_before_fly_is_asked_for() -> None:
    check = "import sys, sim_bridge; print(*(m for m in sys.modules if m.partition('.')[0] in sys.argv[1:]))"
    roots = ("numpy", "pydantic", "pandas", "mission", "companion", "sim_bridge")
    done = subprocess.run([sys.executable, "-c", check, *roots], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {"mission", "mission.common", "mission.common.compiled", "sim_bridge"}
    with pytest.raises(ImportError, match="hover"):
        from sim_bridge import hover  # noqa: F401  # type: ignore[attr-defined]


@pytest.mark.parametrize("package", ["mission", "companion", "sim_bridge"])
def test_each_package_says_that_it_is_typed(package: str) -> None:
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    assert "py.typed" in data[package]
    assert (ROOT / package / "py.typed").is_file()


def run_cell(source: str, names: dict[str, Any]) -> Any:
    """As a notebook runs a cell: the value of its last line, if that is an expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)


def check_notebook(notebook: Mapping[str, Any]) -> None:
    """What version 4.5 of the format wants of a notebook that was not run yet."""
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    assert set(notebook) == {"cells", "metadata", "nbformat", "nbformat_minor"}
    ids = [cell["id"] for cell in notebook["cells"]]
    assert all(re.fullmatch("[A-Za-z0-9_-]{1,64}", name) for name in ids)
    assert len(set(ids)) == len(ids)
    for cell in notebook["cells"]:
        extra = {"execution_count", "outputs"} if cell["cell_type"] == "code" else set()
        assert cell["cell_type"] in ("code", "markdown")
        assert set(cell) == {"cell_type", "id", "metadata", "source"} | extra
        assert all(isinstance(line, str) for line in cell["source"])
        assert all(line.endswith("\n") for line in cell["source"][:-1])
        assert cell.get("outputs", []) == []


def test_the_example_notebook_runs_as_it_stands() -> None:
    pytest.importorskip("pandas")
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    check_notebook(notebook)
    names: dict[str, Any] = {}
    answers = [run_cell("".join(c["source"]), names) for c in notebook["cells"] if c["cell_type"] == "code"]
    replayed, figures, speeds, leaders = answers
    assert "<iframe" in replayed._repr_html_()
    assert figures["verdict"] == "ARRIVED"
    assert 1.0 < speeds.loc[1, "transit"] < 3.5
    assert len(leaders) == 2  # the one that was killed, and its heir
