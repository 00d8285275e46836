"""PX4's commander and navigator: modes, arming, failsafes, and the velocity that each mode asks for.

No MAVLink in here but its enums. Positions are NED metres about the mission's origin, as the airframe's.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import assert_never

from companion.mavlink import dialect as mav
from mission.frames import LocalFrame, Vec3
from sim_bridge.airframe.base import Airframe, AirframeState
from sim_bridge.autopilot import px4_tables as tables
from sim_bridge.autopilot.battery import Battery, BatterySpec
from sim_bridge.autopilot.guidance import (
    SpeedLimits,
    interpolated,
    limited,
    stopping_point,
    towards,
    wrapped_rad,
)
from sim_bridge.autopilot.parameters import ParameterTable
from sim_bridge.autopilot.px4_tables import Action, BatteryLevel, Failsafe, Px4Mode

POSITION_S = 2.0  # after boot: the estimator has a position, and home is set (recorded: 1.1-2.0 s)
READY_S = 4.4  # after boot: ready to arm (recorded: 4.4-4.7 s, and STANDBY in the heartbeat at 4.5)
SETPOINT_FRESH_S = 0.5  # PX4 asks for more than 2 Hz
SETPOINTS_NEEDED = 2  # within SETPOINT_FRESH_S; recorded: two or three are enough
GROUND_CONTACT_S = 0.6  # on the ground, not climbing, for this long: landed
EMERGENCY_DESCENT_MPS = 0.65  # recorded; horizontal control is off, hence the drift
EMERGENCY_DRIFT_NED_MPS = (-0.2, -0.4)
TAKEOFF_SEEN_S = 1.0  # after the ramp begins PX4 calls it flying, before it has left the ground (recorded)
LIFT_MPS = 0.05  # a setpoint that climbs faster than this wants to leave the ground
RTL_OVER_HOME_M = 0.5  # close enough to home to land there
GRAVITY_MPS2 = 9.81
NOTICES_MAX = 32


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = mav.MAV_RESULT_ACCEPTED
    TEMPORARILY_REJECTED = mav.MAV_RESULT_TEMPORARILY_REJECTED
    DENIED = mav.MAV_RESULT_DENIED
    UNSUPPORTED = mav.MAV_RESULT_UNSUPPORTED
    FAILED = mav.MAV_RESULT_FAILED


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = mav.MAV_LANDED_STATE_ON_GROUND
    IN_AIR = mav.MAV_LANDED_STATE_IN_AIR
    TAKEOFF = mav.MAV_LANDED_STATE_TAKEOFF
    LANDING = mav.MAV_LANDED_STATE_LANDING


class _RtlPhase(Enum):
    CLIMB = 1
    CRUISE = 2
    LAND = 3


@dataclass(frozen=True, slots=True)
class Setpoint:
    """What OFFBOARD follows: per axis a position (NED m, mission's origin), a velocity (m/s), or both.

    `yaw_rad` None and `yaw_rate_radps` 0: keep the heading.
    """

    pos_ned_m: tuple[float | None, float | None, float | None]
    vel_ned_mps: tuple[float | None, float | None, float | None]
    yaw_rad: float | None = None
    yaw_rate_radps: float = 0.0


STOP = Setpoint((None, None, None), (0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Notice:
    """A text for the ground; severity as MAV_SEVERITY."""

    severity: int
    text: str


class Px4Flight:
    """One vehicle's flight logic: `update` once per step, and requests that answer with a `Result`."""

    def __init__(self, airframe: Airframe, frame: LocalFrame, parameters: ParameterTable, battery: BatterySpec) -> None:
        self._airframe = airframe
        self._frame = frame
        self._parameters = parameters
        self.state: AirframeState = airframe.state
        self.battery = Battery(battery)
        self.origin_ned_m: Vec3 = self.state.pos_ned_m  # of LOCAL_POSITION_NED: where the vehicle booted
        self.home_ned_m: Vec3 | None = None
        self.home_yaw_rad = self.state.attitude_rad[2]
        self.home_at_s = 0.0
        self.notices: deque[Notice] = deque(maxlen=NOTICES_MAX)

        self.armed = False
        self.landed = True
        self.mode = Px4Mode.HOLD  # what HEARTBEAT shows
        self.failsafe: Failsafe | None = None
        self.command_ned_mps: Vec3 = (0.0, 0.0, 0.0)
        self.command_yaw_rad = self.state.attitude_rad[2]

        self._last_s = 0.0
        self._intended = Px4Mode.HOLD  # what the user asked for; a failsafe does not touch it
        self._after_disarm = Px4Mode.HOLD
        self._action = Action.WARN  # of the failsafe that acts
        self._tripped: set[tuple[Failsafe, str]] = set()  # conditions that have acted and still hold
        self._armed_at_s = 0.0
        self._landed_at_s = 0.0
        self._contact_at_s: float | None = None
        self._flown = False  # since arming
        self._ramp_at_s: float | None = None  # start of the ramp that lifts the vehicle off
        self._ramp_done = False
        self._target_ned_m: Vec3 = self.state.pos_ned_m
        self._takeoff_down_m: float | None = None
        self._rtl_phase = _RtlPhase.CLIMB
        self._rtl_down_m = 0.0
        self._cruise_mps: float | None = None  # DO_CHANGE_SPEED
        self._setpoint = STOP
        self._setpoint_times_s: deque[float] = deque(maxlen=SETPOINTS_NEEDED)
        self._gcs_heard_s: float | None = None

    # What others see

    @property
    def ready(self) -> bool:
        """The prearm bit: booted, and the mode asked for could run."""
        if self._last_s < READY_S or self.failsafe is Failsafe.TERMINATED:
            return False
        if self._intended is Px4Mode.OFFBOARD:
            return not self._offboard_lost(self._last_s)
        return self.armed or self._intended not in tables.NO_ARMING_MODES

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status. PX4 shows UNINIT, not BOOT, while it could not arm (as recorded)."""
        if self.failsafe is Failsafe.TERMINATED:
            return int(mav.MAV_STATE_FLIGHT_TERMINATION)
        if self.armed:
            return int(mav.MAV_STATE_CRITICAL if self.failsafe else mav.MAV_STATE_ACTIVE)
        return int(mav.MAV_STATE_STANDBY if self.ready else mav.MAV_STATE_UNINIT)

    @property
    def landed_state(self) -> LandedState:
        if self.landed:
            return LandedState.ON_GROUND
        if self.mode is Px4Mode.TAKEOFF:
            return LandedState.TAKEOFF
        if self.mode is Px4Mode.LAND or (self.mode is Px4Mode.RTL and self._rtl_phase is _RtlPhase.LAND):
            return LandedState.LANDING
        return LandedState.IN_AIR

    @property
    def battery_level(self) -> BatteryLevel:
        left = self.battery.remaining
        if left < self._parameters["BAT_EMERGEN_THR"]:
            return BatteryLevel.EMERGENCY
        if left < self._parameters["BAT_CRIT_THR"]:
            return BatteryLevel.CRITICAL
        return BatteryLevel.LOW if left < self._parameters["BAT_LOW_THR"] else BatteryLevel.OK

    # Requests

    def arm(self, now_s: float, *, force: bool) -> Result:
        """Refused while booting, in a mode that may not arm, and without a ground station where required."""
        if self.armed:
            return Result.ACCEPTED
        refusal = self._arming_refusal(now_s, force=force)
        if refusal:
            self._note(mav.MAV_SEVERITY_CRITICAL, f"Arming denied: {refusal}")
            return Result.TEMPORARILY_REJECTED
        self.armed = True
        self._armed_at_s = now_s
        self._flown = False
        self._ramp_at_s, self._ramp_done = None, not self.landed  # rearmed in the air: no spool-up
        self.command_yaw_rad = self.state.attitude_rad[2]
        self._set_home(self.state.pos_ned_m, now_s)
        self._enter(self.mode)
        self._airframe.set_armed(True)
        self._note(mav.MAV_SEVERITY_INFO, "Armed by external command")
        return Result.ACCEPTED

    def disarm(self, *, force: bool) -> Result:
        """Refused in the air, unless forced: then the vehicle falls."""
        if not self.armed:
            return Result.ACCEPTED
        if not self.landed and not force:
            self._note(mav.MAV_SEVERITY_CRITICAL, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        self._stop("Disarmed by external command")
        return Result.ACCEPTED

    def set_mode(self, mode: Px4Mode, now_s: float) -> Result:
        """Disarmed, every mode is accepted, though OFFBOARD without setpoints does not show.

        Armed, OFFBOARD needs a live stream. MISSION never: there is none to fly.
        """
        if self.failsafe is Failsafe.TERMINATED or mode is Px4Mode.MISSION:
            return self._refuse_mode(mode)
        streaming = self._offboard_alive(now_s)
        if self.armed and mode is Px4Mode.OFFBOARD and not streaming:
            return self._refuse_mode(mode)
        repeated = mode is self.mode and self.failsafe is None
        self._choose(mode)
        if mode is Px4Mode.OFFBOARD and not streaming:
            return Result.ACCEPTED
        if not repeated:
            self._takeoff_down_m = None
            self._enter(mode)
        return Result.ACCEPTED

    def takeoff(self, alt_amsl_m: float) -> Result:
        """NAV_TAKEOFF: up to `alt_amsl_m`, NaN being MIS_TAKEOFF_ALT above home. Starts once armed."""
        if self.failsafe is Failsafe.TERMINATED:
            return self._refuse_mode(Px4Mode.TAKEOFF)
        self._takeoff_down_m = self._frame.origin.alt_m - alt_amsl_m if math.isfinite(alt_amsl_m) else None
        self._choose(Px4Mode.TAKEOFF)
        self._enter(Px4Mode.TAKEOFF)
        return Result.ACCEPTED

    def reposition(self, target: tuple[float, float, float], yaw_rad: float, *, change_mode: bool) -> Result:
        """DO_REPOSITION: HOLD at `target` (NED m, mission's origin); NaN keeps that axis or the heading."""
        if self.failsafe is Failsafe.TERMINATED:
            return self._refuse_mode(Px4Mode.HOLD)
        if not change_mode and self.mode is not Px4Mode.HOLD:
            return Result.TEMPORARILY_REJECTED
        self._choose(Px4Mode.HOLD)
        self._enter(Px4Mode.HOLD)
        here = self._target_ned_m
        north, east, down = (t if math.isfinite(t) else h for t, h in zip(target, here, strict=True))
        self._target_ned_m = (north, east, down)
        if math.isfinite(yaw_rad):
            self.command_yaw_rad = wrapped_rad(yaw_rad)
        return Result.ACCEPTED

    def change_speed(self, speed_mps: float) -> Result:
        """DO_CHANGE_SPEED: cruise of the automatic modes, m/s; -1 or NaN: as it is; -2: the default."""
        if speed_mps == -2.0:
            self._cruise_mps = None
        elif speed_mps > 0.0 and math.isfinite(speed_mps):
            self._cruise_mps = speed_mps
        elif speed_mps != -1.0 and not math.isnan(speed_mps):
            return Result.DENIED
        return Result.ACCEPTED

    def set_home(self, pos_ned_m: Vec3 | None, now_s: float) -> Result:
        """DO_SET_HOME; None is here."""
        if self.home_ned_m is None:
            return Result.TEMPORARILY_REJECTED
        self._set_home(pos_ned_m if pos_ned_m is not None else self.state.pos_ned_m, now_s)
        return Result.ACCEPTED

    def terminate(self) -> Result:
        """DO_FLIGHTTERMINATION: the rotors stop, for good."""
        self._stop("Flight termination")
        self.failsafe = Failsafe.TERMINATED
        return Result.ACCEPTED

    def offer_setpoint(self, setpoint: Setpoint, now_s: float) -> None:
        """A setpoint has come. It counts as the stream in every mode; only OFFBOARD follows it."""
        self._setpoint = setpoint
        self._setpoint_times_s.append(now_s)

    def hear_gcs(self, now_s: float) -> None:
        """A ground station's heartbeat has come."""
        self._gcs_heard_s = now_s
        self._tripped = {trip for trip in self._tripped if trip[0] is not Failsafe.GCS_LOSS}

    # The step

    def update(self, now_s: float) -> None:
        """Look, decide, and give the airframe its velocity and heading."""
        dt_s = max(0.0, now_s - self._last_s)
        self._last_s = now_s
        self.state = self._airframe.state
        self.battery.drain(dt_s, self.state.throttle)
        if self.home_ned_m is None and now_s >= POSITION_S:
            self._set_home(self.state.pos_ned_m, now_s)
        self._detect_landing(now_s)
        self._check_offboard(now_s)
        if not self.armed:
            return
        self._check_failsafes(now_s)
        self._check_auto_disarm(now_s)
        if not self.armed:
            return
        wanted = self._off_the_ground(self._guided(dt_s), now_s)
        # Parameters have no ranges, as in PX4: with absurd ones the vehicle stops, and the bridge goes on.
        self.command_ned_mps = wanted if all(map(math.isfinite, wanted)) else (0.0, 0.0, 0.0)
        self._airframe.command(self.command_ned_mps, self.command_yaw_rad)

    # Decisions

    def _arming_refusal(self, now_s: float, *, force: bool) -> str:
        """Why not, in words; empty: arm."""
        if self._parameters["NAV_DLL_ACT"] > 0 and not self._gcs_alive(now_s):
            return "no connection to the ground station"  # recorded: also when forced
        if self.failsafe is Failsafe.TERMINATED:
            return "terminated"
        if force:
            return "" if self.home_ned_m is not None else "system not ready"
        if now_s < READY_S:
            return "system not ready"
        if self._intended in tables.NO_ARMING_MODES:
            return f"mode {self._intended.name} does not allow arming"
        if self._intended is Px4Mode.OFFBOARD and not self._offboard_alive(now_s):
            return "no offboard signal"
        if self.battery_level in (BatteryLevel.CRITICAL, BatteryLevel.EMERGENCY):
            return "battery"
        return ""

    def _refuse_mode(self, mode: Px4Mode) -> Result:
        self._note(mav.MAV_SEVERITY_CRITICAL, f"Switching to mode {mode.name} is currently not available")
        return Result.TEMPORARILY_REJECTED

    def _choose(self, mode: Px4Mode) -> None:
        """The user's word: it ends a failsafe."""
        self._intended = mode
        if mode not in tables.NO_ARMING_MODES:
            self._after_disarm = mode
        self.failsafe = None

    def _enter(self, mode: Px4Mode) -> None:
        """Show `mode` and prepare what it holds on to."""
        self.mode = mode
        state = self.state
        here = state.pos_ned_m
        if self.armed and not self.landed:
            here = stopping_point(here, state.vel_ned_mps, brake_mps2=max(self._parameters["MPC_ACC_HOR"], 0.1))
        self._target_ned_m = here
        match mode:
            case Px4Mode.TAKEOFF:
                down_m = self._takeoff_down_m
                if down_m is None:
                    home = self.home_ned_m or state.pos_ned_m
                    down_m = home[2] - self._parameters["MIS_TAKEOFF_ALT"]
                self._target_ned_m = (here[0], here[1], min(down_m, state.pos_ned_m[2]))
            case Px4Mode.RTL:
                self._enter_rtl()
            case _:
                pass

    def _enter_rtl(self) -> None:
        """The height to fly home at: within a cone near home, never lower than now (PX4's RTL_CONE_ANG)."""
        home = self.home_ned_m or self.origin_ned_m
        pos = self.state.pos_ned_m
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

    def _check_offboard(self, now_s: float) -> None:
        """OFFBOARD begins, is lost, and comes back, for as long as the user wants it."""
        if self._intended is not Px4Mode.OFFBOARD:
            return
        if self.failsafe in (None, Failsafe.OFFBOARD_LOSS):
            showing = self.mode is Px4Mode.OFFBOARD and self.failsafe is None
            if not showing and self._offboard_alive(now_s):
                self.failsafe = None
                self._enter(Px4Mode.OFFBOARD)
            elif showing and self.armed and self._offboard_lost(now_s):
                action, mode = tables.OFFBOARD_LOSS_ACTIONS.get(
                    int(self._parameters["COM_OBL_RC_ACT"]), (Action.HOLD, Px4Mode.HOLD)
                )
                self._act(Failsafe.OFFBOARD_LOSS, action, mode)

    def _check_failsafes(self, now_s: float) -> None:
        """The conditions besides the offboard stream; each acts once, and again only after it has cleared."""
        for cause, what, action in self._conditions(now_s):
            trip = (cause, what)
            if trip in self._tripped:
                continue
            self._tripped.add(trip)
            if action is Action.WARN:
                self._note(mav.MAV_SEVERITY_WARNING, what)
            elif self.failsafe is None or action > self._action:
                self._act(cause, action, tables.ACTION_MODES.get(action, self.mode))

    def _conditions(self, now_s: float) -> list[tuple[Failsafe, str, Action]]:
        """What holds now, in words, and what its parameter says about it."""
        found: list[tuple[Failsafe, str, Action]] = []
        value = self._parameters
        level = self.battery_level
        if level is not BatteryLevel.OK:
            what, table = tables.BATTERY_ACTIONS[level]
            found.append((Failsafe.BATTERY, what, table.get(int(value["COM_LOW_BAT_ACT"]), Action.WARN)))
        action = tables.GCS_LOSS_ACTIONS.get(int(value["NAV_DLL_ACT"]))
        if action is not None and not self._gcs_alive(now_s):
            found.append((Failsafe.GCS_LOSS, "Ground station lost", action))
        action = tables.GEOFENCE_ACTIONS.get(int(value["GF_ACTION"]))
        if action is not None and self._outside_fence():
            found.append((Failsafe.GEOFENCE, "Geofence violated", action))
        elif self._tripped:
            self._tripped = {trip for trip in self._tripped if trip[0] is not Failsafe.GEOFENCE}
        return found

    def _act(self, cause: Failsafe, action: Action, mode: Px4Mode) -> None:
        self._note(mav.MAV_SEVERITY_CRITICAL, f"Failsafe activated: {cause.value}, {action.name}")
        if action is Action.TERMINATE:
            self.terminate()
            return
        self.failsafe = cause
        self._action = action
        self._enter(mode)

    def _check_auto_disarm(self, now_s: float) -> None:
        if not self.landed:
            return
        if self._flown:
            limit_s = self._parameters["COM_DISARM_LAND"]
            if 0.0 < limit_s <= now_s - self._landed_at_s:
                self._stop("Disarmed by landing")
        else:
            limit_s = self._parameters["COM_DISARM_PRFLT"]
            if 0.0 < limit_s <= now_s - self._armed_at_s:
                self._stop("Disarmed by auto preflight disarming")

    def _stop(self, why: str) -> None:
        """Disarm: the mode goes back to the last one chosen that may arm."""
        if self.armed:
            self._note(mav.MAV_SEVERITY_INFO, why)
        self.armed = False
        self._airframe.set_armed(False)
        self.command_ned_mps = (0.0, 0.0, 0.0)
        self.failsafe = None
        self._tripped.clear()
        self._takeoff_down_m = None
        self._intended = self._after_disarm
        self._enter(self._after_disarm)

    # Observations

    def _offboard_alive(self, now_s: float) -> bool:
        """Enough setpoints lately to begin, or to come back to, OFFBOARD."""
        times = self._setpoint_times_s
        return len(times) == SETPOINTS_NEEDED and now_s - times[0] <= SETPOINT_FRESH_S

    def _offboard_lost(self, now_s: float) -> bool:
        times = self._setpoint_times_s
        return not times or now_s - times[-1] > self._parameters["COM_OF_LOSS_T"]

    def _gcs_alive(self, now_s: float) -> bool:
        heard_s = self._gcs_heard_s
        return heard_s is not None and now_s - heard_s <= self._parameters["COM_DL_LOSS_T"]

    def _outside_fence(self) -> bool:
        """The cylinder about home of GF_MAX_HOR_DIST and GF_MAX_VER_DIST; 0: no bound."""
        radius_m, height_m = self._parameters["GF_MAX_HOR_DIST"], self._parameters["GF_MAX_VER_DIST"]
        home = self.home_ned_m
        if home is None or (radius_m <= 0.0 and height_m <= 0.0):
            return False
        pos = self.state.pos_ned_m
        far = radius_m > 0.0 and math.hypot(pos[0] - home[0], pos[1] - home[1]) > radius_m
        return far or (height_m > 0.0 and home[2] - pos[2] > height_m)

    def _set_home(self, pos_ned_m: Vec3, now_s: float) -> None:
        self.home_ned_m = pos_ned_m
        self.home_yaw_rad = self.state.attitude_rad[2]
        self.home_at_s = now_s

    def _detect_landing(self, now_s: float) -> None:
        ramp_at_s = self._ramp_at_s
        if self.landed:
            if self.armed and ramp_at_s is not None and now_s - ramp_at_s >= TAKEOFF_SEEN_S:
                self.landed = False
                self._flown = True
                self._note(mav.MAV_SEVERITY_INFO, "Takeoff detected")
            return
        lifting = self.armed and (self.command_ned_mps[2] < 0.0 or not self._ramp_done)
        if lifting or not self.state.on_ground:
            self._contact_at_s = None
            return
        if self._contact_at_s is None:
            self._contact_at_s = now_s
        if now_s - self._contact_at_s >= GROUND_CONTACT_S or not self.armed:
            self.landed = True
            self._landed_at_s = now_s
            self._ramp_at_s, self._ramp_done = None, False
            self._note(mav.MAV_SEVERITY_INFO, "Landing detected")

    def _note(self, severity: int, text: str) -> None:
        self.notices.append(Notice(severity, text))

    # Guidance

    def _guided(self, dt_s: float) -> Vec3:
        """The velocity (NED m/s) that the mode asks for; sets the heading."""
        if self.failsafe is not None and self._action is Action.DESCEND:
            return (*EMERGENCY_DRIFT_NED_MPS, EMERGENCY_DESCENT_MPS)
        match self.mode:
            case Px4Mode.OFFBOARD:
                return self._follow_setpoint(dt_s)
            case Px4Mode.TAKEOFF:
                return self._climb()
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

    def _off_the_ground(self, wanted: Vec3, now_s: float) -> Vec3:
        """On the ground the rotors idle until a mode wants up; then PX4's spool-up and climb ramp."""
        if self._ramp_done:
            return wanted
        value = self._parameters
        idle = (0.0, 0.0, value["MPC_LAND_CRWL"])  # presses the vehicle gently onto the ground
        lifts = self.mode in (Px4Mode.TAKEOFF, Px4Mode.OFFBOARD) and wanted[2] < -LIFT_MPS
        if self.state.on_ground and not lifts:
            self._ramp_at_s, self._ramp_done = None, not self.landed
            return idle
        if now_s - self._armed_at_s < value["COM_SPOOLUP_TIME"]:
            return idle
        if self._ramp_at_s is None:
            self._ramp_at_s = now_s
        ramp_s = value["MPC_TKO_RAMP_T"]
        share = (now_s - self._ramp_at_s) / ramp_s if ramp_s > 0.0 else 1.0
        if share >= 1.0:
            self._ramp_done = True
            return wanted
        # PX4 ramps the largest climb from the velocity error that would ask for no thrust at all.
        start_mps = -GRAVITY_MPS2 / max(value["MPC_Z_VEL_P_ACC"], 0.1)
        climb_max_mps = start_mps + share * (value["MPC_TKO_SPEED"] - start_mps)
        standing = self.state.on_ground
        if climb_max_mps <= 0.0 and standing:
            return idle
        north, east = (0.0, 0.0) if standing else wanted[:2]
        return (north, east, max(wanted[2], -max(climb_max_mps, 0.0)))

    def _follow_setpoint(self, dt_s: float) -> Vec3:
        value = self._parameters
        setpoint = self._setpoint
        pos = self.state.pos_ned_m
        gains = (value["MPC_XY_P"], value["MPC_XY_P"], value["MPC_Z_P"])
        north, east, down = (
            (gain * (want_m - here_m) if want_m is not None else 0.0) + (vel_mps or 0.0)
            for want_m, vel_mps, here_m, gain in zip(setpoint.pos_ned_m, setpoint.vel_ned_mps, pos, gains, strict=True)
        )
        if setpoint.yaw_rad is not None:
            self.command_yaw_rad = wrapped_rad(setpoint.yaw_rad)
        elif setpoint.yaw_rate_radps:
            self.command_yaw_rad = wrapped_rad(self.command_yaw_rad + setpoint.yaw_rate_radps * dt_s)
        limits = SpeedLimits(value["MPC_XY_VEL_MAX"], value["MPC_Z_VEL_MAX_UP"], value["MPC_Z_VEL_MAX_DN"])
        return limited((north, east, down), limits)

    def _go_to(self, target_ned_m: Vec3, *, up_mps: float | None = None) -> Vec3:
        value = self._parameters
        cruise_mps = min(self._cruise_mps or value["MPC_XY_CRUISE"], value["MPC_XY_VEL_MAX"])
        limits = SpeedLimits(
            cruise_mps,
            min(up_mps or value["MPC_Z_V_AUTO_UP"], value["MPC_Z_VEL_MAX_UP"]),
            min(value["MPC_Z_V_AUTO_DN"], value["MPC_Z_VEL_MAX_DN"]),
        )
        return towards(
            self.state.pos_ned_m,
            target_ned_m,
            gain_xy=value["MPC_XY_P"],
            gain_z=value["MPC_Z_P"],
            limits=limits,
        )

    def _climb(self) -> Vec3:
        """TAKEOFF; at the top, HOLD there."""
        target = self._target_ned_m
        climb_left_m = self.state.pos_ned_m[2] - target[2]
        if not self.landed and climb_left_m < self._parameters["NAV_MC_ALT_RAD"]:
            self._choose(Px4Mode.HOLD)
            self.mode = Px4Mode.HOLD  # not entered: the target stays the top
            return self._go_to(target)
        return self._go_to(target, up_mps=self._parameters["MPC_TKO_SPEED"])

    def _land(self) -> Vec3:
        """Down over the target: MPC_LAND_SPEED below MPC_LAND_ALT2, faster the higher above it."""
        value = self._parameters
        ground_m = (self.home_ned_m or self.origin_ned_m)[2]
        down_mps = interpolated(
            ground_m - self.state.pos_ned_m[2],
            value["MPC_LAND_ALT2"],
            value["MPC_LAND_SPEED"],
            value["MPC_LAND_ALT1"],
            max(value["MPC_Z_V_AUTO_DN"], value["MPC_LAND_SPEED"]),
        )
        north, east, _ = self._go_to(self._target_ned_m)
        return (north, east, down_mps)

    def _return(self) -> Vec3:
        """RTL: up, across, down."""
        home = self.home_ned_m or self.origin_ned_m
        pos = self.state.pos_ned_m
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
