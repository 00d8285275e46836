"""Searches for the own position among peers that report theirs: for a vehicle that hovers until it is found.

A companion that starts in the air knows no position to begin with. Others tell where they have the leader
(SWARM_RELATIVE), so where they are about it is known; ranges to them say how far off this vehicle is from each. Ranges
to those in one line fit a position on either side of it, and those to a single one a whole circle: which of them it is,
odometers tell, counted from the mission's start positions, as far as they can have drifted; and ranges tell it as the
others move. So a position counts as found when no other explains what was measured nearly as well, and only then.

Level metres, north and east, as the others' compasses have it. The own odometer counts along the own compass.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, final

from companion.core.localisation.gnss_denied.error_state import Level
from companion.core.model.linear_algebra import Matrix, Row, solve

FRESH_S: Final = 0.8  # what tells of longer ago is not flown by: five beacons, and a radio that is late
LEADER_S: Final = 1.0  # of vehicles that name different leaders, one is followed for so long
WINDOW_S: Final = 10.0  # of ranges
EVERY_S: Final = 0.25  # one of each neighbour
LOOKS_S: Final = 0.5
LATEST_S: Final = 1.0  # before that nothing is found: too few
RANGE_SD_M: Final = 0.15  # of a range, with what both moved since their positions were told
DRIFTS_MPS: Final = 0.1  # two odometers against each other, sd on an axis: biases, and compasses that are off
SOFT2: Final = 9.0  # squared sigmas, from which on a misfit weighs less and less: trunks make ranges late
SURE: Final = 20.0  # by so much, in squared sigmas, any other position must fit worse
NO_GUESS2: Final = 12.0  # squared sigmas off what odometers say: they do not count from the start positions
JUMP_M: Final = 3.0  # between two readings of an odometer; one that is heard every half second flies less
ANOTHER_M: Final = 1.5  # what is nearer is the same position
SD_MAX_M: Final = 1.0  # of a position that is found: a fifth of the separation that is kept
BAD_SHARE: Final = 0.34  # of ranges that may not fit
STAYS_S: Final = 1.0  # for so long a position is found again before it counts
TURNED_RAD: Final = math.radians(3.0)  # two compasses against each other
ROUND: Final = 16  # points on a circle, from which the best positions are sought
STEPS: Final = 8  # of each search


@final
class _Sample:
    """One range, with where its other end was about the leader, and the way as it was read then."""

    __slots__ = ("at_s", "e_m", "level_m", "n_m", "sd_m", "vehicle", "way_e_m", "way_n_m")

    def __init__(self, vehicle: int, there: Level, sd_m: float, level_m: float, way: Level, at_s: float) -> None:
        self.vehicle = vehicle
        self.n_m, self.e_m = there
        self.sd_m = sd_m
        self.level_m = level_m
        self.way_n_m, self.way_e_m = way
        self.at_s = at_s


@final
class _Told:
    """A neighbour's report: its odometer, its position about the leader."""

    __slots__ = ("at_s", "odo", "position", "sd_m", "vel")

    def __init__(self, odo: Level, vel: Level, position: Level | None, sd_m: float, at_s: float) -> None:
        self.odo = odo
        self.vel = vel
        self.position = position
        self.sd_m = sd_m
        self.at_s = at_s


