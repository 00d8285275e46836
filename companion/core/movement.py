"""The conditions of `formation` put together: what a leader and a follower want on the way, before the last stage.

The agents fly by these functions, and so do the studies on point masses: there is one law.
"""

from __future__ import annotations

from collections.abc import Sequence

from companion.core import formation
from companion.core.formation import Route
from companion.core.peers import Neighbour
from companion.core.types import SwarmPhase
from companion.core.vec import add, scale, sub
from mission.frames import Vec3
from mission.model import Mission

GATHER_MPS = 1.0  # the leader on its way to d1, through those that have just taken off beside it
PASS_CLEAR_M = 1.0  # more than the separation from a leader that stands at d2


def lead(mission: Mission, phase: SwarmPhase, goal: tuple[Vec3, float], pos_ned_m: Vec3, *, governor: float) -> Vec3:
    """The leader's velocity (NED m/s), which is its reference velocity as well; `goal` as `Phases.goal` gives it.

    The swarm arranges itself around its leader: that one gives way to nobody but in the last stage.
    """
    cruise_mps = mission.route.vel_leader_mps
    if phase is SwarmPhase.GATHER:
        cruise_mps = min(cruise_mps, GATHER_MPS)
    place_ned_m, stop_m = goal
    return scale(formation.approach(sub(place_ned_m, pos_ned_m), cruise_mps=cruise_mps, stop_m=stop_m), governor)


def follow(
    mission: Mission,
    me: int,
    route: Route,
    neighbours: Sequence[Neighbour],
    fallen: Sequence[Vec3],
    dest_ned_m: Vec3 | None,
    *,
    range_m: float,
    faith: float,
) -> tuple[Vec3, Vec3]:
    """Vehicle `me`'s reference velocity and the velocity that it wants, both NED m/s.

    `fallen`: relative positions of silent vehicles, NED m. `dest_ned_m`: from the vehicle to the tree where it has to
    be passed, on the way to d2; else None. `faith`: 0..1, how far the reference is still to be believed.
    """
    ref = scale(formation.alignment(route), faith)
    push = formation.separation(neighbours, fallen, soft_m=mission.separation.soft_m)
    pull = formation.cohesion(route, range_m=range_m)
    wanted = add(add(ref, push), add(pull, formation.level(route)))
    if dest_ned_m is not None:
        clear_m = max(mission.coverage.keep_out_m, mission.separation.hard_m) + PASS_CLEAR_M
        wanted = add(wanted, formation.pass_by(ref, dest_ned_m, clear_m=clear_m, to_the_right=me % 2 == 0))
    return ref, wanted
