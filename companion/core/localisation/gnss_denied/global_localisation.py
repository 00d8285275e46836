"""The position of a vehicle with a receiver in the mission's frame, and its uncertainty; of swarms by ranges.

An autopilot that has a GNSS fix again jumps to where they have it, by as much as its odometry had drifted; and a fix
wanders by a metre within seconds, which trunks take off the odometer where they are seen (`own_motion`). Whatever
here flies by differences of positions must not see that: obstacles, ranges, the way to d2. So the told position is cut
into an odometer, which never jumps, and an offset to the mission's frame, which follows the fixes as much as they are
worth against odometry: a scalar Kalman filter. Who leads takes the offset over little by little (`Guidance.locate`).

A fix that leaves the way of the odometer, by more than both may err, is led astray: from then on there is none, and the
offset is what it was when it began to leave.

How good the reception is, for the election: worse when it has been so for WORSE_S, better when it has been so for
BETTER_S, and for twice as long after each loss: one that comes and goes does not count as there.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.localisation.gnss_denied.error_state import BY_TRUNKS, Errors
from companion.core.localisation.integrity.fix_monitor import FixMonitor, Noise, Parted
from companion.core.localisation.integrity.velocity_way import VelocityWay
from companion.core.model.events import Position, Satellites
from companion.core.model.states import Reception
from mission.common.frames import Vec3

GOOD_SD_M: Final = 3.0  # of a fix, level: PX4's EKF2_REQ_EPH
FRESH_S: Final = 3.0  # what was said of satellites longer ago is not believed
# A position that does more than its velocity between two readings is pulled by fixes, or jumps to one
PULLED_M: Final = 0.01
PULLED_MPS: Final = 0.5  # PX4's velocities were recorded with an error of 0.23
ACCELERATION_MPS2: Final = 3.0  # of a vehicle, between two readings
MEMORY_S: Final = 30.0  # of a fix's error: those that follow one another so soon say the same
START_SD_M: Final = 0.7  # of the mission's starting positions, level
UNTOLD_SD_M: Final = 1.0
WORSE_S: Final = 5.0
LEADER_S: Final = 2.0  # of a leader so much later: those that hear none any more either have said so by then
BETTER_S: Final = 10.0
BETTER_MAX_S: Final = 160.0
SDS: Final = 2.0  # of what may be
BELIEVED: Final = Errors()  # of odometry
# Of fixes, whose size the receiver tells, against odometry that they correct: a fifth of its errors is left
AGAINST_FIXES: Final = Noise(fix_m=0.5, fix_memory_s=MEMORY_S, walk_m2_per_s=0.004, share=0.005, alarm=24.0)
TRUNKS_S: Final = 1.0  # so long after trunks corrected the odometer last it is as sure as they make it
FRAME_RAD2: Final = math.radians(0.6) ** 2
ASTRAY_SD_M: Final = 1.5  # of a place from which a fix was led astray


@final
class DeadReckoningUncertainty:
    """Error of a position that goes on by odometry: biases walk, and a compass is wrong by the way made."""

    __slots__ = ("_from_ne_m", "_var_m2")

    def __init__(self, sd_m: float) -> None:
        self._var_m2 = sd_m * sd_m / 2.0  # on each axis
        self._from_ne_m: tuple[float, float] | None = None

    def set_known(self, sd_m: float, pos_ned_m: Vec3) -> None:
        """At this reading of the odometer it is off by so much, level."""
        self._var_m2 = sd_m * sd_m / 2.0
        self._from_ne_m = (pos_ned_m[0], pos_ned_m[1])

    def add_bias_walk(self, since_s: float, errors: Errors) -> None:
        """The bias's part: of an odometer with such errors."""
        self._var_m2 += 2.0 * errors.bias_mps**2 * errors.bias_s * since_s

    def sd_m(self, pos_ned_m: Vec3) -> float:
        """Level: root of north and east squared."""
        start = self._from_ne_m
        if start is None:
            start = self._from_ne_m = (pos_ned_m[0], pos_ned_m[1])
        way_m = math.hypot(pos_ned_m[0] - start[0], pos_ned_m[1] - start[1])
        return math.sqrt(2.0 * self._var_m2 + (BELIEVED.yaw_rad * way_m) ** 2)


