"""Odometry of vehicles without satellites, under what they recorded.

A vehicle adds to its odometry what it knows of the mission's frame at that time, and its track tells what. Without
satellites it knows that by another's word, which wanders and lags, and its odometry goes by a compass: one turn of its
whole frame is most of its error, 1.6 degrees are 2.5 m over 90 m, and what is left is 0.15 m. So the added is taken
off, and one turn and one shift of the whole way are put in its place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.stand.records import KeyedPoint, Session

Floats = npt.NDArray[np.float64]

STEADY_S: Final = 300.0  # of the mean of what turn and shift leave: odometry drifts
MEMORY_S: Final = 60.0  # of the word's error: what is added within it says the same
WORD_SD_M: Final = 1.0  # of that
TURN_SD_RAD: Final = np.radians(4.0)  # of a compass
LEAST_POINTS: Final = 3
ASTRAY_M: Final = 30.0  # what changes by more is no vehicle's: it is not gone by


@dataclass(frozen=True, slots=True)
class OdometryFrame:
    """One log's odometry in the mission's frame: turned about its origin by turn_rad, clockwise, and shifted."""

    time_s: Floats  # of k points of its track
    added_m: Floats  # k x 2, north and east: what was added to the odometry there
    turn_rad: float
    shift_m: Floats  # k x 2

    def place(self, recorded_m: Floats, first_s: Floats, last_s: Floats) -> Floats:
        """Of n places recorded from first_s to last_s, where they are in the mission's frame; n x 2."""
        added_m = (self._at(self.added_m, first_s) + self._at(self.added_m, last_s)) / 2.0
        return turned(recorded_m - added_m, self.turn_rad) + self._at(self.shift_m, (first_s + last_s) / 2.0)

    def turned(self, turn_rad: float, pivot_m: Floats) -> OdometryFrame:
        """The same, all of it turned about a place."""
        shift_m = turned(self.shift_m - pivot_m, turn_rad) + pivot_m
        return replace(self, turn_rad=self.turn_rad + turn_rad, shift_m=shift_m)

    def _at(self, values_m: Floats, times_s: Floats) -> Floats:
        return np.column_stack([np.interp(times_s, self.time_s, values_m[:, axis]) for axis in (0, 1)])


def odometry_of(track: Sequence[KeyedPoint]) -> Mapping[Session, OdometryFrame]:
    """Of each log whose track tells it."""
    told: dict[Session, dict[float, tuple[float, float, float, float]]] = {}
    for p in track:
        if p.point.shift_ne_m is not None:
            told.setdefault(p.session, {})[p.point.at_s] = (p.point.north_m, p.point.east_m, *p.point.shift_ne_m)
    found = {}
    for session, points in told.items():
        time_s = np.asarray(sorted(points))
        rows = np.asarray([points[at_s] for at_s in time_s.tolist()])
        added_m = rows[:, 2:]
        if len(rows) >= LEAST_POINTS and np.ptp(added_m, axis=0).max() <= ASTRAY_M:
            found[session] = _fit_frame(time_s, rows[:, :2] - added_m, added_m)
    return found


def turned(places_m: Floats, turn_rad: float) -> Floats:
    """North, east, clockwise about the origin."""
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    return np.column_stack((cos * places_m[:, 0] - sin * places_m[:, 1], sin * places_m[:, 0] + cos * places_m[:, 1]))


def fit_turn(from_m: Floats, to_m: Floats, weight: Floats, prior: float) -> float:
    """The turn of places that brings them to others, whatever the shift; `prior`: weight of no turn, m2."""
    a = from_m - weight @ from_m / weight.sum()
    b = to_m - weight @ to_m / weight.sum()
    across = float(weight @ (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    return float(np.arctan2(across, float(weight @ np.sum(a * b, axis=1)) + prior))


def _fit_frame(time_s: Floats, odometry_m: Floats, added_m: Floats) -> OdometryFrame:
    told_m = odometry_m + added_m
    each_s = float(np.median(np.diff(time_s)))
    weight = np.full(len(time_s), min(1.0, each_s / MEMORY_S) / WORD_SD_M**2)
    turn_rad = fit_turn(odometry_m, told_m, weight, 1.0 / float(TURN_SD_RAD) ** 2)
    left_m = told_m - turned(odometry_m, turn_rad)
    return OdometryFrame(time_s, added_m, turn_rad, _running_mean(time_s, left_m))


def _running_mean(time_s: Floats, values: Floats) -> Floats:
    """Over STEADY_S, or as much of it as there is."""
    first = np.searchsorted(time_s, time_s - STEADY_S / 2.0, side="left")
    last = np.searchsorted(time_s, time_s + STEADY_S / 2.0, side="right")
    total = np.vstack((np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)))
    mean: Floats = (total[last] - total[first]) / (last - first)[:, None]
    return mean
