"""State that the vehicle's own autopilot has reported last, and how old it is: the gate for its own lies.

Two things make a position old. It came long ago: the local clock tells. Or it was long under way (a relay with a
backlog): then frames come as often as ever, and only the autopilot's own time in them tells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from companion.core.model.events import (
    Answer,
    AutopilotEvent,
    AutopilotHealth,
    AutopilotMode,
    AutopilotText,
    BootTime,
    Landed,
    Position,
)
from companion.core.model.states import FlightMode, LandedState, VelocityShaping
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import (
    CRITICAL_BATTERY_PERCENT,
    Cause,
    Finding,
    Readings,
    Source,
)
from companion.core.vehicle.obstacle_sensor_monitor import ObstacleSensorMonitor

DISARMED_IN_AIR: Final = failsafe_engine.row(Cause.DISARMED_IN_AIR)
SETPOINTS_CUT: Final = failsafe_engine.row(Cause.SETPOINTS_CUT)
NO_HEARTBEAT: Final = failsafe_engine.row(Cause.NO_HEARTBEAT)
NO_POSITION: Final = failsafe_engine.row(Cause.NO_POSITION)
LATE: Final = failsafe_engine.row(Cause.TELEMETRY_LATE)
GAP_S: Final = 0.4  # a link that was silent for so long may have cost the autopilot its setpoints; its timeout is 0.5 s
DRIFT: Final = 1e-3  # of the least delay: crystals drift by 2e-4, and a constant delay outlasts a flight
LANDED_OLD_S: Final = 3.0  # it comes five times a second: of one that is armed an older one tells nothing
HEALTH_OLD_S: Final = failsafe_engine.row(Cause.BATTERY_UNKNOWN).delay_s  # it comes once a second
LEAP_S: Final = 2.0  # vehicle time may run ahead of ours by this much at once; further, or back, it is doubted
BELIEVED_AFTER: Final = 3  # frames in a row: then it is so
TAKEOFF_SHORT_SHARE: Final = 0.1  # of the altitude: so far below it a climb may end, where that is more than the make's
ROUND_TRIP_MAX_S: Final = 10.0  # longer ones answer another's question
TELEMETRY_LATE = "telemetry late"
WRAP_S = 2**32 / 1e3  # of time_boot_ms


class Vehicle:
    """Feed it the autopilot's events; all times are of the local clock, in seconds."""

    def __init__(self, sensors: ObstacleSensorMonitor | None = None) -> None:
        """`sensors`: that it must fly by; by default none."""
        self.sensors = sensors or ObstacleSensorMonitor()
        self.position: Position | None = None
        self.mode: AutopilotMode | None = None
        self.landed = LandedState.UNDEFINED
        self.began_aloft = False  # what it told first is that it is in the air; until it is on the ground
        self._ready_to_arm = False
        self._battery_percent: int | None = None
        self.heartbeat_s = -1e9
        self.delay = Delay()
        self._position_s = self._landed_s = self._health_s = -1e9
        self._heard_s = -1e9
        self._gap_ended_s = self._airborne_s = -1e9

    def receive(self, event: AutopilotEvent, now_s: float) -> None:
        """Store one event of the vehicle's own autopilot. A position with a time that is doubted is not taken."""
        if now_s - self._heard_s > GAP_S:
            self._gap_ended_s = now_s
        self._heard_s = now_s
        match event:
            case Position():
                if event.boot_s is None or self.delay.accept_time(event.boot_s, now_s):
                    self.position, self._position_s = event, now_s
            case BootTime():
                self.delay.bound(event, now_s)
            case AutopilotMode():
                self.mode, self.heartbeat_s = event, now_s
            case AutopilotHealth():
                self._ready_to_arm, self._battery_percent = event.ready_to_arm, event.battery_percent
                self._health_s = now_s
            case Landed():
                if self.airborne:
                    self._airborne_s = now_s
                if self.landed is LandedState.UNDEFINED or event.state is LandedState.ON_GROUND:
                    self.began_aloft = event.state is LandedState.IN_AIR
                self.landed, self._landed_s = event.state, now_s
            case AutopilotText() | Answer():
                pass  # a sign of life

    @property
    def airborne(self) -> bool:
        """In the air, by whatever it is flown; or armed, and its landed state has not come for long."""
        told = self.landed in (LandedState.IN_AIR, LandedState.TAKEOFF, LandedState.LANDING)
        return told or (self.armed and self._is_landed_old)

    @property
    def _is_landed_old(self) -> bool:
        """It was told on the ground once, and other messages have come for long since."""
        return self.landed is LandedState.ON_GROUND and self._heard_s - self._landed_s > LANDED_OLD_S

    @property
    def ready_to_arm(self) -> bool:
        """As it says, and has said a moment ago."""
        return self._ready_to_arm and self._heard_s - self._health_s <= HEALTH_OLD_S

    @property
    def battery_percent(self) -> int | None:
        """Charge; None: not told, or long ago."""
        return self._battery_percent if self._heard_s - self._health_s <= HEALTH_OLD_S else None

    def was_airborne(self, now_s: float) -> bool:
        """In the air, or a moment ago: longer than a HEARTBEAT takes to show that it was disarmed there."""
        return self.airborne or now_s - self._airborne_s <= DISARMED_IN_AIR.lingers_s

    @property
    def armed(self) -> bool:
        """As its last HEARTBEAT says."""
        return self.mode is not None and self.mode.armed

    @property
    def shaping(self) -> VelocityShaping | None:
        """Horizontal velocity response of its make where that limits jerk; None: it does not, or is not known."""
        return None if self.mode is None or self.mode.traits is None else self.mode.traits.shaping

    def heartbeat_lost(self, now_s: float) -> bool:
        """The mode that it reported last is old."""
        return now_s - self.heartbeat_s > NO_HEARTBEAT.delay_s

    def silence_s(self, now_s: float) -> float:
        """For how long it has sent nothing at all."""
        return now_s - self._heard_s

    def was_cut_off(self, now_s: float) -> bool:
        """The link was down a moment ago: the autopilot may have missed setpoints."""
        return now_s - self._gap_ended_s <= SETPOINTS_CUT.lingers_s

    def position_missing(self, now_s: float) -> str:
        """Reason why its position is not to be flown by; empty: it is fresh."""
        if self.position is None or now_s - self._position_s > NO_POSITION.delay_s:
            return "no position"
        return TELEMETRY_LATE if self.delay.late else ""

    @property
    def climbs_by_itself(self) -> bool:
        """The autopilot shows its own climb, as its make does."""
        mode = self.mode
        if mode is None or mode.traits is None:
            return False
        climbs_in = mode.traits.climbs_in
        if climbs_in is FlightMode.TAKEOFF:
            return mode.mode is FlightMode.TAKEOFF
        return mode.mode is climbs_in and self.landed is LandedState.TAKEOFF

    def has_climbed_to(self, altitude_m: float) -> bool:
        """At that altitude, or as little below it as a climb of its make may end."""
        mode, position = self.mode, self.position
        if mode is None or mode.traits is None or position is None:
            return False
        short_m = altitude_m + position.pos_ned_m[2]
        return short_m <= max(mode.traits.climb_short_m, TAKEOFF_SHORT_SHARE * altitude_m)

    def missing(self, now_s: float) -> str:
        """Missing condition to arm it, or to steer it, in words; empty: none."""
        if self.heartbeat_lost(now_s):
            return "no autopilot heartbeat"
        if self.mode is not None and self.mode.traits is None:
            return self.mode.name
        if self.position_missing(now_s):
            return self.position_missing(now_s)
        if self.landed is LandedState.UNDEFINED or (self._is_landed_old and not self.armed):
            return "no landed state"
        if self.sensors.missing(now_s):
            return self.sensors.missing(now_s)
        if self._battery_is_critical and not self.airborne:  # it would land as soon as it had taken off
            return f"battery at {self.battery_percent} %"
        return "" if self.armed or self.ready_to_arm else "autopilot not ready to arm"

    def was_left_in_offboard(self, now_s: float) -> bool:
        """Disarmed on the ground in the mode in which it was steered, and by its own word not ready to arm."""
        mode = self.mode
        if mode is None or mode.mode is not FlightMode.OFFBOARD or mode.armed or self.heartbeat_lost(now_s):
            return False
        on_ground = self.landed is LandedState.ON_GROUND and not self._is_landed_old
        return on_ground and not self._ready_to_arm and self._heard_s - self._health_s <= HEALTH_OLD_S

    @property
    def _battery_is_critical(self) -> bool:
        return self.battery_percent is not None and self.battery_percent <= CRITICAL_BATTERY_PERCENT

    def findings(self, now_s: float, *, gnss_lost_s: float = 0.0) -> list[Finding]:
        """Find what it lacks in flight, by the table of failsafes. Once each tick. `gnss_lost_s`: without a fix."""
        self.sensors.update(now_s)
        return failsafe_engine.detect(Source.AUTOPILOT, self.readings(now_s, gnss_lost_s=gnss_lost_s))

    def readings(self, now_s: float, *, gnss_lost_s: float = 0.0) -> Readings:
        """Its part of the readings."""
        return Readings(
            position_age_s=math.inf if self.position is None else now_s - self._position_s,
            heartbeat_age_s=now_s - self.heartbeat_s,
            telemetry_late=self.delay.late,
            telemetry_late_s=self.delay.late_s,
            battery_percent=self.battery_percent,
            battery_age_s=0.0 if self._battery_percent is None else self._heard_s - self._health_s,
            airborne=self.airborne,
            gnss_lost_s=gnss_lost_s,
            no_scan=self.sensors.no_scan,
            no_scan_s=self.sensors.no_scan_s,
        )


