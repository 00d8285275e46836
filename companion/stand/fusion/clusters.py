"""Clusters of observations under way to be stems: their members, and sums of position and diameter."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from companion.stand.fusion.register import KnownStems
from companion.stand.fusion.windows import Columns, Floats, Ints

DENSITY_PER_M2: Final = 0.03  # of stems that stand near another one: 300/ha, fewer than at random in a dense stand
DBH_SPREAD_M: Final = 0.1  # of a stand's diameters: how much a fitting one tells
OUTLIERS: Final = 0.1  # share of diameters that are wrong by more than their error says
MODEL_SD_M: Final = 0.05  # of a stem's axis between passes: lean and taper, cut at another height and side
DBH_MODEL_SD_M: Final = 0.01  # of a diameter from another side: no trunk is round
REACH_MAX_M: Final = 3.0  # of a position after adjustment; what is more uncertain finds only nearer partners
GATE_SDS: Final = 3.7  # of a position in a plane: 0.1 % are beyond
OVERLAP: Final = 0.45  # axes nearer than this share of both diameters' sum: trunks would stand in each other
IMPOSSIBLE: Final = 1e6


class Clusters:
    """Of n observations; a cluster's number is never given twice."""

    def __init__(self, columns: Columns) -> None:
        self._columns = columns
        self._label = np.full(columns.n, -1, dtype=np.int64)  # cluster of each observation; -1: none yet
        self._members: list[list[int]] = []
        self._sums: list[list[float]] = []  # of each cluster: weight, north, east; weight, diameter
        self.pos_m = columns.pos_m.copy()
        self.sd_m = columns.position_sd_m.copy()
        self.dbh_sd_m = np.hypot(columns.dbh_sd_m, DBH_MODEL_SD_M)

    def place(self, pos_m: Floats, sd_m: Floats) -> None:
        """All observations lie there, with these errors."""
        self.pos_m, self.sd_m = pos_m, np.hypot(sd_m, MODEL_SD_M)
        self._sums = [self._summed(members) for members in self._members]

    def numbered(self) -> tuple[Ints, int]:
        """Clusters by their first observation, and how many there are."""
        _, first, inverse = np.unique(self._label, return_index=True, return_inverse=True)
        rank = np.argsort(np.argsort(first))
        return rank[inverse.ravel()].astype(np.int64), len(first)

    def known(self) -> KnownStems:
        """All that have members now."""
        alive = [c for c, members in enumerate(self._members) if members]
        sums = np.asarray([self._sums[c] for c in alive]).reshape(-1, 5)
        pos_m = sums[:, 1:3] / sums[:, :1]
        dbh_sd_m, sd_m = 1.0 / np.sqrt(sums[:, 3]), 1.0 / np.sqrt(sums[:, 0])
        return KnownStems(pos_m, sd_m, sums[:, 4] / sums[:, 3], dbh_sd_m, np.asarray(alive, dtype=np.int64))

    def remove(self, window: Ints) -> None:
        """Observations of `window` from their clusters."""
        for k in window.tolist():
            cluster = int(self._label[k])
            self._members[cluster].remove(k)
            self._sums[cluster] = self._summed(self._members[cluster])
            self._label[k] = -1

    def assign(self, window: Ints, known: KnownStems) -> None:
        """Each observation of `window` to one of the clusters that are `known`, as they are by now, or to a new one."""
        reach_m = min(REACH_MAX_M, GATE_SDS * math.hypot(self.sd_m[window].max(), known.sd_m.max(initial=0.0)))
        own, other = known.pairs(self.pos_m[window], reach_m)
        used, column = np.unique(known.number[other], return_inverse=True)
        cost = np.full((len(window), len(used) + len(window)), IMPOSSIBLE)
        cost[:, len(used) :] = 0.0  # a stem of its own
        for k, c in zip(own.tolist(), column.ravel().tolist(), strict=True):
            i, cluster = int(window[k]), int(used[c])
            if self._members[cluster] and not self._is_distinct(i, self._members[cluster]):
                cost[k, c] = _cost(self._summed([i]), self._sums[cluster])
        for k, c in np.column_stack(linear_sum_assignment(cost)).tolist():
            is_known = c < len(used) and cost[k, c] < 0.0
            self._put(int(window[k]), int(used[c]) if is_known else self._add_cluster())

    def merge(self) -> None:
        """Pairs of clusters that are one stem, the likeliest first; a third waits for the next time."""
        known = self.known()
        reach_m = min(REACH_MAX_M, GATE_SDS * math.sqrt(2.0) * float(known.sd_m.max(initial=0.0)))
        reach_m = max(reach_m, 2.0 * OVERLAP * float(known.dbh_m.max(initial=0.0)))
        pairs = []
        for a, b in cKDTree(known.pos_m).query_pairs(reach_m):
            first, second = sorted((int(known.number[a]), int(known.number[b])))
            cost = _cost(self._sums[first], self._sums[second])
            is_inside = math.dist(known.pos_m[a], known.pos_m[b]) < OVERLAP * (known.dbh_m[a] + known.dbh_m[b])
            if cost < 0.0 or is_inside:
                pairs.append((cost, first, second))
        gone: set[int] = set()
        for _, a, b in sorted(pairs):
            members = self._members[b]
            if a not in gone and b not in gone and not any(self._is_distinct(i, self._members[a]) for i in members):
                for i in list(members):
                    self._put(i, a)
                self._members[b] = []
                gone |= {a, b}

    def _summed(self, members: list[int]) -> list[float]:
        """Sums of a cluster of these, by inverse variance."""
        total = [0.0] * 5
        for i in members:
            w, v = 1.0 / self.sd_m[i] ** 2, 1.0 / self.dbh_sd_m[i] ** 2
            parts = (w, w * self.pos_m[i, 0], w * self.pos_m[i, 1], v, v * self._columns.dbh_m[i])
            total = [a + float(b) for a, b in zip(total, parts, strict=True)]
        return total

    def _is_distinct(self, i: int, members: list[int]) -> bool:
        """True if a member is another stem for sure: the same log saw both at one time."""
        c = self._columns
        return any(
            c.log[k] == c.log[i] and c.first_s[k] <= c.last_s[i] and c.first_s[i] <= c.last_s[k] for k in members
        )

    def _add_cluster(self) -> int:
        self._members.append([])
        self._sums.append([0.0] * 5)
        return len(self._members) - 1

    def _put(self, i: int, cluster: int) -> None:
        self._members[cluster].append(i)
        self._sums[cluster] = self._summed(self._members[cluster])
        self._label[i] = cluster


def _cost(one: list[float], other: list[float]) -> float:
    """Minus the log of the Bayes factor of one stem against two, or IMPOSSIBLE beyond the gate."""
    apart_m = math.hypot(one[1] / one[0] - other[1] / other[0], one[2] / one[0] - other[2] / other[0])
    variance_m2 = 1.0 / one[0] + 1.0 / other[0]
    if apart_m > GATE_SDS * math.sqrt(variance_m2):
        return IMPOSSIBLE
    misfit_m, misfit_m2 = one[4] / one[3] - other[4] / other[3], 1.0 / one[3] + 1.0 / other[3]
    fit = math.exp(-0.5 * misfit_m**2 / misfit_m2) * DBH_SPREAD_M / math.sqrt(2.0 * math.pi * misfit_m2)
    position = 0.5 * apart_m**2 / variance_m2 + math.log(2.0 * math.pi * variance_m2 * DENSITY_PER_M2)
    return position - math.log((1.0 - OUTLIERS) * fit + OUTLIERS)
