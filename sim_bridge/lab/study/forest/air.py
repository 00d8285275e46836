"""The air between the vehicles of one flight: trunks in the way, three models of what they do, loss and delay."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sim_bridge.lab.study.law import Bools, Floats
from sim_bridge.trunk_attenuation import ANTENNA_UP_M

MODELS = ("disc", "attenuated", "cut")


class Sent(NamedTuple):
    """A message under way to the receivers that will hear it."""

    due_tick: int
    sender: int
    receivers: list[int]
    message: Any


class Air:
    """`send` and `deliver`, in ticks. Draws from `rng` alone, in the order of calls."""

    def __init__(self, model: str, trunk_db: float, loss: float, delay_ticks: int, rng: np.random.Generator) -> None:
        self._model, self._trunk_db = model, trunk_db
        self._loss, self._delay_ticks, self._rng = loss, delay_ticks, rng
        self._under_way: list[Sent] = []

    def links(self, model: str, distance_m: Floats, trunks: Floats, range_m: Floats) -> Bools:
        """(n, n) whether two vehicles hear each other; `range_m`: (n,) of each radio in the open."""
        reach_m = np.minimum(range_m[:, None], range_m)
        if model == "attenuated":
            # As trunk_attenuation
            reach_m = reach_m * 10.0 ** (-trunks * self._trunk_db / 20.0)
        elif model == "cut":
            reach_m = np.where(trunks > 0, 0.0, reach_m)
        return np.asarray(distance_m <= reach_m)

    def send(self, messages: dict[int, Any], distance_m: Floats, trunks: Floats, range_m: Floats, tick: int) -> None:
        """Broadcast, by sender."""
        linked = self.links(self._model, distance_m, trunks, range_m)
        for sender, message in messages.items():
            kept = self._rng.random(len(linked)) >= self._loss  # one draw for each, in range or not
            hear = linked[:, sender] & kept
            hear[sender] = False
            self._under_way.append(Sent(tick + self._delay_ticks, sender, np.flatnonzero(hear).tolist(), message))

    def deliver(self, tick: int) -> list[Sent]:
        """Messages that have arrived by now, in the order of sending."""
        due = [sent for sent in self._under_way if sent.due_tick <= tick]
        self._under_way = [sent for sent in self._under_way if sent.due_tick > tick]
        return due


def trunks_between(pos_enu_m: Floats, trunks_enu_m: Floats) -> Floats:
    """(n, n) how many trunks the straight line between two vehicles crosses."""
    n = len(pos_enu_m)
    counts = np.zeros((n, n))
    low, high = pos_enu_m[:, :2].min(axis=0), pos_enu_m[:, :2].max(axis=0)
    axes_enu_m, radius = trunks_enu_m[:, :2], trunks_enu_m[:, 2]
    near = ((axes_enu_m >= low - radius[:, None]) & (axes_enu_m <= high + radius[:, None])).all(axis=1)
    if n < 2 or not near.any():
        return counts
    trunks = trunks_enu_m[near]
    i, j = np.triu_indices(n, 1)
    a, way = pos_enu_m[i], pos_enu_m[j] - pos_enu_m[i]
    level2 = np.maximum((way[:, :2] * way[:, :2]).sum(axis=1), 1e-12)
    east, north = (trunks[:, k] - a[:, k, None] for k in (0, 1))
    share = np.clip((east * way[:, 0, None] + north * way[:, 1, None]) / level2[:, None], 0.0, 1.0)
    off_e, off_n = east - share * way[:, 0, None], north - share * way[:, 1, None]
    up_m = ANTENNA_UP_M + a[:, 2, None] + share * way[:, 2, None]
    crossed = (off_e * off_e + off_n * off_n < trunks[:, 2] ** 2) & (up_m < trunks[:, 3])
    counts[i, j] = counts[j, i] = crossed.sum(axis=1)
    return counts
