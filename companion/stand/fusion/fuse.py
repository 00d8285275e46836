"""Stems of a stand from all vehicles' observations: the same records, in whatever order, give the same stems."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from companion.stand.fusion.adjustment import Frames, Knots
from companion.stand.fusion.associate import associate_observations
from companion.stand.fusion.diameters import between_share, fuse_diameters
from companion.stand.fusion.windows import MAX_KNOTS, columns_of
from companion.stand.records import KeyedObservation, KeyedPoint, Session
from companion.survey.observation import Grade

MAX_OBSERVATIONS: Final = 100_000  # 5,000 stems, each measured 20 times
MAX_LOGS: Final = MAX_KNOTS // 2  # each has two knots at least


@dataclass(frozen=True, slots=True)
class FusedStem:
    """A stem. Position: the mission's frame, NED metres from its origin, its axis at the height of the cut."""

    stem_id: str  # of its earliest record: vehicle, log and number
    north_m: float
    east_m: float
    position_sd_m: float  # of each coordinate, with what is left of the frames' error
    dbh_m: float
    dbh_sd_m: float
    dbh_from: str  # "measured" at breast height, by "taper" from a cut elsewhere, or by "measured and taper"
    taper_sd_m: float  # the part of dbh_sd_m that taper adds
    cut_up_m: float  # above the ground
    diameter_m: float  # at the cut
    diameter_sd_m: float
    lean_rad: float | None
    grade: Grade  # the best of its observations
    reason: str  # why it is not GOOD
    is_counted: bool  # in the stand's figures: not POOR
    rays: int
    observed: tuple[int, ...]  # indices of its observations, as they were given
    vehicles: tuple[int, ...]  # that have seen it


@dataclass(frozen=True, slots=True)
class Fusion:
    """Stems by the time of their earliest record, and the frame errors of the logs."""

    stems: tuple[FusedStem, ...]
    frames: Frames
    logs: tuple[Session, ...]  # `frames` has them by index
    between: float  # standard deviation between observations of one diameter, over it


class TooManyError(Exception):
    """More observations than MAX_OBSERVATIONS, or of more logs than MAX_LOGS."""


def fuse(
    observations: Sequence[KeyedObservation], by_word: Collection[int] = (), track: Sequence[KeyedPoint] = ()
) -> Fusion:
    """`observations`: sorted by key, each once, as records.harvest_of gives them.

    `by_word`: vehicles without satellites, which know the mission's frame by others' word; `track`: of all, which tells
    of their odometry.
    """
    if len(observations) > MAX_OBSERVATIONS:
        raise TooManyError(f"{len(observations)} observations of stems: must be at most {MAX_OBSERVATIONS}")
    if not observations:
        none = np.zeros(0)
        frames = Frames(Knots(np.zeros(0, dtype=np.int64), none, none, none, 1.0), np.zeros((0, 2)), ())
        return Fusion((), frames, (), 0.0)
    columns = columns_of(observations, by_word, track)
    if len(columns.logs) > MAX_LOGS:
        raise TooManyError(f"{len(columns.logs)} logs and restarts of their clocks: must be at most {MAX_LOGS}")
    stem, count, solution = associate_observations(columns)
    members: list[list[int]] = [[] for _ in range(count)]
    for i, k in enumerate(stem.tolist()):
        members[k].append(i)
    between = between_share([[observations[i].observation for i in own] for own in members])
    found = []
    for k, own in enumerate(members):
        order, fused = _fused(observations, own, between, solution.stem_m[k].tolist(), float(solution.stem_sd_m[k]))
        found.append((order, fused.stem_id, fused))
    return Fusion(tuple(fused for *_, fused in sorted(found)), solution.frames, columns.logs, between)


def _fused(
    observations: Sequence[KeyedObservation], own: list[int], between: float, pos_m: list[float], sd_m: float
) -> tuple[tuple[int, float], FusedStem]:
    """A stem of the observations `own`, and when the first of them was made: after how many restarts, and then."""
    told = [observations[i].observation for i in own]
    first = min(own, key=lambda i: (_since(observations[i]), observations[i].key))
    vehicle_id, log_id, number = observations[first].key
    diameter = fuse_diameters(told, between)
    best = min(told, key=lambda o: (o.grade, o.dbh_sd_m))
    leans = [o.lean_rad for o in told if o.lean_rad is not None]
    stem = FusedStem(
        stem_id=f"{vehicle_id}-{log_id:08x}-{number}",
        north_m=pos_m[0],
        east_m=pos_m[1],
        position_sd_m=sd_m,
        **diameter._asdict(),
        lean_rad=float(np.median(leans)) if leans else None,
        grade=best.grade,
        reason="" if best.grade is Grade.GOOD else best.reason,
        is_counted=best.grade is not Grade.POOR,
        rays=sum(o.rays for o in told),
        observed=tuple(own),
        vehicles=tuple(sorted({o.vehicle_id for o in told})),
    )
    return _since(observations[first]), stem


def _since(seen: KeyedObservation) -> tuple[int, float]:
    """Order in time, as far as clocks tell it: a second flight's starts at 0 again, and is later all the same."""
    return seen.session[2], seen.observation.first_s
