"""Positions of the neighbours without GNSS: from odometry, ranges and, where there are some, bearings.

One joint filter in each vehicle over the level positions of all neighbours relative to itself. Each vehicle's odometer
(what its autopilot integrates: LOCAL_POSITION_NED without an aid from outside) counts along the north that its compass
believes in, and is wrong by a bias. State: for each neighbour its relative position, for each vehicle its velocity
bias and its compass's error. Ranges between any two vehicles, own or told, own bearings, and trunks that two have both
seen (`shared_trunks`) correct all of it. Everything is level: heights come from barometer and rangefinder, and ranges
are made level before they are handed over.

What cannot be seen stays uncertain: the rotation of a formation that moves as one (`rotation_sd_rad`), the shape of one
that too few ranges brace (`Relative.shape_m2`), and the common error of all compasses: it seems to be a turned world.

Means are moved at each tick and with each odometer reading; covariance and corrections follow every EPOCH_S, all
ranges since then together, each taken against the positions that odometers give for its moment: by then most have told
of it, whose beacons are late. (To wait for all costs more: later corrections tell the formation's turn less well.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.localisation.gnss_denied.epoch_ranges import EpochRanges
from companion.core.localisation.gnss_denied.error_state import Errors, ErrorStateCovariance, Level
from companion.core.localisation.gnss_denied.relative_state import COASTS_S, Relative, VehicleMean, aligned_row
from companion.core.localisation.integrity.innovation_gate import HARD, SOFT, InnovationGate
from companion.core.model.linear_algebra import Matrix, Row
from companion.core.perception.landmarks.constellation import Alignment, turned

EPOCH_S: Final = 0.5
JUMP_M: Final = 1.5  # an odometer that jumps so far beyond what it can have flown begins anew
FASTEST_MPS: Final = 20.0  # what is told faster is not believed
FARTHEST_M: Final = 500.0  # the same of ranges
OLDEST_S: Final = 1.0  # and what is told later
WAITING_MAX: Final = 1024  # ranges of an epoch: twelve vehicles measure 660 a second
TRUNKS_S: Final = 2.5  # so long after trunks corrected its odometer last it is as sure as they make it: it tells each s
LOCKED_S: Final = 3.0  # a vehicle none of whose ranges were good for so long is somewhere else
AFTER_JUMP_M: Final = 2.0  # an odometer's jump hides so much flight

_Range = tuple[int | None, int, float, float]  # between whom (None: this vehicle), level metres, when


@final
class RelativeFilter:
    """Feed it with odometers, ranges and bearings as they come, `advance` it, and ask. Times: the local clock's."""

    def __init__(self, errors: Errors | None = None) -> None:
        self._errors = errors or Errors()
        self.ids: list[int] = []  # neighbours, in the order of the state
        self._me = VehicleMean((0.0, 0.0))
        self._of: dict[int, VehicleMean] = {}
        self._epoch_s = -1.0  # when the covariance was brought up last; < 0: never
        self._covariance = ErrorStateCovariance(self._errors)
        self.gate: Final = InnovationGate()
        self._waiting: list[_Range] = []
        self._ranges = EpochRanges(self._errors)
        self._aligned: dict[int, Alignment] = {}  # by neighbour: what waits for the end of the epoch

    # --- which are there ---

    def initialise(
        self, starts_ne_m: dict[int, Level], sd_m: float, *, sure: Sequence[int] = (), is_sure: bool = False
    ) -> None:
        """All begin anew: where the mission puts them from here, each vehicle (this one too) off it by `sd_m`.

        `sure`: neighbours with GNSS, by which their autopilots know bias and compass; `is_sure`: so has this one.
        """
        self.ids = sorted(starts_ne_m)
        self._of = {vehicle: VehicleMean(starts_ne_m[vehicle]) for vehicle in self.ids}
        self._me = VehicleMean((0.0, 0.0))
        self._covariance.initialise(len(self.ids), sd_m, [*[vehicle in sure for vehicle in self.ids], is_sure])

    def add_peer(self, vehicle: int, ne_m: Level, sd_m: float) -> None:
        """A neighbour, newly found there; known ones are placed anew."""
        self.remove_peer(vehicle)
        self.ids.append(vehicle)
        self._of[vehicle] = VehicleMean(ne_m)
        self._covariance.add_slot(sd_m)

    def remove_peer(self, vehicle: int) -> None:
        """A neighbour that is not there any more."""
        if vehicle not in self._of:
            return
        slot = self.ids.index(vehicle)
        self._aligned.pop(vehicle, None)
        del self.ids[slot], self._of[vehicle]
        self._covariance.remove_slot(slot)

    # --- what comes in ---

    def update_odometry(self, odo_ne_m: Level, vel_ne_mps: Level, now_s: float) -> None:
        """The own odometer, read now. Of the first reading only what follows counts."""
        self._read_odometry(self._me, odo_ne_m, vel_ne_mps, 0.0, now_s, -1)

    def update_peer_odometry(
        self, vehicle: int, odo_ne_m: Level, vel_ne_mps: Level, age_s: float, now_s: float
    ) -> None:
        """A neighbour's odometer, as its beacon tells it: metres since it began, along the north of its compass."""
        mover = self._of.get(vehicle)
        if mover is not None:
            self._read_odometry(mover, odo_ne_m, vel_ne_mps, age_s, now_s, self.ids.index(vehicle))

    def update_range(self, one: int | None, other: int, level_m: float, age_s: float, now_s: float) -> None:
        """The level distance between two vehicles, measured `age_s` ago. `one` None: this vehicle."""
        if one == other or not (0.0 < level_m <= FARTHEST_M and 0.0 <= age_s <= OLDEST_S):
            return
        self._waiting.append((one, other, level_m, now_s - age_s))
        del self._waiting[:-WAITING_MAX]

    def _take_ranges(self, now_s: float) -> None:
        ranges, self._waiting = self._waiting, []
        for one, other, level_m, at_s in ranges:
            a, b = self._me if one is None else self._of.get(one), self._of.get(other)
            if a is not None and b is not None:
                slot_a = -1 if one is None else self.ids.index(one)
                self._take_range(a, b, (slot_a, self.ids.index(other)), level_m, at_s, now_s)
        self._ranges.reckon_in(self._covariance)

    def _take_range(
        self, a: VehicleMean, b: VehicleMean, slots: tuple[int, int], level_m: float, at_s: float, now_s: float
    ) -> None:
        if a.lost or b.lost:  # by how much such a one has strayed is taken back when it tells: nothing may lean on it
            return
        # Where they were then: back along the way that their odometers have told.
        (slot_a, slot_b), a_way, b_way = slots, a.way_since(at_s), b.way_since(at_s)
        a_n, a_e = turned(a.yaw, a_way[0], a_way[1])
        b_n, b_e = turned(b.yaw, b_way[0], b_way[1])
        n_m, e_m = b.n_m - a.n_m - b_n + a_n, b.e_m - a.e_m - b_e + a_e
        apart_m = math.sqrt(n_m * n_m + e_m * e_m)
        if apart_m < 0.1:
            return
        u_n, u_e = n_m / apart_m, e_m / apart_m
        off_m = level_m - apart_m
        var = (
            self._errors.range_m**2 * max(1.0, self.gate.mean_square)
            + a.coasted_m2(self._errors, at_s)
            + b.coasted_m2(self._errors, at_s)
        )
        weight = self.gate.weigh(off_m, var + self._covariance.range_variance(slot_a, slot_b, u_n, u_e)) / var
        if self._is_good(a, b, slots, weight, abs(off_m), now_s):
            self._ranges.add(slots, (u_n, u_e, off_m, weight), self._covariance)

    def update_bearing(self, vehicle: int, north_rad: float, now_s: float) -> None:
        """The direction in which this vehicle sees a neighbour now: clockwise from the north of its own compass."""
        mover = self._of.get(vehicle)
        if mover is None:
            return
        slot = self.ids.index(vehicle)
        for one in (self._me, mover):
            self._extrapolate(one, now_s)
        if mover.lost:
            return
        square = mover.n_m * mover.n_m + mover.e_m * mover.e_m
        if not (square > 1.0 and math.isfinite(north_rad)):
            return
        h_n, h_e = -mover.e_m / square, mover.n_m / square
        off = north_rad + self._me.yaw - math.atan2(mover.e_m, mover.n_m)
        off -= math.tau * round(off / math.tau)
        var = self._errors.bearing_rad**2 + mover.coasted_m2(self._errors, now_s) / square
        weight = self.gate.weigh(off, var + self._covariance.bearing_variance(slot, h_n, h_e)) / var
        if weight > 0.0:
            self._covariance.add_bearing(slot, h_n, h_e, off, weight)

    def note_trunks(self, vehicle: int | None, now_s: float) -> None:
        """Trunks correct the odometer of this vehicle (None) or of a neighbour, as it tells."""
        mover = self._me if vehicle is None else self._of.get(vehicle)
        if mover is not None:
            mover.trunks_s = now_s

    def _believe_odometers(self, now_s: float) -> None:
        """As they are corrected now: who sees no trunk has the errors of its autopilot."""
        for slot in range(-1, len(self.ids)):
            mover = self._me if slot < 0 else self._of[self.ids[slot]]
            if self._covariance.set_by_trunks(slot, by_trunks=now_s - mover.trunks_s <= TRUNKS_S):
                mover.bias_n = mover.bias_e = 0.0

    def add_alignment(self, vehicle: int, found: Alignment) -> None:
        """Trunks that both have seen: a known neighbour's odometer in the own. It counts with the next epoch."""
        self._aligned[vehicle] = found

    def _take_alignment(self, found: Alignment, mover: VehicleMean, slot: int) -> None:
        """Place, then turn, if all of it is within the gate; some in a row that fit but for the turn: it was turned."""
        if mover.lost:
            return
        joint = self._covariance
        for is_within in (False, True):
            for axis in range(3):
                seen, off, variance = aligned_row(found, self._me, mover, axis, joint.indices(slot))
                ratio2 = off * off / (variance + joint.variance_of(seen))
                if ratio2 > HARD * HARD:
                    if axis < 2:
                        mover.turned = 0
                    elif mover.note_turned():
                        joint.inflate_yaw(slot, off)
                    return
                if is_within:
                    self._correct_means(joint.correct_by(seen, off, variance * max(1.0, ratio2 / (SOFT * SOFT))))
        mover.turned = 0

    def advance(self, now_s: float) -> None:
        """Bring all up to now."""
        self._extrapolate(self._me, now_s)
        for vehicle in self.ids:
            self._extrapolate(self._of[vehicle], now_s)
        if self._epoch_s < 0.0:
            self._epoch_s = now_s
        elif now_s - self._epoch_s >= EPOCH_S - 1e-6:
            since_s, self._epoch_s = now_s - self._epoch_s, now_s
            self._believe_odometers(now_s)
            self._take_ranges(now_s)
            self._propagate_covariance(since_s)
            if self._covariance.fresh:
                self._correct_means(self._covariance.correct())
            for vehicle in sorted(self._aligned):
                self._take_alignment(self._aligned.pop(vehicle), self._of[vehicle], self.ids.index(vehicle))
            self._covariance.add_process_noise(since_s)

    # --- what comes out ---

    def odometer_of(self, vehicle: int) -> Level | None:
        """Up to where a neighbour's odometer is reckoned in; None: it is not known."""
        mover = self._of.get(vehicle)
        return None if mover is None or mover.lost or mover.told_s < 0.0 else (mover.odo_n, mover.odo_e)

    def has_lost(self, vehicle: int) -> bool:
        """It has told nothing for so long that it is only reckoned to have flown along."""
        mover = self._of.get(vehicle)
        return mover is not None and mover.lost

    def relative(self, vehicle: int) -> Relative | None:
        """None: it is not known."""
        mover = self._of.get(vehicle)
        if mover is None:
            return None
        k, turn = 2 * self.ids.index(vehicle), 2 * len(self.ids)
        cov, coasted = self._covariance.cov, mover.coasted_m2(self._errors, mover.heard_s)
        n_m, e_m, var = mover.n_m, mover.e_m, cov[turn][turn]
        with_n, with_e = cov[k][turn], cov[k + 1][turn]
        return Relative(
            (n_m, e_m),
            cov[k][k] - 2.0 * e_m * with_n + e_m * e_m * var + coasted,
            cov[k][k + 1] + n_m * with_n - e_m * with_e - n_m * e_m * var,
            cov[k + 1][k + 1] + 2.0 * n_m * with_e + n_m * n_m * var + coasted,
            cov[k][k] + cov[k + 1][k + 1],
        )

    @property
    def covariance_m2(self) -> Matrix:
        """Of all relative positions: north and east of each of `ids`."""
        found = self._covariance.positions(self._turning())
        for i, row in enumerate(found):
            mover = self._of[self.ids[i // 2]]
            row[i] += mover.coasted_m2(self._errors, mover.heard_s)
        return found

    @property
    def compass(self) -> tuple[float, float]:
        """The error of the own compass, as it is found, and how sure: true yaw less told yaw, sd; radians.

        A vehicle steers by its compass: what it commands is turned back by this.
        """
        yaw = self._covariance.yaw(-1)
        return self._me.yaw, math.sqrt(max(0.0, self._covariance.cov[yaw][yaw]))

    @property
    def bias_ne_mps(self) -> Level:
        """The bias of the own odometer, as it is found: told velocity less true."""
        return self._me.bias_n, self._me.bias_e

    def compass_of(self, vehicle: int) -> float:
        """The error of a neighbour's compass, as it is found: true yaw less told yaw, radians. 0: it is not known."""
        mover = self._of.get(vehicle)
        return 0.0 if mover is None else mover.yaw

    @property
    def rotation_sd_rad(self) -> float:
        """Standard deviation of the turn of the whole formation about this vehicle: ranges see it only in motion."""
        return math.sqrt(self._covariance.turn_variance(self._turning()))

    # --- means ---

    def _read_odometry(
        self, mover: VehicleMean, odo_ne_m: Level, vel_ne_mps: Level, age_s: float, now_s: float, slot: int
    ) -> None:
        (odo_n, odo_e), (vel_n, vel_e) = odo_ne_m, vel_ne_mps
        if not (vel_n * vel_n + vel_e * vel_e <= FASTEST_MPS * FASTEST_MPS and 0.0 <= age_s <= OLDEST_S):
            return
        if odo_n - odo_n != 0.0 or odo_e - odo_e != 0.0:  # no number
            return
        told_s = max(0.0, now_s - age_s)
        if told_s < mover.told_s:  # another has overtaken it
            return
        self._extrapolate(mover, now_s)
        to_n, to_e = odo_n + vel_n * age_s, odo_e + vel_e * age_s
        if mover.told_s < 0.0:
            mover.odo_n, mover.odo_e = to_n, to_e
        else:
            d_n, d_e = to_n - mover.odo_n, to_e - mover.odo_e
            way_m = math.hypot(d_n, d_e)
            if way_m > JUMP_M + FASTEST_MPS * (now_s - mover.told_s):
                self._covariance.inflate(slot, AFTER_JUMP_M)
                mover.knots.clear()
            elif mover.lost:  # no way of this epoch: it would seem to show how the formation is turned
                north, east = turned(mover.yaw, d_n, d_e)
                mover.n_m, mover.e_m = mover.n_m + north, mover.e_m + east
                self._covariance.inflate(slot, self._errors.yaw_rad * way_m)
            else:
                self._move(mover, d_n, d_e)
            mover.odo_n, mover.odo_e = to_n, to_e
        mover.vel_n, mover.vel_e = vel_n, vel_e
        mover.told_s, mover.heard_s = told_s, now_s
        mover.add_knot(odo_n, odo_e, told_s)
        mover.lost = False

    def _extrapolate(self, mover: VehicleMean, now_s: float) -> None:
        """As it flew last."""
        since_s = now_s - mover.heard_s
        if not since_s > 0.0:
            return
        mover.heard_s = now_s
        if mover.told_s < 0.0:
            return
        if now_s - mover.told_s <= COASTS_S:
            d_n, d_e = mover.vel_n * since_s, mover.vel_e * since_s
            mover.odo_n += d_n
            mover.odo_e += d_e
            self._move(mover, d_n - mover.bias_n * since_s, d_e - mover.bias_e * since_s)
        elif mover is not self._me:
            mover.lost = True

    def _move(self, mover: VehicleMean, d_n: float, d_e: float) -> None:
        """Along its own north. Those that are lost go along with this vehicle."""
        north, east = turned(mover.yaw, d_n, d_e)
        mover.went_n += north
        mover.went_e += east
        if mover is self._me:
            for vehicle in self.ids:
                other = self._of[vehicle]
                if other.lost:
                    with_n, with_e = turned(-other.yaw, north, east)
                    other.odo_n += with_n
                    other.odo_e += with_e
                    other.went_n += north
                    other.went_e += east
                else:
                    other.n_m -= north
                    other.e_m -= east
        else:
            mover.n_m += north
            mover.e_m += east

    def _turning(self) -> Row:
        """The way by which all positions move for each radian that the formation turns about this vehicle."""
        movers = [self._of[vehicle] for vehicle in self.ids]
        return [value for mover in movers for value in (-mover.e_m, mover.n_m)]

    # --- gates ---

    def _is_good(
        self, a: VehicleMean, b: VehicleMean, slots: tuple[int, int], weight: float, off_m: float, now_s: float
    ) -> bool:
        """A range counts. A neighbour all of whose ranges were dropped for a while is somewhere else."""
        if weight > 0.0:
            a.shut_out_s = b.shut_out_s = -1.0
            return True
        for mover, slot in zip((a, b), slots, strict=True):
            if mover.shut_out_s < 0.0:
                mover.shut_out_s = now_s
            elif slot >= 0 and now_s - mover.shut_out_s > LOCKED_S:
                self._covariance.inflate(slot, off_m)
                mover.shut_out_s = -1.0
        return False

    # --- epochs ---

    def _propagate_covariance(self, since_s: float) -> None:
        """The covariance of the epoch's end; biases and compasses wander back to none."""
        movers = [self._of[vehicle] for vehicle in self.ids] + [self._me]
        self._covariance.propagate([(mover.went_n, mover.went_e) for mover in movers], self._turning(), since_s)
        keep_bias, keep_yaw = math.exp(-since_s / self._errors.bias_s), math.exp(-since_s / self._errors.yaw_s)
        for mover in movers:
            mover.bias_n *= keep_bias
            mover.bias_e *= keep_bias
            mover.yaw *= keep_yaw
            mover.went_n = mover.went_e = 0.0

    def _correct_means(self, change: Row) -> None:
        joint = self._covariance
        for slot in range(-1, joint.n):
            mover = self._me if slot < 0 else self._of[self.ids[slot]]
            if slot >= 0:
                n_m, e_m = mover.n_m + change[2 * slot], mover.e_m + change[2 * slot + 1]
                mover.n_m, mover.e_m = turned(change[2 * joint.n], n_m, e_m)
            bias = joint.bias(slot)
            mover.bias_n += change[bias]
            mover.bias_e += change[bias + 1]
            mover.yaw += change[joint.yaw(slot)]
