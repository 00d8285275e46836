"""Our law over arrays: `companion.core.formation` and the neighbours' part of `companion.core.safety`.

The flight software's functions take one vehicle and its neighbours; here the same sums are made for B x n vehicles at
once, with the constants of those modules. A test holds both equal. Not here, as nothing of it acts on these flights:
the election, fence, tree, coverage, silent neighbours and the fading of faith.
"""

from __future__ import annotations

import numpy as np

from companion.core import formation, phases, safety
from companion.core.types import NO_ROUTE
from mission.model import Mission
from sim_bridge.study import law
from sim_bridge.study.law import Bools, Floats, Law, View


class Params(law.Params):
    """None: its parameters are the flight software's."""


def make(mission: Mission, flights: int, params: Params) -> Law:  # noqa: ARG001
    """Our law."""
    return Ours(mission, flights)


class Ours:
    """State: what the last beacons said, and the last setpoints."""

    def __init__(self, mission: Mission, flights: int) -> None:
        n = mission.swarm.size
        self._mission = mission
        self._envelope = safety.Envelope.of(mission)
        self._cost = np.full((flights, n), NO_ROUTE, order="F")
        self._parent = np.full((flights, n), -1, order="F")
        self._governor = np.ones((flights, n), order="F")
        self._ref = np.zeros((flights, n, 3), order="F")
        self._setpoint = np.zeros((flights, n, 3), order="F")

    def velocity(self, view: View) -> Floats:
        """(B, n, 3) setpoints."""
        wanted = self._desired(view)
        self._setpoint = self._admit(wanted, view)
        return self._setpoint

    def _desired(self, view: View) -> Floats:
        range_m = self._mission.radio.transit_range_m
        leads, distance_m = view.leads, view.distance_m
        cost_heard = np.broadcast_to(self._cost[:, None, :], distance_m.shape)
        usable = view.heard & (cost_heard < NO_ROUTE)
        stretch = np.maximum(0.0, (distance_m / range_m - 0.5) / 0.5)
        stretch[~usable] = 0.0
        through = np.where(usable, cost_heard + (1.0 + formation.STRETCH * stretch * stretch), np.inf)
        parent = through.argmin(axis=2)
        cost = np.minimum(np.take_along_axis(through, parent[:, :, None], 2)[:, :, 0], NO_ROUTE)
        parent = np.where((cost < NO_ROUTE) & ~leads, parent, -1)
        cost = np.where(leads, 0.0, cost)
        up = view.heard & (cost_heard <= (cost - formation.UP_STEP)[:, :, None]) & (parent >= 0)[:, :, None]
        governor = self._govern(view, cost, parent, cost_heard)
        count = np.maximum(up.sum(axis=2), 1)[:, :, None]
        ref = (np.where(up[:, :, :, None], self._ref[:, None, :, :], 0.0)).sum(axis=2) / count
        ref_leader = _approach(view, self._mission)[:, None, :] * governor[:, :, None]
        ref = np.where(leads[:, :, None], ref_leader, ref)
        rise = np.where(up, view.rel_enu_m[:, :, :, 2], 0.0).sum(axis=2) / count[:, :, 0]
        pull = self._cohesion(view, up)
        pull[:, :, 2] += formation.LEVEL_GAIN_PER_S * rise
        push = self._separation(view)
        self._cost, self._parent, self._governor, self._ref = cost, parent, governor, ref
        return np.where(leads[:, :, None], ref, (ref + push) + pull)

    def _govern(self, view: View, cost: Floats, parent: law.Floats, cost_heard: Floats) -> Floats:
        range_m = self._mission.radio.transit_range_m
        n = cost.shape[1]
        at = np.maximum(parent, 0)[:, :, None].astype(np.intp)
        parent_m = np.take_along_axis(view.distance_m, at, 2)[:, :, 0]
        room_m = formation.GOVERNOR_ZERO * range_m - np.where(parent >= 0, parent_m, 0.0)
        share = np.clip(room_m / ((formation.GOVERNOR_ZERO - formation.GOVERNOR_FULL) * range_m), 0.0, 1.0)
        share = np.where(parent >= 0, share, 1.0)
        follows = view.heard & (self._parent[:, None, :] == np.arange(n)[None, :, None])
        follows &= cost_heard > cost[:, :, None]
        behind: Floats = np.where(follows, self._governor[:, None, :], 1.0).min(axis=2)
        return np.minimum(share, behind)

    def _separation(self, view: View) -> Floats:
        soft_m = self._mission.separation.soft_m
        near = view.heard & (view.distance_m < soft_m) & (view.distance_m > 1e-6)
        if not near.any():
            return np.zeros_like(view.pos_enu_m)
        distance_m = np.where(near, view.distance_m, 1.0)
        gain = np.where(near, -formation.SEPARATION_GAIN_PER_S * (soft_m - distance_m) / distance_m, 0.0)
        return _limit((view.rel_enu_m * gain[:, :, :, None]).sum(axis=2), formation.SEPARATION_LIMIT_MPS)

    def _cohesion(self, view: View, up: Bools) -> Floats:
        range_m = self._mission.radio.transit_range_m
        distance_m = np.where(up, view.distance_m, np.inf)
        followed = min(formation.FOLLOWED, distance_m.shape[2]) - 1
        farthest = np.partition(distance_m, followed, axis=2)[:, :, followed : followed + 1]
        nearest = up & (distance_m <= farthest)
        speed = np.where(
            nearest, formation.COHESION_GAIN_PER_S * (distance_m - formation.COHESION_START * range_m), 0.0
        )
        np.maximum(speed, 0.0, out=speed)
        if not speed.any():
            return np.zeros_like(view.pos_enu_m)
        strained_m = np.where(nearest, distance_m - formation.STRAIN_START * range_m, 0.0)
        left_m = np.where(nearest, range_m - distance_m, 1.0)
        speed += np.maximum(0.0, strained_m) / np.maximum(left_m, 0.3)
        share = np.where(nearest, speed / np.where(nearest, distance_m, 1.0), 0.0)
        share /= np.maximum(nearest.sum(axis=2, keepdims=True), 1)
        return _limit((view.rel_enu_m * share[:, :, :, None]).sum(axis=2), formation.COHESION_LIMIT_MPS)

    # --- the last filter ---

    def _admit(self, wanted: Floats, view: View) -> Floats:
        envelope = self._envelope
        v = self._limit_speed(wanted)
        v = self._setpoint + _limit(v - self._setpoint, envelope.acceleration_max_mps2 * view.dt_s)
        v = self._keep_apart(v, view)
        return self._shorten(v)

    def _limit_speed(self, v: Floats) -> Floats:
        v = _limit(v, self._envelope.speed_max_mps)
        v[:, :, 2] = np.clip(v[:, :, 2], -self._envelope.climb_max_mps, self._envelope.climb_max_mps)
        return v

    def _shorten(self, v: Floats) -> Floats:
        v = _limit(v, self._envelope.speed_max_mps)
        climb_mps = np.abs(v[:, :, 2:])
        return np.asarray(v * (self._envelope.climb_max_mps / np.maximum(climb_mps, self._envelope.climb_max_mps)))

    def _keep_apart(self, v: Floats, view: View) -> Floats:
        """safety.keep_within over the neighbours, in the order of their ids."""
        envelope = self._envelope
        direction = view.rel_enu_m / np.maximum(view.distance_m, 1e-6)[:, :, :, None]
        room_m = view.distance_m - envelope.hard_separation_m - safety.MARGIN_M
        braking = safety.BRAKING_SHARE * envelope.acceleration_max_mps2
        ahead_m = np.where(view.heard, np.maximum(room_m, 0.0), 0.0)
        closing = braking * (np.sqrt(safety.REACTION_S**2 + 2.0 * ahead_m / braking) - safety.REACTION_S)
        closing = np.where(room_m > 0.0, closing, room_m)
        both = view.vel_enu_mps[:, :, None, :] + view.vel_heard_enu_mps[:, None, :, :]
        most = closing / 2.0 + (both * direction).sum(axis=3) / 2.0
        most = np.where(view.heard, most, np.inf)
        for _ in range(safety.PASSES):
            if not ((direction * v[:, :, None, :]).sum(axis=3) > most).any():
                break
            for j in range(v.shape[1]):
                excess = (direction[:, :, j] * v).sum(axis=2) - most[:, :, j]
                np.maximum(excess, 0.0, out=excess)
                if excess.any():
                    v = v - direction[:, :, j] * excess[:, :, None]
        return v


def _approach(view: View, mission: Mission) -> Floats:
    """(B, 3) formation.approach of the leaders: to d1 itself before departure, to rest short of d2 after it."""
    to_goal = view.to_goal_enu_m
    distance_m = np.sqrt((to_goal * to_goal).sum(axis=1))
    gathering = view.cruise_mps != mission.route.vel_leader_mps
    stop_m = np.where(gathering, 0.0, phases.STOP_SHARE * mission.route.arrival_distance_m)
    left_m = np.maximum(0.0, distance_m - stop_m)
    speed = np.minimum(view.cruise_mps, np.sqrt(2.0 * formation.APPROACH_MPS2 * left_m))
    speed = np.minimum(speed, formation.APPROACH_GAIN_PER_S * left_m)
    toward: Floats = to_goal * (speed / np.maximum(distance_m, 1e-9))[:, None]
    return toward


def _limit(v: Floats, longest: float) -> Floats:
    """vec.limit over the last axis of (B, n, 3)."""
    length = np.sqrt((v * v).sum(axis=2, keepdims=True))
    return np.asarray(v * (longest / np.maximum(length, longest)))
