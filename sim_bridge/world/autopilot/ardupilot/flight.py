"""ArduCopter's modes, arming, home, landing and failsafes.

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
from sim_bridge.world.autopilot.ardupilot import tables
from sim_bridge.world.autopilot.ardupilot.failsafe import Conditions, Trip, fence_breach
from sim_bridge.world.autopilot.ardupilot.navigator import GuidedMode, Navigator, ReturnPhase
from sim_bridge.world.autopilot.ardupilot.prearm import prearm_refusals
from sim_bridge.world.autopilot.ardupilot.tables import CopterAction, CopterMode
from sim_bridge.world.autopilot.battery import Battery, BatterySpec
from sim_bridge.world.autopilot.estimates.gnss_faults import has_position
from sim_bridge.world.autopilot.fence import Fence
from sim_bridge.world.autopilot.protocols.parameters import ParameterTable
from sim_bridge.world.autopilot.setpoint import Setpoint
from sim_bridge.world.autopilot.types import BatteryLevel, Failsafe, LandedState, Notice, Result

SPOOL_AFTER_ARMING_S: Final = 2.0  # ArduCopter's delay before the motors answer
SPOOL_UP_S: Final = 1.3  # from then, or from the takeoff command, to the first lift (recorded: 3.3 s after arming)
LIFT_RAMP_S: Final = 0.6  # the first part of a takeoff: thrust still builds up
LIFT_RAMP_MPS: Final = 0.3
IDLE_DOWN_MPS: Final = 0.3  # presses the vehicle gently onto the ground
LANDED_S: Final = 1.9  # on the ground, not climbing: landed (recorded)
DISARM_AFTER_LANDING_S: Final = 0.1
PREARM_TEXT_EVERY_S: Final = 30.0
NOTICES_MAX: Final = 64
INFO, WARNING, CRITICAL = mav.MAV_SEVERITY_INFO, mav.MAV_SEVERITY_WARNING, mav.MAV_SEVERITY_CRITICAL


class CopterFlight:
    """One vehicle's flight logic: `update` once per step, and requests that answer with a `Result`."""

    def __init__(self, airframe: Airframe, frame: LocalFrame, parameters: ParameterTable, battery: BatterySpec) -> None:
        self._airframe = airframe
        self._frame = frame
        self._parameters = parameters
        self._battery = battery
        self.state: AirframeState = airframe.state
        self.battery = Battery(battery)
        self.navigator = Navigator(parameters, self.state)
        self.origin_ned_m: Vec3 = self.state.pos_ned_m  # of LOCAL_POSITION_NED: where the EKF's origin was set
        self.home_ned_m: Vec3 | None = None
        self.home_yaw_rad = math.nan  # HOME_POSITION has no heading here
        self.home_at_s = 0.0
        self.homes_set = 0  # each is broadcast once
        self.notices: deque[Notice] = deque(maxlen=NOTICES_MAX)

        self.armed = False
        self.landed = True
        self.mode = CopterMode.STABILIZE
        self.failsafe: Failsafe | None = None
        self.command_ned_mps: Vec3 = (0.0, 0.0, 0.0)
        self.fence = Fence()

        self._last_s = 0.0
        self._boot_texts = deque(tables.BOOT_TEXTS)
        self._next_prearm_text_s = tables.PREARM_TEXT_S
        self._in_flight_texts_said = False
        self._armed_at_s = 0.0
        self._idle_since_s = 0.0  # armed on the ground
        self._takeoff_at_s: float | None = None  # of a takeoff that still stands on the ground
        self._landed_at_s = 0.0
        self._contact_at_s: float | None = None
        self._conditions = Conditions(parameters)

    # What others see

    @property
    def command_yaw_rad(self) -> float:
        """The heading that the airframe is to keep."""
        return self.navigator.yaw_rad

    @property
    def position_known(self) -> bool:
        """The EKF uses its GPS."""
        return self._last_s >= tables.POSITION_S

    @property
    def prearm_ok(self) -> bool:
        """SYS_STATUS's prearm bit: true long before the EKF has a position, in a mode that needs none (recorded)."""
        return self._last_s >= tables.PREARM_CHECKED_S and not self._refusals()

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status."""
        if self._last_s < tables.INITIALISED_S:
            return int(mav.MAV_STATE_BOOT)
        if self.failsafe is not None and self.armed:
            return int(mav.MAV_STATE_CRITICAL)
        return int(mav.MAV_STATE_STANDBY if self.landed else mav.MAV_STATE_ACTIVE)

    @property
    def landed_state(self) -> LandedState:
        """As EXTENDED_SYS_STATE shows it."""
        if self.landed:
            return LandedState.ON_GROUND
        guided = self.navigator.guided.doing
        if self.mode is CopterMode.GUIDED and guided is GuidedMode.TAKEOFF:
            return LandedState.TAKEOFF
        returning = self.mode is CopterMode.RTL and self.navigator.return_phase is ReturnPhase.LAND
        if self.mode is CopterMode.LAND or returning:
            return LandedState.LANDING
        return LandedState.IN_AIR

    @property
    def battery_level(self) -> BatteryLevel:
        """By the voltage and charge of BATT_LOW_* and BATT_CRT_*."""
        value = self._parameters
        left_mah = self.battery.remaining * self._battery.capacity_mah
        if self.battery.voltage_v < value["BATT_CRT_VOLT"] or left_mah < value["BATT_CRT_MAH"]:
            return BatteryLevel.CRITICAL
        low = self.battery.voltage_v < value["BATT_LOW_VOLT"] or left_mah < value["BATT_LOW_MAH"]
        return BatteryLevel.LOW if low else BatteryLevel.OK

    # Requests

    def arm(self, now_s: float, *, force: bool) -> Result:
        """Refused with its reasons in words; `force` arms in spite of all but the boot."""
        if self.armed:
            return Result.ACCEPTED
        refusals = self._refusals()
        if self.mode not in tables.ARMING_MODES:
            refusals.append("Mode not armable")
        if refusals and (not force or self._last_s < tables.INITIALISED_S):
            for why in refusals:
                self._note(CRITICAL, f"Arm: {why}")
            return Result.FAILED
        self.armed = True
        self._armed_at_s = self._idle_since_s = now_s
        self._takeoff_at_s = None
        self.navigator.yaw_rad = self.state.attitude_rad[2]
        self._set_home(self.state.pos_ned_m, now_s)
        self.navigator.begin(self.mode)
        self._airframe.set_armed(True)
        self._note(INFO, "Arming motors")
        return Result.ACCEPTED

    def disarm(self, *, force: bool) -> Result:
        """Refused in the air, unless forced: then the vehicle falls."""
        if self.armed and not self.landed and not force:
            return Result.FAILED
        self._stop()
        return Result.ACCEPTED

    def set_mode(self, number: int) -> Result:
        """By its number, as ArduCopter has it."""
        try:
            mode = CopterMode(number)
        except ValueError:
            self._note(WARNING, f"No such mode {number}")
            return Result.FAILED
        if mode is self.mode:
            return Result.ACCEPTED
        if self.armed and mode in tables.NEEDS_POSITION and not self.position_known:
            self._note(WARNING, f"Mode change to {mode.name} failed: requires position")
            return Result.FAILED
        self._enter_mode(mode)
        return Result.ACCEPTED

    def takeoff(self, climb_m: float, now_s: float) -> Result:
        """NAV_TAKEOFF to `climb_m` above home: armed on the ground, in GUIDED, or it fails."""
        if not self.armed or not self.landed or self.mode is not CopterMode.GUIDED or not climb_m > 0.0:
            return Result.FAILED
        self.navigator.take_off(climb_m)
        if self._takeoff_at_s is None:  # asked again, its motors have begun to spool up already
            self._takeoff_at_s = now_s
        return Result.ACCEPTED

    def reposition(self, target: tuple[float, float, float], yaw_rad: float, *, change_mode: bool) -> Result:
        """DO_REPOSITION: GUIDED to `target` (NED m, mission's origin); NaN keeps that axis or the heading."""
        if self.mode is not CopterMode.GUIDED:
            if not change_mode:
                return Result.DENIED
            if self.set_mode(CopterMode.GUIDED) is not Result.ACCEPTED:
                return Result.FAILED
        if self.landed:
            return Result.FAILED
        self.navigator.move_target(target, yaw_rad)
        return Result.ACCEPTED

    def change_speed(self, speed_mps: float) -> Result:
        """DO_CHANGE_SPEED: horizontal, m/s."""
        if not (speed_mps > 0.0 and math.isfinite(speed_mps)):
            return Result.FAILED
        self.navigator.cruise_mps = speed_mps
        return Result.ACCEPTED

    def set_home(self, pos_ned_m: Vec3 | None, now_s: float) -> Result:
        """DO_SET_HOME; None is here."""
        if self.home_ned_m is None:
            return Result.FAILED
        self._set_home(pos_ned_m if pos_ned_m is not None else self.state.pos_ned_m, now_s)
        return Result.ACCEPTED

    def terminate(self) -> Result:
        """DO_FLIGHTTERMINATION: the rotors stop."""
        self._stop()
        return Result.ACCEPTED

    def offer_setpoint(self, setpoint: Setpoint, now_s: float) -> None:
        """A setpoint has come; outside GUIDED it is ignored."""
        if self.mode is CopterMode.GUIDED:
            self.navigator.offer_setpoint(setpoint, now_s)

    def hear_gcs(self, system: int, now_s: float) -> None:
        """Only MAV_GCS_SYSID counts, whatever type it says it is."""
        if system != int(self._parameters["MAV_GCS_SYSID"]):
            return
        if self._conditions.hear_gcs(now_s):
            self._note(WARNING, "GCS Failsafe Cleared")
            if self.failsafe is Failsafe.GCS_LOSS:
                self.failsafe = None  # the mode stays

    # The step

    def update(self, now_s: float) -> None:
        """Look, decide, and give the airframe its velocity and heading."""
        dt_s = max(0.0, now_s - self._last_s)
        before_s, self._last_s = self._last_s, now_s
        self.state = self.navigator.state = self._airframe.state
        self.battery.drain(dt_s, self.state.throttle)
        if self._boot_texts or not self.armed:
            self._boot(before_s, now_s)
        self._detect_landing(now_s)
        if not self.armed:
            return
        self._check_failsafes(now_s)
        self._check_auto_disarm(now_s)
        if self.armed:
            self._command(now_s, dt_s)

    def _boot(self, before_s: float, now_s: float) -> None:
        """Advances what comes by itself while it starts."""
        if before_s < tables.RC_SWITCH_S <= now_s and self.mode is not CopterMode.STABILIZE:
            self._enter_mode(CopterMode.STABILIZE)
        if self.home_ned_m is None and now_s >= tables.HOME_S:
            self.origin_ned_m = self.state.pos_ned_m
            self._set_home(self.state.pos_ned_m, now_s)
        ground_m = self._frame.origin.alt_m - self.state.pos_ned_m[2]
        while self._boot_texts and now_s >= self._boot_texts[0][0]:
            self._note(INFO, self._boot_texts.popleft()[1].format(ground_m=ground_m))
        if now_s >= self._next_prearm_text_s and not self.armed:
            self._next_prearm_text_s = now_s + PREARM_TEXT_EVERY_S
            for why in self._refusals():
                self._note(CRITICAL, f"PreArm: {why}")

    def _command(self, now_s: float, dt_s: float) -> None:
        """Give the airframe its velocity and heading."""
        idle = (0.0, 0.0, IDLE_DOWN_MPS)
        if self.landed:
            wanted = self._lift(now_s, idle)
        else:
            wanted = self.navigator.wanted(self.mode, now_s, dt_s)
            if self._takeoff_at_s is not None:
                wanted = self._lift(now_s, wanted)
            self._say_in_flight()
        # Parameters have no ranges here: with absurd ones the vehicle stops, and the bridge goes on.
        self.command_ned_mps = wanted if is_finite(wanted) else (0.0, 0.0, 0.0)
        self._airframe.command(self.command_ned_mps, self.navigator.yaw_rad)

    def _lift(self, now_s: float, otherwise: Vec3) -> Vec3:
        """The beginning of a takeoff: spool up, then lift slowly; `otherwise` without a takeoff, and after it."""
        asked_s = self._takeoff_at_s
        if asked_s is None or self.navigator.guided.doing is not GuidedMode.TAKEOFF:
            self._takeoff_at_s = None
            return otherwise
        lift_s = max(self._armed_at_s + SPOOL_AFTER_ARMING_S, asked_s) + SPOOL_UP_S
        if now_s < lift_s:
            return (0.0, 0.0, IDLE_DOWN_MPS)
        if now_s >= lift_s + LIFT_RAMP_S:
            self._takeoff_at_s = None
        return (0.0, 0.0, -LIFT_RAMP_MPS)

    # Decisions

    def _refusals(self) -> list[str]:
        home_known, level = self.home_ned_m is not None, self.battery_level
        checks = self._parameters["ARMING_CHECK"] != 0
        return prearm_refusals(self._last_s, self.mode, checks=checks, home_known=home_known, level=level)

    def _enter_mode(self, mode: CopterMode) -> None:
        """Show `mode`, which begins here."""
        self.mode = mode
        self._takeoff_at_s = None
        self.navigator.begin(mode, has_position=has_position(self._airframe))

    def _check_failsafes(self, now_s: float) -> None:
        self._trip(self._conditions.gcs(now_s, self.mode))
        self._trip(self._conditions.battery(now_s, self.battery_level, self.battery))
        self._trip(self._conditions.position(has_position=has_position(self._airframe)))
        self._check_fence()

    def _trip(self, trip: Trip | None) -> None:
        if trip is not None:
            self._note(WARNING, trip.text)
            self._act(trip.cause, trip.action)

    def _check_fence(self) -> None:
        fenced = self._parameters["FENCE_ENABLE"] and not self.landed
        breach = fence_breach(self._parameters, self.fence, self.home_ned_m, self.state.pos_ned_m) if fenced else ""
        cleared = self._conditions.fence_breached and not breach
        trip = self._conditions.fence(breach)
        self._trip(trip)
        if cleared and self.failsafe is Failsafe.GEOFENCE:
            self.failsafe = None

    def _act(self, cause: Failsafe, action: CopterAction) -> None:
        """On the ground it disarms, whatever the action is."""
        self.failsafe = cause
        if action is CopterAction.NONE:
            return
        if self.landed or action is CopterAction.TERMINATE:
            self._stop()
            return
        mode = {CopterAction.RTL: CopterMode.RTL, CopterAction.BRAKE: CopterMode.BRAKE}.get(action, CopterMode.LAND)
        loses_place = cause is Failsafe.POSITION_LOSS and mode is self.mode
        if loses_place or (mode is not self.mode and not (mode is CopterMode.RTL and self.mode is CopterMode.LAND)):
            self._enter_mode(mode)

    def _check_auto_disarm(self, now_s: float) -> None:
        if not self.landed:
            self._idle_since_s = now_s
            return
        if self._takeoff_at_s is not None:
            self._idle_since_s = now_s
        landing = self.mode in (CopterMode.LAND, CopterMode.RTL)
        delay_s = DISARM_AFTER_LANDING_S if landing else self._parameters["DISARM_DELAY"]
        if 0.0 < delay_s <= now_s - (self._landed_at_s if landing else self._idle_since_s):
            self._stop()

    def _stop(self) -> None:
        """Disarm; the mode stays."""
        if self.armed:
            self._note(INFO, "Disarming motors")
        self.armed = False
        self.landed = True  # by its land detector's definition, also while it falls (recorded)
        self._airframe.set_armed(False)
        self.command_ned_mps = (0.0, 0.0, 0.0)
        self.failsafe = None
        self._takeoff_at_s = None
        self._conditions.fence_breached = False
        self.navigator.begin(self.mode)

    # Observations

    def _detect_landing(self, now_s: float) -> None:
        if self.landed:
            if self.armed and not self.state.on_ground and self.command_ned_mps[2] < 0.0:
                self.landed = False
                self._contact_at_s = None
            return
        if self.navigator.guided.doing is GuidedMode.TAKEOFF and self.mode is CopterMode.GUIDED:
            if self.navigator.taken_off:
                self.navigator.move_target((math.nan, math.nan, math.nan), math.nan)
            return
        if not self.state.on_ground or self.command_ned_mps[2] < 0.0:
            self._contact_at_s = None
            return
        if self._contact_at_s is None:
            self._contact_at_s = now_s
        if now_s - self._contact_at_s >= LANDED_S:
            self.landed = True
            self._landed_at_s = self._idle_since_s = now_s

    def _set_home(self, pos_ned_m: Vec3, now_s: float) -> None:
        self.home_ned_m = self.navigator.home_ned_m = pos_ned_m
        self.home_at_s = now_s
        self.homes_set += 1

    def _say_in_flight(self) -> None:
        if self._in_flight_texts_said or self.home_ned_m is None:
            return
        if self.home_ned_m[2] - self.state.pos_ned_m[2] > tables.IN_FLIGHT_TEXTS_HEIGHT_M:
            self._in_flight_texts_said = True
            for text in tables.IN_FLIGHT_TEXTS:
                self._note(INFO, text)

    def _note(self, severity: int, text: str) -> None:
        self.notices.append(Notice(severity, text))
