"""The bound: all measurements of a flight solved at once, by Gauss-Newton on the chain of knots (a factor graph's MAP).

It begins at the truth, so it finds the best solution there is, and takes the same weights for late ranges as the
estimator. Unknown at each knot, for every vehicle: by how much its odometer is off (north, east), its bias, its
compass's error. One forward elimination about the solution gives what was to be known at each knot from what had come
by then (`causal`), the whole chain what was to be known afterwards (`smoothed`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from companion.core.agent import TICK_S
from companion.core.localisation.gnss_denied.error_state import Errors
from companion.core.localisation.integrity.innovation_gate import HARD, SOFT
from sim_bridge.lab.study.law import Floats
from sim_bridge.lab.study.localise.paths import Paths
from sim_bridge.lab.study.localise.sensors import Measured

KNOT_TICKS = 10
ROUNDS = 5
ROBUST_FROM = 1  # round


class Bound(NamedTuple):
    """Root of the mean square of the level error of relative positions, over neighbours and knots."""

    causal_m: float
    smoothed_m: float


def solve(paths: Paths, measured: Measured, errors: Errors, observer: int, start_m: float) -> Bound:
    """By what the vehicle in row `observer` has heard; north as the others' compasses have it, as the estimator's."""
    chain = _Chain(paths, measured, errors, observer, start_m)
    causal = np.zeros(0)
    for k in range(ROUNDS):
        causal = chain.round(robust=k >= ROBUST_FROM)
    return Bound(chain.error_m(causal), chain.error_m(chain.x))


class _Chain:
    """`x`: (K, 5n): odometers' errors (n, 2), biases (n, 2), compasses (n)."""

    def __init__(self, paths: Paths, measured: Measured, errors: Errors, observer: int, start_m: float) -> None:
        ticks, n, _ = paths.pos_ne_m.shape
        self.n, self.observer, self.errors, self.start_m = n, observer, errors, start_m
        self.at = np.arange(0, ticks, KNOT_TICKS)
        self.base_m = measured.starts_ne_m + measured.odo_ne_m  # (T, n, 2)
        self.steps_m = np.diff(measured.odo_ne_m[self.at], axis=0)  # (K - 1, n, 2)
        self.true_m = paths.pos_ne_m - self.base_m
        self.x = np.zeros((len(self.at), 5 * n))
        self.x[:, : 2 * n] = self.true_m[self.at].reshape(len(self.at), -1)
        self.x[:, 4 * n :] = measured.yaw_rad[self.at]
        last = int(self.at[-1])
        known = [
            one for per_tick in measured.ranges for one in per_tick if observer in (one.a, one.b) and one.tick < last
        ] + [
            one
            for per_tick in measured.broadcasts
            for beacon in per_tick
            if beacon.sender != observer and beacon.heard[observer]
            for one in beacon.ranges
            if observer not in (one.a, one.b) and one.tick < last
        ]
        self.ticks = np.array([one.tick for one in known])
        self.a, self.b = np.array([one.a for one in known]), np.array([one.b for one in known])
        self.metres = np.array([one.metres for one in known])

    def error_m(self, x: Floats) -> float:
        """Of relative positions."""
        off = x[:, : 2 * self.n].reshape(len(x), self.n, 2) - self.true_m[self.at]
        off = np.delete(off - off[:, [self.observer]], self.observer, axis=1)
        return float(np.sqrt((off * off).sum(axis=-1).mean()))

    def round(self, *, robust: bool) -> Floats:
        """One Gauss-Newton step of `x`; what was to be known at each knot by then."""
        ends, begins, across, pull_end, pull_begin = self._odometry()
        self._ranges(ends, begins, across, pull_end, pull_begin, robust=robust)
        knots, size = self.x.shape
        causal = np.zeros_like(self.x)
        gains, means = np.zeros((knots, size, size)), np.zeros_like(self.x)
        past, pull = ends[0], pull_end[0]
        for k in range(knots):
            causal[k] = self.x[k] + np.linalg.solve(past, pull)
            if k + 1 == knots:
                means[k] = causal[k] - self.x[k]
                break
            whole, pulls = past + begins[k], pull + pull_begin[k]
            solved = np.linalg.solve(whole, np.column_stack([across[k], pulls]))
            gains[k], means[k] = solved[:, :-1], solved[:, -1]
            past = ends[k + 1] - across[k].T @ gains[k]
            pull = pull_end[k + 1] - across[k].T @ means[k]
        change = means.copy()
        for k in range(knots - 2, -1, -1):
            change[k] -= gains[k] @ change[k + 1]
        self.x = self.x + change
        return causal

    def _odometry(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Information on each knot from before and after it, across each step, and the pulls."""
        n, errors = self.n, self.errors
        knots, size = self.x.shape
        since_s = KNOT_TICKS * TICK_S
        keep_b, keep_y = math.exp(-since_s / errors.bias_s), math.exp(-since_s / errors.yaw_s)
        sd = np.concatenate([np.full(2 * n, self.start_m), np.full(2 * n, errors.bias_mps), np.full(n, errors.yaw_rad)])
        walk = errors.velocity_mps**2 * errors.velocity_s * since_s
        new = np.concatenate(
            [
                np.full(2 * n, walk),
                np.full(2 * n, errors.bias_mps**2 * (1.0 - keep_b**2)),
                np.full(n, errors.yaw_rad**2 * (1.0 - keep_y**2)),
            ]
        )
        ends, begins = np.zeros((knots, size, size)), np.zeros((knots, size, size))
        across = np.zeros((knots - 1, size, size))
        pull_end, pull_begin = np.zeros((knots, size)), np.zeros((knots, size))
        ends[0] = np.diag(1.0 / sd**2)
        pull_end[0] = -self.x[0] / sd**2
        yaw = self.x[:-1, 4 * n :]
        c, s = np.cos(yaw), np.sin(yaw)
        moved = self.steps_m - self.x[:-1, 2 * n : 4 * n].reshape(-1, n, 2) * since_s
        went_n, went_e = c * moved[..., 0] - s * moved[..., 1], s * moved[..., 0] + c * moved[..., 1]
        step = np.stack([went_n, went_e], axis=-1) - self.steps_m  # of an odometer's error
        flow = np.zeros((knots - 1, size, size))  # of the next knot by this one
        flow[:, np.arange(size), np.arange(size)] = np.concatenate(
            [np.ones(2 * n), np.full(2 * n, keep_b), np.full(n, keep_y)]
        )
        rows = np.arange(n)
        flow[:, 2 * rows, 2 * n + 2 * rows] = -since_s * c
        flow[:, 2 * rows, 2 * n + 2 * rows + 1] = since_s * s
        flow[:, 2 * rows + 1, 2 * n + 2 * rows] = -since_s * s
        flow[:, 2 * rows + 1, 2 * n + 2 * rows + 1] = -since_s * c
        flow[:, 2 * rows, 4 * n + rows] = -went_e
        flow[:, 2 * rows + 1, 4 * n + rows] = went_n
        expected = np.concatenate(
            [
                self.x[:-1, : 2 * n] + step.reshape(-1, 2 * n),
                keep_b * self.x[:-1, 2 * n : 4 * n],
                keep_y * self.x[:-1, 4 * n :],
            ],
            axis=1,
        )
        off = (self.x[1:] - expected) / new
        weighted = flow / new[:, None]
        ends[1:] += np.diag(1.0 / new)
        begins[:-1] += np.swapaxes(flow, 1, 2) @ weighted
        across += -np.swapaxes(weighted, 1, 2)
        pull_end[1:] -= off
        pull_begin[:-1] += np.einsum("kij,ki->kj", flow, off)
        return ends, begins, across, pull_end, pull_begin

    def _ranges(
        self, ends: Floats, begins: Floats, across: Floats, pull_end: Floats, pull_begin: Floats, *, robust: bool
    ) -> None:
        """Each between two knots, in between by odometry."""
        n = self.n
        k = self.ticks // KNOT_TICKS
        late = (self.ticks - k * KNOT_TICKS) / KNOT_TICKS
        odo = self.x[:, : 2 * n].reshape(len(self.x), n, 2)
        off = (1.0 - late)[:, None, None] * odo[k] + late[:, None, None] * odo[k + 1]
        rows = np.arange(len(k))
        positions = self.base_m[self.ticks] + off
        apart = positions[rows, self.b] - positions[rows, self.a]
        metres = np.hypot(apart[:, 0], apart[:, 1])
        u = apart / metres[:, None]
        miss = self.metres - metres
        weight = np.full(len(k), 1.0 / self.errors.range_m**2)
        if robust:
            ratio = np.abs(miss) / self.errors.range_m
            soft = np.minimum(1.0, SOFT / np.maximum(ratio, 1e-9)) ** 2
            weight *= np.where(ratio > HARD, 0.0, np.where(miss > 0.0, soft**2, soft))
        where = np.stack([2 * self.a, 2 * self.a + 1, 2 * self.b, 2 * self.b + 1], axis=1)
        slope = np.concatenate([-u, u], axis=1)
        square = weight[:, None, None] * slope[:, :, None] * slope[:, None, :]
        pull = (weight * miss)[:, None] * slope
        at = (k[:, None, None], where[:, :, None], where[:, None, :])
        begin, end = (1.0 - late)[:, None, None], late[:, None, None]
        np.add.at(begins, at, begin * begin * square)
        np.add.at(across, at, begin * end * square)
        np.add.at(ends, (k[:, None, None] + 1, *at[1:]), end * end * square)
        np.add.at(pull_begin, (k[:, None], where), begin[..., 0] * pull)
        np.add.at(pull_end, (k[:, None] + 1, where), end[..., 0] * pull)
