"""The values that a foreign law gets in every tick. NED: north, east, down; m and m/s, about the vehicle itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission.common.frames import Vec3


@dataclass(frozen=True, slots=True)
class Peer:
    """Another vehicle that is heard, brought up to now."""

    id: int
    rel_ned_m: Vec3  # from this vehicle to it
    vel_ned_mps: Vec3
    ref_ned_mps: Vec3  # what it hands down: the velocity that its own law desired; a leader's is the swarm's course
    distance_m: float
    age_s: float  # of its last beacon
    leads: bool
    ahead: bool  # its way to the leader, link by link, is shorter than this vehicle's
    gives_way: bool  # a companion steers it; False: it climbs, lands, hovers, or has a pilot


@dataclass(frozen=True, slots=True)
class Trunk:
    """A tree that the mission names: at d2, and at each stop."""

    rel_ned_m: Vec3
    keep_out_m: float  # from its axis


@dataclass(frozen=True, slots=True)
class View:
    """Knowledge of one vehicle in one tick: its own companion's, no truth. No absolute position is in it."""

    dt_s: float  # of a tick
    state: str  # gathering (at d1), transit (to d2), returning (to d1), coverage
    leads: bool
    vel_ned_mps: Vec3  # own, as estimated
    commanded_ned_mps: Vec3  # the last setpoint, as the safety filter left it
    goal_ned_m: Vec3 | None  # a leader's: from here to where it is to go; None: it follows, or waits
    stop_m: float  # how far before that it comes to rest
    cruise_mps: float  # a leader's speed limit for now: 1 m/s while the swarm gathers, less where a link is strained
    to_d2_ned_m: Vec3 | None  # from here to the tree, as followers know it from others, too; None: not known yet
    peers: tuple[Peer, ...]
    silent_ned_m: tuple[Vec3, ...]  # vehicles that fell silent in the air, and hover
    points_ne_m: NDArray[np.float64]  # (k, 2) north and east of what the obstacle sensor saw; none without one
    trunks: tuple[Trunk, ...]
    range_m: float  # radio range that the formation keeps
    size: int  # vehicles in the air
