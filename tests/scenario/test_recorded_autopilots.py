"""The companion listens to recorded flights of real autopilots (tests/recordings): what it makes of them."""

from __future__ import annotations

import itertools
import lzma
import math
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import pytest

from companion.core.model.events import BootTime, Position
from companion.core.model.states import FlightState
from companion.core.model.vectors import add, scale
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.autopilot_state import Delay
from companion.core.vehicle.failsafe import Cause
from companion.mavlink import dialect
from companion.mavlink.endpoint import SYNC_S, Endpoint
from companion.mavlink.framing.frames import Framing, frames
from companion.mavlink.makes.make import REQUESTS
from mission.common.frames import LocalFrame, Wgs84
from tests.unit.core.core_kit import mission

LATE_S = failsafe_engine.row(Cause.TELEMETRY_LATE).delay_s

RECORDINGS = Path(__file__).parents[1] / "recordings"
ORIGIN = Wgs84(47.397742, 8.545594, 488.0)
TICK_S = 0.05
PACKET_MAX = 300  # bytes: more than a MAVLink 2 frame has
SETPOINT = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
FLIGHTS = sorted(path.name.removesuffix(".tlog.xz") for path in RECORDINGS.glob("*.tlog.xz"))


@dataclass
class Heard:
    """What a companion on the link knew, at which second of the recording."""

    make: str = ""
    ready_s: float = math.inf
    modes: list[tuple[str, bool, bool]] = field(default_factory=list)  # name, armed, failsafe; changes only
    mode_s: list[float] = field(default_factory=list)
    landed: list[int] = field(default_factory=list)
    states: list[FlightState] = field(default_factory=list)
    positions: int = 0
    furthest_off_m: float = 0.0  # own position from GLOBAL_POSITION_INT
    sent: set[object] = field(default_factory=set)  # setpoints and requests that move a vehicle
    said: list[str] = field(default_factory=list)
    dropped: int = 0
    bad: int = 0
    doubted: bool = False  # its origin, by its home
    reboots: int = 0


@cache
def listen(name: str, started_s: float = 0.0) -> Heard:
    """A companion of a swarm of three, started at this second, hears what the autopilot sent in this flight."""
    origin = {"lat_deg": ORIGIN.lat_deg, "lon_deg": ORIGIN.lon_deg, "alt_m": ORIGIN.alt_m}
    one = Endpoint(mission(swarm={"size": 3}, origin=origin), 1)
    frame, heard = LocalFrame(ORIGIN), Heard()
    ours, all_of_it = Framing({SETPOINT, dialect.MAVLINK_MSG_ID_COMMAND_LONG}), Framing()
    where: tuple[int, Position] | None = None
    next_s = started_s
    for now_s, packet in packets(name):
        if now_s < started_s:
            continue
        while next_s <= now_s:
            out = one.tick(next_s)
            heard.said += [say.text for say in out.said]
            for m in ours.parse(out.autopilot):
                heard.sent.add(SETPOINT if m.get_msgId() == SETPOINT else REQUESTS.get(m.command, "message"))
            next_s += TICK_S
            note(heard.states, one.agent.flight.state)
        one.from_autopilot(packet, now_s)
        heard.doubted |= one.codec.origin_doubted
        flight = one.agent.flight
        mode = flight.vehicle.mode
        if mode is not None and note(heard.modes, (mode.name, mode.armed, mode.failsafe)):
            heard.mode_s.append(now_s)
        note(heard.landed, int(flight.vehicle.landed))
        if flight.vehicle.ready_to_arm:
            heard.ready_s = min(heard.ready_s, now_s)
        for m in all_of_it.parse(packet):
            if m.get_msgId() == dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED and one.codec.origin_known:
                position = flight.vehicle.position
                assert position is not None
                assert all(map(math.isfinite, (*position.pos_ned_m, *position.vel_ned_mps)))
                where = (m.time_boot_ms, position)
                heard.positions += 1
            if m.get_msgId() == dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT and where is not None:
                truth = frame.to_ned(Wgs84(m.lat / 1e7, m.lon / 1e7, m.alt / 1e3))
                at, later_s = where[1], (m.time_boot_ms - where[0]) / 1e3
                if abs(later_s) <= 0.05 and heard.ready_s < now_s - 1.0:  # before, PX4's estimator still jumps
                    expected = add(at.pos_ned_m, scale(at.vel_ned_mps, later_s))
                    heard.furthest_off_m = max(heard.furthest_off_m, math.dist(truth, expected))
    heard.make = one.codec.make.name if one.codec.make is not None else ""
    heard.dropped, heard.bad, heard.reboots = one.codec.dropped, one.autopilot.bad, one.codec.reboots
    return heard


def packets(name: str) -> list[tuple[float, bytes]]:
    """(seconds, packet) of what the autopilot sent."""
    data = lzma.decompress((RECORDINGS / f"{name}.tlog.xz").read_bytes())
    found, at = [], 0
    while at < len(data):
        time_s = int.from_bytes(data[at : at + 8], "big") / 1e6
        start, end, _ = frames(data[at + 8 : at + 8 + PACKET_MAX], 0)[0]
        assert start == 0
        packet, at = data[at + 8 : at + 8 + end], at + 8 + end
        found.append((time_s, packet))
    first_s = found[0][0]
    return [(time_s - first_s, p) for time_s, p in found if (p[5], p[6]) == (1, 1) or p[0] == 0xFE]


def note(changes: list, value: object) -> bool:  # type: ignore[type-arg]
    """Keep `value` when it is news."""
    if changes and changes[-1] == value:
        return False
    changes.append(value)
    return True


