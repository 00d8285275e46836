"""A simulated PX4 on a body of point mass, as a client on the wire sees it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame, Vec3
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot import (
    BatterySpec,
    Link,
    Px4Autopilot,
    StreamProfile,
)
from sim_bridge.world.autopilot.estimates.gnss_faults import FaultyGnss
from tests.unit.world.autopilot.autopilot_kit import NAN, ORIGIN, STEP_S, Wire

MINIMAL = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
ARM, SET_MODE, TAKEOFF, LAND, RTL, REPOSITION, SET_INTERVAL, REQUEST = 400, 176, 22, 21, 20, 192, 511, 512
OFFBOARD = (1.0, 6.0)
HOLD = (1.0, 4.0, 3.0)


class Body:
    """An airframe that takes every velocity at once; the ground is at down = 0."""

    def __init__(self, pos_ned_m: Vec3 = (20.0, -10.0, 0.0)) -> None:
        self.pos = pos_ned_m
        self.vel: Vec3 = (0.0, 0.0, 0.0)
        self.yaw = 0.0
        self.armed = False

    @property
    def state(self) -> AirframeState:
        throttle = 0.5 if self.armed else 0.0
        return AirframeState(self.pos, self.vel, (0.0, 0.0, self.yaw), (0.0, 0.0, 0.0), self.pos[2] >= 0.0, throttle)

    def set_armed(self, armed: bool) -> None:
        self.armed = armed

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        assert all(map(math.isfinite, (*vel_ned_mps, yaw_rad)))
        self.vel, self.yaw = vel_ned_mps, yaw_rad

    def step(self, dt_s: float) -> None:
        if not self.armed:
            self.vel = (0.0, 0.0, 5.0)
        if self.pos[2] >= 0.0 and self.vel[2] >= 0.0:
            self.vel = (0.0, 0.0, 0.0)
        north, east, down = (p + v * dt_s for p, v in zip(self.pos, self.vel, strict=True))
        self.pos = (north, east, min(down, 0.0))


class Flight(Wire):
    """An autopilot, its body, and a client on each link."""

    def __init__(
        self,
        parameters: Mapping[str, float] | None = None,
        links: Mapping[Link, StreamProfile] = MINIMAL,
        battery: BatterySpec | None = None,
        gnss_fails: bool = False,
    ) -> None:
        super().__init__(onboard_system=1)
        self.body: Body | FaultyGnss = FaultyGnss(Body(), seed=1, vehicle_id=1) if gnss_fails else Body()
        self.frame = LocalFrame(ORIGIN)
        self.autopilot = Px4Autopilot(1, self.body, self.frame, parameters=parameters, links=links, battery=battery)
        self.heard: dict[Link, list[Any]] = {Link.ONBOARD: [], Link.GROUND: []}

    def run(self, seconds: float, *repeated: Any) -> None:
        """Fly on, sending `repeated` before every step."""
        for _ in range(round(seconds / STEP_S)):
            self.step(*repeated)
            for link in self.heard:
                if link in self.autopilot._channels:
                    self.heard[link] += self.listen(link)

    def last(self, kind: str, link: Link = Link.ONBOARD) -> Any:
        return next(m for m in reversed(self.heard[link]) if m.get_type() == kind)

    def texts(self) -> str:
        return "|".join(m.text for m in self.heard[Link.GROUND] if m.get_type() == "STATUSTEXT")

    # Flights to start from

    def ready(self) -> Flight:
        self.run(5.0)
        return self

    def airborne(self, height_m: float = 5.0) -> Flight:
        """In HOLD at about `height_m`."""
        self.ready()
        assert self.command(TAKEOFF, 0, 0, 0, NAN, NAN, NAN, ORIGIN.alt_m + height_m) == ACCEPTED
        assert self.command(ARM, 1.0) == ACCEPTED
        self.run(8.0 + height_m)
        assert self.mode == "HOLD"
        return self

    def offboard(self) -> Flight:
        """In OFFBOARD, standing still in the air."""
        self.airborne()
        self.run(0.2, velocity())
        assert self.command(SET_MODE, *OFFBOARD) == ACCEPTED
        self.run(0.2, velocity())
        assert self.mode == "OFFBOARD"
        return self


def setpoint(
    mask: int, pos: Vec3 = (0.0, 0.0, 0.0), vel: Vec3 = (0.0, 0.0, 0.0), yaw: float = 0.0, rate: float = 0.0
) -> Any:
    return mav.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mav.MAV_FRAME_LOCAL_NED, mask, *pos, *vel, 0.0, 0.0, 0.0, yaw, rate
    )


def velocity(north: float = 0.0, east: float = 0.0, down: float = 0.0, mask: int = 0x9C7) -> Any:
    return setpoint(mask, vel=(north, east, down))
