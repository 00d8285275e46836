"""Passes of stems as a survey leaves them."""

from __future__ import annotations

import numpy as np

from companion.cloud.returns import OF_STEM, POINT, StemReturns


def returns_at(
    *,
    vehicle_id: int = 1,
    body: bytes = b"",
    north_m: float = 5.0,
    east_m: float = 3.0,
    n: int = 8,
    first_s: float = 10.0,
) -> StemReturns:
    """`n` points around a stem of 30 cm at 1.3 m above ground that is at -0.5 m; the last is of no stem."""
    points = np.zeros(n, dtype=POINT)
    turn = np.linspace(0.0, np.pi, n)
    points["north_m"], points["east_m"], points["up_m"] = 0.15 * np.cos(turn), 0.15 * np.sin(turn), 0.8
    points["at_s"], points["ring"], points["flags"] = np.arange(n) * 0.1, np.arange(n) % 15, OF_STEM
    points["flags"][-1] = 0
    return StemReturns(vehicle_id, body, first_s, north_m, east_m, -0.5, points)
