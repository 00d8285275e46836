"""Diameters brought from the height of a cut to breast height, by a stated linear taper, with the error that it adds.

The lower stem of a forest tree, above its butt swell, loses about a centimetre of diameter per metre: Ormerod's bole
(Ormerod 1973, "A simple bole model", Forestry Chronicle 49, 136-138), d(h) = DBH ((H - h) / (H - 1.3))^p, of p = 0.7,
has 0.8 cm/m for a tree of 10 cm and 11 m, 1.0 for 25 cm and 20 m, 1.3 for 50 cm and 28 m. What a mission says in
`survey.taper_cm_per_m` is for all; how far single trees are off it is `survey.taper_sd_cm_per_m`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from mission.schema.trees import BREAST_HEIGHT_M

AT_BREAST_M: Final = 0.3  # a cut so near to breast height has measured there


@dataclass(frozen=True, slots=True)
class Taper:
    """Metres of diameter per metre of height, and its standard deviation between trees."""

    per_m: float
    sd_per_m: float

    def at_breast_height(self, diameter_m: float, sd_m: float, cut_up_m: float, cut_sd_m: float) -> tuple[float, float]:
        """Diameter at breast height and its standard deviation, of one at a cut (`cut_sd_m`: error of its height)."""
        above_m = cut_up_m - BREAST_HEIGHT_M
        by_taper_m = math.hypot(self.sd_per_m * above_m, self.per_m * cut_sd_m)
        return diameter_m + self.per_m * above_m, math.hypot(sd_m, by_taper_m)


def is_at_breast_height(cut_up_m: float) -> bool:
    """True if a cut there counts as measured at breast height."""
    return abs(cut_up_m - BREAST_HEIGHT_M) <= AT_BREAST_M