@pytest.mark.parametrize("name", FLIGHTS)
def test_make_is_recognised_and_no_packet_is_bad(name: str) -> None:
    heard = listen(name)
    assert heard.make == ("PX4" if name.startswith("px4") else "ArduPilot")
    assert (heard.bad, heard.dropped) == (0, 0)


@pytest.mark.parametrize("name", FLIGHTS)
def test_what_a_make_says_of_its_home_makes_no_doubt_of_its_frame(name: str) -> None:
    heard = listen(name)
    assert (heard.doubted, heard.reboots) == (False, 0)


@pytest.mark.parametrize("name", FLIGHTS)
def test_companion_that_nobody_told_to_fly_only_listens(name: str) -> None:
    assert listen(name).sent <= {"message"}


@pytest.mark.parametrize("name", [name for name in FLIGHTS if name != "ap_mavsdk_A"])  # it never asked for SYS_STATUS
def test_ready_when_the_recorded_autopilot_was(name: str) -> None:
    ready_s = listen(name).ready_s
    assert 4.0 <= ready_s <= 4.8 if name.startswith("px4") else 40.4 <= ready_s <= 42.0


@pytest.mark.parametrize("name", FLIGHTS)
def test_positions_agree_with_the_autopilots_own_in_the_missions_frame(name: str) -> None:
    heard = listen(name)
    assert heard.positions > 100
    assert heard.furthest_off_m < 0.08  # the two messages are up to 0.05 s apart


AP_MODES = [("GUIDED", True, False), ("LAND", True, False), ("LAND", False, False)]


@pytest.mark.parametrize("name", ["ap_pymavlink_A", "ap_loss_comp245"])
def test_ardupilots_flight_is_one_in_guided(name: str) -> None:
    heard = listen(name)
    assert heard.modes[-3:] == AP_MODES
    assert [state for state in heard.landed if state] == [1, 3, 2, 4, 1]


@pytest.mark.parametrize(
    ("name", "mode", "at_s"),
    [
        ("px4_loss_sp_RCACT5", "AUTO.HOLD", 23.4),
        ("px4_loss_sp_RCACT4", "AUTO.LAND", 23.4),
        ("px4_loss_sp_RCACT3", "AUTO.RTL", 23.4),
        ("px4_loss_all", "POSCTL", 22.4),
        ("ap_loss_gcs255", "RTL", 58.3),
    ],
)
def test_failsafe_is_told_from_a_pilot(name: str, mode: str, at_s: float) -> None:
    heard = listen(name)
    failsafes = [(found, when) for found, when in zip(heard.modes, heard.mode_s, strict=True) if found[2]]
    assert failsafes[0][0] == (mode, True, True)
    assert failsafes[0][1] == pytest.approx(at_s, abs=1.0)


@pytest.mark.parametrize("name", ["px4_pymavlink_A", "px4_pymavlink_B", "px4_mavsdk_A"])
def test_px4s_flight_is_seen_in_order(name: str) -> None:
    heard = listen(name)
    armed = [found for found, is_armed, failsafe in heard.modes if is_armed and not failsafe]
    names = [found for found, _ in itertools.groupby(armed)]
    assert names[:3] == ["AUTO.TAKEOFF", "AUTO.HOLD", "OFFBOARD"]
    assert names[-1] == "AUTO.LAND"
    assert [state for state in heard.landed if state] == [1, 3, 2, 4, 1]


def test_companion_that_starts_in_a_failsafe_hold_waits_for_the_swarm() -> None:
    """Its first second of the recording is one in which PX4 holds because setpoints stopped."""
    heard = listen("px4_loss_sp_RCACT5", 25.0)
    assert heard.modes[0] == ("AUTO.HOLD", True, True)
    assert heard.states[0] is FlightState.WAITING
    assert "waiting: in the air: listening for the swarm" in heard.said
    assert heard.sent <= {"message"}


@pytest.mark.parametrize("name", ["px4_loss_sp_RCACT3", "px4_loss_all", "ap_loss_gcs255"])
def test_companion_that_starts_while_another_failsafe_acts_leaves_the_vehicle_to_it(name: str) -> None:
    heard = listen(name, 59.0 if name.startswith("ap") else 24.0)
    assert heard.states[:2] == [FlightState.WAITING, FlightState.RELEASED]
    assert heard.said[0].startswith("released: failsafe, mode ")
    assert heard.sent <= {"message"}


def lateness(name: str, *, answered: bool) -> list[float]:
    """How late the recorded positions were judged to be, s; with a TIMESYNC answer each SYNC_S, 50 ms under way."""
    delay, found, asked_s = Delay(), [], 0.0
    framing = Framing({dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED})
    for now_s, packet in packets(name):
        for m in framing.parse(packet):
            assert delay.accept_time(m.time_boot_ms / 1e3, now_s)
            found.append(delay.late_s)
            if answered and now_s - asked_s >= SYNC_S:
                asked_s = now_s
                delay.bound(BootTime(m.time_boot_ms / 1e3, 0.05), now_s)
    return found


@pytest.mark.parametrize("name", FLIGHTS)
def test_recorded_telemetry_is_not_late_although_simulators_clocks_run_slow(name: str) -> None:
    """In one flight the simulator stood still for 0.4 s, which an answer a moment later explains."""
    assert sum(late_s > LATE_S for late_s in lateness(name, answered=True)) <= 8


def test_px4s_simulated_clock_runs_so_slow_that_without_answers_it_would_look_late() -> None:
    assert sum(late_s > LATE_S for late_s in lateness("px4_pymavlink_B", answered=False)) > 1000


def test_recordings_have_what_these_tests_tell_apart() -> None:
    assert len(FLIGHTS) == 14
