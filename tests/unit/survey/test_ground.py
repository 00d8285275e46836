"""The ground by rays: a plane through the lowest, without litter, and none where too little was seen."""

from __future__ import annotations

import random

import pytest

from companion.survey.ground import CELLS_MAX, FRESH_S, Ground


def seen(rise: float, *, litter: float = 0.0) -> Ground:
    """Rays on a slope, some of which end on heaps."""
    ground, rng = Ground(), random.Random(1)
    for _ in range(600):
        n, e = rng.uniform(-4.0, 4.0), rng.uniform(-4.0, 4.0)
        heap = 0.4 if rng.random() < litter else 0.0
        ground.add(n, e, rise * n + 0.5 + heap + rng.gauss(0.0, 0.01), 0.0)
    return ground


@pytest.mark.parametrize("rise", [0.0, 0.3])
def test_a_slope_is_followed(rise: float) -> None:
    height_m = seen(rise).height_up_m(1.0, -0.5)
    assert height_m == pytest.approx(0.5 + rise, abs=0.08)


def test_litter_is_no_ground() -> None:
    height_m = seen(0.0, litter=0.3).height_up_m(0.0, 0.0)
    assert height_m == pytest.approx(0.5, abs=0.05)


def test_a_heap_that_fills_cells_is_left_out() -> None:
    ground = seen(0.0)
    for k in range(3):
        ground = seen(0.0)
        for _ in range(3):
            ground.add(0.5 + k, 0.5, 0.9, FRESH_S + 1.0)  # fresh, and nothing lower
        assert ground.height_up_m(0.0, 0.0) == pytest.approx(0.5, abs=0.05)


def test_nothing_is_said_of_ground_not_seen() -> None:
    ground = Ground()
    ground.add(0.2, 0.2, 1.0, 0.0)
    assert ground.height_up_m(0.0, 0.0) is None


def test_what_is_seen_later_replaces_what_is_old() -> None:
    ground = seen(0.0)
    for k in range(-3, 4):
        for j in range(-3, 4):
            ground.add(k + 0.5, j + 0.5, 0.9, FRESH_S + 1.0)  # the own height has wandered
    assert ground.height_up_m(0.0, 0.0) == pytest.approx(0.9, abs=0.05)


def test_the_cells_are_bounded() -> None:
    ground = Ground()
    for k in range(3 * CELLS_MAX):
        ground.add(1.5 * k, 0.0, 0.0, 0.1 * k)
    assert len(ground._cells) <= CELLS_MAX
