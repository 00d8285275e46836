"""The elections that Algorithm 1 is made of: its lines 4 to 18 as printed, un-nested, and KHOPCA's four rules as meant.

Weights as in the paper's sense: `leaderID` is the least, `weightLimit` the greatest, a step from a leader adds one.
Functions take the weights (B, n) and the neighbours `near` (B, n) of vehicle `u`, and give its new weight (B,).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_bridge.lab.study.law import Bools

Ints = NDArray[np.int64 | np.intp]

LEADER_ID = 0  # sorts below every other weight: otherwise R2 < u_w never holds beside a leader
WEIGHT_LIMIT = 4  # our choice, the paper gives none; clusters of at most this many hops


def initial_weights(n: int, rng: np.random.Generator, *, least: int = LEADER_ID + 1, limit: int = WEIGHT_LIMIT) -> Ints:
    """(n,) "initially, weights are assigned to each UAV": at random; from LEADER_ID + 1 on there is no leader yet."""
    return rng.integers(least, limit + 1, n)


def printed(weight: Ints, near: Bools, u: int, *, limit: int = WEIGHT_LIMIT) -> Ints:
    """Lines 4 to 18, nested as they are."""
    own = weight[:, u]
    most, least = _extremes(weight, near, limit)  # 4, 5: R1, R2
    beside_leader = (near & (weight == LEADER_ID)).any(axis=1)  # 6: R3
    rule1 = least < own  # 7
    own = np.where(rule1, least + 1, own)  # 8
    rule2 = rule1 & (most == limit)  # 9
    own = np.where(rule2, LEADER_ID, own)  # 10
    rule3 = rule2 & (least >= own) & (own != LEADER_ID)  # 11: never, after 10
    own = np.where(rule3, least + 1, own)  # 12
    rule4 = rule3 & (own == LEADER_ID) & beside_leader  # 13
    return np.where(rule4, own + 1, own)  # 14


def unnested(weight: Ints, near: Bools, u: int, *, limit: int = WEIGHT_LIMIT) -> Ints:
    """Lines 4 to 18 with the four rules one after the other instead of inside one another; else as printed."""
    own = weight[:, u]
    most, least = _extremes(weight, near, limit)  # 4, 5
    beside_leader = (near & (weight == LEADER_ID)).any(axis=1)  # 6
    own = np.where(least < own, least + 1, own)  # 7, 8
    own = np.where(most == limit, LEADER_ID, own)  # 9, 10: KHOPCA asks for R2 = u_w = weightLimit
    own = np.where((least >= own) & (own != LEADER_ID), least + 1, own)  # 11, 12: KHOPCA has u_w + 1
    return np.where((own == LEADER_ID) & beside_leader, own + 1, own)  # 13, 14: KHOPCA breaks the tie


def clean(weight: Ints, near: Bools, u: int, *, limit: int = WEIGHT_LIMIT) -> Ints:
    """KHOPCA: follow a better neighbour; lead where there is none; else step down; of two heads the lower id stays."""
    own = weight[:, u]
    _, least = _extremes(weight, near, limit)
    first_head = (near & (weight == LEADER_ID)).argmax(axis=1)
    beside_leader = (near & (weight == LEADER_ID)).any(axis=1)
    follows = least < own
    lonely = (least >= limit) & (own == limit)
    stale = (least >= own) & (own != LEADER_ID) & ~lonely
    beaten = (own == LEADER_ID) & beside_leader & (first_head < u)
    new = np.where(follows, least + 1, own)
    new = np.where(lonely, LEADER_ID, new)
    new = np.where(stale & ~follows, own + 1, new)
    return np.minimum(np.where(beaten, own + 1, new), limit)


def _extremes(weight: Ints, near: Bools, limit: int) -> tuple[Ints, Ints]:
    """(B,) greatest and least weight among the neighbours; without one, neither rule can hold."""
    most: Ints = np.where(near, weight, LEADER_ID - 1).max(axis=1)
    least: Ints = np.where(near, weight, limit + 1).min(axis=1)
    return most, least
