"""Stems that may be hulls of vehicles: one that hovers looks as a trunk does, and drifts by its own wrong velocity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from companion.core.perception.landmarks.trunk_tracks import Sighting
from mission.common.frames import Vec3

NEIGHBOUR_M: Final = 1.2  # a stem so near to a reported neighbour may be that one's hull
NEIGHBOUR_SIGMAS: Final = 2.0  # and farther by so many of what is seen is turned from the frame of reports
HULL_SHARE: Final = 0.5  # of a vehicle's radius: what is thinner, as raw scans have it, is none


def is_heard_hull(sighting: Sighting, neighbours: Sequence[Vec3], heading_sd_rad: float) -> bool:
    """It may be the hull of one that is reported there, in the frame of the scan."""
    away_m = sighting.stem.surface_m + sighting.stem.radius_m
    near_m = NEIGHBOUR_M + NEIGHBOUR_SIGMAS * heading_sd_rad * away_m
    for at in neighbours:
        n, e = at[0] - sighting.north_m, at[1] - sighting.east_m
        if n * n + e * e < near_m * near_m:
            return True
    return False


def leave_out_hulls(found: list[Sighting], unheard: int, thick_m: float, least: int) -> list[Sighting]:
    """Of good trunks that were seen again those that may correct the pose, though `unheard` vehicles may be among them.

    Where no more are as thick as a hull (`thick_m`) than there are such vehicles, these are left out. Else nobody can
    tell which are: all count, or none where fewer than `least` would be left without them.
    """
    if unheard <= 0:
        return found
    thinner = [one for one in found if one.trunk is not None and one.trunk.radius_m < thick_m]
    if len(found) - len(thinner) <= unheard:
        return thinner
    return found if len(found) - unheard >= least else []
