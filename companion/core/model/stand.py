"""Figures of the stand that is surveyed, and of its records, as events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(slots=True, init=False, unsafe_hash=True)
class StandMeasured:
    """Figures of the stand, by the records that this vehicle has, of which those of others may be false."""

    basal_area_pct: Final[float | None]  # half of the interval of the basal area, over it; None: it has none yet

    def __init__(self, basal_area_pct: float | None) -> None:
        self.basal_area_pct = basal_area_pct


@dataclass(slots=True, init=False, unsafe_hash=True)
class RecordsWaiting:
    """Records that this node knows of, and of which it has not heard that the base station has them."""

    count: Final[int]

    def __init__(self, count: int) -> None:
        self.count = count
