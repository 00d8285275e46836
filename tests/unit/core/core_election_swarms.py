"""Swarms as hypothesis draws them: links, priorities, losses."""

from __future__ import annotations

import random
from typing import Any

from hypothesis import strategies as st

from companion.core.swarm.election import ACT_PERIODS
from tests.unit.core.core_election_net import (
    Edge,
)

# A claim is acted upon after the way to all and back: deeper networks take longer than these tests wait.
MAX_DIAMETER = ACT_PERIODS


def random_links(ids: list[int], rng: random.Random, *, density: float, reach: int) -> set[Edge]:
    """A random tree, in which a vehicle hangs on one of the `reach` before it (1: a chain), and more links."""
    edges = {(ids[k], ids[rng.randrange(max(0, k - reach), k)]) for k in range(1, len(ids))}
    edges |= {(a, b) for a in ids for b in ids if a < b and rng.random() < density}
    return edges


@st.composite
def swarms(draw: st.DrawFn, *, connected: bool = True, priorities: bool = True, near: bool = False) -> dict[str, Any]:
    """Arguments of a Net: up to 12 vehicles, one component or several; `near`: most a few hops from one another."""
    ids = draw(st.lists(st.integers(1, 250), min_size=1, max_size=12, unique=True))
    rng = random.Random(draw(st.integers(0, 2**32)))
    cut = len(ids) if connected else draw(st.integers(0, len(ids)))
    density, reach = draw(
        st.sampled_from([(0.3, 12), (0.6, 12)] if near else [(0.0, 1), (0.0, 3), (0.1, 12), (0.4, 12)])
    )
    edges = random_links(ids[:cut], rng, density=density, reach=reach)
    edges |= random_links(ids[cut:], rng, density=density, reach=reach)
    some = st.sampled_from([0, 0, 0, 1, 2]) if priorities else st.just(0)
    return {
        "ids": ids,
        "edges": edges,
        "priority": {i: draw(some) for i in ids},
        "score": {i: draw(st.integers(0, 10)) for i in ids},
        "seed": draw(st.integers(0, 2**32)),
    }
