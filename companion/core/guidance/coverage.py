"""Coverage of the tree at d2 (the paper's Fig. 4d; Algorithm 1 has no rule for it).

`dest_ned_m` is the vector from the vehicle to the tree, known to the leader and relayed hop by hop, so a follower needs
no position of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final

from companion.core.model.vectors import ZERO, add, dot, limit, norm, scale, sub
from mission.common.forming import FORMED_RATIO, ring_tolerance_m
from mission.common.frames import Vec3

RADIAL_GAIN_PER_S: Final = 0.5
RING_GAIN_PER_S: Final = RADIAL_GAIN_PER_S  # so the velocity tells how far the position is off
SPHERE_GAIN_MPS: Final = 3.6  # the softest ways to rearrange are slow: at a third of this some take a minute
LIFT_M: Final = 1.0  # the difference in height that is made up between two on one level
LEVEL_GAIN_PER_S: Final = 0.5
CROWDED: Final = 0.3  # share of the even gap: below it a vehicle waits where it is
FREE: Final = 0.7  # from this share it goes
SPREAD_LIMIT_MPS: Final = 2.0
CLOSE_UP_LIMIT_MPS: Final = 3.0  # for those that are still on their way to the tree
# Where a trunk stands in a position: others that are tried, metres outward and along the ring. What is left of the 2 m
# within which a vehicle counts as being on the ring is for gusts.
OUTWARD_M = (0.0, 0.5, -0.5, 1.0, -1.0, 1.5, -1.5)
OUTWARD_COST: Final = 0.3  # of a metre along: the gaps stay even
ALONG_STEP_M: Final = 0.5
ALONG_M: Final = 5.0
# A stranded vehicle is passed outside the ring, where the ring leads nearer to it than this share of its clearance,
PASSED: Final = 0.85
PASS_FROM_M: Final = 3.0  # or will so much further on,
ARRIVED_M: Final = 0.5  # by a vehicle that is further than this from its position.


def ring(
    dest_ned_m: Vec3,
    peers_rel_ned_m: Sequence[Vec3],
    *,
    size: int,
    radius_m: float,
    wait_m: float,
    range_m: float,
    is_free: Callable[[float, float], bool] | None = None,
    stranded_rel_ned_m: Sequence[Vec3] = (),
    told_rel_ned_m: Sequence[Vec3] = (),
    clear_m: float = 0.0,
) -> Vec3:
    """Velocity (NED m/s) to an even position on a level ring about the tree's axis; `size`: how many are to be on it.

    Each vehicle keeps its rank around the tree and goes to where the mean of all ranks' even positions puts it. On a
    ring too wide to hear across it goes midway between those ahead and behind, and no further from either than the even
    gap: so one that hears none ahead opens the ring, without losing the one behind. No vehicle enters the ring where it
    is crowded: from outside it waits `wait_m` before it.

    `is_free`: no trunk is known to stand in that position (north, east of the vehicle). Where one does the vehicle goes
    to the position nearest to it that is free, a little off the ring rather than along it; the others keep even gaps to
    where it then is, as they would to anybody. Beside one that is stranded it stays on the ring.

    `told_rel_ned_m`: where others alone have one that is stranded. Courses are led round these places, so in none of
    them it could come to rest; but no word moves it: it goes as far as it comes to rest clear of them.
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
    on_m = radius_m
    if is_free is not None or stranded_rel_ned_m:
        clears = _clears_all(stranded_rel_ned_m, clear_m)
        reach_m = ALONG_M + 2.0 * clear_m * len(stranded_rel_ned_m)
        turn, on_m = _free_position((north, east), bearing, turn, radius_m, is_free, clears, reach_m)
        if told_rel_ned_m:
            all_clear = _clears_all([*stranded_rel_ned_m, *told_rel_ned_m], clear_m)
            turn = _stop_short((north, east), bearing, turn, radius_m, all_clear)
        if _is_passing(stranded_rel_ned_m, (north, east), bearing, turn, radius_m, clear_m):
            on_m, room = radius_m + max(wait_m, clear_m), 1.0
        elif stranded_rel_ned_m and radius_m * abs(turn) < ARRIVED_M:
            room = 1.0  # beside them gaps are uneven: more room than it has there will not come
    around_mps = max(-SPREAD_LIMIT_MPS, min(SPREAD_LIMIT_MPS, RING_GAIN_PER_S * radius_m * turn))
    if distance_m > on_m:
        radial_mps = RADIAL_GAIN_PER_S * min(0.0, on_m + (1.0 - room) * wait_m - distance_m)
    else:
        radial_mps = RADIAL_GAIN_PER_S * room * (on_m - distance_m)
    velocity = add(scale(outward, radial_mps), scale(clockwise, around_mps))
    return add(limit(velocity, CLOSE_UP_LIMIT_MPS), (0.0, 0.0, LEVEL_GAIN_PER_S * down))


