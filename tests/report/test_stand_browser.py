"""The forester's page, stand/report.html, in Chromium: on a desk and a phone, light and dark, and its link."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_page_browser import browser  # noqa: F401  (a fixture)

from companion.stand.products.write import write_products
from mission.document.model import Mission
from sim_bridge import cli
from sim_bridge.judge.run_folder import STAND_FOLDER, STAND_REPORT
from tests.report import browser_kit
from tests.report.browser_kit import Browser
from tests.unit.stand.stand_kit import Survey, records_of, regular_stand, rows_of

pytestmark = pytest.mark.skipif(browser_kit.WHY_NOT is not None, reason=str(browser_kit.WHY_NOT))
MISSION = {
    "schema": 1,
    "name": "north stand",
    "route": {"d1_enu_m": (0.0, 0.0, 5.0), "d2_enu_m": (40.0, 30.0, 5.0), "vel_leader_mps": 1.0},
    "swarm": {"size": 2},
    "fence": {
        "altitude_min_m": 2.0,
        "altitude_max_m": 9.0,
        "polygon_enu_m": ((-30.0, -30.0), (90.0, -30.0), (90.0, 80.0), (-30.0, 80.0)),
    },
}


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of products."""
    folder = tmp_path_factory.mktemp("stand")
    survey = Survey(seed=4, vehicles=4)
    trees = regular_stand(4, 400.0, east_m=40.0, north_m=30.0)
    records = records_of(trees, rows_of((0.0, 0.0), (40.0, 30.0), survey), survey)
    write_products(records, Mission.model_validate(MISSION), folder)
    return folder


@pytest.fixture
def page(browser: Browser) -> Iterator[Browser]:  # noqa: F811
    yield browser
    assert (browser.requests(), browser.console()) == ([], [])


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_the_report_fits_and_nothing_of_it_is_a_barrier(page: Browser, stand: Path, width: int, dark: bool) -> None:
    page.dark(dark)
    page.screen(width, 844, mobile=width < 500)
    page.open(stand / "report.html", scripted=False)
    assert page.run("return document.documentElement.scrollWidth") <= width
    assert page.run("return document.querySelectorAll('figure circle').length") > 20
    if browser_kit.WHY_NOT_AXE is None:
        assert page.barriers() == []


def test_the_engineers_page_leads_to_the_foresters(page: Browser, run: Path, stand: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(run, tmp_path / "run")
    shutil.copytree(stand, folder / STAND_FOLDER)
    cli.main(["report", str(folder)])
    page.screen(1280, 800)
    page.open(folder / "report.html")
    links = "return [...document.querySelectorAll('header a')].map((one) => one.getAttribute('href'))"
    assert page.run(links) == [STAND_REPORT]
    cli.main(["report", str(folder), "--out", str(tmp_path / "elsewhere.html")])
    page.open(tmp_path / "elsewhere.html")
    assert page.run(links) == []
