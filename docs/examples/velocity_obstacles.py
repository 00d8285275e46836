"""A law for `sim-bridge fly --law`: velocity obstacles (Fiorini and Shiller 1998; van den Berg et al. 2008), sampled.

Of some velocities near the preferred one, the cheapest flies: its distance from that one, and, the sooner it leads too
near to another vehicle or to what the obstacle sensor saw, the more. Two vehicles share the turn (RVO). Level; height
is kept as the leader's.
"""

import math

import numpy as np

HORIZON_S = 4.0  # further ahead nothing counts
WEIGHT_M = 6.0  # m/s of detour that a collision in one second is worth
PULL_PER_S, NEAR, FAR = 0.5, 0.35, 0.5  # followers keep between these shares of the radio's range to those ahead
CLIMB_PER_S = 0.8
ANGLES = np.radians(np.arange(0.0, 360.0, 15.0))
SPEEDS = np.array((0.25, 0.5, 0.75, 1.0))
FAN = np.stack((np.cos(ANGLES), np.sin(ANGLES)), axis=1)


class Memory:  # a vehicle's
    def __init__(self, mission, vehicle_id):
        self.apart_m = mission.separation.hard_m + 1.0
        self.bark_m = 1.0 if mission.sensing is None else mission.sensing.vehicle_radius_m + 0.5
        self.radius_m, self.side = mission.coverage.radius_m, 1.0 if vehicle_id % 2 else -1.0


start = Memory


def transit(memory, view):
    """A leader to its goal; a follower with those that are nearer to the leader."""
    ahead = [peer for peer in view.peers if peer.ahead]
    if view.goal_ned_m is None and (view.leads or not ahead):
        return avoid(memory, view, np.zeros(2), 0.0)
    if view.goal_ned_m is not None:
        north, east, down = view.goal_ned_m
        left_m = max(0.0, math.hypot(north, east) - view.stop_m)
        speed_mps = min(view.cruise_mps, 0.8 * left_m)
        preferred = np.array((north, east)) * speed_mps / max(math.hypot(north, east), 1e-6)
        return avoid(memory, view, preferred, CLIMB_PER_S * down)
    preferred = np.mean([peer.ref_ned_mps[:2] for peer in ahead], axis=0)
    first = min(ahead, key=lambda peer: (peer.distance_m, peer.id))
    too_far_m = max(0.0, first.distance_m - FAR * view.range_m)
    too_near_m = max(0.0, min(2.0 * memory.apart_m, NEAR * view.range_m) - first.distance_m)
    way = np.array(first.rel_ned_m[:2]) / max(first.distance_m, 1e-6)
    preferred = preferred + PULL_PER_S * (too_far_m - 0.2 * too_near_m) * way
    return avoid(memory, view, preferred, CLIMB_PER_S * np.mean([peer.rel_ned_m[2] for peer in ahead]))


def cover(memory, view):
    """On to the ring about d2, and along it away from the nearest neighbour on each side."""
    if view.to_d2_ned_m is None:
        return avoid(memory, view, np.zeros(2), 0.0)
    to_tree = np.array(view.to_d2_ned_m[:2])
    off_m = max(float(np.hypot(*to_tree)), 1e-6)
    inward, along = to_tree / off_m, np.array((to_tree[1], -to_tree[0])) / off_m
    bearings = [math.atan2(*(np.array(peer.rel_ned_m[:2]) - to_tree)[::-1]) for peer in view.peers if peer.gives_way]
    own = math.atan2(-to_tree[1], -to_tree[0])
    turns = sorted((bearing - own) % math.tau for bearing in bearings)
    push = 0.5 * (turns[0] - (math.tau - turns[-1])) if turns else 0.0  # to the middle of the gap
    preferred = (off_m - memory.radius_m) * 0.5 * inward + 0.5 * memory.radius_m * push * along
    speed_mps = float(np.hypot(*preferred))
    return avoid(memory, view, preferred * min(1.0, 1.5 / max(speed_mps, 1e-6)), CLIMB_PER_S * view.to_d2_ned_m[2])


def avoid(memory, view, preferred, down_mps):
    """(north, east, down): the cheapest of the velocities, level; `down_mps` within 1 m/s."""
    speed_mps = max(1.0, float(np.hypot(*preferred)))
    tried = np.concatenate((preferred[None], np.zeros((1, 2)), *(FAN * speed_mps * share for share in SPEEDS)))
    cost = np.hypot(*(tried - preferred).T) + 1e-3 * memory.side * (tried @ (preferred[1], -preferred[0]))
    risk = np.zeros(len(tried))
    own = np.array(view.vel_ned_mps[:2])
    for peer in view.peers:
        if peer.distance_m < 30.0:
            shared = 2.0 * tried - own if peer.gives_way else tried
            risk = np.maximum(
                risk, soonest(np.array([peer.rel_ned_m[:2]]), shared - peer.vel_ned_mps[:2], memory.apart_m)
            )
    still = [rel[:2] for rel in view.silent_ned_m]
    risk = np.maximum(risk, soonest(np.array(still).reshape(-1, 2), tried, memory.apart_m))
    risk = np.maximum(risk, soonest(view.points_ne_m, tried, memory.bark_m))
    for trunk in view.trunks:
        risk = np.maximum(risk, soonest(np.array([trunk.rel_ned_m[:2]]), tried, trunk.keep_out_m + 0.5))
    north, east = tried[int((cost + WEIGHT_M * risk).argmin())].tolist()
    return north, east, max(-1.0, min(1.0, float(down_mps)))


def soonest(places, velocities, clear_m):
    """(m,) for each velocity 1 over the seconds until it comes nearer than `clear_m` to a place; 0: never."""
    if not len(places):
        return np.zeros(len(velocities))
    closing = velocities @ places.T  # (m, k)
    square = (velocities * velocities).sum(axis=1)[:, None]
    room = (places * places).sum(axis=1)[None] - clear_m * clear_m
    root = closing * closing - square * room
    time_s = np.where(room > 0.0, room / np.maximum(closing + np.sqrt(np.maximum(root, 0.0)), 1e-9), 0.1)
    meets = (closing > 0.0) & (root > 0.0) & (time_s < HORIZON_S)
    return np.where(meets, 1.0 / np.maximum(time_s, 0.1), 0.0).max(axis=1)
