"""Coverage of the tree at d2 (the paper's Fig. 4d; Algorithm 1 has no rule for it).

`dest_ned_m` is the vector from the vehicle to the tree, known to the leader and relayed hop by hop, so a follower needs
no position of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from companion.core.types import ZERO
from companion.core.vec import add, dot, limit, norm, scale, sub
from mission.frames import Vec3

RADIAL_GAIN_PER_S = 0.5
RING_GAIN_PER_S = 0.5
SPHERE_GAIN_MPS = 1.2
LEVEL_GAIN_PER_S = 0.5
SPREAD_LIMIT_MPS = 2.0


def ring(dest_ned_m: Vec3, peers_rel_ned_m: Sequence[Vec3], *, radius_m: float) -> Vec3:
    """Velocity (NED m/s) onto a level ring about the tree's axis, midway between those ahead and behind."""
    north, east, down = -dest_ned_m[0], -dest_ned_m[1], dest_ned_m[2]
    distance_m = math.hypot(north, east)
    if distance_m < 1e-6:
        return ZERO
    outward = (north / distance_m, east / distance_m, 0.0)
    clockwise = (-outward[1], outward[0], 0.0)
    bearing = math.atan2(east, north)
    gaps = sorted((math.atan2(rel[1] + east, rel[0] + north) - bearing) % math.tau for rel in peers_rel_ned_m)
    turn = (gaps[0] - (math.tau - gaps[-1])) / 2.0 if gaps else 0.0
    speed_mps = max(-SPREAD_LIMIT_MPS, min(SPREAD_LIMIT_MPS, RING_GAIN_PER_S * radius_m * turn))
    radial_mps = RADIAL_GAIN_PER_S * (radius_m - distance_m)
    velocity = add(scale(outward, radial_mps), scale(clockwise, speed_mps))
    return add(limit(velocity, SPREAD_LIMIT_MPS), (0.0, 0.0, LEVEL_GAIN_PER_S * down))


def sphere(dest_ned_m: Vec3, peers_rel_ned_m: Sequence[Vec3], *, radius_m: float) -> Vec3:
    """Velocity (NED m/s) onto a sphere about d2, away along it from the others."""
    distance_m = norm(dest_ned_m)
    if distance_m < 1e-6:
        return ZERO
    outward = scale(dest_ned_m, -1.0 / distance_m)
    spacing_m = radius_m * math.sqrt(4.0 * math.pi / (len(peers_rel_ned_m) + 1))
    push = ZERO
    for rel in peers_rel_ned_m:
        apart_m = max(norm(rel), 0.1)
        push = add(push, scale(rel, -SPHERE_GAIN_MPS * (spacing_m / apart_m) ** 2 / apart_m))
    along = sub(push, scale(outward, dot(push, outward)))
    radial_mps = RADIAL_GAIN_PER_S * (radius_m - distance_m)
    return limit(add(scale(outward, radial_mps), limit(along, SPREAD_LIMIT_MPS)), SPREAD_LIMIT_MPS)
