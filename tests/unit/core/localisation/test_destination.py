"""The vector to d2 of a follower: others' words, as far as its own odometry bears them out."""

from __future__ import annotations

import math

import pytest

from companion.core.localisation.destination import FOLLOW_M, FOLLOW_MPS, Destination
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission, neighbour

TRUE: Vec3 = (0.0, 50.0, 0.0)
TICK_S = 0.05


def told(vector: Vec3) -> list[object]:
    return [neighbour(2, (5.0, 0.0, 0.0), dest_ned_m=vector)]


def after(seconds: float, vector: Vec3, followed: Destination, *, from_s: float = 0.0) -> Vec3:
    for k in range(1, round(seconds / TICK_S) + 1):
        followed.update_follower((0.0, 0.0, -8.0), 0, told(vector), from_s + k * TICK_S)  # type: ignore[arg-type]
    assert followed.ned_m is not None
    return followed.ned_m


def test_what_differs_a_little_counts_at_once_and_to_the_bit() -> None:
    followed = Destination(mission())
    assert after(1.0, TRUE, followed) == TRUE
    near = (1.0, 51.0, 0.5)
    assert after(TICK_S, near, followed, from_s=1.0) == near


@pytest.mark.parametrize("seconds", [0.05, 2.0, 10.0])
def test_a_false_word_moves_it_as_fast_as_odometry_may_drift(seconds: float) -> None:
    followed = Destination(mission())
    after(1.0, TRUE, followed)
    moved_m = math.dist(after(seconds, (0.0, 1000.0, 0.0), followed, from_s=1.0), TRUE)
    assert moved_m == pytest.approx(FOLLOW_M + FOLLOW_MPS * seconds, abs=0.1)


def test_who_did_not_know_its_place_takes_others_words() -> None:
    followed = Destination(mission())
    after(1.0, TRUE, followed)
    followed.forget_odometry()
    assert after(TICK_S, (30.0, 50.0, 0.0), followed, from_s=1.0) == (30.0, 50.0, 0.0)
