"""Clearance below: a vehicle may land while nobody flies or hovers in the column that it descends through."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from companion.core.model.beacon import PeerReport
from companion.core.model.neighbour import Neighbour, find_hover_places

SPREAD_DONE_SHARE: Final = 0.8  # of the soft separation, level, before a descent


def is_clear_below(
    neighbours: Sequence[Neighbour], silent: Mapping[int, PeerReport], *, soft_m: float, hard_m: float
) -> bool:
    """No vehicle flies or hovers above or below. `soft_m`, `hard_m`: the mission's separation."""
    clear_m = SPREAD_DONE_SHARE * soft_m
    flies = all(math.hypot(n.rel_ned_m[0], n.rel_ned_m[1]) >= clear_m for n in neighbours)
    return flies and all(math.hypot(rel[0], rel[1]) >= hard_m for rel in find_hover_places(silent.values()))
