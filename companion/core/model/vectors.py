"""Three floats as a vector. Plain tuples: for up to about 100 neighbours faster than small numpy arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mission.common.frames import Vec3

ZERO: Vec3 = (0.0, 0.0, 0.0)


def add(a: Vec3, b: Vec3) -> Vec3:
    """a + b"""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def sub(a: Vec3, b: Vec3) -> Vec3:
    """a - b"""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(a: Vec3, k: float) -> Vec3:
    """k a"""
    return (a[0] * k, a[1] * k, a[2] * k)


def dot(a: Vec3, b: Vec3) -> float:
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: Vec3) -> float:
    """|a|"""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def limit(a: Vec3, longest: float) -> Vec3:
    """`a`, shortened to `longest` where it is longer."""
    length = norm(a)
    return a if length <= longest else scale(a, longest / length)


def turned_level(a: Vec3, by_rad: float) -> Vec3:
    """`a`, turned clockwise, north to east."""
    c, s = math.cos(by_rad), math.sin(by_rad)
    return (c * a[0] - s * a[1], s * a[0] + c * a[1], a[2])


def median(vectors: Sequence[Vec3]) -> Vec3:
    """Component by component: the lower one of two in the middle."""
    middle = (len(vectors) - 1) // 2
    x, y, z = (sorted([v[k] for v in vectors])[middle] for k in range(3))
    return (x, y, z)


def is_finite(a: Vec3) -> bool:
    """Neither infinite nor NaN, of which nothing subtracted from itself is 0: compiled, several times as fast."""
    return a[0] - a[0] == 0.0 and a[1] - a[1] == 0.0 and a[2] - a[2] == 0.0
