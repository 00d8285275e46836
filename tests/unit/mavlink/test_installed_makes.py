"""Makes of installed packages: flown by their entry point, and what is said of one that is no make."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import pytest

from companion import doctor
from companion.mavlink.makes import MAKES, load_installed_makes, make_of
from companion.mavlink.makes.installed import GROUP, load_makes, wrongs_of
from companion.preflight.report import Verdict
from companion.run_command import EXIT_REFUSED, RefusedError, mission_of
from mission.common.entry_points import EntryPointError
from tests.installed_kit import Site
from tests.unit.mavlink.test_makes import TOY, TOY_AUTOPILOT

GOOD = "from tests.unit.mavlink.test_makes import TOY\nfrom dataclasses import replace\n\nMINE = replace(TOY)\n"


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Site:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("companion.mavlink.makes.MAKES", dict(MAKES))
    monkeypatch.setattr("companion.doctor.MAKES", dict(MAKES))
    return Site(tmp_path)


def test_our_own_makes_are_makes() -> None:
    for name, make in MAKES.items():
        others = {key: other for key, other in MAKES.items() if key != name}
        assert list(wrongs_of(make, name, others)) == []


def test_an_installed_make_is_known_by_its_heartbeat_once_loaded(site: Site) -> None:
    site.install("toys", GROUP, "toy = toys_1:MINE", toys_1=GOOD)
    assert make_of(TOY_AUTOPILOT) is None
    load_installed_makes()
    load_installed_makes()  # as a second mission of the same process does
    found = make_of(TOY_AUTOPILOT)
    assert found is not None
    assert found.name == TOY.name


@pytest.mark.parametrize(
    ("value", "change", "message"),
    [
        ("nowhere_3:MINE", "", "cannot be imported: ModuleNotFoundError"),
        ("toys_{}", "", "is of type module: must be a companion.mavlink.makes.make.Make"),
        ("toys_{}:MINE", "key='other'", "key = 'other': must be the entry point's name, 'toy'"),
        ("toys_{}:MINE", "autopilot=12", "autopilot = 12: PX4 has the same"),
        ("toys_{}:MINE", "autopilot='PX4'", "autopilot = 'PX4': must be of type int"),
        ("toys_{}:MINE", "traits=None", "traits = None: must be of type AutopilotTraits"),
        ("toys_{}:MINE", "fence_rules=()", "fence_rules: must be a function"),
        ("toys_{}:MINE", "modes={}", "modes: has no OFFBOARD"),
        ("toys_{}:MINE", "command=lambda r: (400, ())", "command(ARM): TypeError: "),
        ("toys_{}:MINE", "command=lambda r, a: (400, ())", "command(OFFBOARD) = 400, (): must be 176"),
    ],
)
def test_an_entry_point_that_is_no_make_is_named_with_its_package(
    site: Site, value: str, change: str, message: str, request: pytest.FixtureRequest
) -> None:
    module = f"toys_{abs(hash(request.node.name))}"
    value = value.format(module.removeprefix("toys_"))
    site.install("wrong", GROUP, f"toy = {value}", **{module: GOOD.replace("replace(TOY)", f"replace(TOY, {change})")})
    named = f"toy (entry point understory.makes: {value}, of wrong 1.2): "
    with pytest.raises(EntryPointError, match="^" + re.escape(named)) as caught:
        load_makes(dict(MAKES))
    assert message in str(caught.value)


def test_a_companion_refuses_to_start_beside_a_broken_one(site: Site) -> None:
    site.install("broken", GROUP, "toy = toys_2:MINE", toys_2="1 / 0\n")
    with pytest.raises(RefusedError, match=r"^make of autopilot toy \(entry point .* of broken 1\.2\)") as caught:
        mission_of(argparse.Namespace(mission="none.toml", id=1))
    assert caught.value.code == EXIT_REFUSED
    (row,) = doctor.packages()
    assert (row.verdict, "toy (entry point" in row.found) == (Verdict.FAIL, True)
