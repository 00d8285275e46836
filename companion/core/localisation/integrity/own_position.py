"""The own position, from what the autopilot reports to what is flown by: gate, trunks in sight, localiser.

Where all have GNSS, fixes are held against the way that trunks tell (`fix_monitor`). When they part the fix counts as
led astray for the rest of the flight: the drift that was found is taken off what is reported, as a guess, and trunks
correct the rest. Without trunks the guess goes on, but the vehicle holds, and lands soon. What parts faster than
receivers are led is a step, as when an estimator is reset: a jump, which does not go on.

Where vehicles have range radios, the place that these tell is held against the reported one (`range_check`), and taken
instead in the same way.

While no trunks tell it, positions are held against the way by their own velocities (`velocity_way`), which finds those
that drift while the velocity is right. The velocities' way is flown by then. A drift of both shows nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, final

from companion.core.localisation.integrity.fix_monitor import FixMonitor, Noise, Parted
from companion.core.localisation.integrity.position_gate import PositionGate
from companion.core.localisation.integrity.velocity_way import VelocityWay
from companion.core.localisation.localiser import Localiser
from companion.core.model.actions import SendBeacon
from companion.core.model.displaced import Displaced
from companion.core.model.events import HeardBeacon, Position
from companion.core.model.vectors import ZERO, add, norm, sub
from companion.core.perception.obstacle_perception import ObstaclePerception
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Finding, Readings, Source
from mission.common.frames import Vec3
from mission.document.model import Mission

# Of recorded positions (0.17 to 0.28 m an axis) and of scan odometry, as the bench `spoofing --open-loop` has it
BY_TRUNKS: Final = Noise(fix_m=0.2, fix_memory_s=5.0, walk_m2_per_s=0.005, share=0.005, alarm=30.0)
# Of a fix less the noise that its receiver's velocity has not: a walk of 1 or 2 m, within a minute, is GNSS's own
BY_VELOCITY: Final = Noise(fix_m=0.5, fix_memory_s=5.0, walk_m2_per_s=0.02, share=0.0, alarm=22.0)
FOUND_M: Final = 1.0  # error of a position after the fix was found to be wrong
STEP_MPS: Final = 0.6  # that parts faster is no drift
SEEN_MPS: Final = 0.04  # by which that grows while trunks tell the motion: as DeadReckoning has it
GUESSED_MPS: Final = 0.2  # and by the drift that was found alone, or as fast as that is, as it may end
ERROR_MAX_M: Final = 25.0
SURE_M: Final = 3.0  # a position that errs by more is not flown by
OUTSIDE_M: Final = 1.0  # above or below all heights of the mission: gusts do not bring it there


@dataclass(frozen=True, slots=True)
class _Astray:
    """A fix that is led astray."""

    found_s: float
    off_ne_m: tuple[float, float]  # of the fix, when it was found
    drift_ne_mps: tuple[float, float]
    vel_off_ned_mps: Vec3  # of the velocity: as the drift, or none
    led_less_way_ne_m: tuple[float, float] | None = None  # where its velocity is gone by: position less that way

    def correct(self, told: Position, now_s: float, way_ne_m: tuple[float, float]) -> Position:
        """The reported position and velocity without the drift as it was found. `way_ne_m`: by the velocity."""
        led = self.led_less_way_ne_m
        if led is not None:
            placed = (led[0] + way_ne_m[0], led[1] + way_ne_m[1], told.pos_ned_m[2])
            return Position(placed, told.vel_ned_mps, told.boot_s)
        since_s = now_s - self.found_s
        off = (self.off_ne_m[0] + self.drift_ne_mps[0] * since_s, self.off_ne_m[1] + self.drift_ne_mps[1] * since_s)
        pos = told.pos_ned_m
        return Position(
            (pos[0] - off[0], pos[1] - off[1], pos[2]), sub(told.vel_ned_mps, self.vel_off_ned_mps), told.boot_s
        )


@final
class OwnPosition:
    """One vehicle's."""

    def __init__(self, mission: Mission, localiser: Localiser, perception: ObstaclePerception) -> None:
        self._least_up_m: Final = mission.fence.altitude_min_m - OUTSIDE_M
        self._most_up_m: Final = max(mission.fence.altitude_max_m, mission.rise_to_m or 0.0) + OUTSIDE_M
        self._localiser: Final = localiser
        self._perception: Final = perception
        self._gate: Final = PositionGate(level=not localiser.may_lose_position)
        self._holds_fixes: Final = not localiser.may_lose_position
        self._monitor: Final = FixMonitor(BY_TRUNKS)
        self._way: Final = VelocityWay()
        self._velocity_monitor: Final = FixMonitor(BY_VELOCITY)
        self._astray: _Astray | None = None
        self._ranged: Displaced | None = None  # the last that was taken
        self._error_m = 0.0  # of the position since
        self._seen_s = self._updated_s = 0.0  # when trunks told the motion last, and when it was looked at
        self._flown_up_m: float | None = None
        self._is_height_false: bool | None = None  # of one that began aloft; None: not looked at
        self.off_ned_m: Vec3 = ZERO  # position flown by less reported; 0 where all is well

    def receive(self, told: Position, now_s: float, *, airborne: bool, commanded_ned_mps: Vec3) -> Position:
        """A position as the autopilot reports it; the one that the flight goes by."""
        localiser, gate = self._localiser, self._gate
        is_lost = localiser.is_fix_lost
        if not airborne:
            self._astray = None
        if is_lost or not airborne:  # what comes next is another fix, or another frame of trunks
            self._monitor.forget()
            self._velocity_monitor.forget()
        gate.commanded_ned_mps = commanded_ned_mps
        gated = gate.receive_position(told, now_s, airborne=airborne, trusts_jump=is_lost)
        astray = self._astray
        guessed_m = self._way.guessed_m
        goes_on = airborne and self._holds_fixes and self._way.update(gated, now_s)
        if astray is not None and astray.led_less_way_ne_m is not None:
            self._error_m += self._way.guessed_m - guessed_m
        reported = gated if astray is None else astray.correct(gated, now_s, self._way.ne_m)
        smooth = localiser.split_jumps(reported, now_s, airborne=airborne)
        seen = self._perception.correct_odometry(smooth, now_s, reckons=is_lost or astray is not None)
        displaced = localiser.displaced
        if displaced is not None and displaced is not self._ranged and airborne and not is_lost:
            self._take_ranged(displaced, gated, seen, now_s)
        elif astray is not None:
            self._update_error(now_s)
        elif airborne and self._holds_fixes and not is_lost:
            self._hold_fix(gated, now_s, goes_on=goes_on)
        self.off_ned_m = self._find_off(seen.pos_ned_m, told.pos_ned_m)
        flown = localiser.receive_position(seen, now_s)
        self._flown_up_m = -flown.pos_ned_m[2]
        if airborne and localiser.is_due_for_trunks(now_s):
            trunks = self._perception.find_solitary_trunks(seen, now_s)
            if trunks is not None:
                localiser.note_trunks(trunks, now_s)
        return flown

    def _find_off(self, flown_ned_m: Vec3, told_ned_m: Vec3) -> Vec3:
        """Of what is told and heard by reported positions; where not all have GNSS those are heights alone."""
        if flown_ned_m == told_ned_m:
            return ZERO
        north, east, down = sub(flown_ned_m, told_ned_m)
        return (north, east, down) if self._holds_fixes else (0.0, 0.0, down)

    def _hold_fix(self, reported: Position, now_s: float, *, goes_on: bool) -> None:
        """Against the way that trunks tell, or its own velocity. `goes_on`: of that way nothing is missing."""
        way = self._perception.read_way(reported, now_s)
        fix = (reported.pos_ned_m[0], reported.pos_ned_m[1])
        self._hold_against_velocity(fix, now_s, goes_on=goes_on, may_tell=way is None)
        if way is None:
            return
        parted = self._monitor.update(fix, way.ne_m, now_s, frame=way.frame, frame_rad2=way.frame_rad2)
        if parted is not None and not self._took_step(fix, parted, now_s):
            self._begin_reckoning(reported, parted, now_s)

    def _took_step(self, fix_ne_m: tuple[float, float], parted: Parted, now_s: float) -> bool:
        """Both ways parted at once, by less than the gate sees: it is taken off as a jump."""
        off = (fix_ne_m[0] - parted.fix_ne_m[0], fix_ne_m[1] - parted.fix_ne_m[1])
        if math.hypot(*off) <= STEP_MPS * (now_s - parted.since_s):
            return False
        self._gate.take_off((off[0], off[1], 0.0), now_s)
        self._monitor.forget()
        self._velocity_monitor.forget()
        return True

    def _hold_against_velocity(self, fix: tuple[float, float], now_s: float, *, goes_on: bool, may_tell: bool) -> None:
        way, monitor = self._way, self._velocity_monitor
        if not goes_on:
            monitor.forget()
            return
        parted = monitor.update(fix, way.ne_m, now_s, walk_since=way.walk_since)
        if parted is None or not may_tell or self._took_step(fix, parted, now_s):
            return
        led = parted.fix_ne_m
        less_way = (led[0] - way.ne_m[0], led[1] - way.ne_m[1])
        self._astray = _Astray(now_s, (fix[0] - led[0], fix[1] - led[1]), (0.0, 0.0), ZERO, less_way)
        self._error_m, self._seen_s, self._updated_s = FOUND_M, now_s, now_s
        self._monitor.forget()

    def _begin_reckoning(self, reported: Position, parted: Parted, now_s: float) -> None:
        since_s = now_s - parted.since_s
        pos = reported.pos_ned_m
        off = (pos[0] - parted.fix_ne_m[0], pos[1] - parted.fix_ne_m[1])
        drift = (off[0] / since_s, off[1] / since_s, 0.0)
        bias = self._perception.velocity_bias(ZERO)  # of a velocity that is led astray too: against the drift
        is_led = norm(add(bias, drift)) < norm(bias)
        self._astray = _Astray(now_s, off, (drift[0], drift[1]), drift if is_led else ZERO)
        self._error_m, self._seen_s, self._updated_s = FOUND_M, now_s, now_s
        self._monitor.forget()
        self._perception.reckon_from(parted.fix_ne_m, reported, parted.turned_rad)

    def _take_ranged(self, displaced: Displaced, gated: Position, flown: Position, now_s: float) -> None:
        """A place that ranges tell, against the position flown by; once it is astray, trunks tell it better."""
        self._ranged, astray = displaced, self._astray
        if astray is not None and self._perception.sees_motion:
            return
        off, drift = displaced.off_ne_m, displaced.drift_ne_mps
        if astray is not None and off == (0.0, 0.0):  # the side is open: what it goes by already is as good
            self._error_m = max(self._error_m, displaced.error_m)
            return
        there = (flown.pos_ned_m[0] - off[0], flown.pos_ned_m[1] - off[1])
        off = (gated.pos_ned_m[0] - there[0], gated.pos_ned_m[1] - there[1])
        self._perception.reckon_anew()
        if astray is None:
            self._seen_s = now_s
        else:
            drift = (drift[0] + astray.drift_ne_mps[0], drift[1] + astray.drift_ne_mps[1])
        self._astray = _Astray(now_s, off, drift, (drift[0], drift[1], 0.0))
        self._error_m, self._updated_s = displaced.error_m, now_s
        self._monitor.forget()

    def _update_error(self, now_s: float) -> None:
        since_s, self._updated_s = now_s - self._updated_s, now_s
        is_seen, astray = self._perception.sees_motion, self._astray
        guessed_mps = GUESSED_MPS if astray is None else max(GUESSED_MPS, math.hypot(*astray.drift_ne_mps))
        if is_seen:
            self._seen_s = now_s
        self._error_m = min(ERROR_MAX_M, self._error_m + (SEEN_MPS if is_seen else guessed_mps) * since_s)

    # --- what follows ---

    def find_motion(self, flown: Position) -> Position:
        """The position flown by, with what is believed of the own velocity."""
        bias = self._perception.velocity_bias(self._localiser.velocity_bias_ned_mps)
        return Position(flown.pos_ned_m, add(flown.vel_ned_mps, bias))

    @property
    def setpoint_bias_ned_mps(self) -> Vec3:
        """True velocity less the one that the autopilot holds."""
        return self._correct_bias(self._perception.setpoint_bias(self._localiser.velocity_bias_ned_mps))

    @property
    def rest_bias_ned_mps(self) -> Vec3:
        """The same without what scans tell."""
        return self._correct_bias(self._localiser.velocity_bias_ned_mps)

    def _correct_bias(self, bias_ned_mps: Vec3) -> Vec3:
        """Of a bias of the velocity that the flight goes by: the autopilot's has the drift in it."""
        return bias_ned_mps if self._astray is None else sub(bias_ned_mps, self._astray.vel_off_ned_mps)

    def error_m(self, now_s: float) -> float:
        """Level error that the position flown by may have, beyond what a fix has."""
        error_m = self._localiser.position_error_m(now_s) + self._gate.error_m(now_s)
        return error_m if self._astray is None else error_m + self._error_m

    def findings(self, now_s: float, *, airborne: bool, began_aloft: bool) -> list[Finding]:
        """By the table of failsafes. `began_aloft`: the companion started anew in the air."""
        if not airborne:
            return []
        if began_aloft and self._is_height_false is None and self._flown_up_m is not None:
            self._is_height_false = not self._least_up_m <= self._flown_up_m <= self._most_up_m
        gate, astray = self._gate, self._astray is not None
        frozen_s = gate.frozen_s(now_s)
        unseen_s = now_s - self._seen_s if astray else 0.0
        if astray and self._error_m > SURE_M:
            unseen_s = math.inf
        return failsafe_engine.detect(
            Source.INTEGRITY,
            Readings(
                height_false=began_aloft and self._is_height_false is True,
                frozen_s=frozen_s,
                since_jump_s=now_s - gate.jumped_s,
                is_astray=astray,
                is_off_velocity=self._astray is not None and self._astray.led_less_way_ne_m is not None,
                is_off=gate.is_off,
                unseen_s=unseen_s,
            ),
        )

    def locate_sender(self, heard: HeardBeacon) -> HeardBeacon:
        """A beacon, which the codec made relative to the reported position, from the one that is flown by."""
        if self.off_ned_m == ZERO:
            return heard
        return HeardBeacon(heard.said, sub(heard.rel_ned_m, self.off_ned_m), is_vouched=heard.is_vouched)

    def correct_broadcast(self, sent: SendBeacon) -> SendBeacon:
        """A beacon, to which the codec adds the reported position."""
        if self.off_ned_m == ZERO:
            return sent
        return SendBeacon(sent.beacon, sent.word, sent.pos_ned_m, self.off_ned_m, sent.trunks)
