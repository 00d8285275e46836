"""PX4's commander: modes, arming, home, landing, failsafes.

No MAVLink in here but its enums. Positions are NED metres about the mission's origin, as the airframe's.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from companion.core.model.vectors import is_finite
from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame, Vec3
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot.battery import Battery, BatterySpec
from sim_bridge.world.autopilot.estimates.gnss_faults import has_position
from sim_bridge.world.autopilot.fence import Fence
from sim_bridge.world.autopilot.protocols.parameters import ParameterTable
from sim_bridge.world.autopilot.px4 import tables
from sim_bridge.world.autopilot.px4.failsafe import Conditions, SetpointStream
from sim_bridge.world.autopilot.px4.navigator import EMERGENCY_DESCENT_MPS, EMERGENCY_DRIFT_NED_MPS, Liftoff, Navigator
from sim_bridge.world.autopilot.px4.tables import Action, Px4Mode
from sim_bridge.world.autopilot.setpoint import Setpoint
from sim_bridge.world.autopilot.types import BatteryLevel, Failsafe, LandedState, Notice, Result

POSITION_S: Final = 1.2  # after boot: the estimator has a position, and home is set (recorded: 1.1-1.3 s)
READY_S: Final = 4.1  # after boot: ready to arm (recorded, by PX4's own clock: not yet at 4.0 s, STANDBY at 4.15)
GROUND_CONTACT_S: Final = 2.0  # on the ground, not climbing, so long: landed (recorded: 2-5 s after the descent)
NOTICES_MAX: Final = 32


class Px4Flight:
    """One vehicle's flight logic: `update` once per step, and requests that answer with a `Result`."""

    def __init__(self, airframe: Airframe, frame: LocalFrame, parameters: ParameterTable, battery: BatterySpec) -> None:
        self._airframe = airframe
        self._frame = frame
        self._parameters = parameters
        self.state: AirframeState = airframe.state
        self.battery = Battery(battery)
        self._navigator = Navigator(parameters, self.state)
        self._liftoff = Liftoff(parameters)
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
        self.fence = Fence()

        self._last_s = 0.0
        self._intended = Px4Mode.HOLD  # what the user asked for; a failsafe does not touch it
        self._after_disarm = Px4Mode.HOLD
        self._action = Action.WARN  # of the failsafe that acts
        self._conditions = Conditions(parameters)
        self._armed_at_s = 0.0
        self._landed_at_s = 0.0
        self._contact_at_s: float | None = None
        self._flown = False  # since arming
        self._setpoints = SetpointStream(parameters)

    # What others see

    @property
    def command_yaw_rad(self) -> float:
        """The heading that the airframe is to keep."""
        return self._navigator.yaw_rad

    @property
    def ready(self) -> bool:
        """The prearm bit: booted, and the mode asked for could run."""
        if self._last_s < READY_S or self.failsafe is Failsafe.TERMINATED:
            return False
        if self._intended is Px4Mode.OFFBOARD:
            return not self._setpoints.lost(self._last_s)
        return self.armed or self._intended not in tables.NO_ARMING_MODES

    @property
    def awaits_first_setpoint(self) -> bool:
        """OFFBOARD is asked for, and none has come since boot."""
        return self._intended is Px4Mode.OFFBOARD and not self._setpoints.begun

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
        """As EXTENDED_SYS_STATE shows it."""
        if self.landed:
            return LandedState.ON_GROUND
        if self.mode is Px4Mode.TAKEOFF:
            return LandedState.TAKEOFF
        returning = self.mode is Px4Mode.RTL and self._navigator.returning_to_ground
        if self.mode is Px4Mode.LAND or returning:
            return LandedState.LANDING
        return LandedState.IN_AIR

    @property
    def battery_level(self) -> BatteryLevel:
        """By the share left: BAT_LOW_THR, BAT_CRIT_THR, BAT_EMERGEN_THR."""
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
        self._liftoff.reset(done=not self.landed)  # rearmed in the air: no spool-up
        self._navigator.yaw_rad = self.state.attitude_rad[2]
        self._set_home(self.state.pos_ned_m, now_s)
        self._enter_mode(self.mode)
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
        streaming = self._setpoints.alive(now_s)
        if self.armed and mode is Px4Mode.OFFBOARD and not streaming:
            return self._refuse_mode(mode)
        repeated = mode is self.mode and self.failsafe is None
        self._choose(mode)
        if mode is Px4Mode.OFFBOARD and not streaming:
            return Result.ACCEPTED
        if not repeated:
            self._navigator.takeoff_down_m = None
            self._enter_mode(mode)
        return Result.ACCEPTED

    def takeoff(self, alt_amsl_m: float) -> Result:
        """NAV_TAKEOFF: up to `alt_amsl_m`, NaN being MIS_TAKEOFF_ALT above home. Starts once armed."""
        if self.failsafe is Failsafe.TERMINATED:
            return self._refuse_mode(Px4Mode.TAKEOFF)
        down_m = self._frame.origin.alt_m - alt_amsl_m
        self._navigator.takeoff_down_m = down_m if math.isfinite(down_m) else None
        self._choose(Px4Mode.TAKEOFF)
        self._enter_mode(Px4Mode.TAKEOFF)
        return Result.ACCEPTED

    def reposition(self, target: tuple[float, float, float], yaw_rad: float, *, change_mode: bool) -> Result:
        """DO_REPOSITION: HOLD at `target` (NED m, mission's origin); NaN keeps that axis or the heading."""
        if self.failsafe is Failsafe.TERMINATED:
            return self._refuse_mode(Px4Mode.HOLD)
        if not change_mode and self.mode is not Px4Mode.HOLD:
            return Result.TEMPORARILY_REJECTED
        self._choose(Px4Mode.HOLD)
        self._enter_mode(Px4Mode.HOLD)
        self._navigator.move_target(target, yaw_rad)
        return Result.ACCEPTED

    def change_speed(self, speed_mps: float) -> Result:
        """DO_CHANGE_SPEED: cruise of the automatic modes, m/s; -1 or NaN: as it is; -2: the default."""
        if speed_mps == -2.0:
            self._navigator.cruise_mps = None
        elif speed_mps > 0.0 and math.isfinite(speed_mps):
            self._navigator.cruise_mps = speed_mps
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
        self._navigator.setpoint = setpoint
        self._setpoints.record_setpoint(now_s)

    def hear_gcs(self, system: int, now_s: float) -> None:
        """A ground station's heartbeat has come: any, to PX4."""
        del system
        self._conditions.hear_gcs(now_s)

    # The step

    def update(self, now_s: float) -> None:
        """Look, decide, and give the airframe its velocity and heading."""
        dt_s = max(0.0, now_s - self._last_s)
        self._last_s = now_s
        self.state = self._navigator.state = self._airframe.state
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
        if self.mode is Px4Mode.TAKEOFF and not self.state.on_ground and self._navigator.at_top:
            self._choose(Px4Mode.HOLD)
            self.mode = Px4Mode.HOLD  # not entered: it holds the top
        self._command(now_s, dt_s)

    def _command(self, now_s: float, dt_s: float) -> None:
        """Give the airframe its velocity and heading."""
        if self.failsafe is not None and self._action is Action.DESCEND:
            wanted: Vec3 = (*EMERGENCY_DRIFT_NED_MPS, EMERGENCY_DESCENT_MPS)
        else:
            wanted = self._navigator.wanted(self.mode, dt_s)
        wanted = self._liftoff.limit(
            wanted,
            now_s,
            armed_s=now_s - self._armed_at_s,
            may_lift=self.mode in (Px4Mode.TAKEOFF, Px4Mode.OFFBOARD),
            standing=self.state.on_ground,
        )
        # Parameters have no ranges, as in PX4: with absurd ones the vehicle stops, and the bridge goes on.
        self.command_ned_mps = wanted if is_finite(wanted) else (0.0, 0.0, 0.0)
        self._airframe.command(self.command_ned_mps, self._navigator.yaw_rad)

    # Decisions

    def _arming_refusal(self, now_s: float, *, force: bool) -> str:
        """Reason why it may not arm, in words; empty: arm."""
        if self._parameters["NAV_DLL_ACT"] > 0 and not self._conditions.gcs_alive(now_s):
            return "no connection to the ground station"  # recorded: also when forced
        if self.failsafe is Failsafe.TERMINATED:
            return "terminated"
        if force:
            return "" if self.home_ned_m is not None else "system not ready"
        if now_s < READY_S:
            return "system not ready"
        if self._intended in tables.NO_ARMING_MODES:
            return f"mode {self._intended.name} does not allow arming"
        if self._intended is Px4Mode.OFFBOARD and not self._setpoints.alive(now_s):
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

    def _enter_mode(self, mode: Px4Mode) -> None:
        """Show `mode`, which begins here."""
        self.mode = mode
        self._navigator.begin(mode, flying=self.armed and not self.landed)

    def _check_offboard(self, now_s: float) -> None:
        """OFFBOARD begins, is lost, and comes back, for as long as the user wants it."""
        if self._intended is not Px4Mode.OFFBOARD:
            return
        if self.failsafe in (None, Failsafe.OFFBOARD_LOSS):
            showing = self.mode is Px4Mode.OFFBOARD and self.failsafe is None
            # Back after a loss one setpoint is enough (recorded at 0.9 Hz).
            lost = self.failsafe is Failsafe.OFFBOARD_LOSS
            if not showing and (not self._setpoints.lost(now_s) if lost else self._setpoints.alive(now_s)):
                self.failsafe = None
                self._enter_mode(Px4Mode.OFFBOARD)
            elif showing and self.armed and self._setpoints.lost(now_s):
                action, mode = tables.OFFBOARD_LOSS_ACTIONS.get(
                    int(self._parameters["COM_OBL_RC_ACT"]), (Action.HOLD, Px4Mode.HOLD)
                )
                self._act(Failsafe.OFFBOARD_LOSS, action, mode)

    def _check_failsafes(self, now_s: float) -> None:
        """The conditions besides the offboard stream. One that is graver than what acts already takes over."""
        for cause, what, action in self._conditions.trip(
            now_s, self.battery_level, self._outside_fence, has_position=has_position(self._airframe)
        ):
            if action is Action.WARN:
                self._note(mav.MAV_SEVERITY_WARNING, what)
            elif self.failsafe is None or action > self._action:
                self._act(cause, action, tables.ACTION_MODES.get(action, self.mode))

    def _act(self, cause: Failsafe, action: Action, mode: Px4Mode) -> None:
        self._note(mav.MAV_SEVERITY_CRITICAL, f"Failsafe activated: {cause.value}, {action.name}")
        if action is Action.TERMINATE:
            self.terminate()
            return
        self.failsafe = cause
        self._action = action
        self._enter_mode(mode)

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
        self._conditions.forget()
        self._navigator.takeoff_down_m = None
        self._intended = self._after_disarm
        self._enter_mode(self._after_disarm)

    # Observations

    def _outside_fence(self) -> bool:
        """The fence uploaded, and the cylinder about home of GF_MAX_HOR_DIST and GF_MAX_VER_DIST; 0: no bound."""
        radius_m, height_m = self._parameters["GF_MAX_HOR_DIST"], self._parameters["GF_MAX_VER_DIST"]
        home, pos = self.home_ned_m, self.state.pos_ned_m
        if home is None:
            return False
        if self.fence.breached(pos, within_all=False):
            return True
        far = radius_m > 0.0 and math.hypot(pos[0] - home[0], pos[1] - home[1]) > radius_m
        return far or (height_m > 0.0 and home[2] - pos[2] > height_m)

    def _set_home(self, pos_ned_m: Vec3, now_s: float) -> None:
        self.home_ned_m = self._navigator.home_ned_m = pos_ned_m
        self.home_yaw_rad = self.state.attitude_rad[2]
        self.home_at_s = now_s

    def _detect_landing(self, now_s: float) -> None:
        if self.landed:
            if self.armed and self._liftoff.seen(now_s):
                self.landed = False
                self._flown = True
                self._note(mav.MAV_SEVERITY_INFO, "Takeoff detected")
            return
        lifting = self.armed and (self.command_ned_mps[2] < 0.0 or not self._liftoff.done)
        if lifting or not self.state.on_ground:
            self._contact_at_s = None
            return
        if self._contact_at_s is None:
            self._contact_at_s = now_s
        if now_s - self._contact_at_s >= GROUND_CONTACT_S or not self.armed:
            self.landed = True
            self._landed_at_s = now_s
            self._liftoff.reset()
            self._note(mav.MAV_SEVERITY_INFO, "Landing detected")

    def _note(self, severity: int, text: str) -> None:
        self.notices.append(Notice(severity, text))
