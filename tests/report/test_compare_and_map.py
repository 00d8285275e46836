"""Two flights in one page, and the reader's own map under a flight: what is written, and what Chromium shows of it."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import pytest
from test_page_browser import browser, pixels  # noqa: F401  (a fixture)

from mission.document.load import load_mission
from sim_bridge import cli
from sim_bridge.judge.metrics import FIGURES
from tests.flights import flown, short_mission
from tests.report import browser_kit
from tests.report.browser_kit import Browser
from tests.unit.watch.watch_kit import mbtiles

GREEN, RED = (20, 140, 60), (200, 30, 30)
in_chromium = pytest.mark.skipif(browser_kit.WHY_NOT is not None, reason=str(browser_kit.WHY_NOT))


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another flight of two, in the open."""
    folder = tmp_path_factory.mktemp("other")
    flown(short_mission(swarm={"size": 2}), folder)
    return folder


def png(colour: tuple[int, int, int]) -> bytes:
    import io

    from PIL import Image

    data = io.BytesIO()
    Image.new("RGB", (256, 256), colour).save(data, "PNG")
    return data.getvalue()


def map_of(path: Path, lat_deg: float, lon_deg: float, zooms: tuple[int, ...] = (15, 16)) -> Path:
    """Tiles about a place: green, and red on its east."""
    tiles = {}
    for zoom in zooms:
        side = 1 << zoom
        x = int((lon_deg + 180.0) / 360.0 * side)
        y = int((1.0 - math.asinh(math.tan(math.radians(lat_deg))) / math.pi) / 2.0 * side)
        for dx in range(-3, 4):
            for dy in range(-3, 4):
                tiles[zoom, x + dx, y + dy] = png(RED if dx > 1 else GREEN)
    return mbtiles(path, tiles, attribution="(c) the forester")


def test_figures_of_two_flights_stand_side_by_side_with_their_difference(
    run: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "both.html"
    code = cli.main(["report", str(run), "--against", str(other), "--out", str(file), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert code in (0, 1)
    assert [flight["name"] for flight in found["flights"]] == ["A", "B"]
    figures = {row["name"]: row for row in found["figures"]}
    separation = next(figure for figure in FIGURES if figure.name == "min_separation_m")
    one = figures[separation.heading]
    told = [json.loads((folder / "metrics.json").read_bytes())["min_separation_m"] for folder in (run, other)]
    assert [one["a"], one["b"]] == pytest.approx(told)
    assert one["difference"] == pytest.approx(told[1] - told[0])
    assert one["better"] == ("B" if told[1] > told[0] else "A")
    changes = next(row for name, row in figures.items() if name.startswith("changes of the leader"))
    assert (changes["a"], changes["b"], changes["better"]) == (1.0, 0.0, "B")


def test_the_program_says_what_differs_before_the_figures(
    run: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cli.main(["report", str(run), "--against", str(other), "--out", str(tmp_path / "both.html")])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "They flew in different stands: trees are those of A."
    assert any(line.startswith("A flew 3 vehicles, B 2.") for line in lines)
    assert lines[-1] == f"both: {tmp_path / 'both.html'}"
    cli.main(["report", str(run), "--against", str(run), "--out", str(tmp_path / "same.html")])
    assert "different" not in capsys.readouterr().out


@in_chromium
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_both_are_replayed_together_and_nothing_of_it_is_a_barrier(
    browser: Browser,  # noqa: F811
    run: Path,
    other: Path,
    tmp_path: Path,
    dark: bool,
) -> None:
    file = tmp_path / "both.html"
    cli.main(["report", str(run), "--against", str(other), "--out", str(file)])
    browser.dark(dark)
    browser.screen(1280, 900)
    browser.open(file, "#t=25")
    assert browser.run("return document.querySelectorAll('.comparison .verdict').length") == 2
    assert browser.run("return document.querySelectorAll('table.vehicles').length") == 2
    settle = "return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
    for tab, view in enumerate(("canvas.flat", ".space canvas")):
        browser.run("document.querySelectorAll('.tabs button')[arguments[0]].click()", tab)
        browser.wait(f"document.querySelector('{view}')")
        browser.run(settle)
        both = pixels(browser, view).copy()
        browser.run("document.querySelector('input[name=against]').click()")
        browser.run(settle)
        assert (pixels(browser, view) != both).any()  # B is not drawn any more
        browser.run("document.querySelector('input[name=against]').click()")
    if browser_kit.WHY_NOT_AXE is None:
        browser.run("for (const one of document.querySelectorAll('details')) one.open = true")
        assert browser.barriers() == []
    browser.screen(390, 844, mobile=True)
    browser.wait("document.documentElement.scrollWidth <= 390")
    assert (browser.requests(), browser.console()) == ([], [])


@in_chromium
def test_a_map_lies_under_the_flight_where_it_belongs_and_in_the_page_itself(
    browser: Browser,  # noqa: F811
    run: Path,
    tmp_path: Path,
) -> None:
    origin = load_mission(run / "mission.toml").origin
    assert origin is not None
    file = tmp_path / "report.html"
    plan = map_of(tmp_path / "stand.mbtiles", origin.lat_deg, origin.lon_deg)
    assert cli.main(["report", str(run), "--map", str(plan), "--out", str(file)]) in (0, 1)
    plan.unlink()
    browser.dark(False)
    browser.screen(1280, 800)
    browser.open(file, "#t=40")
    for name in ("crowns", "scans", "ranges"):
        browser.run("document.querySelector(`input[name=${arguments[0]}]`).click()", name)
    browser.run("return new Promise((done) => setTimeout(done, 300))")  # pictures are decoded beside the page
    seen = pixels(browser, "canvas.flat").reshape(-1, 3)
    assert ((abs(seen.astype(int) - GREEN) < 3).all(axis=1)).mean() > 0.5
    assert browser.run("return document.querySelector('.credit').textContent") == "(c) the forester"
    if browser_kit.WHY_NOT_AXE is None:
        assert browser.barriers() == []
    assert (browser.requests(), browser.console()) == ([], [])


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--map", "{elsewhere}"], "has no tile where the flight was, about 47."),
        (["--map", "{missing}"], "no such file"),
        (["--utm", "32N"], "--utm 32N: is for an image that --map names"),
        (["--map", "{elsewhere}", "--utm", "forest"], "--utm forest: must be a zone"),
        (["--against", "{missing}"], "must be the folder of a flight"),
    ],
)
def test_a_map_or_flight_that_does_not_fit_is_refused_with_its_name(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], reason: str
) -> None:
    elsewhere = map_of(tmp_path / "elsewhere.mbtiles", -33.0, 151.0)
    named = [option.format(elsewhere=elsewhere, missing=tmp_path / "none.mbtiles") for option in options]
    before = shutil.copytree(run, tmp_path / "run")
    assert cli.main(["report", str(before), *named, "--out", str(tmp_path / "page.html")]) == 2
    assert reason in capsys.readouterr().err
    assert not (tmp_path / "page.html").exists()
