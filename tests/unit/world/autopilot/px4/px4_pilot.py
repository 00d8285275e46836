"""A pilot on the wire who flies a PX4 autopilot on a point mass."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame, Wgs84
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import BatterySpec, Link, Px4Autopilot, StreamProfile

ORIGIN = Wgs84(47.3977, 8.5456, 488.0)
STEP_S = 0.05
NAN = math.nan
ARM, SET_MODE, TAKEOFF, LAND, RTL, REPOSITION = 400, 176, 22, 21, 20, 192
OFFBOARD = (1.0, 6.0)
HOLD = (1.0, 4.0, 3.0)
ACCEPTED, REJECTED = 0, 1


class Pilot:
    """A companion that flies one vehicle and keeps a log of what it hears."""

    def __init__(self, parameters: Mapping[str, float] | None = None, battery: BatterySpec | None = None) -> None:
        self.body = PointMass((12.0, -7.0, 0.0), 0.5)
        links = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}
        self.autopilot = Px4Autopilot(
            3, self.body, LocalFrame(ORIGIN), parameters=parameters, links=links, battery=battery
        )
        self.codec = mav.MAVLink(None, srcSystem=3, srcComponent=191)
        self.steps = 0
        self.landed_states: list[int] = []
        self.modes: list[tuple[int, int]] = []  # custom_mode, system_status of HEARTBEAT
        self.acks: list[tuple[int, int]] = []
        self.texts: list[str] = []
        self.log = b""
        self.command(511, 245.0, 50_000.0)

    @property
    def now_s(self) -> float:
        return self.steps * STEP_S

    @property
    def height_m(self) -> float:
        return -self.body.state.pos_ned_m[2]

    @property
    def speed_ned_mps(self) -> tuple[float, float, float]:
        return self.body.state.vel_ned_mps

    @property
    def mode(self) -> str:
        return self.autopilot.snapshot.mode

    @property
    def armed(self) -> bool:
        return self.autopilot.snapshot.armed

    def send(self, message: Any) -> None:
        self.autopilot.receive(Link.ONBOARD, message.pack(self.codec), self.now_s)

    def command(self, number: int, *params: float) -> int:
        """The result in the acknowledgement."""
        self.send(mav.MAVLink_command_long_message(3, 1, number, 0, *params, *[0.0] * (7 - len(params))))
        self._listen()
        assert self.acks[-1][0] == number
        return self.acks[-1][1]

    def fly(self, seconds: float, velocity: tuple[float, float, float] | None = None) -> None:
        """With a velocity setpoint at 20 Hz, or without."""
        for _ in range(round(seconds / STEP_S)):
            if velocity is not None:
                self.send(
                    mav.MAVLink_set_position_target_local_ned_message(
                        0, 3, 1, 1, 0x5C7, 0, 0, 0, *velocity, 0, 0, 0, 0, 0
                    )
                )
            self.autopilot.update(self.now_s)
            self.body.step(STEP_S)
            self.steps += 1
            self._listen()

    def fly_until_disarmed(self, at_most_s: float) -> float:
        """Seconds it took."""
        begin_s = self.now_s
        while self.armed:
            assert self.now_s - begin_s < at_most_s
            self.fly(STEP_S)
        return self.now_s - begin_s

    def _listen(self) -> None:
        for link in Link:
            for datagram in self.autopilot.transmit(link, self.now_s):
                self.log += datagram
                for message in mav.MAVLink(None).parse_buffer(datagram) or []:
                    self._note(link, message)

    def _note(self, link: Link, message: Any) -> None:
        kind = message.get_type()
        if kind == "STATUSTEXT":
            self.texts.append(message.text.rstrip("\t"))
        if link is Link.GROUND:
            return
        if kind == "COMMAND_ACK":
            self.acks.append((message.command, message.result))
        elif kind == "EXTENDED_SYS_STATE" and self.landed_states[-1:] != [message.landed_state]:
            self.landed_states.append(message.landed_state)
        elif kind == "HEARTBEAT":
            shown = (message.custom_mode, message.system_status)
            if self.modes[-1:] != [shown]:
                self.modes.append(shown)

    def take_off(self, height_m: float = 5.0) -> Pilot:
        self.fly(5.0)
        assert self.command(ARM, 1.0) == ACCEPTED
        assert self.command(TAKEOFF, NAN, 0, 0, NAN, NAN, NAN, ORIGIN.alt_m + height_m) == ACCEPTED
        self.fly(6.0 + height_m)
        assert self.mode == "HOLD"
        return self

    def go_offboard(self, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Pilot:
        self.fly(0.2, (0.0, 0.0, 0.0))
        assert self.command(SET_MODE, *OFFBOARD) == ACCEPTED
        self.fly(3.0, velocity)
        return self
