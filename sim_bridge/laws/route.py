"""What the compared laws are told and ours is not: every vehicle knows the way to the goal."""

from __future__ import annotations

import numpy as np

from companion.core import formation, phases
from mission.model import Mission
from sim_bridge.study.law import Floats, View


def approach(to_goal_enu_m: Floats, view: View, mission: Mission) -> Floats:
    """(B, k, 3) m/s: `formation.approach` for vectors (B, k, 3) to the goal; the flight's own cruise speed.

    To rest at d1 before departure, short of d2 after it, as our leader.
    """
    distance_m = np.sqrt((to_goal_enu_m * to_goal_enu_m).sum(axis=2))
    gathering = view.cruise_mps != mission.route.vel_leader_mps
    stop_m = np.where(gathering, 0.0, phases.STOP_SHARE * mission.route.arrival_distance_m)[:, None]
    left_m = np.maximum(0.0, distance_m - stop_m)
    speed = np.minimum(view.cruise_mps[:, None], np.sqrt(2.0 * formation.APPROACH_MPS2 * left_m))
    speed = np.minimum(speed, formation.APPROACH_GAIN_PER_S * left_m)
    toward: Floats = to_goal_enu_m * (speed / np.maximum(distance_m, 1e-9))[:, :, None]
    return toward


def with_leader(command: Floats, view: View, mission: Mission) -> Floats:
    """`command` (B, n, 3), but the leader flies its route whatever the others do, as ours: arrival is its arrival."""
    leader = approach(view.to_goal_enu_m[:, None, :], view, mission)
    return np.where(view.leads[:, :, None], leader, command)


def goals(view: View) -> Floats:
    """(B, 3) ENU m: where the leader goes."""
    leader = np.where(view.leads[:, :, None], view.pos_enu_m, 0.0).sum(axis=1)
    return np.asarray(leader + view.to_goal_enu_m)


def limit(v: Floats, longest: float) -> Floats:
    """Over the last axis of (B, n, 3)."""
    length = np.sqrt((v * v).sum(axis=2, keepdims=True))
    return np.asarray(v * (longest / np.maximum(length, longest)))
