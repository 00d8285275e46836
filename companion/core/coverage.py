"""Coverage of the tree at d2 (the paper's Fig. 4d; Algorithm 1 has no rule for it).

`dest_ned_m` is the vector from the vehicle to the tree, known to the leader and relayed hop by hop, so a follower needs
no position of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from companion.core.types import ZERO
from companion.core.vec import add, dot, limit, norm, scale, sub
from mission.frames import Vec3

RADIAL_GAIN_PER_S: Final = 0.5
RING_GAIN_PER_S: Final = 0.5
SPHERE_GAIN_MPS: Final = 3.6  # the softest ways to rearrange are slow: at a third of this some take a minute
LIFT_M: Final = 1.0  # the difference in height that is made up between two on one level
LEVEL_GAIN_PER_S: Final = 0.5
CROWDED: Final = 0.3  # share of the even gap: below it a vehicle waits where it is
FREE: Final = 0.7  # from this share it goes
SPREAD_LIMIT_MPS: Final = 2.0
CLOSE_UP_LIMIT_MPS: Final = 3.0  # for those that are still on their way to the tree


def ring(
    dest_ned_m: Vec3, peers_rel_ned_m: Sequence[Vec3], *, size: int, radius_m: float, wait_m: float, range_m: float
) -> Vec3:
    """Velocity (NED m/s) to an even place on a level ring about the tree's axis; `size`: how many are to be on it.

    Each vehicle keeps its rank around the tree and goes to where the mean of all ranks' even places puts it. On a ring
    too wide to hear across it goes midway between those ahead and behind, and no further from either than the even gap:
    so one that hears none ahead opens the ring, without losing the one behind. No vehicle enters the ring where it is
    crowded: from outside it waits `wait_m` before it.
    """
    north, east, down = -dest_ned_m[0], -dest_ned_m[1], dest_ned_m[2]
    distance_m = math.hypot(north, east)
    if distance_m < 1e-6:
        return ZERO
    outward = (north / distance_m, east / distance_m, 0.0)
    clockwise = (-outward[1], outward[0], 0.0)
    bearing = math.atan2(east, north)
    gaps = sorted((math.atan2(rel[1] + east, rel[0] + north) - bearing) % math.tau for rel in peers_rel_ned_m)
    heard_across = 2.0 * radius_m <= range_m
    even = math.tau / (len(gaps) + 1 if heard_across else size)
    turn, room = 0.0, 1.0
    if gaps:
        ahead, behind = gaps[0], math.tau - gaps[-1]
        room = min(1.0, max(0.0, (min(ahead, behind) / even - CROWDED) / (FREE - CROWDED)))
        if heard_across:
            turn = sum(gap - rank * even for rank, gap in enumerate(gaps, start=1)) / (len(gaps) + 1)
        else:
            turn = (min(ahead, even) - min(behind, even)) / 2.0
    around_mps = max(-SPREAD_LIMIT_MPS, min(SPREAD_LIMIT_MPS, RING_GAIN_PER_S * radius_m * turn))
    if distance_m > radius_m:
        radial_mps = RADIAL_GAIN_PER_S * min(0.0, radius_m + (1.0 - room) * wait_m - distance_m)
    else:
        radial_mps = RADIAL_GAIN_PER_S * room * (radius_m - distance_m)
    velocity = add(scale(outward, radial_mps), scale(clockwise, around_mps))
    return add(limit(velocity, CLOSE_UP_LIMIT_MPS), (0.0, 0.0, LEVEL_GAIN_PER_S * down))


def sphere(dest_ned_m: Vec3, peers: Sequence[tuple[int, Vec3]], *, me: int, radius_m: float) -> Vec3:
    """Velocity (NED m/s) onto a sphere about d2, away along it from the others; `peers`: id and relative position.

    A swarm that comes all on one level would stay on it, as the push of each is level: between an odd and an even id
    a difference in height is made up.
    """
    distance_m = norm(dest_ned_m)
    if distance_m < 1e-6:
        return ZERO
    outward = scale(dest_ned_m, -1.0 / distance_m)
    spacing_m = radius_m * math.sqrt(4.0 * math.pi / (len(peers) + 1))
    push = ZERO
    for peer, (north, east, down) in peers:
        rel = (north, east, down + (peer % 2 - me % 2) * max(0.0, LIFT_M - abs(down)))
        apart_m = max(norm(rel), 0.1)
        push = add(push, scale(rel, -SPHERE_GAIN_MPS * (spacing_m / apart_m) ** 2 / apart_m))
    along = sub(push, scale(outward, dot(push, outward)))
    radial_mps = RADIAL_GAIN_PER_S * (radius_m - distance_m)
    return limit(add(scale(outward, radial_mps), limit(along, SPREAD_LIMIT_MPS)), SPREAD_LIMIT_MPS)
