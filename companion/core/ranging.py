"""Where the neighbours are in a swarm that flies by ranges: `relative`'s filter, fed by beacons, odometer and radio.

What comes out is along the north of this vehicle's own compass, by which it steers. Vectors that others tell are along
theirs, and are turned here. Of a neighbour's place two things are told apart: where it is thought to be, and how near
it may be, which is what is kept clear of.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, final

from companion.core.joint import Level
from companion.core.relative import RelativeFilter
from companion.core.types import ZERO, Beacon, Position, RangeTo, Word
from mission.frames import Vec3, enu_to_ned
from mission.model import Mission

START_SD_M: Final = 0.5  # of the mission's places, on each axis
GAP_S: Final = 1.0  # after a longer one the own bias is reckoned with from now on
AIR_S: Final = 0.05  # from a beacon's making to its being heard: a tick
FRESH_S: Final = 0.3  # a range that is older says nothing of how near a neighbour is now
STEEP: Final = 0.7  # a range is of use where so much of it is level
WIDENS_SDS: Final = 2.0  # a neighbour is kept clear of as if nearer by so many standard deviations
WIDENS_MAX_SHARE: Final = 0.5  # but not by more than half of its distance
TELLS_MAX: Final = 16  # ranges in a beacon


@final
class Neighbourhood:
    """One vehicle's. `tick` it once a tick, after what has come in; ids are the mission's."""

    __slots__ = ("_down_m", "_filter", "_last", "_me", "_odo_ne_m", "_read_s", "_starts", "_to_tell", "strayed_ned_m")

    def __init__(self, mission: Mission, me: int) -> None:
        assert mission.ranging is not None
        starts = [enu_to_ned(place) for place in mission.ranging.start_enu_m[: mission.swarm.size]]
        self._me = me
        self._starts = starts
        here = starts[me - 1]
        others = {k: _level(there, here) for k, there in enumerate(starts, start=1) if k != me}
        self._filter = RelativeFilter()
        sure = [k for k in others if mission.has_satellites(k)]
        self._filter.start(others, START_SD_M, sure=sure, is_sure=mission.has_satellites(me))
        self._down_m = {k: starts[k - 1][2] for k in others}  # as they told last, about the mission's origin
        self._odo_ne_m: Level = (0.0, 0.0)
        self._read_s: float | None = None
        self.strayed_ned_m: Vec3 = ZERO  # how far the own odometer has gone wrong by its bias, since the start
        self._last: dict[int, tuple[float, float]] = {}  # own ranges: metres, measured at
        self._to_tell: list[tuple[int, float, float]] = []  # vehicle, metres, measured at

    # --- what comes in ---

    def own(self, position: Position, now_s: float) -> None:
        """The own odometer: the own told position, of which differences count."""
        pos, vel, start = position.pos_ned_m, position.vel_ned_mps, self._starts[self._me - 1]
        self._down_m[self._me] = pos[2]
        self._odo_ne_m = _level(pos, start)
        if self._read_s is not None and 0.0 < now_s - self._read_s <= GAP_S:
            (bias_n, bias_e), since_s = self._filter.bias_ne_mps, now_s - self._read_s
            strayed = self.strayed_ned_m
            self.strayed_ned_m = (strayed[0] + bias_n * since_s, strayed[1] + bias_e * since_s, 0.0)
        self._read_s = now_s
        self._filter.own(self._odo_ne_m, (vel[0], vel[1]), now_s)

    def measured(self, ranges: tuple[RangeTo, ...], now_s: float) -> None:
        """By the own radio. Of two vehicles one tells the others: the lower if the sum of their ids is even."""
        for vehicle, metres, age_s in ranges:
            if vehicle not in self._filter.ids:
                continue
            self._last[vehicle] = (metres, now_s - age_s)
            self._range(None, vehicle, metres, age_s, now_s)
            if (self._me < vehicle) == ((self._me + vehicle) % 2 == 0):
                self._to_tell.append((vehicle, metres, now_s - age_s))
        del self._to_tell[:-TELLS_MAX]

    def told(self, word: Word, vel_ned_mps: Vec3, down_m: float, now_s: float) -> None:
        """A neighbour's word, with what its beacon says of velocity and height."""
        self._down_m[word.sender] = down_m
        self._filter.told(word.sender, word.odo_ne_m, (vel_ned_mps[0], vel_ned_mps[1]), AIR_S, now_s)
        for vehicle, metres, age_s in word.ranges:
            if vehicle not in (self._me, word.sender):  # this vehicle's own it has from its own radio
                self._range(word.sender, vehicle, metres, age_s + AIR_S, now_s)

    def tick(self, now_s: float) -> None:
        """Bring all up to now."""
        self._filter.tick(now_s)

    def _range(self, one: int | None, other: int, metres: float, age_s: float, now_s: float) -> None:
        a, b = self._down_m.get(one or self._me), self._down_m.get(other)
        if a is None or b is None:
            return
        square = metres * metres - (a - b) * (a - b)
        if square > STEEP * STEEP * metres * metres:
            self._filter.ranged(one, other, math.sqrt(square), age_s, now_s)

    # --- what comes out ---

    def place(self, vehicle: int, own_down_m: float, now_s: float) -> tuple[Vec3, Vec3] | None:
        """Where a neighbour is thought to be, and the same as near as it may be; NED m from here. None: not known."""
        found = self._filter.relative(vehicle)
        if found is None:
            return None
        north, east = found.ne_m
        down_m = self._down_m[vehicle] - own_down_m
        away_m = max(1e-6, math.hypot(north, east))
        u_n, u_e = north / away_m, east / away_m
        var = u_n * u_n * found.var_nn_m2 + 2.0 * u_n * u_e * found.var_ne_m2 + u_e * u_e * found.var_ee_m2
        near_m = away_m
        metres, measured_s = self._last.get(vehicle, (0.0, -1e9))
        if now_s - measured_s <= FRESH_S and metres > abs(down_m):
            near_m = min(near_m, math.sqrt(metres * metres - down_m * down_m))
        near_m -= min(WIDENS_SDS * math.sqrt(max(0.0, var)), WIDENS_MAX_SHARE * near_m)
        c, s = self._turn(-self._filter.compass[0])
        rel = (c * north - s * east, s * north + c * east, down_m)
        share = near_m / away_m
        return rel, (share * rel[0], share * rel[1], down_m)

    def turned(self, said: Beacon) -> Beacon:
        """What a neighbour says, with its vectors along the own north."""
        c, s = self._turn(self._filter.compass_of(said.sender) - self._filter.compass[0])
        dest, seen = said.dest_ned_m, said.sighting
        return replace(
            said,
            vel_ned_mps=_turned(said.vel_ned_mps, c, s),
            ref_ned_mps=_turned(said.ref_ned_mps, c, s),
            dest_ned_m=None if dest is None else _turned(dest, c, s),
            sighting=None if seen is None else replace(seen, rel_ned_m=_turned(seen.rel_ned_m, c, s)),
        )

    def word(self, leader: int, time_ms: int, now_s: float) -> Word:
        """For the next beacon. `leader`: the acting one; 0: none."""
        found = self._filter.relative(leader)
        ranges = tuple([(vehicle, metres, now_s - at_s) for vehicle, metres, at_s in self._to_tell])
        self._to_tell.clear()
        to_leader = None if found is None else found.ne_m
        return Word(self._me, time_ms, self._odo_ne_m, to_leader, 0.0 if found is None else found.sd_m, ranges)

    @property
    def rotation_sd_rad(self) -> float:
        """See RelativeFilter."""
        return self._filter.rotation_sd_rad

    @staticmethod
    def _turn(by_rad: float) -> tuple[float, float]:
        return math.cos(by_rad), math.sin(by_rad)


def _turned(v: Vec3, c: float, s: float) -> Vec3:
    return (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])


def _level(a: Vec3, b: Vec3) -> Level:
    return (a[0] - b[0], a[1] - b[1])
