"""Aligns trunks of a neighbour whose place is not known: held against the own ones at every place within reach.

As `constellation`, but shifts are counted in cells, as there are hundreds of times as many, and one that is accepted
must have matched more trunks, as chance has as many more tries. Compasses are believed to some degrees all the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.localisation.gnss_denied.error_state import Level
from companion.core.model.beacon import ToldTrunk
from companion.core.perception.landmarks.constellation import (
    DIAMETERS_M,
    OVERLAP_SHARE,
    Alignment,
    count_expected,
    is_one_of,
    is_sharp,
    refine,
    turned,
)

REACH_MAX_M: Final = 40.0
TURNS: Final = 12  # to either side, each of
TURN_RAD: Final = math.radians(1.0)
CELL_M: Final = 0.5  # of shifts; a vote counts in the four cells about it
TRIES: Final = 12
VOTES_LEAST: Final = 6
LEAST: Final = 8  # trunks matched
SECOND_SHARE: Final = 0.7  # of them, that another place may match
ROW: Final = 1 << 12  # cells to the east of each other in a row: more than REACH_MAX_M holds


@final
class _Cell:
    """Told trunks, each once, that a shift into this cell brings upon a known one."""

    __slots__ = ("count", "last")

    def __init__(self) -> None:
        self.count = 0
        self.last = -1


def align_wide(
    told: Sequence[ToldTrunk], known: Sequence[ToldTrunk], place: Level, turn_rad: float, reach_m: float
) -> Alignment | None:
    """As `constellation.align`, at every place within `reach_m` of `place`; None: none stands out."""
    if min(len(told), len(known)) < LEAST:
        return None
    found: list[Alignment] = []
    best: Alignment | None = None
    for _, start in _vote(told, known, place, turn_rad, min(reach_m, REACH_MAX_M)):
        if len(found) >= TRIES:
            break
        if is_one_of(start, found):
            continue
        fit = refine(told, known, start)
        if fit is not None:
            found.append(fit)
            if best is None or fit.matched > best.matched:
                best = fit
    if best is None or best.matched < LEAST or not is_sharp(best):
        return None
    for fit in found:
        if fit.matched > SECOND_SHARE * best.matched and not is_one_of(fit, [best]):
            return None
    return best if best.matched >= OVERLAP_SHARE * count_expected(told, known, best) else None


def _vote(
    told: Sequence[ToldTrunk], known: Sequence[ToldTrunk], place: Level, turn_rad: float, reach_m: float
) -> list[tuple[int, Alignment]]:
    """Places with how many trunks vote for each, less than none; the most first."""
    middle = (sum([one[0] for one in told]) / len(told), sum([one[1] for one in told]) / len(told))
    votes: list[tuple[int, Alignment]] = []
    for step in range(-TURNS, TURNS + 1):
        at_rad = turn_rad + step * TURN_RAD
        n, e = turned(at_rad, middle[0], middle[1])
        cells = _count_shifts(told, known, place, at_rad, reach_m)
        for key in cells:
            count = cells[key].count
            if count >= VOTES_LEAST:
                row = (key + ROW // 2) // ROW
                here = (place[0] + n + CELL_M * row, place[1] + e + CELL_M * (key - ROW * row))
                votes.append(
                    (-count, Alignment(middle, here, at_rad, position_sd_m=0.0, turn_sd_rad=0.0, matched=count))
                )
    votes.sort(key=_rank_of)
    return votes


def _rank_of(vote: tuple[int, Alignment]) -> int:
    return vote[0]


def _count_shifts(
    told: Sequence[ToldTrunk], known: Sequence[ToldTrunk], place: Level, turn_rad: float, reach_m: float
) -> dict[int, _Cell]:
    """Cells by ROW times their number north and that east: of those about each shift."""
    cells: dict[int, _Cell] = {}
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    for k in range(len(told)):
        north_m, east_m, diameter_m = told[k]
        n, e = place[0] + c * north_m - s * east_m, place[1] + s * north_m + c * east_m
        for one in known:
            dn, de = one[0] - n, one[1] - e
            if abs(one[2] - diameter_m) > DIAMETERS_M or dn * dn + de * de > reach_m * reach_m:
                continue
            first = ROW * math.floor(dn / CELL_M) + math.floor(de / CELL_M)
            for key in (first, first + 1, first + ROW, first + ROW + 1):
                cell = cells.get(key)
                if cell is None:
                    cell = cells[key] = _Cell()
                if cell.last != k:
                    cell.last, cell.count = k, cell.count + 1
    return cells
