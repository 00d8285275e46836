"""The joint uncertainty of a swarm's relative positions, and what measurements make of it: `relative`'s algebra.

The state, of n neighbours: the errors of their positions (north, east each); the turn of the whole formation; the own
compass; the own velocity bias (north, east); then each neighbour's bias and compass. A true position is the estimated
one and its error, turned together by the turn: so ranges, which see no turn, see none here either, wherever the
formation is thought to be. Were the turn left among the positions, each correction of the formation's shape would seem
to tell of it (as in maps that filters build), and the filter would soon be sure of a turn that nobody has seen.

Whatever is measured concerns the first 2 n + 2 only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

from companion.core.model.linear_algebra import Matrix, Row, dot, solve, zeros

Level = tuple[float, float]  # north, east

POWER_S: Final = 10.0  # over which the power of moves is taken
SURE_SHARE: Final = 0.2  # of bias and compass error, of a vehicle with GNSS: its autopilot corrects both by it
NOISE_SHARE: Final = 1.15  # of noise that is reckoned with: less than all would be taken for moves by chance


@dataclass(frozen=True, slots=True)
class Errors:
    """The errors of the sensors, as they are believed: standard deviations, on each level axis where there are two."""

    velocity_mps: float = 0.1  # white, new every `velocity_s`
    velocity_s: float = 0.1
    bias_mps: float = 0.05  # forgotten in `bias_s`
    bias_s: float = 20.0
    yaw_rad: float = math.radians(2.0)  # of a compass, forgotten in `yaw_s`
    yaw_s: float = 300.0
    range_m: float = 0.1
    mean_range_m: float | None = None  # what a pair's ranges of an epoch have in common; None: each is weighed alone
    bearing_rad: float = math.radians(5.0)


AMONG_TRUNKS: Final = Errors(mean_range_m=0.04)  # where trunks are shared, of an odometer that none correct
# Of odometers that raw scans correct: 0.01 to 0.04 m in 2 s among 400 trees/ha; more where few trunks are in sight
BY_TRUNKS: Final = Errors(velocity_mps=0.05, bias_mps=0.02, mean_range_m=0.04)


@final
class ErrorStateCovariance:
    """Slots: neighbours in their order, -1 this vehicle. A `turning`: by what each position moves for a radian."""

    __slots__ = ("_by_trunks", "_errors", "_info", "_noise", "_power", "_pull", "_shares", "cov", "fresh", "n")

    def __init__(self, errors: Errors) -> None:
        self._errors: Final = errors
        self.n = 0
        self._shares: Row = [1.0]  # of each slot, last this vehicle: of bias and compass error
        self._by_trunks = [False]  # of each slot, last this vehicle: trunks correct its odometer
        self.cov: Matrix = zeros(4, 4)
        self._info: Matrix = []  # what was measured since the last correction: H'R^-1 H, and
        self._pull: Row = []  # H'R^-1 times the innovations
        self.fresh = False  # that there is any
        self._power = self._noise = 0.0  # of ways against their mean, in an epoch, lately, m2
        self._prior(-1)
        self.clear()

    # --- which are there ---

    def initialise(self, n: int, sd_m: float, sure: Sequence[bool] = ()) -> None:
        """All anew: each of n neighbours and this vehicle, off its position by `sd_m` by itself.

        `sure`: of each, this vehicle last, whether it has GNSS; by default none has.
        """
        self._shares = [SURE_SHARE if one else 1.0 for one in sure] or [1.0] * (n + 1)
        self._by_trunks = [False] * (n + 1)
        self.n, self.cov = n, zeros(5 * n + 4, 5 * n + 4)
        for i in range(2 * n):
            for j in range(i % 2, 2 * n, 2):
                self.cov[i][j] = sd_m * sd_m * (2.0 if i == j else 1.0)
        for slot in range(-1, n):
            self._prior(slot)
        self.clear()

    def add_slot(self, sd_m: float) -> None:
        """One neighbour more, the last."""
        n = self.n
        size = 5 * n + 9
        keep = [k for k in range(size - 3) if k not in (2 * n, 2 * n + 1)]
        grown = zeros(size, size)
        for i, row in zip(keep, self.cov, strict=True):
            for j, value in zip(keep, row, strict=True):
                grown[i][j] = value
        grown[2 * n][2 * n] = grown[2 * n + 1][2 * n + 1] = sd_m * sd_m
        self.n, self.cov = n + 1, grown
        self._shares.insert(n, 1.0)
        self._by_trunks.insert(n, False)
        self._prior(n)
        self.clear()

    def remove_slot(self, slot: int) -> None:
        """Without that neighbour."""
        bias = self.bias(slot)
        gone = (2 * slot, 2 * slot + 1, bias, bias + 1, bias + 2)
        keep = [k for k in range(len(self.cov)) if k not in gone]
        del self._shares[slot], self._by_trunks[slot]
        self.cov = [[self.cov[i][j] for j in keep] for i in keep]
        self.n -= 1
        self.clear()

    def bias(self, slot: int) -> int:
        """Index in the state of a vehicle's bias north; east is the next."""
        return 2 * self.n + 4 + 3 * slot if slot >= 0 else 2 * self.n + 2

    def yaw(self, slot: int) -> int:
        """Index in the state of the error of its compass."""
        return 2 * self.n + 6 + 3 * slot if slot >= 0 else 2 * self.n + 1

    def indices(self, slot: int) -> tuple[int, int, int, int]:
        """Of a neighbour's position north (east is the next), the formation's turn, its compass, the own one."""
        return 2 * slot, 2 * self.n, self.yaw(slot), self.yaw(-1)

    def _prior(self, slot: int) -> None:
        cov, bias, yaw = self.cov, self.bias(slot), self.yaw(slot)
        share = self._shares[slot] ** 2
        cov[bias][bias] = cov[bias + 1][bias + 1] = share * self._errors_of(slot).bias_mps ** 2
        cov[yaw][yaw] = share * self._errors.yaw_rad**2

    def _errors_of(self, slot: int) -> Errors:
        return BY_TRUNKS if self._by_trunks[slot] else self._errors

    def set_by_trunks(self, slot: int, *, by_trunks: bool) -> bool:
        """Believe a vehicle's odometer as one that trunks correct, or not. True: that is new, as is its bias."""
        if self._by_trunks[slot] == by_trunks:
            return False
        self._by_trunks[slot] = by_trunks
        for state in (self.bias(slot), self.bias(slot) + 1):
            self.cov[state] = [0.0] * len(self.cov)
            for row in self.cov:
                row[state] = 0.0
            self.cov[state][state] = self._shares[slot] ** 2 * self._errors_of(slot).bias_mps ** 2
        return True

    def inflate(self, slot: int, by_m: float) -> None:
        """One vehicle may be off by so much more."""
        n, cov = self.n, self.cov
        if slot >= 0:
            for k in (2 * slot, 2 * slot + 1):
                cov[k][k] += by_m * by_m
            return
        for i in range(2 * n):
            for j in range(i % 2, 2 * n, 2):
                cov[i][j] += by_m * by_m

    def inflate_yaw(self, slot: int, by_rad: float) -> None:
        """A neighbour's compass may be off by so much more; of one with GNSS, which tells north, those of all others.

        These together, and with them the formation's turn: what they have of one another stays.
        """
        turned = [self.yaw(slot)]
        if self._shares[slot] < 1.0:
            turned = [2 * self.n, *[self.yaw(other) for other in range(-1, self.n) if other != slot]]
        for i in turned:
            for j in turned:
                self.cov[i][j] += by_rad * by_rad

    # --- what is uncertain ---

    def range_variance(self, a: int, b: int, u_n: float, u_e: float) -> float:
        """u' P u for the position of slot b less that of slot a."""
        if a < 0:
            return self._shared(b, b, u_n, u_e)
        both = self._shared(a, a, u_n, u_e) + self._shared(b, b, u_n, u_e)
        return both - 2.0 * self._shared(a, b, u_n, u_e)

    def _shared(self, a: int, b: int, u_n: float, u_e: float) -> float:
        north, east, k = self.cov[2 * a], self.cov[2 * a + 1], 2 * b
        return u_n * (north[k] * u_n + north[k + 1] * u_e) + u_e * (east[k] * u_n + east[k + 1] * u_e)

    def bearing_variance(self, slot: int, u_n: float, u_e: float) -> float:
        """The same of a bearing along `u` as the own compass has it: with the turn and the compass."""
        cov, k, turn, yaw = self.cov, 2 * slot, 2 * self.n, 2 * self.n + 1
        turned = cov[turn][turn] - 2.0 * cov[turn][yaw] + cov[yaw][yaw]
        shared = u_n * (cov[k][turn] - cov[k][yaw]) + u_e * (cov[k + 1][turn] - cov[k + 1][yaw])
        return self._shared(slot, slot, u_n, u_e) + turned + 2.0 * shared

    def positions(self, turning: Row) -> Matrix:
        """The covariance of all positions, with what the turn adds to it."""
        size = 2 * self.n
        var, with_turn = self.cov[size][size], self.cov[size]
        return [
            [
                self.cov[i][j] + turning[i] * with_turn[j] + with_turn[i] * turning[j] + turning[i] * turning[j] * var
                for j in range(size)
            ]
            for i in range(size)
        ]

    def turn_variance(self, turning: Row) -> float:
        """Of the formation's turn, in radians squared; infinite without a formation."""
        cov, turn = self.cov, 2 * self.n
        square = dot(turning, turning, turn)
        if square == 0.0:
            return math.inf
        var = cov[turn][turn] + 2.0 * dot(turning, cov[turn], turn) / square
        for i in range(turn):
            var += turning[i] * dot(cov[i], turning, turn) / (square * square)
        return max(0.0, var)

    # --- what is measured, until it is reckoned in ---

    def clear(self) -> None:
        """Nothing was measured."""
        self._info = zeros(2 * self.n + 2, 2 * self.n + 2)
        self._pull = [0.0] * (2 * self.n + 2)
        self.fresh = False

    def add_range(self, a: int, b: int, u_n: float, u_e: float, off_m: float, weight: float) -> None:
        """From slot a to b along `u`: longer than thought by `off_m`. `weight`: 1 / variance."""
        self.fresh = True
        self._add(2 * b, 2 * b, u_n, u_e, weight)
        self._pull[2 * b] += weight * off_m * u_n
        self._pull[2 * b + 1] += weight * off_m * u_e
        if a >= 0:
            self._add(2 * a, 2 * a, u_n, u_e, weight)
            self._add(2 * a, 2 * b, u_n, u_e, -weight)
            self._add(2 * b, 2 * a, u_n, u_e, -weight)
            self._pull[2 * a] -= weight * off_m * u_n
            self._pull[2 * a + 1] -= weight * off_m * u_e

    def _add(self, i: int, j: int, u_n: float, u_e: float, weight: float) -> None:
        north, east = self._info[i], self._info[i + 1]
        north[j] += weight * u_n * u_n
        north[j + 1] += weight * u_n * u_e
        east[j] += weight * u_e * u_n
        east[j + 1] += weight * u_e * u_e

    def add_bearing(self, slot: int, u_n: float, u_e: float, off_rad: float, weight: float) -> None:
        """By the own compass, clockwise of where it is thought by `off_rad`. `u`: the bearing's gradient, rad/m."""
        self.fresh = True
        turn = 2 * self.n
        seen = ((2 * slot, u_n), (2 * slot + 1, u_e), (turn, 1.0), (turn + 1, -1.0))
        for i, h in seen:
            row = self._info[i]
            for j, g in seen:
                row[j] += weight * h * g
            self._pull[i] += weight * h * off_rad

    # --- epochs ---

    def propagate(self, went: list[Level], turning: Row, since_s: float) -> None:
        """P <- F P F' + Q: how odometers may have erred. `went`: each neighbour's way, last this vehicle's."""
        errors, cov, n = self._errors, self.cov, self.n
        size, turn, own_yaw, own = len(cov), 2 * n, 2 * n + 1, 2 * n + 2
        ways = self._moves(went, since_s)
        my_n, my_e = ways[n]
        for slot in range(n):  # rows
            w_n, w_e = ways[slot]
            bias = self.bias(slot)
            own_bias, its_bias, its_yaw, my_yaw, turned = cov[own], cov[bias], cov[bias + 2], cov[own_yaw], cov[turn]
            row = cov[2 * slot]
            for j in range(size):
                row[j] += since_s * (own_bias[j] - its_bias[j]) - w_e * its_yaw[j] + my_e * my_yaw[j]
                row[j] += (w_e - my_e) * turned[j]
            own_bias, its_bias, row = cov[own + 1], cov[bias + 1], cov[2 * slot + 1]
            for j in range(size):
                row[j] += since_s * (own_bias[j] - its_bias[j]) + w_n * its_yaw[j] - my_n * my_yaw[j]
                row[j] -= (w_n - my_n) * turned[j]
        keep_bias, keep_yaw = math.exp(-since_s / errors.bias_s), math.exp(-since_s / errors.yaw_s)
        keeps = [1.0] * (2 * n + 1) + [keep_yaw, keep_bias, keep_bias] + [keep_bias, keep_bias, keep_yaw] * n
        for i in range(size):  # columns, and what is forgotten
            row, keep = cov[i], keeps[i]
            for slot in range(n):
                w_n, w_e = ways[slot]
                bias = self.bias(slot)
                north = since_s * (row[own] - row[bias]) - w_e * row[bias + 2] + my_e * row[own_yaw]
                east = since_s * (row[own + 1] - row[bias + 1]) + w_n * row[bias + 2] - my_n * row[own_yaw]
                row[2 * slot] += north + (w_e - my_e) * row[turn]
                row[2 * slot + 1] += east - (w_n - my_n) * row[turn]
            for j in range(size):
                row[j] *= keep * keeps[j]
        new_yaw = errors.yaw_rad**2 * (1.0 - keep_yaw * keep_yaw)
        for slot in range(-1, n):
            bias, yaw, share = self.bias(slot), self.yaw(slot), self._shares[slot] ** 2
            new_bias = self._errors_of(slot).bias_mps ** 2 * (1.0 - keep_bias * keep_bias)
            cov[bias][bias] += share * new_bias
            cov[bias + 1][bias + 1] += share * new_bias
            cov[yaw][yaw] += share * new_yaw
        self._take_turn(turning)

    def _moves(self, went: list[Level], since_s: float) -> list[Level]:
        """`went` as far as it is no error of odometers.

        One that moves against the others shows how the formation is turned. Noise that is taken for such a move would
        show it too, and wrongly: the ways against their mean are shortened by what share of their power is noise.
        """
        count = len(went)
        mean_n = sum([way[0] for way in went]) / count
        mean_e = sum([way[1] for way in went]) / count
        power = 0.0
        for north, east in went:
            power += (north - mean_n) ** 2 + (east - mean_e) ** 2
        by_trunks = sum(self._by_trunks) / count
        noise = (1.0 - by_trunks) * _moves_m2(self._errors, since_s) + by_trunks * _moves_m2(BY_TRUNKS, since_s)
        follow = min(1.0, since_s / POWER_S)
        self._power += follow * (power - self._power)
        self._noise += follow * (2.0 * (count - 1) * noise - self._noise)
        keep = math.sqrt(max(0.0, 1.0 - NOISE_SHARE * self._noise / self._power)) if self._power > 0.0 else 0.0
        return [(mean_n + keep * (north - mean_n), mean_e + keep * (east - mean_e)) for north, east in went]

    def _take_turn(self, turning: Row) -> None:
        """Moves to the turn of the formation what the positions' errors share of it."""
        cov, turn = self.cov, 2 * self.n
        square = dot(turning, turning, turn)
        if square == 0.0:
            return
        size = len(cov)
        share = [0.0] * size
        for i in range(turn):
            row, by = cov[i], turning[i] / square
            for j in range(size):
                share[j] += by * row[j]
        for i in range(turn):
            row, by = cov[i], turning[i]
            for j in range(size):
                row[j] -= by * share[j]
        row = cov[turn]
        for j in range(size):
            row[j] += share[j]
        for row in cov:
            by = dot(turning, row, turn) / square
            for j in range(turn):
                row[j] -= by * turning[j]
            row[turn] += by

    def correct(self) -> Row:
        """P <- P - P_d M P_d', M = (I + A P_dd)^-1 A; the change of the state, P_d (I + A P_dd)^-1 y.

        A and y: what was measured, of the first d states.
        """
        cov, info = self.cov, self._info
        d, size = len(info), len(cov)
        left = zeros(d, d)
        for i in range(d):
            row = info[i]
            for j in range(d):
                left[i][j] = dot(row, cov[j], d)
            left[i][i] += 1.0
            row.append(self._pull[i])
        solve(left, info)
        first = [row[:d] for row in cov]
        step = [info[i][d] for i in range(d)]
        for i in range(size):
            mine, row = first[i], cov[i]
            taken = [dot(mine, info[j], d) for j in range(d)]
            for j in range(i + 1):
                value = row[j] - dot(taken, first[j], d)
                row[j] = value
                cov[j][i] = value
        self.clear()
        return [dot(first[i], step, d) for i in range(size)]

    def variance_of(self, seen: Sequence[tuple[int, float]]) -> float:
        """h P h', of a measurement of any of the states: their indices and factors."""
        return sum([h * g * self.cov[k][j] for k, h in seen for j, g in seen])

    def correct_by(self, seen: Sequence[tuple[int, float]], off: float, variance: float) -> Row:
        """One such measurement, off what is thought by so much; the change of the state."""
        cov = self.cov
        column = [sum([h * row[k] for k, h in seen]) for row in cov]
        expected = variance + sum([h * column[k] for k, h in seen])
        for i, row in enumerate(cov):
            gain = column[i] / expected
            for j in range(i + 1):
                value = row[j] - gain * column[j]
                row[j] = value
                cov[j][i] = value
        return [one * off / expected for one in column]

    def add_process_noise(self, since_s: float) -> None:
        """White noise of all odometers. After the correction: ranges are older, by half an epoch and a beacon."""
        cov, n = self.cov, self.n
        walks = [e.velocity_mps**2 * e.velocity_s * since_s for e in [self._errors_of(slot) for slot in range(n + 1)]]
        for i in range(2 * n):
            row = cov[i]
            for j in range(i % 2, 2 * n, 2):
                row[j] += walks[n]
            row[i] += walks[i // 2]


def _moves_m2(errors: Errors, since_s: float) -> float:
    """Variance of the way, on an axis, m2, that an odometer tells of a vehicle that stands still."""
    white = errors.velocity_mps**2 * min(errors.velocity_s, since_s) * since_s
    return white + (errors.bias_mps * since_s) ** 2
