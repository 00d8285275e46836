"""A standing tree, and how tall and wide one of its diameter is.

Heights: the Korf curves that SiTree has for the Norwegian national forest inventory (Antón-Fernández & Astrup 2022,
"SiTree", SoftwareX 18, 101025; function height.korf), spruce, pine, and birch with the other broadleaves. Crowns:
diameters of open-grown trees in Austria (Hasenauer 1997, Forest Ecology and Management 96, 197-206; Picea abies, Pinus
sylvestris, Fagus sylvatica), the most that a crown in a stand has.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

BREAST_HEIGHT_M = 1.3
UNDERGROWTH = "undergrowth"  # the species of a bush, in a map of ours too


class Species(StrEnum):
    """Groups of species that the curves tell apart."""

    SPRUCE = "spruce"
    PINE = "pine"
    BROADLEAF = "broadleaf"


_KORF = {  # a (dm), b, c of height = a exp(-b d^-c), d in mm
    Species.SPRUCE: (1017.27, 12.697, 0.3562),
    Species.PINE: (299.34, 34.2159, 0.6932),
    Species.BROADLEAF: (714.0037, 11.0299, 0.347),
}
_CROWN = {  # b0, b1 of ln(crown diameter, m) = b0 + b1 ln(d), d in cm
    Species.SPRUCE: (-0.3232, 0.6441),
    Species.PINE: (-0.1797, 0.6267),
    Species.BROADLEAF: (0.2662, 0.6072),
}


@dataclass(frozen=True, slots=True)
class StandTree:
    """An upright cylinder, the trunk, with an upright cylinder, the crown, about its upper part.

    east_m, north_m: the axis, metres from the mission's origin. radius_m: half the diameter at breast height. Heights
    count from the ground at the axis; the crown reaches from crown_base_m to height_m. A bush has no crown:
    crown_base_m = height_m. species: as the stem map has it, "" if it says nothing.
    """

    east_m: float
    north_m: float
    radius_m: float
    height_m: float
    crown_base_m: float
    crown_radius_m: float
    species: str = ""


def height_of_m(dbh_m: float, species: Species) -> float:
    """Height of a tree with this diameter at breast height; m, to 0.1 m."""
    a, b, c = _KORF[species]
    return round(max(BREAST_HEIGHT_M, 0.1 * a * math.exp(-b * (1000.0 * dbh_m) ** -c)), 1)


def crown_radius_of_m(dbh_m: float, species: Species) -> float:
    """Radius of its crown; m, to 0.1 m and not less than the trunk's."""
    b0, b1 = _CROWN[species]
    return max(dbh_m / 2.0, round(0.5 * math.exp(b0 + b1 * math.log(100.0 * dbh_m)), 1))


def tree_of(
    east_m: float, north_m: float, dbh_m: float, species: Species, *, crown_base_share: float, height_share: float = 1.0
) -> StandTree:
    """A tree of which only place, diameter and species are known.

    crown_base_share: crown base over height. height_share: height over what the curve has.
    """
    height_m = round(height_share * height_of_m(dbh_m, species), 1)
    base_m, reach_m = round(crown_base_share * height_m, 1), crown_radius_of_m(dbh_m, species)
    return StandTree(east_m, north_m, dbh_m / 2.0, height_m, base_m, reach_m, species.value)