@final
class GlobalLocalisation:
    """One vehicle's. `receives`: the mission says that it has a receiver."""

    __slots__ = (
        "_astray",
        "_better_s",
        "_flown",
        "_heard_s",
        "_jumped_ne_m",
        "_monitor",
        "_off_ne_m",
        "_other_since_s",
        "_own",
        "_pos_ned_m",
        "_read_s",
        "_receives",
        "_said",
        "_since_s",
        "_told",
        "_told_off_ne_m",
        "_trunks_s",
        "_velocity_way",
        "_way",
        "reception",
    )

    def __init__(self, *, receives: bool) -> None:
        self._receives = receives
        self.reception = Reception.GOOD if receives else Reception.NONE  # on the ground: as the mission says
        self._said: Satellites | None = None
        self._heard_s = self._trunks_s = -1e9
        self._other_since_s: float | None = None  # since when it has been heard worse, or better
        self._better_s = BETTER_S
        self._flown = False
        self._told: Position | None = None
        self._read_s = self._since_s = 0.0
        self._pos_ned_m: Vec3 = (0.0, 0.0, 0.0)  # of the odometer, as what is seen corrects it
        self._jumped_ne_m = (0.0, 0.0)  # of the told position, taken off the odometer
        self._told_off_ne_m = (0.0, 0.0)  # told position less the corrected odometer
        self._off_ne_m = (0.0, 0.0)  # mission's position less odometer
        self._own = DeadReckoningUncertainty(START_SD_M)  # of that
        self._way = DeadReckoningUncertainty(START_SD_M)  # of the way to d2
        self._monitor = FixMonitor(AGAINST_FIXES)
        self._velocity_way = VelocityWay()
        self._astray = False

    # --- what comes in ---

    def receive_satellites(self, said: Satellites, now_s: float) -> None:
        """The autopilot has told of its receiver."""
        if self._receives:
            self._said, self._heard_s = said, now_s

    def note_trunks(self, now_s: float) -> None:
        """The own scans correct the odometer now."""
        self._trunks_s = now_s

    def split_position(self, told: Position, now_s: float, *, airborne: bool) -> Position:
        """A told position; the same by the odometer. Heights stay as told. `note_flown` is next."""
        before, self._told = self._told, told
        self._since_s = 0.0 if before is None else told.since_s(before, now_s - self._read_s)
        self._read_s = now_s
        self._flown |= airborne
        if not self._receives:
            return told
        if before is not None and self._flown:
            self._split_jump(before, told, self._since_s, now_s)
        north, east, down = told.pos_ned_m
        pos = (north - self._jumped_ne_m[0], east - self._jumped_ne_m[1], down)
        return Position(pos, told.vel_ned_mps, told.boot_s)

    def note_flown(self, flown: Position, now_s: float) -> None:
        """The odometer's position as what is seen corrects it: that is flown by, and satellites say where it is."""
        told, since_s, pos = self._told, self._since_s, flown.pos_ned_m
        errors = BY_TRUNKS if now_s - self._trunks_s <= TRUNKS_S else BELIEVED
        self._pos_ned_m = pos
        if told is None or not self._receives:
            self._way.add_bias_walk(since_s, errors)
            return
        self._told_off_ne_m = (told.pos_ned_m[0] - pos[0], told.pos_ned_m[1] - pos[1])
        self._own.add_bias_walk(since_s, errors)
        self._way.add_bias_walk(since_s, errors)
        if self.is_used(now_s):
            self._correct_offset(since_s)
            self._hold_fix(told, now_s)
        else:
            self._monitor.forget()

    def _split_jump(self, before: Position, told: Position, since_s: float, now_s: float) -> None:
        """The odometer, where fixes are good, goes as the position does, unless they pull it; else as the velocity."""
        by_n = 0.5 * (before.vel_ned_mps[0] + told.vel_ned_mps[0]) * since_s
        by_e = 0.5 * (before.vel_ned_mps[1] + told.vel_ned_mps[1]) * since_s
        more_n = told.pos_ned_m[0] - before.pos_ned_m[0] - by_n
        more_e = told.pos_ned_m[1] - before.pos_ned_m[1] - by_e
        most_m = PULLED_M + (PULLED_MPS + ACCELERATION_MPS2 * since_s) * since_s
        if math.hypot(more_n, more_e) > most_m or self._reception_now(now_s) is not Reception.GOOD:
            self._jumped_ne_m = (self._jumped_ne_m[0] + more_n, self._jumped_ne_m[1] + more_e)

    def _hold_fix(self, told: Position, now_s: float) -> None:
        """The position that follows fixes, against the way by velocities."""
        if not self._flown:
            return
        if not self._velocity_way.update(told, now_s):
            self._monitor.forget()
            return
        fix = (told.pos_ned_m[0], told.pos_ned_m[1])
        sd_m = UNTOLD_SD_M if self._said is None else self._said.sd_m
        way = self._velocity_way
        parted = self._monitor.update(
            fix,
            way.ne_m,
            now_s,
            frame_rad2=FRAME_RAD2,
            fix_m=sd_m / math.sqrt(2.0),
            walk_since=way.walk_since,
        )
        if parted is not None:
            self._drop_fix(parted)

    def _drop_fix(self, parted: Parted) -> None:
        """For the rest of the flight: it is where the odometer has led since the fix left its way."""
        self._astray = True
        led, pos = parted.fix_ne_m, self._pos_ned_m
        self._off_ne_m = (led[0] - pos[0], led[1] - pos[1])
        self._own.set_known(ASTRAY_SD_M, pos)
        self._way.set_known(ASTRAY_SD_M, pos)

    def _correct_offset(self, since_s: float) -> None:
        """By where satellites have it now."""
        sd_m = UNTOLD_SD_M if self._said is None else self._said.sd_m
        var = self._own.sd_m(self._pos_ned_m) ** 2
        share = var * since_s / (var * since_s + sd_m**2 * MEMORY_S) if since_s > 0.0 else 0.0
        off, told_off = self._off_ne_m, self._told_off_ne_m
        self._off_ne_m = (off[0] + share * (told_off[0] - off[0]), off[1] + share * (told_off[1] - off[1]))
        self._own.set_known(math.sqrt((1.0 - share) * var), self._pos_ned_m)

    def update_destination_sd(self, told_sd_m: float | None, now_s: float, *, lag_m: float | None) -> None:
        """Each tick: how sure it is of the way to d2. `told_sd_m`: as those nearer to the leader tell, None: nobody.

        `lag_m`: of an acting leader, how far the way that it goes by is off what satellites say; None: of others.
        """
        if lag_m is not None and self.is_used(now_s):
            self._way.set_known(math.hypot(self._own.sd_m(self._pos_ned_m), lag_m), self._pos_ned_m)
        elif lag_m is None and told_sd_m is not None:
            self._way.set_known(told_sd_m, self._pos_ned_m)

    def update_reception(self, now_s: float, *, leads: bool) -> None:
        """See `reception`: it is worse or better than it was, and has been so long enough."""
        if not (self._receives and self._flown):
            return
        heard = self._reception_now(now_s)
        if heard is self.reception:
            self._other_since_s = None
            return
        worse = heard < self.reception
        if self._other_since_s is None:
            self._other_since_s = now_s
        worse_s = WORSE_S + LEADER_S if leads else WORSE_S
        if now_s - self._other_since_s < (worse_s if worse else self._better_s):
            return
        if heard is Reception.NONE:
            self._better_s = min(BETTER_MAX_S, 2.0 * self._better_s)
        self.reception, self._other_since_s = heard, None

    # --- what comes out ---

    @property
    def is_astray(self) -> bool:
        """Fixes are not gone by any more: they were led astray."""
        return self._astray

    def is_used(self, now_s: float) -> bool:
        """Its autopilot goes by GNSS now."""
        return self._reception_now(now_s) is not Reception.NONE

    def fix_ned_m(self, now_s: float) -> Vec3 | None:
        """The position that satellites give now, as much as they are worth; None: its autopilot does not go by them.

        Of fixes that were led astray: what they would have been.
        """
        if not self._receives or not (self.is_used(now_s) or self._astray or not self._flown):
            return None
        pos, off = self._pos_ned_m, self._off_ne_m
        return (pos[0] + off[0], pos[1] + off[1], pos[2])

    def told_off_ne_m(self, now_s: float) -> tuple[float, float] | None:
        """The reported position less the odometer; None: its autopilot does not go by good fixes now.

        It wanders with the receiver, within seconds, where `fix_ned_m` takes half a minute to follow.
        """
        return self._told_off_ne_m if self._receives and self._reception_now(now_s) is Reception.GOOD else None

    @property
    def sd_m(self) -> float:
        """Error of the way to d2, level: one standard deviation."""
        return self._way.sd_m(self._pos_ned_m)

    def is_lost(self, now_s: float, budget_m: float) -> bool:
        """It goes by odometry alone, and two standard deviations are more than that."""
        return not self.is_used(now_s) and SDS * self.sd_m > budget_m

    def _reception_now(self, now_s: float) -> Reception:
        said = self._said
        if self._astray:
            return Reception.NONE
        if said is None:  # it tells nothing of satellites: the mission's word counts
            return Reception.GOOD if self._receives else Reception.NONE
        if not said.used or now_s - self._heard_s > FRESH_S:
            return Reception.NONE
        return Reception.GOOD if said.sd_m <= GOOD_SD_M else Reception.POOR