@final
class Relocaliser:
    """Fed with neighbours' reports and ranges to them, then `search` each tick; `locate_vehicles` has all."""

    __slots__ = ("_at", "_leader", "_leader_s", "_looked_s", "_mark", "_own", "_reports", "_samples", "_since_s")

    def __init__(self) -> None:
        self._leader = 0
        self._leader_s = -1e9
        self._mark = 0  # the vehicle whose odometer says how the leader moves; 0: none
        self._reports: dict[int, _Told] = {}
        self._samples: list[_Sample] = []
        self._own: Level = (0.0, 0.0)  # where the own odometer has this vehicle, about the mission's origin
        self._looked_s = -1e9
        self._at: tuple[Level, float] | None = None  # about the leader, sd: the best, as far as it is the only one
        self._since_s = -1e9  # since when it is that

    # --- what comes in ---

    def update_odometry(self, position: Level) -> None:
        """The own odometer, counted from the mission's start position. One that jumps begins anew, and so does all."""
        if math.dist(position, self._own) > JUMP_M:
            self._restart(0)
        self._own = position

    def store_report(
        self, vehicle: int, leader: int, to_leader: Level | None, sd_m: float, odo: Level, vel: Level, now_s: float
    ) -> None:
        """A neighbour's word: where it has `leader` (0: it knows none). `odo`: its own, as `update_odometry`'s."""
        if leader != self._leader and leader and now_s - self._leader_s > LEADER_S:
            self._leader = leader
            for known in self._reports.values():
                known.position = None
            self._restart(0)
        position: Level | None = None
        if leader == self._leader and leader:
            self._leader_s = now_s
            if vehicle == leader:
                position, sd_m = (0.0, 0.0), 0.0
            elif to_leader is not None:
                position = (-to_leader[0], -to_leader[1])
        before = self._reports.get(vehicle)
        if vehicle == self._mark and before is not None and math.dist(odo, before.odo) > JUMP_M:
            self._restart(0)
        self._reports[vehicle] = _Told(odo, vel, position, sd_m, now_s)

    def add_range(self, vehicle: int, level_m: float, now_s: float) -> None:
        """The level distance to a neighbour, measured now."""
        there = self._reports.get(vehicle)
        if there is None or there.position is None or now_s - there.at_s > FRESH_S:
            return
        last = max([sample.at_s for sample in self._samples if sample.vehicle == vehicle], default=-1e9)
        if now_s - last < EVERY_S:
            return
        way = self._way(now_s)
        if way is not None:
            self._samples.append(_Sample(vehicle, there.position, there.sd_m, level_m, way, now_s))

    # --- what comes out ---

    def search(self, drifted_m: float, now_s: float) -> bool:
        """Searches; True: this vehicle is found. `drifted_m`: how far odometers may be off by now, sd on an axis.

        Infinite: they, and the mission's start positions, are not asked.
        """
        if now_s - self._looked_s < LOOKS_S:
            return self._at is not None and now_s - self._since_s >= STAYS_S
        self._looked_s = now_s
        self._samples = [sample for sample in self._samples if now_s - sample.at_s <= WINDOW_S]
        before, self._at = self._at, None
        way = self._way(now_s)
        if way is None or not self._samples or now_s - self._samples[0].at_s < LATEST_S:
            return False
        self._at = _Fit(self._samples, way, self._guess(), drifted_m, now_s).only()
        if self._at is None or before is None or math.dist(self._at[0], before[0]) > 2.0 * ANOTHER_M:
            self._since_s = now_s
        return self._at is not None and now_s - self._since_s >= STAYS_S

    def knows_leader(self, vehicle: int, now_s: float) -> bool:
        """It has told lately where it has the leader, or is that."""
        told = self._reports.get(vehicle)
        return told is not None and told.position is not None and now_s - told.at_s <= FRESH_S

    def place_by(self, vehicle: int, there: Level, now_s: float) -> bool:
        """Found without ranges: a neighbour that is known to be `there` from here; False: it does not know the leader.

        Its vector to the leader is as far off as two compasses turn it.
        """
        told = self._reports.get(vehicle)
        if told is None or told.position is None or not self.knows_leader(vehicle, now_s):
            return False
        at, turned_m = told.position, TURNED_RAD * math.hypot(told.position[0], told.position[1])
        self._at = ((at[0] - there[0], at[1] - there[1]), math.hypot(told.sd_m, turned_m))
        return True

    @property
    def leader(self) -> tuple[int, Level, float]:
        """After it was found: which vehicle leads, where that is from here, sd on each axis."""
        assert self._at is not None
        (north, east), sd_m = self._at
        return self._leader, (-north, -east), sd_m

    def locate_vehicles(self, vehicles: Iterable[int], now_s: float) -> tuple[dict[int, Level], float]:
        """After it was found: where those are that tell it, from here; sd on each axis."""
        assert self._at is not None
        (north, east), sd_m = self._at
        found: dict[int, Level] = {}
        for vehicle in vehicles:
            told = self._reports.get(vehicle)
            if told is not None and told.position is not None and now_s - told.at_s <= FRESH_S:
                found[vehicle] = (told.position[0] - north, told.position[1] - east)
                sd_m = max(sd_m, told.sd_m)
        return found, sd_m

    def dead_reckon(self, vehicle: int) -> Level | None:
        """The position where odometers alone have a neighbour, from here."""
        told = self._reports.get(vehicle)
        return None if told is None else (told.odo[0] - self._own[0], told.odo[1] - self._own[1])

    # --- inside ---

    def _restart(self, mark: int) -> None:
        self._mark = mark
        self._samples.clear()
        self._at = None

    def _way(self, now_s: float) -> Level | None:
        """The way that this vehicle has moved against the leader, from wherever; None: it cannot be told."""
        mark = self._reports.get(self._mark)
        if mark is None or mark.position is None or now_s - mark.at_s > FRESH_S:
            fresh = [
                k for k, told in self._reports.items() if told.position is not None and now_s - told.at_s <= FRESH_S
            ]
            if not fresh:
                return None
            self._restart(self._leader if self._leader in fresh else min(fresh))
            mark = self._reports[self._mark]
        assert mark.position is not None
        since_s = now_s - mark.at_s
        leader_n = mark.odo[0] + mark.vel[0] * since_s - mark.position[0]
        leader_e = mark.odo[1] + mark.vel[1] * since_s - mark.position[1]
        return (self._own[0] - leader_n, self._own[1] - leader_e)

    def _guess(self) -> Level:
        """About the leader, as odometers have it that count from the mission's start positions."""
        mark = self._reports[self._mark]
        assert mark.position is not None
        there = (mark.odo[0] - mark.position[0], mark.odo[1] - mark.position[1])
        return (self._own[0] - there[0], self._own[1] - there[1])


