"""Observations as arrays, cut into windows: what one log saw within one interval of its clock.

A log here is one session of a log of records: a clock that started anew tells no times of one pass.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.stand.fusion.odometry import OdometryFrame, odometry_of
from companion.stand.records import KeyedObservation, KeyedPoint, Session

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

WINDOW_S: Final = 20.0  # a vehicle under way sees a constellation of ten stems and more
KNOT_S: Final = 10.0  # between knots of the frame errors, which wander within CORRELATION_S
CORRELATION_S: Final = 60.0  # multipath under a canopy and drift between corrections: a minute or so
MAX_KNOTS: Final = 3_000  # one dense matrix of 72 MB; 12 vehicles for 40 minutes
POSITION_SD_MIN_M: Final = 0.02  # less is believed of no fit: bark, and the ground's wobble of the vehicle
FRAME_SD_MIN_M: Final = 0.01
DIAMETER_SD_MIN_M: Final = 0.002
# A vehicle without satellites knows the mission's frame by the word of one that has them, and lags behind. Its error is
# that of all such, and nothing that is known besides: by so much more it may err, where another tells the frame.
BY_WORD: Final = 4.0
# Of odometry that trunks correct, once its frame is turned and shifted: 0.1 m within KNOT_S
DRIFT_M: Final = 0.3
DRIFT_S: Final = 200.0


@dataclass(frozen=True, slots=True)
class Columns:
    """n observations, in the order of their records' keys. Positions: north, east."""

    log: Ints  # index in `logs`
    first_s: Floats
    last_s: Floats
    time_s: Floats  # the middle
    pos_m: Floats  # n x 2
    position_sd_m: Floats  # relative to the frame at the knots: with its wandering between them
    frame_sd_m: Floats
    constant_sd_m: Floats  # of a log's frame error: the part that is there from the start on, before it is known,
    wander_sd_m: Floats  # and the one that wanders
    correlation_s: Floats  # within so long; of each log
    dbh_m: Floats
    dbh_sd_m: Floats
    logs: tuple[Session, ...]
    odometry: tuple[OdometryFrame | None, ...]  # of logs without satellites, where their track tells it: positions are
    recorded_m: Floats  # n x 2: positions as they were recorded

    @property
    def n(self) -> int:
        """Number of observations."""
        return len(self.log)

    def turned(self, log: int, turn_rad: float, pivot_m: Floats) -> Columns:
        """The same, one log's odometry turned about a place."""
        frame = self.odometry[log]
        if frame is None:
            return self
        own, pos_m = self.log == log, self.pos_m.copy()
        frame = frame.turned(turn_rad, pivot_m)
        pos_m[own] = frame.place(self.recorded_m[own], self.first_s[own], self.last_s[own])
        return replace(self, pos_m=pos_m, odometry=(*self.odometry[:log], frame, *self.odometry[log + 1 :]))


def columns_of(
    observations: Sequence[KeyedObservation], by_word: Collection[int] = (), track: Sequence[KeyedPoint] = ()
) -> Columns:
    """`observations` as they are sorted. `by_word`: vehicles without satellites; `track`: tells of odometry."""
    logs = tuple(sorted({o.session for o in observations}))
    index = {log: k for k, log in enumerate(logs)}
    told = [o.observation for o in observations]

    def column(values: Sequence[float] | Sequence[tuple[float, float]]) -> Floats:
        return np.asarray(values, dtype=np.float64)

    first_s, last_s = column([o.first_s for o in told]), column([o.last_s for o in told])
    frame_sd_m = np.maximum(column([o.frame_sd_m for o in told]), FRAME_SD_MIN_M)
    log = np.asarray([index[o.session] for o in observations], dtype=np.int64)
    recorded_m = column([(o.north_m, o.east_m) for o in told]).reshape(-1, 2)
    known, pos_m = odometry_of([p for p in track if p.point.vehicle_id in by_word]), recorded_m.copy()
    odometry = tuple(known.get(session) for session in logs)
    for k, frame in enumerate(odometry):
        if frame is not None:
            own = log == k
            pos_m[own] = frame.place(recorded_m[own], first_s[own], last_s[own])
    by_odometry = np.asarray([frame is not None for frame in odometry])
    half_m = frame_sd_m * np.sqrt(0.5) * np.where(np.isin([o.vehicle_id for o in told], list(by_word)), BY_WORD, 1.0)
    correlation_s = np.where(by_odometry, DRIFT_S, CORRELATION_S)
    own_wander_m = np.where(by_odometry[log], DRIFT_M, frame_sd_m * np.sqrt(0.5))
    # Of a Brownian bridge, its mean over the time between knots
    between_m = own_wander_m * np.sqrt(KNOT_S / (3.0 * correlation_s[log]))
    return Columns(
        log=log,
        first_s=first_s,
        last_s=last_s,
        time_s=(first_s + last_s) / 2.0,
        pos_m=pos_m,
        position_sd_m=np.hypot(np.maximum(column([o.position_sd_m for o in told]), POSITION_SD_MIN_M), between_m),
        frame_sd_m=frame_sd_m,
        constant_sd_m=half_m,
        wander_sd_m=np.where(by_odometry[log], DRIFT_M, half_m),
        correlation_s=correlation_s,
        dbh_m=column([o.dbh_m for o in told]),
        dbh_sd_m=np.maximum(column([o.dbh_sd_m for o in told]), DIAMETER_SD_MIN_M),
        logs=logs,
        odometry=odometry,
        recorded_m=recorded_m,
    )


def knot_spacing_s(columns: Columns) -> float:
    """KNOT_S, or so many times as much that there are at most MAX_KNOTS."""
    spacing_s = KNOT_S
    while len(_cells(columns, spacing_s)) > MAX_KNOTS // 2:  # each cell has two ends
        spacing_s *= 2.0
    return spacing_s


def windows_of(columns: Columns) -> list[Ints]:
    """Indices of the observations of each window, by time and log."""
    cell = np.floor(columns.time_s / WINDOW_S).astype(np.int64)
    order = np.lexsort((np.arange(columns.n), columns.log, cell))
    changes = np.flatnonzero((np.diff(cell[order]) != 0) | (np.diff(columns.log[order]) != 0)) + 1
    return [np.asarray(part, dtype=np.int64) for part in np.split(order, changes) if len(part)]


def _cells(columns: Columns, spacing_s: float) -> Floats:
    """Intervals with observations in them."""
    pairs = np.column_stack((columns.log, np.floor(columns.time_s / spacing_s)))
    return np.unique(pairs, axis=0)
