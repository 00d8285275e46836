"""What a preflight's report allows a companion to do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from companion.preflight import computer
from companion.preflight.report import AGE_MAX_S, AHEAD_MAX_S, Check, Now, Report, Verdict, clearance, write_report
from mission.document.load import mission_sha256

NOW_S = 1_800_000_000.0
NOW = Now(NOW_S, "b007", 20_000.0)
GOOD = Check(name="battery", verdict=Verdict.PASS, found="90 %", wanted="at least 50 %")
BAD = Check(name="GF_ACTION", verdict=Verdict.FAIL, found="3", wanted="2")
WORSE = Check(name="home", verdict=Verdict.FAIL, found="none", wanted="near d1")
DOUBTFUL = Check(name="clock", verdict=Verdict.WARN, found="off", wanted="set")


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    path = tmp_path / "m.toml"
    path.write_text("schema = 1\n")
    return path


def report(mission: Path, *checks: Check, **changes: Any) -> str:
    failed = any(check.verdict is Verdict.FAIL for check in checks)
    fields: dict[str, Any] = {
        "verdict": Verdict.FAIL if failed else Verdict.PASS,
        "time_unix_s": NOW_S - 3600.0,
        "time_utc": "2027-01-15T07:00:00Z",
        "mission": "a mission",
        "mission_sha256": mission_sha256(mission),
        "vehicle_id": 3,
        "checks": checks,
    }
    path = mission.with_name("report.json")
    write_report(Report(**{**fields, **changes}), path)
    return str(path)


def replace(check: Check, name: str) -> Check:
    return check.model_copy(update={"name": name})


def grounded(mission: Path, file: str | None, *waived: str) -> str:
    return clearance(file, waived, str(mission), 3, now=NOW, is_clock_set=lambda: True).grounded


def test_passing_report_clears_and_a_warning_does_not_ground(mission: Path) -> None:
    cleared = clearance(report(mission, GOOD, DOUBTFUL), (), str(mission), 3, now=NOW, is_clock_set=lambda: True)
    assert (cleared.grounded, cleared.waived) == ("", ())


def test_without_a_report_nothing_is_armed_unless_all_is_waived(mission: Path) -> None:
    assert "no preflight" in grounded(mission, None)
    assert "no preflight" in grounded(mission, None, "battery")
    assert clearance(None, ("all",), str(mission), 3, now=NOW, is_clock_set=lambda: True).waived == ("all",)
    assert grounded(mission, None, "all") == ""


def test_failed_checks_ground_until_each_is_waived_by_name(mission: Path) -> None:
    file = report(mission, GOOD, BAD, WORSE)
    assert grounded(mission, file) == "preflight failed: GF_ACTION,home"
    assert grounded(mission, file, "home", "battery") == "preflight failed: GF_ACTION"
    cleared = clearance(file, ("home", "battery", "GF_ACTION"), str(mission), 3, now=NOW, is_clock_set=lambda: True)
    assert (cleared.grounded, cleared.waived, cleared.unknown) == ("", ("GF_ACTION", "home"), "")


def test_check_that_this_flight_needs_grounds_where_it_is_not_in_the_report(mission: Path) -> None:
    def cleared(*checks: Check, waived: tuple[str, ...] = ()) -> str:
        file, path = report(mission, *checks), str(mission)
        return clearance(file, waived, path, 3, now=NOW, is_clock_set=lambda: True, needs=("signing",)).grounded

    assert cleared(GOOD) == "preflight failed: signing"
    assert cleared(GOOD, waived=("signing",)) == ""
    assert cleared(GOOD, replace(GOOD, "signing")) == ""
    assert cleared(GOOD, replace(BAD, "signing")) == "preflight failed: signing"


def test_name_that_is_no_check_is_told_and_waives_nothing(mission: Path) -> None:
    told = "waive: no check named 'bogus', 'hom'"
    cleared = clearance(
        report(mission, GOOD, WORSE), ("bogus", "hom"), str(mission), 3, now=NOW, is_clock_set=lambda: True
    )
    assert (cleared.grounded, cleared.unknown) == (f"preflight failed: home; {told}", told)
    cleared = clearance(
        report(mission, GOOD, WORSE), ("bogus", "home"), str(mission), 3, now=NOW, is_clock_set=lambda: True
    )
    assert (cleared.grounded, cleared.unknown) == ("", "waive: no check named 'bogus'")


@pytest.mark.parametrize(
    ("age_s", "word"),
    [(0.0, ""), (AGE_MAX_S, ""), (AGE_MAX_S + 1.0, "12 h old"), (-AHEAD_MAX_S, ""), (-AHEAD_MAX_S - 1.0, "to come")],
)
def test_old_report_grounds(mission: Path, age_s: float, word: str) -> None:
    why = grounded(mission, report(mission, GOOD, time_unix_s=NOW_S - age_s))
    assert bool(why) == bool(word)
    assert word in why


@pytest.mark.parametrize(("age_s", "word"), [(0.0, ""), (AGE_MAX_S, ""), (AGE_MAX_S + 1.0, "12 h old"), (-1e3, "come")])
def test_report_of_this_boot_is_as_old_as_the_boot_tells_whatever_the_wall_clock_does(
    mission: Path, age_s: float, word: str
) -> None:
    now = Now(0.0, "b007", 90_000.0)
    file = report(mission, GOOD, boot_id="b007", boot_s=now.boot_s - age_s)
    for is_set in (True, False, None):
        why = clearance(file, (), str(mission), 3, now=now, is_clock_set=lambda told=is_set: told).grounded
        assert bool(why) == bool(word)
        assert word in why


@pytest.mark.parametrize("boot_id", ["b006", ""])
@pytest.mark.parametrize("is_set", [True, False, None])
def test_report_of_an_earlier_boot_is_believed_by_a_clock_that_is_set_alone(
    mission: Path, boot_id: str, is_set: bool | None
) -> None:
    """A board without a battery for its clock goes on from its shutdown: the report seems an hour old, in any year."""
    file = report(mission, GOOD, boot_id=boot_id, boot_s=1.0)
    why = clearance(file, (), str(mission), 3, now=NOW, is_clock_set=lambda: is_set).grounded
    believed = is_set or (is_set is None and not boot_id)  # a report of a version before, where nobody tells
    assert bool(why) != believed
    assert believed or ("reboot" if boot_id else "older version") in why
    assert believed or "run it again" in why


def test_boots_that_are_not_known_are_not_one(mission: Path) -> None:
    file, unknown = report(mission, GOOD), Now(NOW_S, "", 20_000.0)
    assert "older version" in clearance(file, (), str(mission), 3, now=unknown, is_clock_set=lambda: False).grounded


def test_a_boot_has_one_name_by_the_kernel_and_in_the_service(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "boot_id"
    file.write_text("12345678-9abc-def0-1234-56789abcdef0\n")
    monkeypatch.setattr(computer, "BOOT_ID", file)
    by_kernel = computer.now()
    file.unlink()
    monkeypatch.setenv("UNDERSTORY_BOOT_ID", "123456789abcdef0123456789abcdef0")
    by_service = computer.now()
    assert by_kernel.boot_id == by_service.boot_id == "123456789abcdef0123456789abcdef0"
    assert by_kernel.boot_s <= by_service.boot_s
    monkeypatch.delenv("UNDERSTORY_BOOT_ID")
    assert computer.now().boot_id == ""


def test_report_is_of_one_vehicle_and_of_one_mission_to_the_byte(mission: Path) -> None:
    assert "vehicle 2" in grounded(mission, report(mission, GOOD, vehicle_id=2))
    file = report(mission, GOOD)
    mission.write_text("schema = 1 \n")
    assert "another mission" in grounded(mission, file)


@pytest.mark.parametrize("text", ["", "{}", "[1]", "\0\xff", '{"format": 2}', "{" * 100_000])
def test_unreadable_report_grounds_and_does_not_raise(mission: Path, text: str) -> None:
    file = mission.with_name("report.json")
    file.write_bytes(text.encode("latin-1"))
    assert "not readable" in grounded(mission, str(file))
    assert "not readable" in grounded(mission, str(mission.parent))
    assert "No such file" in grounded(mission, str(mission.with_name("none.json")))


def test_failed_report_without_a_failed_check_grounds(mission: Path) -> None:
    assert "not readable" in grounded(mission, report(mission, GOOD, verdict=Verdict.FAIL))


def test_report_replaces_the_old_one_and_leaves_nothing_else(mission: Path) -> None:
    report(mission, BAD)
    report(mission, GOOD)
    assert sorted(path.name for path in mission.parent.iterdir()) == ["m.toml", "report.json"]
    with pytest.raises(OSError, match="Not a directory"):
        write_report(Report.model_validate_json(mission.with_name("report.json").read_bytes()), mission / "x")
