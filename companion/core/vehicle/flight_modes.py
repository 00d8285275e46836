"""Whose the flight mode is: this companion's, the pilot's, or a failsafe's. Only the autopilot's HEARTBEAT tells.

A mode that this companion did not ask for is the pilot's. So is a failsafe that holds, unless this companion's
setpoints did stop: the autopilot goes back to OFFBOARD by itself when that was the cause; else the hold has another.
"""

from __future__ import annotations

from typing import final

from companion.core.model.states import AutopilotTraits, FlightMode
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.autopilot_state import Vehicle
from companion.core.vehicle.failsafe import Finding, Readings, Source

OURS = Readings()  # armed, and following this companion's setpoints
BEFORE_OFFBOARD = frozenset({FlightMode.HOLD, FlightMode.TAKEOFF})


class Modes:
    """History of the autopilot's modes since this step of the flight began."""

    __slots__ = ("_began_in", "_vehicle", "failsafe_may_end", "failsafe_overruled", "left", "offboard_seen")

    def __init__(self, vehicle: Vehicle) -> None:
        self.left = False  # the mode that was asked for has shown in this step of the flight
        self.offboard_seen = False  # since the companion steers
        self.failsafe_may_end = False  # it holds because setpoints stopped, or for another reason: streaming tells
        self.failsafe_overruled = False  # an operator has handed back a vehicle that holds by its failsafe
        self._vehicle = vehicle
        self._began_in = ""  # name of the mode in which this step began

    def begin(self) -> None:
        """Another step of the flight."""
        self._began_in = "" if self._vehicle.mode is None else self._vehicle.mode.name
        self.left = self.failsafe_may_end = self.failsafe_overruled = False

    def is_in(self, mode: FlightMode) -> bool:
        """The autopilot last showed this mode."""
        return self._vehicle.mode is not None and self._vehicle.mode.mode is mode

    @property
    def holds_by_failsafe(self) -> bool:
        """The autopilot holds, and by its own failsafe."""
        mode = self._vehicle.mode
        return mode is not None and mode.mode is FlightMode.HOLD and mode.failsafe

    @property
    def follows_or_holds(self) -> bool:
        """The autopilot still follows setpoints, or holds by its failsafe: perhaps because they stopped."""
        return self.holds_by_failsafe or self.is_in(FlightMode.OFFBOARD)

    @property
    def as_it_began(self) -> bool:
        """In the mode in which this step of the flight began."""
        return self._vehicle.mode is not None and self._vehicle.mode.name == self._began_in

    @property
    def awaits_offboard(self) -> bool:
        """Still in the HOLD in which its climb ended, or in which an operator handed it back."""
        return self.is_in(FlightMode.HOLD) and self.as_it_began and not self.offboard_seen

    def is_anothers(self, asked_for: FlightMode, *, ends_in_hold: bool = False) -> bool:
        """The mode is neither the one in which this step began nor `asked_for`, or is no longer `asked_for`."""
        if self.is_in(asked_for):
            self.left = True
            return False
        if self.left:
            return not (ends_in_hold and self.is_in(FlightMode.HOLD))
        return not self.as_it_began

    def see_offboard(self) -> None:
        """While the companion steers: the autopilot follows its setpoints."""
        if self._vehicle.armed and self.is_in(FlightMode.OFFBOARD):
            self.offboard_seen, self.failsafe_overruled = True, False

    def find_mode_change(self) -> Finding:
        """Find whose the mode is that is not this companion's: the pilot's, or a failsafe's."""
        mode = self._vehicle.mode
        assert mode is not None
        readings = Readings(mode=mode.name, mode_taken=True, mode_failsafe=mode.failsafe)
        return failsafe_engine.detect(Source.MODE, readings)[0]

    def findings(self, now_s: float, streams_s: float) -> list[Finding]:
        """Find what arming and mode say while the companion steers. `streams_s`: for how long setpoints have come."""
        return failsafe_engine.detect(Source.MODE, self.readings(now_s, streams_s))

    def readings(self, now_s: float, streams_s: float) -> Readings:
        """Its part of the readings, while the companion steers."""
        mode = self._vehicle.mode
        assert mode is not None
        if not mode.armed:
            return Readings(disarmed=True, was_airborne=self._vehicle.was_airborne(now_s))
        if mode.mode is FlightMode.OFFBOARD:
            return OURS
        ends_s = 0.0 if mode.traits is None else mode.traits.failsafe_ends_s
        return Readings(
            mode=mode.name,
            mode_taken=mode.mode not in BEFORE_OFFBOARD or (self.offboard_seen and not self.holds_by_failsafe),
            mode_failsafe=mode.failsafe,
            failsafe_holds=self.holds_by_failsafe and not self.failsafe_overruled,
            setpoints_cut=self.offboard_seen and self._vehicle.was_cut_off(now_s),
            setpoints_return=self.failsafe_may_end and not self.offboard_seen and streams_s <= ends_s,
        )


@final
class Climb:
    """History of one vehicle's takeoff: whether it was armed, and whether it climbs. `findings` each tick of it."""

    __slots__ = ("_altitude_m", "_modes", "_vehicle", "armed_seen", "seen", "stalled")

    def __init__(self, vehicle: Vehicle, modes: Modes, altitude_m: float) -> None:
        self._vehicle, self._modes, self._altitude_m = vehicle, modes, altitude_m
        self.seen = False
        self.stalled = False  # this companion, while it climbs
        self.armed_seen = False

    def start_over(self) -> None:
        """Another flight."""
        self.seen = self.stalled = self.armed_seen = False

    def findings(self, how: AutopilotTraits) -> list[Finding]:
        """Look at what shows now, and find what ends the climb. `how`: of its make."""
        vehicle, found = self._vehicle, []
        if self.stalled and vehicle.airborne:  # it climbs or has climbed: it need not be seen to
            self.seen = self._modes.left = True
        self.stalled = False
        if self._modes.is_anothers(how.climbs_in, ends_in_hold=how.climbs_in is FlightMode.TAKEOFF):
            found.append(self._modes.find_mode_change())
        self.armed_seen |= vehicle.armed
        self.seen |= vehicle.climbs_by_itself or (how.climbs_in is FlightMode.OFFBOARD and vehicle.airborne)
        if self.armed_seen and not vehicle.armed:
            found += failsafe_engine.detect(Source.CLIMB, Readings(disarmed=True, climb_seen=self.seen))
        elif self.seen and not (vehicle.climbs_by_itself or vehicle.has_climbed_to(self._altitude_m)):
            found.append(self._modes.find_mode_change())
        return found
