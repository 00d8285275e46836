"""Makes of autopilot: what every entry must hold, and that a third one flies by its entry alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from companion.core.model.actions import Say
from companion.core.model.states import FlightMode, FlightState, Request
from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import Framing
from companion.mavlink.makes import MAKES, make_of
from companion.mavlink.makes.make import REQUESTS, Altitude, Command, Make, Rule
from companion.mavlink.makes.px4 import PX4
from companion.mavlink.streams import FIX_HZ, streams_hz
from companion.preflight.checks import judge
from companion.preflight.report import Verdict
from companion.preflight.survey import Parameter, Survey
from mission.common.frames import Vec3
from mission.document.model import Mission
from tests.unit.core.core_kit import mission
from tests.unit.core.ranging_kit import ranging_mission

TICK_S = 0.05
TOY_AUTOPILOT = 77  # no MAV_AUTOPILOT of anybody
ALTITUDE_M = 8.0
HELD, STEERED, LANDS = 100, 200, 300  # custom modes
UNSTEERED = {0: "MANUAL", HELD: "STAY", STEERED: "STEERED", LANDS: "DOWN"}


def toys_command(request: Request, altitude: Altitude) -> Command:
    match request:
        case Request.ARM:
            return dialect.MAV_CMD_COMPONENT_ARM_DISARM, (1,)
        case Request.OFFBOARD:
            return dialect.MAV_CMD_DO_SET_MODE, (1, STEERED)
        case Request.TAKEOFF:
            return dialect.MAV_CMD_NAV_TAKEOFF, (0, 0, 0, 0, 0, 0, altitude.above_home_m)
        case Request.LAND:
            return dialect.MAV_CMD_NAV_LAND, (LANDS,)


TOY = Make(
    key="toy",
    name="Toy",
    autopilot=TOY_AUTOPILOT,
    traits=replace(PX4.traits, takeoff=(Request.ARM, Request.OFFBOARD, Request.TAKEOFF), climbs_in=FlightMode.OFFBOARD),
    modes={HELD: FlightMode.HOLD, STEERED: FlightMode.OFFBOARD, LANDS: FlightMode.LAND},
    mode_names=UNSTEERED,
    command=toys_command,
    streams_hz={dialect.MAVLINK_MSG_ID_ALTITUDE: 2},
    reception_hz={},
    ready_ekf_flags=0,
    ready_state=dialect.MAV_STATE_STANDBY,
    ready_about="as it likes",
    id_parameter="TOY_ID",
    serial_parameters="TOY_BAUD",
    canopy_rules=(Rule("TOY_LOST", {1: "stay"}, "It would come home."),),
    satellite_rules=(),
    odometry_rules=lambda _: (),
    fence_rules=lambda _mission: (),
)


@pytest.fixture
def third(monkeypatch: pytest.MonkeyPatch) -> Make:
    monkeypatch.setitem(MAKES, TOY.key, TOY)
    return TOY


class ToyAutopilot:
    """Obeys what it is told in its own modes, and moves as its setpoints say. Streams only what it was asked for."""

    def __init__(self) -> None:
        self.custom_mode, self.armed, self.taken_off = 0, False, False
        self.pos_ned_m: Vec3 = (0.0, 0.0, 0.0)
        self.vel_ned_mps: Vec3 = (0.0, 0.0, 0.0)
        self.climbs_to_m = 0.0
        self.asked: list[int] = []  # commands, in their order, but for streams
        self.streams: set[int] = set()
        self._framing = Framing()
        self._sender = wire.Sender(1, dialect.MAV_COMP_ID_AUTOPILOT1)
        self._answers: list[bytes] = []

    def hear(self, data: bytes) -> None:
        for incoming in self._framing.read_messages(data):
            m, message_id = incoming.message, incoming.message_id
            if message_id == dialect.MAVLINK_MSG_ID_COMMAND_LONG:
                self._obey(m)
            elif message_id == dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED and self.custom_mode == STEERED:
                self.vel_ned_mps = (m.vx, m.vy, m.vz)

    def _obey(self, m: Any) -> None:
        match m.command:
            case dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
                self.streams.add(int(m.param1))
                return
            case dialect.MAV_CMD_REQUEST_MESSAGE:
                return
            case dialect.MAV_CMD_COMPONENT_ARM_DISARM:
                self.armed = True
            case dialect.MAV_CMD_DO_SET_MODE:
                self.custom_mode = int(m.param2)
            case dialect.MAV_CMD_NAV_TAKEOFF:
                assert self.custom_mode == STEERED
                self.taken_off, self.climbs_to_m = True, m.param7
            case dialect.MAV_CMD_NAV_LAND:
                self.custom_mode = int(m.param1)
        self.asked.append(m.command)
        self._answers.append(self._sender.pack(dialect.MAVLink_command_ack_message(m.command, 0)))

    def step(self) -> None:
        up_m = -self.pos_ned_m[2]
        climbs = self.taken_off and up_m < self.climbs_to_m - 0.1
        if not self.taken_off or self.custom_mode == HELD:
            self.vel_ned_mps = (0.0, 0.0, 0.0)
        elif climbs:
            self.vel_ned_mps = (0.0, 0.0, -2.0)
        elif self.custom_mode == LANDS:
            self.vel_ned_mps = (0.0, 0.0, 1.0 if up_m > 0.05 else 0.0)
            self.armed &= up_m > 0.05
        if not climbs:
            self.climbs_to_m = 0.0
        x, y, z = (p + v * TICK_S for p, v in zip(self.pos_ned_m, self.vel_ned_mps, strict=True))
        self.pos_ned_m = (x, y, min(0.0, z))

    def says(self, tick: int) -> bytes:
        told: list[Any] = [
            dialect.MAVLink_local_position_ned_message(tick * 50, *self.pos_ned_m, *self.vel_ned_mps),
            dialect.MAVLink_extended_sys_state_message(
                0, 1 if self.pos_ned_m[2] > -0.1 else 3 if self.climbs_to_m else 2
            ),
        ]
        if tick % 20 == 0:
            status = dialect.MAV_STATE_ACTIVE if self.armed else dialect.MAV_STATE_STANDBY
            told += [
                dialect.MAVLink_heartbeat_message(2, TOY_AUTOPILOT, 128 * self.armed, self.custom_mode, status, 3),
                dialect.MAVLink_sys_status_message(0, 0, 1 << 28, 0, 0, 0, 90, 0, 0, 0, 0, 0, 0),
                dialect.MAVLink_gps_global_origin_message(470_000_000, 80_000_000, 400_000, 0),
                dialect.MAVLink_home_position_message(470_000_000, 80_000_000, 400_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0),
            ]
        answers, self._answers = self._answers, []
        return b"".join(answers) + b"".join(map(self._sender.pack, told))


def flown(seconds: float, *, start_s: float = 5.0, land_s: float = 1e9) -> tuple[Endpoint, ToyAutopilot, list[Say]]:
    """A swarm of one, started after `start_s` and told to land after `land_s`; all that it said."""
    endpoint, toy = Endpoint(mission(swarm={"size": 1}), 1), ToyAutopilot()
    endpoint.agent.waive("all")
    said = []
    for tick in range(int(seconds / TICK_S)):
        now_s = 10.0 + tick * TICK_S
        toy.step()
        endpoint.from_autopilot(toy.says(tick), now_s)
        for at_s, order in ((start_s, dialect.MAV_CMD_MISSION_START), (land_s, dialect.MAV_CMD_NAV_LAND)):
            if tick == int(at_s / TICK_S):
                command = dialect.MAVLink_command_long_message(1, 191, order, 0, 0, 0, 0, 0, 0, 0, 0)
                endpoint.from_autopilot(wire.pack(command, seq=0, system=255, component=190), now_s)
        out = endpoint.tick(now_s)
        said += out.said
        toy.hear(out.autopilot)
    return endpoint, toy, said


def test_entries_are_told_apart_and_ask_by_the_commands_that_answers_are_known_by() -> None:
    assert all(make.key == key for key, make in MAKES.items())
    assert len({make.autopilot for make in MAKES.values()}) == len(MAKES)
    for make in MAKES.values():
        assert make_of(make.autopilot) is make
        assert FlightMode.OFFBOARD in make.modes.values()
        assert set(make.modes) <= set(make.mode_names)
        for request in Request:
            assert REQUESTS[make.command(request, Altitude(408.0, 8.0))[0]] is request


def test_without_its_entry_a_third_make_is_unknown_and_never_armed() -> None:
    _, toy, _ = flown(20.0)
    assert (toy.armed, toy.asked) == (False, [])


@pytest.mark.usefixtures("third")
def test_third_make_flies_by_its_entry_alone() -> None:
    _, toy, said = flown(60.0, land_s=40.0)
    assert toy.asked == [
        dialect.MAV_CMD_COMPONENT_ARM_DISARM,
        dialect.MAV_CMD_DO_SET_MODE,
        dialect.MAV_CMD_NAV_TAKEOFF,
        dialect.MAV_CMD_NAV_LAND,
    ]
    assert toy.streams == {dialect.MAVLINK_MSG_ID_ALTITUDE, *FIX_HZ}  # the others come unasked
    assert toy.pos_ned_m[1] > 50.0  # it was on its way to d2, in the east
    assert said[-1].text == "landed"


@pytest.mark.usefixtures("third")
def test_modes_of_a_third_make_are_called_by_its_own_names() -> None:
    endpoint, toy, _ = flown(30.0)
    assert endpoint.agent.flight.state is FlightState.TRANSIT
    toy.custom_mode = 0
    endpoint.from_autopilot(toy.says(20), 40.0)
    assert any("mode MANUAL" in say.text for say in endpoint.tick(40.0).said)


def test_preflight_judges_a_third_make_by_its_entry(third: Make) -> None:
    fenced: Mission = mission()
    messages = {
        "HEARTBEAT": {"base_mode": 0, "system_status": 3, "autopilot": TOY_AUTOPILOT},
        "SYS_STATUS": {"onboard_control_sensors_health": 1 << 28},
    }
    seen = Survey(
        heard=(1,),
        kind=third.key,
        messages=messages,
        window_s=4.0,
        parameters={"TOY_LOST": Parameter(name="TOY_LOST", value=0)},
        fence=(),
    )
    rows = {check.name: check for check in judge(seen, fenced, 1, apply=False)}
    assert (rows["autopilot"].verdict, rows["ready"].verdict) == (Verdict.PASS, Verdict.PASS)
    assert (rows["TOY_LOST"].verdict, rows["TOY_LOST"].wanted) == (Verdict.FAIL, "1 (stay)")
    assert dialect.MAVLINK_MSG_ID_ALTITUDE in streams_hz(third)


@pytest.mark.parametrize(
    ("key", "name", "with_them", "without"),
    [
        ("px4", "EKF2_GPS_CTRL", 7, 0),
        ("ardupilot", "EK3_SRC1_POSXY", 3, 0),
    ],
)
def test_the_leader_must_use_satellites_and_the_others_must_not(
    key: str, name: str, with_them: int, without: int
) -> None:
    """Parameters are copied from vehicle to vehicle: this one differs."""
    flown = ranging_mission()
    wanted = [{rule.name: rule.wanted for rule in MAKES[key].rules(flown, k)}.get(name) for k in (1, 2)]
    assert wanted == [with_them, without]
    everywhere = mission()
    assert name not in {rule.name for rule in MAKES[key].rules(everywhere, 1)}