def position_off_m(spread_ned_mps: Vec3) -> float:
    """Level distance of the position to which a velocity of `ring` leads, m; infinite: further than it tells."""
    level_mps = math.hypot(spread_ned_mps[0], spread_ned_mps[1])
    return level_mps / RING_GAIN_PER_S if level_mps < SPREAD_LIMIT_MPS else math.inf


def _free_position(
    here: tuple[float, float],
    bearing: float,
    turn: float,
    radius_m: float,
    is_free: Callable[[float, float], bool] | None,
    clears: Callable[[float, float], bool],
    reach_m: float,
) -> tuple[float, float]:
    """Turn and radius of the free position nearest to the one at `turn` on the ring; that one where none is free.

    `here`: north, east of the tree. `clears`: those that are stranded are far enough off. They are made way for along
    the ring alone: to leave it by 1.5 m spares half a metre along it, and nothing is left for errors and for gusts.
    `reach_m`: how far along the ring is looked, to half of it. Of two as near, the one on this vehicle's side.
    """
    side = -1.0 if turn > 0.0 else 1.0
    best, least = (turn, radius_m), math.inf
    for step in range(2 * int(min(reach_m, math.pi * radius_m) / ALONG_STEP_M) + 1):
        along_m = ALONG_STEP_M * ((step + 1) // 2) * (side if step % 2 else -side)
        if abs(along_m) >= least:
            break
        its_turn = turn + along_m / radius_m
        cos, sin = math.cos(bearing + its_turn), math.sin(bearing + its_turn)
        if not clears(radius_m * cos - here[0], radius_m * sin - here[1]):
            continue
        for outward_m in OUTWARD_M:
            cost = abs(along_m) + OUTWARD_COST * abs(outward_m)
            on_m = radius_m + outward_m
            north_m, east_m = on_m * cos - here[0], on_m * sin - here[1]
            if cost < least and clears(north_m, east_m) and (is_free is None or is_free(north_m, east_m)):
                best, least = (its_turn, on_m), cost
    return best


def _stop_short(
    here: tuple[float, float],
    bearing: float,
    turn: float,
    radius_m: float,
    clears: Callable[[float, float], bool],
) -> float:
    """As much of `turn` as ends in a position on the ring that `clears`; 0 where none does."""
    steps = int(radius_m * abs(turn) / ALONG_STEP_M)
    for step in range(steps + 1):
        its_turn = turn - math.copysign(step * ALONG_STEP_M / radius_m, turn)
        north, east = radius_m * math.cos(bearing + its_turn), radius_m * math.sin(bearing + its_turn)
        if clears(north - here[0], east - here[1]):
            return its_turn
    return 0.0


def _clears_all(stranded_rel_ned_m: Sequence[Vec3], clear_m: float) -> Callable[[float, float], bool]:
    """Test of a position (north, east of the vehicle): `clear_m` from each that is stranded."""
    return lambda north_m, east_m: all(
        [math.hypot(rel[0] - north_m, rel[1] - east_m) >= clear_m for rel in stranded_rel_ned_m]
    )


def _is_passing(
    stranded_rel_ned_m: Sequence[Vec3],
    here: tuple[float, float],
    bearing: float,
    turn: float,
    radius_m: float,
    clear_m: float,
) -> bool:
    """True where the way along the ring leads by a stranded vehicle, nearer than this one may come to it."""
    if radius_m * abs(turn) < ARRIVED_M:
        return False
    further = math.copysign(min(abs(turn), PASS_FROM_M / radius_m), turn)
    for rel in stranded_rel_ned_m:
        north, east = here[0] + rel[0], here[1] + rel[1]
        is_ahead = math.remainder(math.atan2(east, north) - bearing, math.tau) * turn > 0.0
        at = bearing + further if is_ahead else bearing
        if math.hypot(north - radius_m * math.cos(at), east - radius_m * math.sin(at)) < PASSED * clear_m:
            return True
    return False


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


def is_formed(from_tree_ned_m: Sequence[Vec3], *, hidden: int, radius_m: float, is_ring: bool) -> bool:
    """True when all those at these positions about the tree are on the ring or sphere, and the ring has no wide gap.

    `hidden`: so many more are there, not heard here, as where the trunk is in between: they may stand in wide gaps.
    """
    axes = 2 if is_ring else 3
    off_m = [abs(math.hypot(*position[:axes]) - radius_m) for position in from_tree_ned_m]
    if not off_m or max(off_m) > ring_tolerance_m(radius_m):
        return False
    if not is_ring:
        return True
    widest = FORMED_RATIO * math.tau / (len(off_m) + hidden)
    bearings = sorted([math.atan2(east, north) for north, east, _ in from_tree_ned_m])
    gaps = [after - before for before, after in pairwise([*bearings, bearings[0] + math.tau])]
    return sum([math.ceil(gap / widest) - 1 for gap in gaps]) <= hidden
