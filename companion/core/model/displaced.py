"""A reported position that is not where ranges to the neighbours have the vehicle."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Displaced:
    """By how much it is off. On a side that is not known: no offset, and the error instead."""

    off_ne_m: tuple[float, float]  # reported less true: north, east
    drift_ne_mps: tuple[float, float]
    error_m: float  # of the position less the offset
