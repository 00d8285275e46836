"""The route, as the compared laws know it and ours does not: every vehicle knows the way to the goal."""

from __future__ import annotations

import numpy as np

from companion.core.guidance import formation
from sim_bridge.lab.study.law import Floats, View


def approach(to_goal_enu_m: Floats, view: View) -> Floats:
    """(B, k, 3) m/s: `formation.approach` for vectors (B, k, 3) to the goal, with the flight's own speed and stop."""
    distance_m = np.sqrt((to_goal_enu_m * to_goal_enu_m).sum(axis=2))
    left_m = np.maximum(0.0, distance_m - view.stop_m[:, None])
    speed = np.minimum(view.cruise_mps[:, None], np.sqrt(2.0 * formation.APPROACH_MPS2 * left_m))
    speed = np.minimum(speed, formation.APPROACH_GAIN_PER_S * left_m)
    toward: Floats = to_goal_enu_m * (speed / np.maximum(distance_m, 1e-9))[:, :, None]
    return toward


def with_leader(command: Floats, view: View) -> Floats:
    """`command` (B, n, 3), but the leader flies to its goal whatever the others do: arrival is its arrival."""
    leader = approach(view.to_goal_enu_m[:, None, :], view)
    return np.where(view.leads[:, :, None], leader, command)


def goals(view: View) -> Floats:
    """(B, 3) ENU m: where the leader goes."""
    leader = np.where(view.leads[:, :, None], view.pos_enu_m, 0.0).sum(axis=1)
    return np.asarray(leader + view.to_goal_enu_m)


def limit(v: Floats, longest: float) -> Floats:
    """Over the last axis of (B, n, 3)."""
    length = np.sqrt((v * v).sum(axis=2, keepdims=True))
    return np.asarray(v * (longest / np.maximum(length, longest)))
