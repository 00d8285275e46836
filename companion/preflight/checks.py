"""From a survey to verdicts. Pure: a row for each thing that was looked at."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from companion.mavlink import dialect
from companion.mavlink.makes import MAKES
from companion.mavlink.makes.make import Aid, Make, Rule
from companion.mavlink.streams import RATE_MIN_SHARE, fastest_hz, receiver_hz, reception_counts, streams_hz
from companion.preflight.fence import difference, fence_of
from companion.preflight.report import Check, Verdict
from companion.preflight.survey import Survey
from companion.sensors.table import SENSORS, autopilot_hz
from mission.common.frames import LocalFrame, Wgs84
from mission.common.plane import clearance_m
from mission.document.model import Mission

BATTERY_MIN_PERCENT = 50  # a flight ends at 20 (no leadership) and 10 (landing)
VOLTAGE_MIN_V = 3.0  # less than one cell: nothing is measured
FIX_MIN, SATELLITES_MIN = 3, 6  # a 3D fix, and two satellites more than it needs
HOME_D1_MAX_M = 100.0  # level; vehicles take off about d1
HOME_HEIGHT_MAX_M = 10.0  # from the origin's ground: heights in the mission count from there
HEARTBEAT_GAP_MAX_S = 2.0  # one may be late; after 3 s the companion takes the autopilot for lost
CLOCK_MAX_S = 2.0
PREARM_BIT = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
UNKNOWN_VOLTAGE_MV = 0xFFFF
UNKNOWN_SATELLITES = 0xFF
# What each check is about, for the reference; those of parameters are named as the parameters.
ABOUT = {
    "mission": "The file is valid and has an [origin]; its SHA-256 is what the report is for.",
    "id": "The autopilot's system id is --id. A warning: other autopilots are on the link too.",
    "autopilot": " or ".join(make.name for make in MAKES.values())
    + ", by its HEARTBEAT; version and hardware id go into the report.",
    "disarmed": "By its HEARTBEAT. An armed vehicle is not changed.",
    "ready": " ".join(f"{make.name}: {make.ready_about}." for make in MAKES.values()),
    "gps": f"At least a 3D fix, and {SATELLITES_MIN} satellites.",
    "battery": f"Measured, and at least {BATTERY_MIN_PERCENT} %: a flight ends at 20 (no leadership) and 10 (landing).",
    "home": f"Within {HOME_D1_MAX_M:.0f} m of d1, within {HOME_HEIGHT_MAX_M:.0f} m of the height of the origin's "
    "ground, and inside the fence: else it is another site's mission, or a wrong altitude.",
    "link": f"What the companion needs comes at {RATE_MIN_SHARE * 100:.0f} % or more of the rates asked for.",
    "heartbeat": f"Never more than {HEARTBEAT_GAP_MAX_S:g} s between two; after 3 s a companion takes its autopilot "
    "for lost.",
    "clock": f"A warning: this computer's clock is more than {CLOCK_MAX_S:g} s off GPS time. No flight goes by it; "
    "logs do.",
    **{name: kind.ABOUT for name, kind in SENSORS.items()},
    "aiding": "Of a vehicle without GNSS (`swarm.gnss`). "
    + " ".join(f"{make.name}: {', or '.join(aid.text for aid in make.aids)}." for make in MAKES.values())
    + " Read only: preflight does not know which sensor it carries.",
    "height": "Of a mission with layers of height (`separation.height_layers`): a downward range finder holds it. "
    + " ".join(f"{make.name}: {', or '.join(aid.text for aid in make.height_aids)}." for make in MAKES.values())
    + " Read only.",
    "odometry": "Of a vehicle with GNSS whose companion sends it a velocity (`sensing.sends_odometry`): it is used. "
    + " ".join(f"{make.name}: {', or '.join(aid.text for aid in make.odometry_aids)}." for make in MAKES.values())
    + " Read only.",
    "fence": "The polygon on the autopilot is the mission's, vertex by vertex, to 1e-7 degrees; without one there is "
    "none on the autopilot.",
    "key": "[This vehicle's key file](../how-to/keys.md), mode 0600, this user's (or root's). It shows fingerprints of "
    "the fleet's public keys and of each epoch's secret: the same on every vehicle. A warning: none was given, or the "
    "fleet has no key of a vehicle of the mission.",
    "signing": "With `--sign-autopilot` ([how](../how-to/sign-the-autopilot-link.md)): frames of the autopilot come "
    "signed by this vehicle's key; requests that are unsigned, or signed by another key, get no answer; one by the key "
    "does. Without: only where the autopilot signs, and has told none of its parameters; then it fails.",
    "disk": "500 MB free where the report goes, or here.",
    "monotonic": "The clock that the flight goes by has steps of a millisecond or less.",
}
AIDING_FIX = (
    "switch on the sensor that it carries: nothing else tells it how it moves. --apply does not: it cannot know"
)
ODOMETRY_FIX = "set it to use the companion's velocity, or fly with sensing.sends_odometry = false"
HEIGHT_FIX = "set the range finder that it carries up; without one fly with separation.height_layers = false"
FIXES = ("no GPS", "no fix", "2D", "3D", "DGPS", "RTK float", "RTK fixed", "static", "PPP")


def judge(survey: Survey, mission: Mission, vehicle_id: int, *, apply: bool) -> Iterator[Check]:
    """All rows about the autopilot. `apply`: the survey was to set what is wrong."""
    yield _id(survey, vehicle_id)
    if vehicle_id not in survey.heard:
        return
    yield _make(survey)
    make = survey.make
    if make is None:
        return
    yield _disarmed(survey)
    satellites = mission.has_satellites(vehicle_id)
    yield _ready(survey, make, satellites=satellites)
    if satellites:
        yield _gps(survey)
    yield _battery(survey)
    if satellites:
        yield _home(survey, mission)
    yield _link(survey, mission, vehicle_id)
    yield _heartbeat(survey)
    yield _clock(survey)
    for rule in make.rules(mission, vehicle_id):
        yield _parameter(survey, rule, apply=apply)
    for name, needed, fix in (
        ("aiding", make.aids_of(mission, vehicle_id), AIDING_FIX),
        ("height", make.height_aids_of(mission), HEIGHT_FIX),
        ("odometry", make.odometry_aids_of(mission, vehicle_id), ODOMETRY_FIX),
    ):
        if needed:
            yield _aiding(survey, name, needed, fix)
    yield _fence(survey, mission, apply=apply)


def _check(name: str, good: bool, found: str, wanted: str, fix: str = "", *, doubt: bool = False) -> Check:
    bad = Verdict.WARN if doubt else Verdict.FAIL
    return Check(name=name, verdict=Verdict.PASS if good else bad, found=found, wanted=wanted, fix="" if good else fix)


def _id(survey: Survey, vehicle_id: int) -> Check:
    wanted = f"system id {vehicle_id}"
    if vehicle_id not in survey.heard:
        there = ", ".join(map(str, survey.heard))
        parameters = ", ".join(f"{make.id_parameter} ({make.name})" for make in MAKES.values())
        fix = f"give the vehicle's own --id, or set {parameters} and reboot"
        return _check("id", False, f"system id {there}", wanted, fix)
    others = [k for k in survey.heard if k != vehicle_id]
    found = f"system id {vehicle_id}" + (f", and {', '.join(map(str, others))} on the same link" if others else "")
    return _check("id", not others, found, wanted, "is the link meant to be shared?", doubt=True)


def _make(survey: Survey) -> Check:
    kind, version = survey.kind, survey.version
    found = (
        "another kind" if kind is None else f"{kind} {version or 'of unknown version'}, uid {survey.uid or 'unknown'}"
    )
    return _check("autopilot", kind is not None, found, " or ".join(MAKES), "no other autopilot is flown")


def _disarmed(survey: Survey) -> Check:
    return _check("disarmed", not survey.armed, "armed" if survey.armed else "disarmed", "disarmed", "disarm it")


def _ready(survey: Survey, make: Make, *, satellites: bool) -> Check:
    """The true readiness of each make; see `Preflight` in the how-to guides."""
    prearm = bool(survey.messages.get("SYS_STATUS", {}).get("onboard_control_sensors_health", 0) & PREARM_BIT)
    good, found, wanted = [prearm], [f"pre-arm checks {'passed' if prearm else 'not passed'}"], ["passed"]
    if make.ready_state is not None:
        state = survey.messages.get("HEARTBEAT", {}).get("system_status")
        good.append(state == make.ready_state)
        found.append(f"state {state}")
        name = dialect.enums["MAV_STATE"][make.ready_state].name.removeprefix("MAV_STATE_").lower()
        wanted.append(f"state {make.ready_state} ({name})")
    if make.ready_ekf_flags:
        flags = survey.messages.get("EKF_STATUS_REPORT", {}).get("flags")
        positioned = flags is not None and (
            flags & make.ready_ekf_flags == make.ready_ekf_flags
            or (not satellites and bool(flags & dialect.EKF_POS_HORIZ_REL))
        )
        good.append(positioned)
        found.append("position known" if positioned else "estimator silent" if flags is None else "position not known")
        wanted.append("position known")
    fix = "wait; the autopilot's own texts say what is missing (a ground station shows them)"
    return _check("ready", all(good), ", ".join(found), ", ".join(wanted), fix)


def _gps(survey: Survey) -> Check:
    told = survey.messages.get("GPS_RAW_INT")
    wanted = f"3D fix, {SATELLITES_MIN} satellites"
    if told is None:
        return _check("gps", False, "silent", wanted, "is a GPS fitted? Else --waive gps")
    fix, satellites = told["fix_type"], told["satellites_visible"]
    name = FIXES[fix] if fix < len(FIXES) else f"fix {fix}"
    if satellites == UNKNOWN_SATELLITES:
        return _check("gps", False, f"{name}, satellites not counted", wanted, "does the receiver tell? --waive gps")
    good = fix >= FIX_MIN and satellites >= SATELLITES_MIN
    return _check("gps", good, f"{name}, {satellites} satellites", wanted, "wait, or move away from the trees")


def _battery(survey: Survey) -> Check:
    told = survey.messages.get("SYS_STATUS", {})
    percent, millivolts = told.get("battery_remaining", -1), told.get("voltage_battery", UNKNOWN_VOLTAGE_MV)
    known = percent >= 0 and millivolts != UNKNOWN_VOLTAGE_MV
    found = f"{percent} %, {millivolts / 1000:.1f} V" if known else "not measured"
    good = known and percent >= BATTERY_MIN_PERCENT and millivolts / 1000 >= VOLTAGE_MIN_V
    fix = "charge it" if known else "set the battery monitor up: low battery is a failsafe"
    return _check("battery", good, found, f"at least {BATTERY_MIN_PERCENT} %", fix)


def _home(survey: Survey, mission: Mission) -> Check:
    told = survey.messages.get("HOME_POSITION")
    wanted = f"within {HOME_D1_MAX_M:.0f} m of d1, {HOME_HEIGHT_MAX_M:.0f} m of the origin's height, inside the fence"
    if told is None:
        return _check("home", False, "not set", wanted, "wait for a GPS fix")
    assert mission.origin is not None
    home = Wgs84(told["latitude"] / 1e7, told["longitude"] / 1e7, told["altitude"] / 1e3)
    north_m, east_m, down_m = LocalFrame(mission.origin.wgs84).to_ned(home)
    d1 = mission.route.d1_enu_m
    apart_m = math.hypot(east_m - d1[0], north_m - d1[1])
    polygon = mission.fence.polygon_enu_m
    outside = polygon is not None and clearance_m((east_m, north_m), polygon) <= 0.0
    good = apart_m <= HOME_D1_MAX_M and abs(down_m) <= HOME_HEIGHT_MAX_M and not outside
    found = f"{apart_m:.0f} m from d1, {-down_m:+.1f} m" + (", outside the fence" if outside else "")
    return _check(
        "home", good, found, wanted, "the right mission? Its [origin] and d1 say where; alt_m is of the ground"
    )


def _link(survey: Survey, mission: Mission, vehicle_id: int) -> Check:
    """Streams that the companion needs, at the rates it has asked for."""
    parts, slow, absent = [], False, []
    reception = reception_counts(mission, vehicle_id)
    own_hz = fastest_hz(receiver_hz(mission, vehicle_id), autopilot_hz(mission))
    asked_hz = streams_hz(survey.make, sensors_hz=own_hz, reception=reception)
    for message_id, rate_hz in asked_hz.items():
        name = dialect.mavlink_map[message_id].msgname
        count = survey.counts.get(name, 0)
        slow |= count + 1 < RATE_MIN_SHARE * rate_hz * survey.window_s
        if not count:
            absent.append(name)
        parts.append(f"{name} {count / survey.window_s:.3g}")
    wanted = ", ".join(f"{rate_hz:g}" for rate_hz in asked_hz.values())
    found = f"{', '.join(parts)} Hz; {sum(survey.counts.values()) / survey.window_s:.0f} messages/s"
    fix = "on a serial link that is nearly full: a faster port (921600 baud), or fewer other streams"
    if absent and survey.counts:
        fix = f"{', '.join(absent)} not sent: no position yet, or not supported"
    return _check("link", not slow, found, f"{wanted} Hz", fix)


def _heartbeat(survey: Survey) -> Check:
    gap_s = survey.heartbeat_gap_s
    return _check(
        "heartbeat",
        gap_s <= HEARTBEAT_GAP_MAX_S,
        f"longest gap {gap_s:.1f} s",
        f"at most {HEARTBEAT_GAP_MAX_S:g} s",
        "a loose cable, or a link that is too slow?",
    )


def _clock(survey: Survey) -> Check:
    """A doubt only: nothing in flight goes by the wall clock."""
    ahead_s = survey.clock_ahead_s
    found = "the autopilot has no time" if ahead_s is None else f"this computer {ahead_s:+.1f} s of the autopilot's"
    good = ahead_s is not None and abs(ahead_s) <= CLOCK_MAX_S
    wanted = f"within {CLOCK_MAX_S:g} s of GPS time"
    fix = "set the one that is wrong (here: timedatectl, chrony): logs are compared by it. A simulator's is not real"
    return _check("clock", good, found, wanted, fix, doubt=True)


def _parameter(survey: Survey, rule: Rule, *, apply: bool) -> Check:
    there = survey.parameters[rule.name]
    if there.value is None:
        fix = f"look for it with a ground station; a firmware without it may do what it prevents. {rule.why}"
        return _check(rule.name, False, "none here, or no answer", rule.text, fix, doubt=rule.optional)
    found = f"{there.value:g}" + (f" (as {there.name})" if there.name != rule.name else "")
    if rule.name in survey.applied:
        found += ", set just now"
    elif rule.name in survey.refused:
        found += f", cannot be set: {survey.refused[rule.name]}"
    return _check(rule.name, rule.fits(there.value), found, rule.text, rule.why if apply else f"--apply. {rule.why}")


def _aiding(survey: Survey, name: str, aids: Sequence[Aid], fix: str) -> Check:
    """One of `aids` is switched on. --apply never does that: it cannot know what the vehicle carries."""
    parameters = dict.fromkeys(parameter for aid in aids for parameter in aid.names)
    values = {key: survey.parameters[key].value for key in parameters if key in survey.parameters}
    told = [f"{key} {'not there' if values.get(key) is None else f'{values[key]:g}'}" for key in parameters]
    wanted = ", or ".join(aid.text for aid in aids)
    return _check(name, any(aid.is_on(values) for aid in aids), ", ".join(told), wanted, fix)


def _fence(survey: Survey, mission: Mission, *, apply: bool) -> Check:
    wanted = fence_of(mission)
    words = f"the mission's {len(wanted)} vertices" if wanted else "none"
    if survey.fence is None:
        return _check(
            "fence", False, f"cannot be read: {survey.fence_error}", words, "does this firmware have a fence?"
        )
    wrong = difference(survey.fence, wanted)
    found = wrong or words
    if "fence" in survey.applied:
        found += ", set just now"
    elif "fence" in survey.refused:
        found += f", cannot be set: {survey.refused['fence']}"
    return _check("fence", not wrong, found, words, "see the autopilot's texts" if apply else "--apply")
