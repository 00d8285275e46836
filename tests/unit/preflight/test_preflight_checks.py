"""Every verdict of a preflight, from surveys made by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from companion.keys.fingerprints import epoch_fingerprint, fleet_fingerprint
from companion.mavlink.makes import MAKES
from companion.mavlink.makes.ardupilot import ARDUPILOT
from companion.mavlink.makes.make import Make
from companion.mavlink.makes.px4 import PX4
from companion.preflight.checks import ABOUT, judge
from companion.preflight.command import verdict_line
from companion.preflight.computer import check_disk, check_key, check_monotonic
from companion.preflight.fence import difference, fence_of
from companion.preflight.report import Check, Report, Verdict
from companion.preflight.survey import Parameter, Survey
from companion.preflight.table import table
from companion.sensors.table import SENSORS
from mission.document.model import Mission
from tests.unit.core.core_kit import mission
from tests.unit.keys.keys_kit import key_file, operator_of, secret_texts, vehicle_of

ME = 3
SQUARE = ((-50.0, -50.0), (200.0, -50.0), (200.0, 50.0), (-50.0, 50.0))
MISSION = mission(fence={"polygon_enu_m": SQUARE})
MESSAGES: dict[str, dict[str, Any]] = {
    "HEARTBEAT": {"base_mode": 29, "system_status": 3},
    "SYS_STATUS": {
        "onboard_control_sensors_health": 0x10000000,
        "battery_remaining": 90,
        "voltage_battery": 16200,
    },
    "EKF_STATUS_REPORT": {"flags": 0x33F},
    "GPS_RAW_INT": {"fix_type": 3, "satellites_visible": 10},
    "HOME_POSITION": {"latitude": 470000000, "longitude": 80000000, "altitude": 401000},
    "AUTOPILOT_VERSION": {"flight_sw_version": 17826047, "uid": 7, "uid2": [0] * 18},
}


def survey(make: Make | None = PX4, aimed: Mission = MISSION, **changes: Any) -> Survey:
    """Of a vehicle that is fit in every respect; `changes` to a message are merged into it."""
    messages = {name: MESSAGES[name] | changes.pop(name, {}) for name in MESSAGES}
    good: dict[str, Any] = {
        "heard": (ME,),
        "kind": None if make is None else make.key,
        "messages": messages,
        "window_s": 4.0,
        "counts": {
            "LOCAL_POSITION_NED": 80,
            "EXTENDED_SYS_STATE": 20,
            "SYS_STATUS": 4,
            "GPS_RAW_INT": 20,
            "EKF_STATUS_REPORT": 4,
        },
        "heartbeat_gap_s": 1.0,
        "clock_ahead_s": 0.1,
        "parameters": {r.name: Parameter(name=r.name, value=r.wanted) for r in make.rules(aimed)} if make else {},
        "fence": fence_of(aimed),
    }
    return Survey(**(good | changes))


def judged(seen: Survey, aimed: Mission = MISSION, *, apply: bool = False) -> dict[str, Check]:
    return {check.name: check for check in judge(seen, aimed, ME, apply=apply)}


def bad(seen: Survey, aimed: Mission = MISSION) -> dict[str, str]:
    """Name -> verdict of all that is not good."""
    return {name: check.verdict.value for name, check in judged(seen, aimed).items() if check.verdict != Verdict.PASS}


def with_parameter(seen: Survey, name: str, value: float | None) -> Survey:
    return seen.model_copy(update={"parameters": {**seen.parameters, name: Parameter(name=name, value=value)}})


@pytest.mark.parametrize("make", MAKES.values())
def test_fit_vehicle_passes(make: Make) -> None:
    assert bad(survey(make)) == {}


@pytest.mark.parametrize(
    ("make", "changes", "expected"),
    [
        (PX4, {"HEARTBEAT": {"base_mode": 29 | 128}}, {"disarmed": "fail"}),
        (PX4, {"HEARTBEAT": {"system_status": 1}}, {"ready": "fail"}),
        (PX4, {"SYS_STATUS": {"onboard_control_sensors_health": 0}}, {"ready": "fail"}),
        (ARDUPILOT, {"EKF_STATUS_REPORT": {"flags": 0x32F}}, {"ready": "fail"}),  # prearm is true, too early
        (ARDUPILOT, {"SYS_STATUS": {"onboard_control_sensors_health": 0}}, {"ready": "fail"}),
        (ARDUPILOT, {"HEARTBEAT": {"system_status": 1}}, {}),
        (PX4, {"GPS_RAW_INT": {"fix_type": 2}}, {"gps": "fail"}),
        (PX4, {"GPS_RAW_INT": {"satellites_visible": 5}}, {"gps": "fail"}),
        (PX4, {"GPS_RAW_INT": {"satellites_visible": 255}}, {"gps": "fail"}),  # not known
        (PX4, {"GPS_RAW_INT": {"fix_type": 99}}, {}),
        (PX4, {"SYS_STATUS": {"battery_remaining": 49}}, {"battery": "fail"}),
        (PX4, {"SYS_STATUS": {"battery_remaining": 50}}, {}),
        (PX4, {"SYS_STATUS": {"battery_remaining": -1}}, {"battery": "fail"}),
        (PX4, {"SYS_STATUS": {"voltage_battery": 0xFFFF}}, {"battery": "fail"}),
        (PX4, {"SYS_STATUS": {"voltage_battery": 0}}, {"battery": "fail"}),
        (PX4, {"HOME_POSITION": {"latitude": 470010000}}, {"home": "fail"}),  # 111 m north
        (PX4, {"HOME_POSITION": {"latitude": 470005000}}, {"home": "fail"}),  # 56 m north: outside the fence
        (PX4, {"HOME_POSITION": {"altitude": 389000}}, {"home": "fail"}),
        (
            PX4,
            {"counts": {"LOCAL_POSITION_NED": 60, "EXTENDED_SYS_STATE": 20, "SYS_STATUS": 4, "GPS_RAW_INT": 20}},
            {"link": "fail"},
        ),
        (PX4, {"counts": {"LOCAL_POSITION_NED": 66, "EXTENDED_SYS_STATE": 15, "SYS_STATUS": 3, "GPS_RAW_INT": 20}}, {}),
        (PX4, {"counts": {}}, {"link": "fail"}),
        (
            ARDUPILOT,
            {"counts": {"LOCAL_POSITION_NED": 80, "EXTENDED_SYS_STATE": 20, "SYS_STATUS": 4, "GPS_RAW_INT": 20}},
            {"link": "fail"},
        ),
        (PX4, {"heartbeat_gap_s": 2.1}, {"heartbeat": "fail"}),
        (PX4, {"clock_ahead_s": -3.0}, {"clock": "warn"}),
        (PX4, {"clock_ahead_s": None}, {"clock": "warn"}),
        (PX4, {"heard": (ME, 4)}, {"id": "warn"}),
        (PX4, {"heard": (4,)}, {"id": "fail"}),
        (None, {}, {"autopilot": "fail"}),
        (PX4, {"fence": None, "fence_error": "unsupported"}, {"fence": "fail"}),
        (PX4, {"fence": ()}, {"fence": "fail"}),
    ],
)
def test_each_fault_fails_its_own_check(make: Make | None, changes: dict[str, Any], expected: dict[str, str]) -> None:
    assert bad(survey(make, **changes)) == expected


@pytest.mark.parametrize("name", ["GPS_RAW_INT", "HOME_POSITION"])
def test_silence_fails(name: str) -> None:
    seen = survey()
    seen.messages.pop(name)
    assert list(bad(seen).values()) == ["fail"]


RETURNS = {  # what each failsafe does with these values is return, or retrace
    PX4: {
        "COM_OBL_RC_ACT": (3,),
        "NAV_RCL_ACT": (2,),
        "NAV_DLL_ACT": (2,),
        "COM_LOW_BAT_ACT": (1, 3),
        "COM_FLTT_LOW_ACT": (3,),
        "COM_POS_LOW_ACT": (3,),
        "GF_ACTION": (3,),
    },
    ARDUPILOT: {
        "FS_GCS_ENABLE": (1, 2, 3, 4, 6),
        "FS_THR_ENABLE": (1, 2, 4, 5, 6),
        "FS_DR_ENABLE": (2, 3, 4, 6),
        "BATT_FS_LOW_ACT": (2, 3, 4, 6),
        "BATT_FS_CRT_ACT": (2, 3, 4, 6),
        "FENCE_ACTION": (1, 3, 5),
    },
}


@pytest.mark.parametrize(
    ("make", "name", "value"),
    [(k, name, value) for k, table in RETURNS.items() for name, values in table.items() for value in values],
)
def test_nothing_may_return_to_launch(make: Make, name: str, value: int) -> None:
    assert bad(with_parameter(survey(make), name, value)) == {name: "fail"}


@pytest.mark.parametrize(("make", "name"), [(k, rule.name) for k in MAKES.values() for rule in k.canopy_rules])
def test_parameter_that_the_autopilot_lacks_is_said(make: Make, name: str) -> None:
    optional = next(rule for rule in make.canopy_rules if rule.name == name).optional
    check = judged(with_parameter(survey(make), name, None))[name]
    assert check.verdict is (Verdict.WARN if optional else Verdict.FAIL)
    assert "none here" in check.found


def test_what_apply_sets_is_good_and_read_back_as_a_float32_still_is() -> None:
    for make in MAKES.values():
        for rule in make.rules(MISSION):
            assert rule.fits(rule.wanted)
            assert rule.why
    timeout = next(rule for rule in PX4.canopy_rules if rule.name == "COM_OF_LOSS_T")
    assert timeout.fits(0.5000000001)
    assert not timeout.fits(0.51)


def test_older_name_of_a_parameter_is_told() -> None:
    seen = survey(ARDUPILOT)
    older = {**seen.parameters, "MAV_GCS_SYSID": Parameter(name="SYSID_MYGCS", value=255)}
    check = judged(seen.model_copy(update={"parameters": older}))["MAV_GCS_SYSID"]
    assert (check.verdict, check.found) == (Verdict.PASS, "255 (as SYSID_MYGCS)")


def test_ceiling_is_the_missions() -> None:
    low = mission(fence={"altitude_max_m": 20.0})
    assert bad(survey(aimed=MISSION), low) == {"GF_MAX_VER_DIST": "fail", "fence": "fail"}
    assert bad(survey(ARDUPILOT, MISSION), low) == {"FENCE_TYPE": "fail", "FENCE_ALT_MAX": "fail", "fence": "fail"}
    assert bad(survey(ARDUPILOT, low), low) == {}


def test_applied_and_refused_are_told() -> None:
    seen = with_parameter(survey(applied={"GF_ACTION": 2}, refused={"NAV_RCL_ACT": "timeout"}), "NAV_RCL_ACT", 2)
    rows = judged(seen, apply=True)
    assert rows["GF_ACTION"].found == "2, set just now"
    assert rows["NAV_RCL_ACT"].found == "2, cannot be set: timeout"
    assert "--apply" not in rows["NAV_RCL_ACT"].fix
    assert "--apply" in judged(seen)["NAV_RCL_ACT"].fix


# --- the fence ---


def test_fence_is_where_the_mission_says() -> None:
    vertices = fence_of(MISSION)
    assert [vertex.count for vertex in vertices] == [4.0] * 4
    north_m = (vertices[2].lat_e7 - vertices[1].lat_e7) / 1e7 * 111_174.0
    east_m = (vertices[1].lon_e7 - vertices[0].lon_e7) / 1e7 * 76_055.0
    assert (north_m, east_m) == pytest.approx((100.0, 250.0), rel=1e-3)
    assert fence_of(mission()) == ()


def test_fence_across_the_date_line_stays_within_180_degrees() -> None:
    there = mission(origin={"lon_deg": 180.0}, fence={"polygon_enu_m": SQUARE})
    longitudes = [vertex.lon_e7 for vertex in fence_of(there)]
    assert all(abs(lon_e7) <= 1_800_000_000 for lon_e7 in longitudes)
    assert min(longitudes) < 0 < max(longitudes)


@pytest.mark.parametrize(
    ("change", "same"),
    [({"lat_e7": 1}, True), ({"lon_e7": -1}, True), ({"lat_e7": 2}, False), ({"lon_e7": -2}, False)],
)
def test_fence_is_compared_vertex_by_vertex_to_one_unit(change: dict[str, int], same: bool) -> None:
    wanted = fence_of(MISSION)
    moved = wanted[2].model_copy(update={key: getattr(wanted[2], key) + by for key, by in change.items()})
    found = (*wanted[:2], moved, wanted[3])
    assert (difference(found, wanted) == "") is same
    assert same or "item 3" in difference(found, wanted)


def test_fence_with_other_items_or_another_order_is_not_the_missions() -> None:
    wanted = fence_of(MISSION)
    assert difference(wanted[:3], wanted) == "3 items instead of 4"
    assert difference((*wanted, wanted[0]), wanted) == "5 items instead of 4"
    assert "item 1" in difference(wanted[::-1], wanted)
    assert "exclusion" in difference((wanted[0].model_copy(update={"command": 5002}), *wanted[1:]), wanted)
    assert difference((wanted[0].model_copy(update={"count": 3.0}), *wanted[1:]), wanted)
    assert difference((), ()) == ""


# --- this computer ---


@pytest.fixture
def _dumpable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.preflight.computer.harden_process", lambda: "")


@pytest.mark.usefixtures("_dumpable")
def test_key_of_this_vehicle_passes_with_its_fingerprints_and_none_is_a_warning(tmp_path: Path) -> None:
    keyring = vehicle_of(operator_of(4, epochs=(255, 0)), ME)
    path = key_file(tmp_path / "key", keyring)
    check = check_key(str(path), ME, 4)
    assert check.verdict is Verdict.PASS
    epochs = f"0 {epoch_fingerprint(keyring.secrets[0])} and 255 {epoch_fingerprint(keyring.secrets[255])} (active)"
    assert check.found == f"vehicle {ME}, fleet {fleet_fingerprint(keyring)}, epoch {epochs}"
    assert check_key(str(path), None).verdict is Verdict.PASS
    assert not [part for part in secret_texts(keyring) if part in check.model_dump_json()]
    none = check_key(None, ME)
    assert none.verdict is Verdict.WARN
    assert "flies UNSIGNED (--unsigned)" in none.fix


@pytest.mark.usefixtures("_dumpable")
def test_key_that_is_not_this_vehicles_or_not_its_alone_fails_with_the_reason(tmp_path: Path) -> None:
    def why(path: Path, owner: int = ME) -> str:
        check = check_key(str(path), owner)
        assert check.verdict is Verdict.FAIL
        return check.found

    path = key_file(tmp_path / "key", vehicle_of(operator_of(4), ME))
    assert "No such file" in why(tmp_path / "none")
    assert "not a regular file" in why(tmp_path)
    assert f"owner: is vehicle {ME}: must be vehicle 2" in why(path, 2)
    path.chmod(0o640)
    assert "mode 0640" in why(path)
    path.chmod(0o600)
    path.write_bytes(bytes(range(32)))  # what a key was before
    assert "is not TOML" in why(path)


@pytest.mark.usefixtures("_dumpable")
def test_vehicles_of_the_mission_without_a_key_are_a_warning(tmp_path: Path) -> None:
    operator = operator_of(4)
    fleet = replace(operator, vehicles={k: key for k, key in operator.vehicles.items() if k != 2})
    check = check_key(str(key_file(tmp_path / "key", vehicle_of(fleet, ME))), ME, 6)
    assert check.verdict is Verdict.WARN
    assert check.found.endswith("; no key of vehicle 2, 5, 6")


def test_computer_with_a_key_makes_no_core_dump(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    monkeypatch.setattr("companion.preflight.computer.harden_process", lambda: calls.append("harden"))
    monkeypatch.setattr("companion.preflight.computer.load_keyring", lambda *_: calls.append("load") or operator_of())
    check_key(str(tmp_path), ME)
    assert calls == ["harden", "load"]


def test_disk_and_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.preflight.computer.DISK_FREE_MIN_BYTES", 1)
    assert check_disk(tmp_path).verdict is Verdict.PASS
    monkeypatch.setattr("companion.preflight.computer.DISK_FREE_MIN_BYTES", 10**18)
    assert check_disk(tmp_path).verdict is Verdict.FAIL
    assert check_disk(tmp_path / "none").verdict is Verdict.FAIL
    assert check_monotonic().verdict is Verdict.PASS


# --- what is printed ---


def test_table_has_a_row_for_each_check_the_fix_of_each_fault_and_one_verdict() -> None:
    checks = tuple(judge(survey(heartbeat_gap_s=2.5, clock_ahead_s=None), MISSION, ME, apply=False))
    report = Report(
        verdict=Verdict.FAIL,
        time_unix_s=0.0,
        time_utc="",
        mission="lone tree",
        mission_sha256="",
        vehicle_id=ME,
        checks=checks,
    )
    lines = table(report.checks).splitlines()
    assert all(any(line.startswith(f"{check.name} ") for line in lines) for check in checks)
    assert sum("-> " in line for line in lines) == 2
    assert verdict_line(report) == f"FAIL: vehicle 3: 1 of {len(checks)} checks: heartbeat (1 warning)"
    passed = report.model_copy(update={"checks": checks[:2]})
    assert verdict_line(passed) == "PASS: vehicle 3 is fit for lone tree"


def test_every_check_is_in_the_reference() -> None:
    names = set(judged(survey())) | {
        "mission",
        "aiding",
        "height",
        "odometry",
        *SENSORS,
        "key",
        "signing",
        "disk",
        "monotonic",
    }
    assert names - {rule.name for rule in PX4.rules(MISSION)} == set(ABOUT)
