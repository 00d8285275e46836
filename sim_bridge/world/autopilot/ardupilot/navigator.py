"""ArduCopter's controllers: the velocity that each mode asks for.

Positions are NED metres about the mission's origin, velocities NED m/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final, assert_never

from mission.common.frames import Vec3
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot.ardupilot.tables import CopterMode
from sim_bridge.world.autopilot.guidance import (
    Shaper,
    SpeedLimits,
    approach_mps,
    limited,
    pursuit,
    stopping_point,
    wrapped_rad,
)
from sim_bridge.world.autopilot.protocols.parameters import ParameterTable
from sim_bridge.world.autopilot.setpoint import STOP, Setpoint

CM: Final = 0.01  # ArduPilot's lengths and speeds are centimetres
CLIMB_BRAKE_MPS2: Final = 0.62  # recorded: how it comes to rest at the top of a takeoff
CLIMB_GAIN: Final = 1.6  # 1/s, near the top
AIRFRAME_LAG_S: Final = 0.35  # with which an airframe follows a velocity
TAKEN_OFF_M: Final = 0.06  # this near to its altitude the takeoff is complete
BRAKE_MPS2: Final = 2.5
RETURN_CLIMB_MPS2: Final = 0.6  # how its climb begins
HOME_REACHED_M: Final = 0.03
RETURN_BRAKE_MPS2: Final = 0.6  # recorded in ap_loss_gcs255, as the rest of RTL's figures
RETURNED_M: Final = 0.15
THROTTLE_LOW_MPS: Final = 2.4  # recorded: LOITER with the simulated stick down
# Of the shaping of velocities: with these the vehicle follows as recorded (see tests/scenario/test_velocity_steps.py).
JERK_SHARE: Final = 1.4  # of PSC_JERK_XY
END_LAG_S: Final = 0.25
LEAD_S: Final = 0.3
RESTS_MPS: Final = 0.05  # slower, it has come to rest


class GuidedMode(Enum):
    """Submodes of GUIDED."""

    HOLD = "hold"
    TAKEOFF = "takeoff"
    SETPOINT = "setpoint"


class ReturnPhase(Enum):
    """RTL's parts."""

    CLIMB = 1
    CRUISE = 2
    WAIT = 3
    LAND = 4


@dataclass(slots=True)
class Guided:
    """GUIDED's state."""

    doing: GuidedMode = GuidedMode.HOLD
    setpoint: Setpoint = STOP
    heard_s: float = -math.inf  # of the setpoint
    rests_ned_m: Vec3 | None = None  # where it has come to rest after the last one


