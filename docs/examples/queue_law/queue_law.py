"""A law in a package of its own: the leader heads for its goal, each other keeps a gap of its own to one ahead."""

import math


def start(mission, vehicle_id):
    return mission.separation.hard_m + 2.0 + 0.5 * vehicle_id


def transit(gap_m, view):
    if view.goal_ned_m is not None:
        left_m = max(1e-6, math.dist((0.0, 0.0, 0.0), view.goal_ned_m))
        speed_mps = min(view.cruise_mps, 0.5 * max(0.0, left_m - view.stop_m))
        return [speed_mps / left_m * part for part in view.goal_ned_m]
    first = min((peer for peer in view.peers if peer.ahead), key=lambda peer: peer.distance_m, default=None)
    if first is None:
        return (0.0, 0.0, 0.0)
    closer = 0.5 * (first.distance_m - gap_m) / first.distance_m
    return [ref + closer * rel for ref, rel in zip(first.ref_ned_mps, first.rel_ned_m, strict=True)]