@dataclass(slots=True, init=False, unsafe_hash=True)
class _Reading:
    boot_s: Final[float]
    now_s: Final[float]

    def __init__(self, boot_s: float, now_s: float) -> None:
        self.boot_s = boot_s
        self.now_s = now_s

    def precedes(self, later: _Reading) -> bool:
        """`later` goes on from it: not back, and not far ahead of the local clock."""
        step_s = _ahead(later.boot_s, self.boot_s)
        return 0.0 <= step_s <= later.now_s - self.now_s + LEAP_S


class Delay:
    """Delay of telemetry: arrival minus the autopilot's own time, above the least of it that was seen.

    The two clocks need not agree. Where the autopilot's runs slower (a simulator that is short of time), its answers to
    TIMESYNC show that it is not the way that grew longer: none can have been under way for longer than the round trip.
    """

    def __init__(self) -> None:
        self.late_s = 0.0  # of the last frame
        self.late = False  # too late to be flown by
        self._last: _Reading | None = None
        self._offset_s = 0.0  # arrival minus vehicle time, about that of the first frame
        self._least_s = 0.0
        self._doubted: _Reading | None = None
        self._doubted_count = 0

    def accept_time(self, boot_s: float, now_s: float) -> bool:
        """Judge a frame by its time since boot; False: not to be believed.

        A time that goes back, or far ahead, is one stray frame's, unless a few in a row go on from it: then the
        autopilot has started again, or frames take another way.
        """
        reading = _Reading(boot_s, now_s)
        if self._last is None:
            self._start(reading)
            return True
        if not self._last.precedes(reading):
            if not self._confirmed(reading):
                return False
            if boot_s <= now_s - self._last.now_s + LATE.delay_s:  # up for no longer than it was not heard
                self._start(reading)
                return True
        offset_s = self._offset_of(reading)
        elapsed_s = now_s - self._last.now_s
        self._last, self._doubted, self._offset_s = reading, None, offset_s
        self._least_s = min(self._least_s + DRIFT * elapsed_s, offset_s)
        self.late_s = offset_s - self._least_s
        self.late = self.late_s > (LATE.clear_below_s if self.late else LATE.delay_s)
        return True

    def bound(self, time: BootTime, now_s: float) -> None:
        """The autopilot's answer to a question of ours."""
        if self._last is not None and 0.0 <= time.round_trip_s <= ROUND_TRIP_MAX_S:
            offset_s = self._offset_of(_Reading(time.boot_s, now_s))
            self._least_s = max(self._least_s, offset_s - time.round_trip_s)

    def _start(self, reading: _Reading) -> None:
        self._last, self._doubted = reading, None
        self._offset_s = self._least_s = self.late_s = 0.0
        self.late = False

    def _offset_of(self, reading: _Reading) -> float:
        assert self._last is not None
        return self._offset_s + (reading.now_s - self._last.now_s) - _ahead(reading.boot_s, self._last.boot_s)

    def _confirmed(self, reading: _Reading) -> bool:
        """Count the frames that do not go on from the last one believed, but from one another."""
        in_a_row = self._doubted is not None and self._doubted.precedes(reading)
        self._doubted_count = self._doubted_count + 1 if in_a_row else 1
        self._doubted = reading
        return self._doubted_count >= BELIEVED_AFTER


def _ahead(boot_s: float, of_s: float) -> float:
    """`boot_s` minus `of_s`, times since boot, the short way round their wrap."""
    return (boot_s - of_s + WRAP_S / 2.0) % WRAP_S - WRAP_S / 2.0
