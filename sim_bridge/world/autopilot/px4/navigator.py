"""PX4's navigator: the velocity that each mode asks for, and how a vehicle leaves the ground.

Positions are NED metres about the mission's origin, velocities NED m/s.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Final, assert_never

from mission.common.frames import Vec3
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot.guidance import (
    SpeedLimits,
    interpolated,
    limited,
    pursuit,
    stopping_point,
    towards,
    wrapped_rad,
)
from sim_bridge.world.autopilot.protocols.parameters import ParameterTable
from sim_bridge.world.autopilot.px4.tables import Px4Mode
from sim_bridge.world.autopilot.setpoint import STOP

# What PX4 makes of MPC_TKO_SPEED and MPC_LAND_SPEED: recorded 1.2-1.3 of 1.5 m/s, 0.5-0.7 of 0.7 m/s.
VERTICAL_SHARE: Final = 0.85
EMERGENCY_DESCENT_MPS: Final = 0.65  # recorded; horizontal control is off, hence the drift
EMERGENCY_DRIFT_NED_MPS = (-0.2, -0.4)
TAKEOFF_SEEN_S: Final = 1.0  # after the ramp begins PX4 calls it flying, before it has left the ground (recorded)
LIFT_MPS: Final = 0.05  # a wish that climbs faster than this wants to leave the ground
RTL_OVER_HOME_M: Final = 0.5  # close enough to home to land there
GRAVITY_MPS2: Final = 9.81


class _RtlPhase(Enum):
    CLIMB = 1
    CRUISE = 2
    LAND = 3


class Navigator:
    """State that the modes keep. Its owner keeps `state` and `home_ned_m` up to date."""

    def __init__(self, parameters: ParameterTable, state: AirframeState) -> None:
        self._parameters = parameters
        self.state = state
        self.home_ned_m: Vec3 = state.pos_ned_m
        self.yaw_rad = state.attitude_rad[2]  # commanded
        self.setpoint = STOP
        self.takeoff_down_m: float | None = None  # None: MIS_TAKEOFF_ALT above home
        self.cruise_mps: float | None = None  # of the automatic modes; None: MPC_XY_CRUISE
        self._target_ned_m: Vec3 = state.pos_ned_m
        self._rtl_phase = _RtlPhase.CLIMB
        self._rtl_down_m = 0.0

    @property
    def returning_to_ground(self) -> bool:
        """RTL has come to its landing."""
        return self._rtl_phase is _RtlPhase.LAND

    @property
    def at_top(self) -> bool:
        """TAKEOFF has come as high as it should."""
        climb_left_m = self.state.pos_ned_m[2] - self._target_ned_m[2]
        return climb_left_m < self._parameters["NAV_MC_ALT_RAD"]

    def begin(self, mode: Px4Mode, *, flying: bool) -> None:
        """Take hold of the place where `mode` begins: flying, where the vehicle can stop."""
        pos = self.state.pos_ned_m
        here = pos
        if flying:
            brake_mps2 = max(self._parameters["MPC_ACC_HOR"], 0.1)
            here = stopping_point(pos, self.state.vel_ned_mps, brake_mps2=brake_mps2)
        self._target_ned_m = here
        if mode is Px4Mode.TAKEOFF:
            down_m = self.takeoff_down_m
            if down_m is None:
                down_m = self.home_ned_m[2] - self._parameters["MIS_TAKEOFF_ALT"]
            self._target_ned_m = (here[0], here[1], min(down_m, pos[2]))
        elif mode is Px4Mode.RTL:
            self._begin_rtl()

    def move_target(self, target: tuple[float, float, float], yaw_rad: float) -> None:
        """Hold elsewhere; NaN keeps that axis, or the heading."""
        here = self._target_ned_m
        north, east, down = (t if math.isfinite(t) else h for t, h in zip(target, here, strict=True))
        self._target_ned_m = (north, east, down)
        if math.isfinite(yaw_rad):
            self.yaw_rad = wrapped_rad(yaw_rad)

    def wanted(self, mode: Px4Mode, dt_s: float) -> Vec3:
        """The velocity that `mode` asks for; sets the heading."""
        match mode:
            case Px4Mode.OFFBOARD:
                return self._follow_setpoint(dt_s)
            case Px4Mode.TAKEOFF:
                return self._go_to(self._target_ned_m, up_mps=VERTICAL_SHARE * self._parameters["MPC_TKO_SPEED"])
            case Px4Mode.LAND:
                return self._land()
            case Px4Mode.RTL:
                return self._return()
            case (
                Px4Mode.HOLD
                | Px4Mode.MISSION
                | Px4Mode.MANUAL
                | Px4Mode.ALTCTL
                | Px4Mode.POSCTL
                | Px4Mode.ACRO
                | Px4Mode.STABILIZED
            ):
                return self._go_to(self._target_ned_m)
            case unreachable:
                assert_never(unreachable)

    def _begin_rtl(self) -> None:
        """The height to fly home at: within a cone near home, never lower than now (PX4's RTL_CONE_ANG)."""
        home, pos = self.home_ned_m, self.state.pos_ned_m
        distance_m = math.hypot(home[0] - pos[0], home[1] - pos[1])
        near_m = self._parameters["NAV_ACC_RAD"]
        if distance_m <= near_m:
            self._target_ned_m = (home[0], home[1], pos[2])
            self._rtl_phase = _RtlPhase.LAND
            return
        height_m = self._parameters["RTL_RETURN_ALT"]
        cone_deg = self._parameters["RTL_CONE_ANG"]
        if 0 < cone_deg < 90 and distance_m <= self._parameters["RTL_MIN_DIST"]:
            height_m = min(height_m, distance_m / math.tan(math.radians(cone_deg)))
        self._rtl_down_m = min(home[2] - max(height_m, 2.0 * near_m), pos[2])
        self._rtl_phase = _RtlPhase.CLIMB

    def _follow_setpoint(self, dt_s: float) -> Vec3:
        value = self._parameters
        setpoint = self.setpoint
        here, there, vel = self.state.pos_ned_m, setpoint.pos_ned_m, setpoint.vel_ned_mps
        gain_xy, gain_z = value["MPC_XY_P"], value["MPC_Z_P"]
        wanted = (
            pursuit(here[0], there[0], vel[0], gain_xy),
            pursuit(here[1], there[1], vel[1], gain_xy),
            pursuit(here[2], there[2], vel[2], gain_z),
        )
        if setpoint.yaw_rad is not None:
            self.yaw_rad = wrapped_rad(setpoint.yaw_rad)
        elif setpoint.yaw_rate_radps:
            self.yaw_rad = wrapped_rad(self.yaw_rad + setpoint.yaw_rate_radps * dt_s)
        limits = SpeedLimits(value["MPC_XY_VEL_MAX"], value["MPC_Z_VEL_MAX_UP"], value["MPC_Z_VEL_MAX_DN"])
        return limited(wanted, limits)

    def _go_to(self, target_ned_m: Vec3, *, up_mps: float | None = None) -> Vec3:
        value = self._parameters
        limits = SpeedLimits(
            min(self.cruise_mps or value["MPC_XY_CRUISE"], value["MPC_XY_VEL_MAX"]),
            min(up_mps or value["MPC_Z_V_AUTO_UP"], value["MPC_Z_VEL_MAX_UP"]),
            min(value["MPC_Z_V_AUTO_DN"], value["MPC_Z_VEL_MAX_DN"]),
        )
        gain_xy, gain_z = value["MPC_XY_P"], value["MPC_Z_P"]
        return towards(self.state.pos_ned_m, target_ned_m, gain_xy=gain_xy, gain_z=gain_z, limits=limits)

    def _land(self) -> Vec3:
        """Down over the target: MPC_LAND_SPEED below MPC_LAND_ALT2, faster above it, crawling below MPC_LAND_ALT3."""
        value = self._parameters
        height_m = self.home_ned_m[2] - self.state.pos_ned_m[2]
        down_mps = VERTICAL_SHARE * interpolated(
            height_m,
            value["MPC_LAND_ALT2"],
            value["MPC_LAND_SPEED"],
            value["MPC_LAND_ALT1"],
            max(value["MPC_Z_V_AUTO_DN"], value["MPC_LAND_SPEED"]),
        )
        if height_m < value["MPC_LAND_ALT3"]:
            down_mps = min(down_mps, value["MPC_LAND_CRWL"])
        north, east, _ = self._go_to(self._target_ned_m)
        return (north, east, down_mps)

    def _return(self) -> Vec3:
        """RTL: up, across, down."""
        home, pos = self.home_ned_m, self.state.pos_ned_m
        match self._rtl_phase:
            case _RtlPhase.CLIMB:
                here = self._target_ned_m
                if pos[2] - self._rtl_down_m < self._parameters["NAV_MC_ALT_RAD"]:
                    self._rtl_phase = _RtlPhase.CRUISE
                return self._go_to((here[0], here[1], self._rtl_down_m))
            case _RtlPhase.CRUISE:
                if math.hypot(home[0] - pos[0], home[1] - pos[1]) < RTL_OVER_HOME_M:
                    self._rtl_phase = _RtlPhase.LAND
                    self._target_ned_m = (home[0], home[1], pos[2])
                return self._go_to((home[0], home[1], self._rtl_down_m))
            case _RtlPhase.LAND:
                return self._land()
            case unreachable:
                assert_never(unreachable)


class Liftoff:
    """PX4's way off the ground: idle until a mode wants up, spool-up, then a ramp of the climb speed."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self._ramp_at_s: float | None = None
        self.done = False  # free of the ground

    def reset(self, *, done: bool = False) -> None:
        """On the ground again; or, `done`, in the air already."""
        self._ramp_at_s, self.done = None, done

    def seen(self, now_s: float) -> bool:
        """The land detector would call it a takeoff."""
        return self._ramp_at_s is not None and now_s - self._ramp_at_s >= TAKEOFF_SEEN_S

    def limit(self, wanted: Vec3, now_s: float, *, armed_s: float, may_lift: bool, standing: bool) -> Vec3:
        """The part of `wanted` that is done now. `armed_s`: how long it has been armed."""
        if self.done:
            return wanted
        value = self._parameters
        idle = (0.0, 0.0, value["MPC_LAND_CRWL"])  # presses the vehicle gently onto the ground
        if standing and not (may_lift and wanted[2] < -LIFT_MPS):
            self.reset(done=self.seen(now_s))
            return idle
        if armed_s < value["COM_SPOOLUP_TIME"]:
            return idle
        if self._ramp_at_s is None:
            self._ramp_at_s = now_s
        ramp_s = value["MPC_TKO_RAMP_T"]
        share = (now_s - self._ramp_at_s) / ramp_s if ramp_s > 0.0 else math.inf
        # PX4 ramps the largest climb from the velocity error that would ask for no thrust at all. Recorded: it
        # leaves the ground when the ramp is through, and gains speed at the same rate.
        start_mps = -GRAVITY_MPS2 / max(value["MPC_Z_VEL_P_ACC"], 0.1)
        climb_max_mps = (share - 1.0) * -start_mps
        if climb_max_mps >= value["MPC_TKO_SPEED"]:
            self.done = True
            return wanted
        if standing and climb_max_mps <= 0.0:
            return idle
        north, east = (0.0, 0.0) if standing else wanted[:2]
        return (north, east, max(wanted[2], -max(climb_max_mps, 0.0)))
