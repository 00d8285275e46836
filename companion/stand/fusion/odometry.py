"""The vehicles' odometry under what they recorded: it drifts slowly, and what they know of the mission's frame wanders.

A vehicle adds to its odometry what it knows of the mission's frame at that time: by satellites or by another's word,
which wander within a minute, and lag. Its track tells what was added. Taken off again, and their mean over a longer
time added instead, what it saw stays together as its odometry had it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.stand.records import KeyedPoint, Session

Floats = npt.NDArray[np.float64]

STEADY_S: Final = 300.0  # of the mean: satellites are right in the mean of so long, and odometry drifts by a metre
LEAST_POINTS: Final = 3
ASTRAY_M: Final = 30.0  # what changes by more is no vehicle's: it is not gone by


@dataclass(frozen=True, slots=True)
class FrameShift:
    """Mission's frame less one log's odometry, at k times: as it was added to what was seen, and steadied."""

    time_s: Floats
    told_m: Floats  # k x 2: north, east
    steady_m: Floats

    def excess_m(self, first_s: Floats, last_s: Floats) -> Floats:
        """What was added too much to what was seen from `first_s` to `last_s`, n x 2: the mean of both ends."""
        added = (self._at(self.told_m, first_s) + self._at(self.told_m, last_s)) / 2.0
        return added - self._at(self.steady_m, (first_s + last_s) / 2.0)

    def _at(self, values_m: Floats, times_s: Floats) -> Floats:
        return np.column_stack([np.interp(times_s, self.time_s, values_m[:, axis]) for axis in (0, 1)])


def shifts_of(track: Sequence[KeyedPoint]) -> Mapping[Session, FrameShift]:
    """Of each log whose track tells it."""
    told: dict[Session, dict[float, tuple[float, float]]] = {}
    for p in track:
        if p.point.shift_ne_m is not None:
            told.setdefault(p.session, {})[p.point.at_s] = p.point.shift_ne_m
    found = {}
    for session, points in told.items():
        if len(points) >= LEAST_POINTS:
            time_s = np.asarray(sorted(points))
            told_m = np.asarray([points[at_s] for at_s in time_s.tolist()])
            if np.ptp(told_m, axis=0).max() <= ASTRAY_M:
                found[session] = FrameShift(time_s, told_m, _running_mean(time_s, told_m))
    return found


def _running_mean(time_s: Floats, values: Floats) -> Floats:
    """Over STEADY_S, or as much of it as there is."""
    first = np.searchsorted(time_s, time_s - STEADY_S / 2.0, side="left")
    last = np.searchsorted(time_s, time_s + STEADY_S / 2.0, side="right")
    total = np.vstack((np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)))
    mean: Floats = (total[last] - total[first]) / (last - first)[:, None]
    return mean