class Navigator:
    """State that the modes keep. Its owner keeps `state` and `home_ned_m` up to date."""

    def __init__(self, parameters: ParameterTable, state: AirframeState) -> None:
        self._parameters = parameters
        self.state = state
        self.home_ned_m: Vec3 = state.pos_ned_m
        self.yaw_rad = state.attitude_rad[2]  # commanded
        self.guided = Guided()
        self.cruise_mps: float | None = None  # by DO_CHANGE_SPEED; None: WPNAV_SPEED
        self.return_phase = ReturnPhase.CLIMB
        self._shaper = Shaper()
        self._target_ned_m: Vec3 = state.pos_ned_m
        self._lands_level = False
        self._return_down_m = 0.0
        self._waits_since_s = 0.0
        self._climbs_since_s: float | None = None

    def begin(self, mode: CopterMode, *, has_position: bool = True) -> None:
        """Take hold of the place where the vehicle can stop; in LAND only where it knows one."""
        state = self.state
        self._lands_level = mode is CopterMode.LAND and not has_position
        self._target_ned_m = stopping_point(state.pos_ned_m, state.vel_ned_mps, brake_mps2=BRAKE_MPS2)
        self.guided = Guided()
        self._shaper.restart(state.vel_ned_mps)
        if mode is CopterMode.RTL:
            self._begin_return()

    def take_off(self, climb_m: float) -> None:
        """GUIDED: up to `climb_m` above home, over this place."""
        pos = self.state.pos_ned_m
        self._target_ned_m = (pos[0], pos[1], self.home_ned_m[2] - climb_m)
        self.guided = Guided(GuidedMode.TAKEOFF)

    def move_target(self, target: tuple[float, float, float], yaw_rad: float) -> None:
        """GUIDED: go elsewhere; NaN keeps that axis, or the heading."""
        here = self._target_ned_m
        north, east, down = (t if math.isfinite(t) else h for t, h in zip(target, here, strict=True))
        self._target_ned_m = (north, east, down)
        self.guided = Guided()
        if math.isfinite(yaw_rad):
            self.yaw_rad = wrapped_rad(yaw_rad)

    def offer_setpoint(self, setpoint: Setpoint, now_s: float) -> None:
        """GUIDED follows it at once, also out of a takeoff, which it ends: as ArduCopter."""
        if self.guided.doing is not GuidedMode.SETPOINT:
            self._shaper.restart(self.state.vel_ned_mps)
        self.guided = Guided(GuidedMode.SETPOINT, setpoint, now_s)

    @property
    def taken_off(self) -> bool:
        """The takeoff under way has come to its altitude."""
        return self.state.pos_ned_m[2] - self._target_ned_m[2] < TAKEN_OFF_M

    def wanted(self, mode: CopterMode, now_s: float, dt_s: float) -> Vec3:
        """The velocity that `mode` asks for; sets the heading."""
        match mode:
            case CopterMode.GUIDED:
                return self._guided(now_s, dt_s)
            case CopterMode.RTL:
                return self._return(now_s)
            case CopterMode.LAND:
                return self._land()
            case CopterMode.BRAKE:
                return self._go_to(self._target_ned_m)
            case CopterMode.STABILIZE | CopterMode.ALT_HOLD | CopterMode.LOITER | CopterMode.POSHOLD:
                # The sticks are not held; a real one falls in STABILIZE, here it sinks as in LOITER.
                north, east, _ = self._go_to(self._target_ned_m)
                return (north, east, THROTTLE_LOW_MPS)
            case unreachable:
                assert_never(unreachable)

    def _guided(self, now_s: float, dt_s: float) -> Vec3:
        match self.guided.doing:
            case GuidedMode.HOLD:
                return self._go_to(self._target_ned_m)
            case GuidedMode.TAKEOFF:
                return self._climb()
            case GuidedMode.SETPOINT:
                return self._follow_setpoint(now_s, dt_s)
            case unreachable:
                assert_never(unreachable)

    def _follow_setpoint(self, now_s: float, dt_s: float) -> Vec3:
        """The setpoint; its velocity for GUID_TIMEOUT after it has come, its position for ever.

        Once stopped it holds its place by its position controller (GUID_OPTIONS 0): a velocity held at 0 would drift.
        """
        value = self._parameters
        setpoint = self.guided.setpoint
        fresh = now_s - self.guided.heard_s <= max(value["GUID_TIMEOUT"], 0.0)
        here, there = self.state.pos_ned_m, setpoint.pos_ned_m
        if not fresh and self.guided.rests_ned_m is None and math.hypot(*self._shaper.vel_ned_mps) < RESTS_MPS:
            self.guided.rests_ned_m = stopping_point(here, self.state.vel_ned_mps, brake_mps2=BRAKE_MPS2)
        rests = self.guided.rests_ned_m
        if rests is not None:
            north, east, down = (at if asked is None else asked for at, asked in zip(rests, there, strict=True))
            there = (north, east, down)
        vel = setpoint.vel_ned_mps if fresh else (None, None, None)
        gain_xy, gain_z = value["PSC_POSXY_P"], value["PSC_POSZ_P"]
        wanted = (
            pursuit(here[0], there[0], vel[0], gain_xy),
            pursuit(here[1], there[1], vel[1], gain_xy),
            pursuit(here[2], there[2], vel[2], gain_z),
        )
        if fresh and setpoint.yaw_rad is not None:
            self.yaw_rad = wrapped_rad(setpoint.yaw_rad)
        elif fresh and setpoint.yaw_rate_radps:
            self.yaw_rad = wrapped_rad(self.yaw_rad + setpoint.yaw_rate_radps * dt_s)
        return self._shaper.track_velocity(
            limited(wanted, self._limits()),
            dt_s,
            accel_mps2=max(value["WPNAV_ACCEL"] * CM, 0.1),
            jerk_mps3=max(value["PSC_JERK_XY"], 0.1) * JERK_SHARE,
            lag_s=END_LAG_S,
            lead_s=LEAD_S,
        )

    def _climb(self) -> Vec3:
        north, east, _ = self._go_to(self._target_ned_m)
        rest_m = self.state.pos_ned_m[2] - self._target_ned_m[2] + self.state.vel_ned_mps[2] * AIRFRAME_LAG_S
        up_mps = approach_mps(max(rest_m, 0.0), gain=CLIMB_GAIN, brake_mps2=CLIMB_BRAKE_MPS2)
        return (north, east, -min(up_mps, self._limits().up_mps))

    def _limits(self) -> SpeedLimits:
        value = self._parameters
        return SpeedLimits(
            self.cruise_mps or value["WPNAV_SPEED"] * CM, value["WPNAV_SPEED_UP"] * CM, value["WPNAV_SPEED_DN"] * CM
        )

    def _go_to(self, target_ned_m: Vec3, *, brake_mps2: float = BRAKE_MPS2) -> Vec3:
        """Straight there, braking in time."""
        value, pos = self._parameters, self.state.pos_ned_m
        to_north, to_east = target_ned_m[0] - pos[0], target_ned_m[1] - pos[1]
        to_down = target_ned_m[2] - pos[2]
        distance_m = math.hypot(to_north, to_east)
        speed = approach_mps(distance_m, gain=max(value["PSC_POSXY_P"], 0.1), brake_mps2=brake_mps2)
        share = speed / distance_m if distance_m > 0.0 else 0.0
        down = math.copysign(
            approach_mps(abs(to_down), gain=max(value["PSC_POSZ_P"], 0.1), brake_mps2=CLIMB_BRAKE_MPS2), to_down
        )
        return limited((to_north * share, to_east * share, down), self._limits())

    def _land(self) -> Vec3:
        """Down over the target: LAND_SPEED below LAND_ALT_LOW above home, faster above it.

        A landing that began without a position seeks none, also when there is one again.
        """
        value = self._parameters
        north, east, _ = (0.0, 0.0, 0.0) if self._lands_level else self._go_to(self._target_ned_m)
        low = self.home_ned_m[2] - self.state.pos_ned_m[2] <= value["LAND_ALT_LOW"] * CM
        speed_cmps = value["LAND_SPEED"] if low else value["LAND_SPEED_HIGH"] or value["WPNAV_SPEED_DN"]
        return (north, east, speed_cmps * CM)

    def _begin_return(self) -> None:
        """The height to fly home at: RTL_ALT, less within the cone about home, never lower than now."""
        value, home, pos = self._parameters, self.home_ned_m, self.state.pos_ned_m
        height_m = value["RTL_ALT"] * CM
        slope = value["RTL_CONE_SLOPE"]
        if slope > 0.0:
            height_m = min(height_m, slope * math.hypot(home[0] - pos[0], home[1] - pos[1]))
        self._return_down_m = min(home[2] - height_m, pos[2] - value["RTL_CLIMB_MIN"] * CM)
        self.return_phase, self._climbs_since_s = ReturnPhase.CLIMB, None

    def _return(self, now_s: float) -> Vec3:
        """RTL: up, across, wait, down."""
        home, pos = self.home_ned_m, self.state.pos_ned_m
        here, over_home = self._target_ned_m, (home[0], home[1], self._return_down_m)
        match self.return_phase:
            case ReturnPhase.CLIMB:
                if pos[2] - self._return_down_m < RETURNED_M:
                    self.return_phase = ReturnPhase.CRUISE
                if self._climbs_since_s is None:
                    self._climbs_since_s = now_s
                north, east, down = self._go_to((here[0], here[1], self._return_down_m))
                return (north, east, max(down, -RETURN_CLIMB_MPS2 * (now_s - self._climbs_since_s)))
            case ReturnPhase.CRUISE:
                if math.dist(pos, over_home) < HOME_REACHED_M:
                    self.return_phase, self._waits_since_s = ReturnPhase.WAIT, now_s
                return self._go_to(over_home, brake_mps2=RETURN_BRAKE_MPS2)
            case ReturnPhase.WAIT:
                if now_s - self._waits_since_s >= self._parameters["RTL_LOIT_TIME"] / 1000.0:
                    self.return_phase, self._target_ned_m = ReturnPhase.LAND, over_home
                return self._go_to(over_home)
            case ReturnPhase.LAND:
                return self._land()
            case unreachable:
                assert_never(unreachable)
