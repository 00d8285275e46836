"""Pairs of vehicles in a recorded flight: how close they came, contacts, links."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mission.document.height_layers import SAME_HEIGHT_M, list_layers
from mission.document.model import Mission
from sim_bridge.judge.metrics.arrays import Bools, Floats, Ints
from sim_bridge.judge.metrics.trunks import unhidden
from sim_bridge.judge.recording import Recording
from sim_bridge.trunk_attenuation import RangeShare

# Two level F450 (0.45 m between opposite motors, 10 in propellers) touch at 0.70 m arm against arm: the hulls of 0.35 m
# that trunks are judged by, where the mission has no `sensing.vehicle_radius_m` of its own
CONTACT_M = 0.7
PAIRS_AT_ONCE = 1_000_000  # bounds memory to tens of megabytes, whatever n and T


@dataclass(frozen=True, slots=True)
class Pairs:
    """Over T ticks and the P = n (n - 1) / 2 pairs of vehicles."""

    first: Ints  # (P,) column of one vehicle
    second: Ints  # (P,) column of the other
    links: Bools  # (T, P) linked in G
    separation_m: Floats  # (T,) least separation of two vehicles in flight; inf: fewer than two
    nearest: Ints  # (T,) which pair that is
    touches: Ints  # (C, 2) tick and pair of each contact, where it begins

    def ids(self, pair: int) -> tuple[int, int]:
        """Of the two vehicles of a pair."""
        return int(self.first[pair]) + 1, int(self.second[pair]) + 1


def separation_m(recording: Recording, mission: Mission) -> Floats:
    """(T,) least separation of two vehicles in flight, as in min_separation_m; inf: fewer than two."""
    return look_at_pairs(recording, mission).separation_m


def links(recording: Recording, tick: int, share: RangeShare | None = None) -> Ints:
    """(L, 2) columns of the vehicles that are linked in G at `tick`; `share`: as for look_at_pairs."""
    first, second = np.triu_indices(recording.pos_ned_m.shape[1], k=1)
    at = slice(tick, tick + 1) if tick >= 0 else slice(tick, tick + 1 or None)
    linked = _linked(recording, at, first, second, _distance_m(recording, at, first, second), share)[0]
    return np.stack((first[linked], second[linked]), axis=1)


def in_flight(recording: Recording, mission: Mission) -> Bools:
    """(T, n) airborne, and above half the height of d1 at least once since the last touch of the ground."""
    ticks = np.arange(len(recording.time_s))[:, None]
    high = -recording.pos_ned_m[:, :, 2] > mission.route.d1_enu_m[2] / 2.0
    last_high = np.maximum.accumulate(np.where(high, ticks, -1), axis=0)
    last_ground = np.maximum.accumulate(np.where(recording.on_ground, ticks, -1), axis=0)
    return last_high > last_ground


def look_at_pairs(
    recording: Recording, mission: Mission, share: RangeShare | None = None, *, flying: Bools | None = None
) -> Pairs:
    """All about the pairs of a flight. `share`: what trunks leave of a link's range; None: all of it.

    Separation is the distance between centres; in a mission that flies in layers of height the level distance of two
    whose heights differ by less than between layers.
    `flying`: (T, n) as `in_flight`, of a recording that does not begin with the flight.
    """
    ticks, n = recording.on_ground.shape
    first, second = np.triu_indices(n, k=1)
    linked = np.zeros((ticks, len(first)), dtype=np.bool_)
    least_m = np.full(ticks, np.inf)
    nearest = np.zeros(ticks, dtype=np.intp)
    flying = in_flight(recording, mission) if flying is None else flying
    touched = np.zeros((1, len(first)), dtype=np.bool_)  # in the tick before
    touches = [np.zeros((0, 2), np.intp)]
    layered = len(list_layers(mission)) > 1
    contact_m = 2.0 * mission.vehicle_radius_m
    for at in _chunks(ticks, len(first)):
        distance_m = _distance_m(recording, at, first, second)
        linked[at] = _linked(recording, at, first, second, distance_m, share)
        both_fly = flying[at][:, first] & flying[at][:, second]
        counted_m = _level_distance_m(recording, at, first, second) if layered else distance_m
        apart_m = np.where(both_fly, counted_m, np.inf)
        if len(first):
            nearest[at] = apart_m.argmin(axis=1)
            least_m[at] = apart_m.min(axis=1)
        both_ground = recording.on_ground[at][:, first] & recording.on_ground[at][:, second]
        touching = (distance_m < contact_m) & ~both_ground
        before = np.concatenate((touched, touching[:-1]))
        touches.append(np.argwhere(touching & ~before) + np.array((at.start, 0)))
        touched = touching[-1:]
    return Pairs(first, second, linked, least_m, nearest, np.concatenate(touches))


def closest(recording: Recording, pairs: Pairs) -> tuple[tuple[int, ...], float | None]:
    """Ids of the two vehicles in flight that came closest, and when, s; empty and None: fewer than two flew."""
    if not np.isfinite(pairs.separation_m).any():
        return (), None
    tick = int(pairs.separation_m.argmin())
    return pairs.ids(pairs.nearest[tick]), float(recording.time_s[tick])


def nearest_of_each(recording: Recording, mission: Mission) -> list[tuple[float, int, float] | None]:
    """Of each vehicle how near another one in flight came, m, which one, and when, s; None: it met none.

    Distances as in look_at_pairs.
    """
    ticks, n = recording.on_ground.shape
    everyone = np.arange(n)
    flying = in_flight(recording, mission)
    layered = len(list_layers(mission)) > 1
    found: list[tuple[float, int, float] | None] = [None] * n
    for k in range(n):
        others = everyone[everyone != k]
        for at in _chunks(ticks, n):
            measure = _level_distance_m if layered else _distance_m
            apart_m = measure(recording, at, np.full(len(others), k), others)
            apart_m = np.where(flying[at][:, k, None] & flying[at][:, others], apart_m, np.inf)
            if not apart_m.size:
                continue
            tick, other = np.unravel_index(int(apart_m.argmin()), apart_m.shape)
            least_m, best = float(apart_m[tick, other]), found[k]
            if np.isfinite(least_m) and (best is None or least_m < best[0]):
                found[k] = (least_m, int(others[other]) + 1, float(recording.time_s[at][tick]))
    return found


def _distance_m(recording: Recording, at: slice, first: Ints, second: Ints) -> Floats:
    """(ticks, P) between centres."""
    north, east, down = _offsets_m(recording, at, first, second)
    distance_m: Floats = np.sqrt(north * north + east * east + down * down)
    return distance_m


def _level_distance_m(recording: Recording, at: slice, first: Ints, second: Ints) -> Floats:
    """(ticks, P) between the axes of two; inf where one is in another layer of height."""
    north, east, down = _offsets_m(recording, at, first, second)
    level_m: Floats = np.where(np.abs(down) < SAME_HEIGHT_M, np.hypot(north, east), np.inf)
    return level_m


def _offsets_m(recording: Recording, at: slice, first: Ints, second: Ints) -> Iterator[Floats]:
    """Three of (ticks, P), NED: from the second to the first."""
    return (
        recording.pos_ned_m[at, :, axis][:, first] - recording.pos_ned_m[at, :, axis][:, second] for axis in range(3)
    )


def _linked(
    recording: Recording, at: slice, first: Ints, second: Ints, distance_m: Floats, share: RangeShare | None
) -> Bools:
    """(ticks, P)"""
    able = recording.agent_alive[at] & ~recording.on_ground[at]
    range_m = recording.range_m[at]
    in_range: Bools = distance_m <= np.minimum(range_m[:, first], range_m[:, second])
    linked: Bools = in_range & able[:, first] & able[:, second]
    return linked if share is None else unhidden(recording, at, (first, second), linked, distance_m, share)


def _chunks(ticks: int, per_tick: int) -> Iterator[slice]:
    """Slices that cover `ticks`, each of about PAIRS_AT_ONCE values."""
    step = max(1, PAIRS_AT_ONCE // max(1, per_tick))
    return (slice(start, min(start + step, ticks)) for start in range(0, ticks, step))