@final
class _Fit:
    """The position of this vehicle about the leader that ranges of the last seconds give together.

    Four numbers: its position, and the velocity by which its odometer and the leader's drift apart.
    """

    __slots__ = ("_guess", "_guess_var", "_rows")

    def __init__(self, samples: list[_Sample], way: Level, guess: Level, drifted_m: float, now_s: float) -> None:
        self._guess = guess
        self._guess_var = drifted_m * drifted_m
        counts: dict[int, int] = {}
        for sample in samples:
            counts[sample.vehicle] = counts.get(sample.vehicle, 0) + 1
        self._rows: list[tuple[float, float, float, float, float]] = []  # north, east, age, metres, variance
        for sample in samples:
            # A neighbour's position is wrong by the same in all its samples: together they say no more than it is sure.
            var = RANGE_SD_M**2 + counts[sample.vehicle] * sample.sd_m**2
            at = (sample.n_m + way[0] - sample.way_n_m, sample.e_m + way[1] - sample.way_e_m)
            self._rows.append((at[0], at[1], now_s - sample.at_s, sample.level_m, var))

    def only(self) -> tuple[Level, float] | None:
        """The position that alone explains what was measured, and its sd; None: there is none, or more than one."""
        nearest = min(self._rows, key=_metres)
        starts = [self._guess] if self._guess_var < math.inf else []
        for k in range(ROUND):
            turn = math.tau * k / ROUND
            starts.append((nearest[0] + nearest[3] * math.cos(turn), nearest[1] + nearest[3] * math.sin(turn)))
        found = sorted([self._search(start) for start in starts], key=_cost_of)
        cost, at = found[0]
        if self._off_guess(at) > NO_GUESS2:  # an odometer began anew: it tells nothing
            self._guess_var = math.inf
            return self.only()
        sd_m, bad = self._judge(at)
        if sd_m > SD_MAX_M or bad > BAD_SHARE:
            return None
        for other, position in found[1:]:
            if other - cost < SURE and math.hypot(position[0] - at[0], position[1] - at[1]) > ANOTHER_M:
                return None
        return (at[0], at[1]), sd_m

    def _search(self, start: Level) -> tuple[float, Row]:
        """Down to the nearest least: its cost, and where."""
        at = [start[0], start[1], 0.0, 0.0]
        cost, damp = self._cost(at), 1e-3
        for _ in range(STEPS):
            slope, step = self._slope(at)
            for k in range(4):
                slope[k][k] *= 1.0 + damp
            solve(slope, step)
            there = [value - step[k][0] for k, value in enumerate(at)]
            less = self._cost(there)
            if less < cost:
                gain, at, cost, damp = cost - less, there, less, damp * 0.3
                if gain < 1e-3:
                    break
            else:
                damp = max(damp, 1e-2) * 10.0
        return cost, at

    def _off_guess(self, at: Row) -> float:
        return ((at[0] - self._guess[0]) ** 2 + (at[1] - self._guess[1]) ** 2) / self._guess_var

    def _cost(self, at: Row) -> float:
        """Squared sigmas; of what does not fit, ever less than that."""
        total = self._off_guess(at) + (at[2] * at[2] + at[3] * at[3]) / DRIFTS_MPS**2
        for n_m, e_m, age_s, metres, var in self._rows:
            d_n, d_e = at[0] + at[2] * age_s - n_m, at[1] + at[3] * age_s - e_m
            off = math.sqrt(d_n * d_n + d_e * d_e) - metres
            total += SOFT2 * math.log1p(off * off / (var * SOFT2))
        return total

    def _slope(self, at: Row) -> tuple[Matrix, Matrix]:
        """Half the second derivatives (Gauss and Newton's), and half the first, of the cost."""
        g_n, g_e = (at[0] - self._guess[0]) / self._guess_var, (at[1] - self._guess[1]) / self._guess_var
        g_vn, g_ve = at[2] / DRIFTS_MPS**2, at[3] / DRIFTS_MPS**2
        nn = ee = 1e-6 + 1.0 / self._guess_var  # ranges to one at rest see one direction alone
        ne = nn1 = ne1 = ee1 = ne2 = 0.0
        nn2 = ee2 = 1.0 / DRIFTS_MPS**2
        for n_m, e_m, age_s, metres, var in self._rows:
            d_n, d_e = at[0] + at[2] * age_s - n_m, at[1] + at[3] * age_s - e_m
            away_m = max(0.1, math.sqrt(d_n * d_n + d_e * d_e))
            off = away_m - metres
            weight = 1.0 / (var * (1.0 + off * off / (var * SOFT2)))
            u_n, u_e = d_n / away_m, d_e / away_m
            pull = weight * off
            g_n += pull * u_n
            g_e += pull * u_e
            g_vn += pull * u_n * age_s
            g_ve += pull * u_e * age_s
            w_nn, w_ne, w_ee = weight * u_n * u_n, weight * u_n * u_e, weight * u_e * u_e
            nn += w_nn
            ne += w_ne
            ee += w_ee
            nn1 += w_nn * age_s
            ne1 += w_ne * age_s
            ee1 += w_ee * age_s
            nn2 += w_nn * age_s * age_s
            ne2 += w_ne * age_s * age_s
            ee2 += w_ee * age_s * age_s
        second = [[nn, ne, nn1, ne1], [ne, ee, ne1, ee1], [nn1, ne1, nn2, ne2], [ne1, ee1, ne2, ee2]]
        return second, [[g_n], [g_e], [g_vn], [g_ve]]

    def _judge(self, at: Row) -> tuple[float, float]:
        """Standard deviation of that position along its longest axis; the share of the ranges that does not fit."""
        second, _ = self._slope(at)
        cov = [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]
        solve(second, cov)
        most = (cov[0][0] + cov[1][1]) / 2.0 + math.hypot((cov[0][0] - cov[1][1]) / 2.0, cov[0][1])
        bad = 0
        for n_m, e_m, age_s, metres, var in self._rows:
            off = math.hypot(at[0] + at[2] * age_s - n_m, at[1] + at[3] * age_s - e_m) - metres
            bad += off * off > SOFT2 * var
        return math.sqrt(max(0.0, most)), bad / len(self._rows)


def _metres(row: tuple[float, float, float, float, float]) -> float:
    return row[3]


def _cost_of(found: tuple[float, Row]) -> float:
    return found[0]
