"""Returns of all vehicles in the frame of the fused stems.

A vehicle has its returns where it thought that it was. The fusion of stems found by how much that was off, at each
observation: so much is taken off the returns that the observation was fitted to. An observation is known again by its
record's body, which is kept with the returns. Returns without a record (too thin a stem, or a record that never came)
go by the frame error of their vehicle at that time, as far as the same file tells which flight it was.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from companion.cloud.returns import OF_STEM, StemReturns
from companion.stand.fusion.fuse import Fusion
from companion.stand.records import KeyedObservation, Session
from companion.survey.observation import StemObservation, decode

Floats = NDArray[np.float64]
NO_TREE: Final = 0


@dataclass(frozen=True, slots=True)
class StandCloud:
    """n points. The mission's frame, metres from its origin, less the vehicles' frame errors."""

    east_m: Floats
    north_m: Floats
    up_m: Floats  # above the origin's ground, by the vehicle's height
    above_ground_m: Floats  # above the ground at the stem, by rays; NaN: they did not see it
    at_s: Floats  # of the vehicle's clock
    vehicle: NDArray[np.uint16]
    ring: NDArray[np.uint8]  # layer of the lidar
    of_stem: NDArray[np.bool_]  # the fit counts it as of the stem
    tree: NDArray[np.uint32]  # from 1 on, as the stem map has its stems; 0: of none in the map

    @property
    def n(self) -> int:
        """Number of points."""
        return len(self.east_m)


def merge_returns(
    files: Iterable[Sequence[StemReturns]], observations: Sequence[KeyedObservation], fusion: Fusion
) -> StandCloud:
    """`files`: passes of each vehicle in the order of its file. `observations`, `fusion`: of the same stand."""
    index = {(o.observation.vehicle_id, o.observation): i for i, o in enumerate(observations)}
    tree_of = {i: k for k, stem in enumerate(fusion.stems, start=1) for i in stem.observed}
    logs = {session: k for k, session in enumerate(fusion.logs)}
    parts: list[StandCloud] = []
    for passes in files:
        seen = [_index_of(one, index) for one in passes]
        sessions = _sessions([None if i is None else observations[i].session for i in seen])
        for one, i, session in zip(passes, seen, sessions, strict=True):
            when_s = one.first_s
            if i is not None:
                told = observations[i].observation
                when_s = (told.first_s + told.last_s) / 2.0
            off_m = np.zeros(2)
            if session in logs:
                recorded_m = np.array([[one.north_m, one.east_m]])
                off_m = fusion.frames.errors_m(logs[session], np.array([when_s]), recorded_m)[0]
            parts.append(_placed(one, off_m, NO_TREE if i is None else tree_of.get(i, NO_TREE)))
    return _joined(parts)


def _index_of(one: StemReturns, index: Mapping[tuple[int, StemObservation], int]) -> int | None:
    told = decode(one.body, one.vehicle_id) if one.body else None
    return None if told is None else index.get((one.vehicle_id, told))


def _sessions(known: Sequence[Session | None]) -> list[Session | None]:
    """Of each pass: its own, or that of the nearest before it, or behind."""
    found = list(known)
    for order in (range(1, len(found)), range(len(found) - 2, -1, -1)):
        step = -1 if order.step > 0 else 1
        for k in order:
            found[k] = found[k] if found[k] is not None else found[k + step]
    return found


def _placed(one: StemReturns, off_m: Floats, tree: int) -> StandCloud:
    points, n = one.points, len(one.points)
    up_m = points["up_m"].astype(np.float64)
    return StandCloud(
        east_m=one.east_m - off_m[1] + points["east_m"],
        north_m=one.north_m - off_m[0] + points["north_m"],
        up_m=up_m,
        above_ground_m=np.full(n, np.nan) if one.ground_up_m is None else up_m - one.ground_up_m,
        at_s=one.first_s + points["at_s"].astype(np.float64),
        vehicle=np.full(n, one.vehicle_id, dtype=np.uint16),
        ring=points["ring"].astype(np.uint8),
        of_stem=points["flags"] & OF_STEM > 0,
        tree=np.full(n, tree, dtype=np.uint32),
    )


def _joined(parts: Sequence[StandCloud]) -> StandCloud:
    return StandCloud(
        east_m=np.concatenate([np.zeros(0), *(part.east_m for part in parts)]),
        north_m=np.concatenate([np.zeros(0), *(part.north_m for part in parts)]),
        up_m=np.concatenate([np.zeros(0), *(part.up_m for part in parts)]),
        above_ground_m=np.concatenate([np.zeros(0), *(part.above_ground_m for part in parts)]),
        at_s=np.concatenate([np.zeros(0), *(part.at_s for part in parts)]),
        vehicle=np.concatenate([np.zeros(0, dtype=np.uint16), *(part.vehicle for part in parts)]),
        ring=np.concatenate([np.zeros(0, dtype=np.uint8), *(part.ring for part in parts)]),
        of_stem=np.concatenate([np.zeros(0, dtype=np.bool_), *(part.of_stem for part in parts)]),
        tree=np.concatenate([np.zeros(0, dtype=np.uint32), *(part.tree for part in parts)]),
    )
