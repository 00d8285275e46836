"""Entry points of laws: what is found, and what is said of one that is no law."""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import pytest

from sim_bridge.drive.entrant.installed import GROUP
from sim_bridge.drive.entrant.law import LawError, find_law, load_law
from tests.installed_kit import Site
from tests.unit.core.core_kit import mission

GOOD = """\
def start(mission, vehicle_id):
    return vehicle_id


def transit(memory, view):
    return (memory, 0, 0)
"""


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Site:
    monkeypatch.syspath_prepend(str(tmp_path))
    return Site(tmp_path)


def test_an_installed_law_is_found_by_its_name_and_goes_to_other_processes(site: Site) -> None:
    site.install("fine", GROUP, "gentle = installed_fine", installed_fine=GOOD)
    found = pickle.loads(pickle.dumps(find_law("gentle")))
    assert (found.name, found.path) == ("gentle", site.folder / "installed_fine.py")
    law = load_law(found)
    assert law.start(mission(), 7) == 7
    assert not law.covers


def test_an_entry_point_may_name_an_object(site: Site) -> None:
    text = "class Law:\n" + "".join(f"    {line}\n" for line in GOOD.replace("(m", "(self, m").splitlines())
    site.install("classy", GROUP, "classy = installed_classy:LAW", installed_classy=text + "\n\nLAW = Law()\n")
    assert load_law(find_law("classy")).start(mission(), 3) == 3


def test_a_package_may_have_parts(site: Site) -> None:
    package = site.folder / "installed_parts"
    package.mkdir()
    (package / "__init__.py").write_text("from .inner import start, transit\n", encoding="utf-8")
    (package / "inner.py").write_text(GOOD, encoding="utf-8")
    site.install("parts", GROUP, "parts = installed_parts")
    assert load_law(find_law("parts")).start(mission(), 2) == 2


@pytest.mark.parametrize(
    ("entry", "text", "message"),
    [
        ("bad = nowhere_at_all", GOOD, "there is no module nowhere_at_all with a file"),
        ("bad = nowhere.at_all", GOOD, "ModuleNotFoundError: No module named 'nowhere'"),
        ("bad = not a module", GOOD, "must be MODULE or MODULE:OBJECT"),
        ("bad = installed_bad_4:missing", GOOD, "cannot be imported: AttributeError"),
        ("bad = installed_bad_5", "\n\n1 / 0\n", "cannot be imported: ZeroDivisionError: division by zero, line 3"),
        ("bad = installed_bad_6", "start = transit = 3\n", "has no function start(mission, vehicle_id)"),
        ("bad = installed_bad_7", GOOD.replace("transit", "move"), "has no function transit(memory, view)"),
        (
            "bad = installed_bad_8",
            GOOD.replace("memory, view", "view"),
            "transit(view): must take transit(memory, view)",
        ),
        (
            "bad = installed_bad_9",
            GOOD + "\n\ndef cover():\n    return (0, 0, 0)\n",
            "cover(): must take cover(memory, view)",
        ),
    ],
)
def test_an_entry_point_that_is_no_law_is_named_with_its_package(
    site: Site, entry: str, text: str, message: str
) -> None:
    value = entry.partition(" = ")[2]
    site.install("wrong", GROUP, entry, **{value.partition(":")[0]: text} if value.startswith("installed") else {})
    named = f"law bad (entry point understory.laws: {value}, of wrong 1.2): "
    with pytest.raises(LawError, match="^" + re.escape(named + message)):
        load_law(find_law("bad"))


def test_what_goes_wrong_in_flight_names_the_entry_point_too(site: Site) -> None:
    site.install("late", GROUP, "late = installed_late", installed_late=GOOD.replace("vehicle_id\n", "1 / 0\n"))
    law = load_law(find_law("late"))
    with pytest.raises(
        LawError, match=r"^law late \(entry point .* of late 1\.2\): start: ZeroDivisionError.*, line 2"
    ):
        law.start(mission(), 1)


def test_a_name_that_two_packages_have_is_nobodys(site: Site) -> None:
    site.install("one", GROUP, "same = installed_one", installed_one=GOOD)
    site.install("two", GROUP, "same = installed_two", installed_two=GOOD)
    with pytest.raises(
        LawError, match=r"^law same: entry point understory\.laws of more than one package: one 1\.2, two"
    ):
        find_law("same")


def test_ours_stays_ours(site: Site) -> None:
    site.install("greedy", GROUP, "ours = installed_greedy", installed_greedy=GOOD)
    with pytest.raises(LawError, match=r"^law ours: entry point .* of greedy 1\.2: must have another name"):
        find_law("ours")


def test_an_unknown_name_lists_the_installed_laws(site: Site) -> None:
    site.install("a", GROUP, "beta = installed_beta\nalpha = installed_beta", installed_beta=GOOD)
    with pytest.raises(LawError, match=r"the name of an installed law \(alpha, beta\), or a module"):
        find_law("gamma")
