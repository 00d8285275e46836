"""Vertex connectivity, against what taking out every set of vertices finds."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_bridge.judge.metrics.arrays import Bools
from sim_bridge.judge.metrics.graph import vertex_connectivity


@st.composite
def graphs(draw: st.DrawFn) -> Bools:
    n = draw(st.integers(1, 7))
    bits = draw(st.lists(st.booleans(), min_size=n * (n - 1) // 2, max_size=n * (n - 1) // 2))
    adjacency = np.zeros((n, n), dtype=np.bool_)
    for (a, b), linked in zip(combinations(range(n), 2), bits, strict=True):
        adjacency[a, b] = adjacency[b, a] = linked
    return adjacency


def is_whole(adjacency: Bools, left: set[int]) -> bool:
    reached = {min(left)}
    while more := {b for b in left if any(adjacency[a, b] for a in reached)} - reached:
        reached |= more
    return reached == left


def by_taking_out(adjacency: Bools) -> int:
    n = len(adjacency)
    for k in range(n - 1):
        if any(not is_whole(adjacency, set(range(n)) - set(gone)) for gone in combinations(range(n), k)):
            return k
    return n - 1


@settings(max_examples=200, deadline=None)
@given(graphs())
def test_it_is_the_least_number_of_vertices_whose_loss_divides_the_rest(adjacency: Bools) -> None:
    assert vertex_connectivity(adjacency) == by_taking_out(adjacency)


def test_ring_of_fifty_that_hears_two_on_either_side_has_four_ways_and_one_of_all_links_cannot_be_divided() -> None:
    n = 50
    steps = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    apart = np.minimum(steps, n - steps)
    assert vertex_connectivity((apart > 0) & (apart <= 2)) == 4
    assert vertex_connectivity(apart > 0) == n - 1
