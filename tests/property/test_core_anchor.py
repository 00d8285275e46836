"""Wherever satellites say that a leader is, its way to d2 changes by no more than it may in a tick."""

from __future__ import annotations

import math
import random

from hypothesis import given
from hypothesis import strategies as st

from companion.core.localisation.destination import Destination
from companion.core.model.vectors import add, norm, sub
from tests.unit.core.ranging_kit import ranging_mission

MISSION = ranging_mission(swarm={"gnss": [1, 2]})
metres = st.floats(-6.0, 6.0)
MOST_M = 0.025


def went_m(rng: random.Random) -> float:
    """Of one tick along one axis: anything up to 0.2 m, and often the most, or nothing."""
    return rng.choice((-0.2, 0.0, 0.2, rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2)))


@given(
    offs=st.lists(st.tuples(metres, metres), min_size=1, max_size=6),
    steps=st.integers(30, 60),
    seed=st.integers(0, 2**32 - 1),  # hundreds of draws an example would cost more than what is tested
)
def test_a_leader_goes_over_to_its_fixes_by_so_much_in_a_tick_and_gets_there(
    offs: list[tuple[float, float]], steps: int, seed: int
) -> None:
    rng = random.Random(seed)
    destination = Destination(MISSION)
    here = (0.0, 0.0, -4.0)
    destination.update_anchored_leader(here, 0, here, MOST_M)
    off = (0.0, 0.0, 0.0)
    for _ in range(steps):
        if rng.random() < 0.5:
            off = (*rng.choice(offs), 0.0)
        fixes = rng.random() < 0.5
        before, moved = destination.ned_m, (went_m(rng), went_m(rng), 0.0)
        here = add(here, moved)
        fix = add(here, off) if fixes else None
        destination.update_anchored_leader(here, 0, fix, MOST_M)
        assert before is not None
        assert destination.ned_m is not None
        assert norm(sub(add(destination.ned_m, moved), before)) <= MOST_M + 1e-9
    for _ in range(math.ceil(40.0 / MOST_M)):  # whatever came before
        destination.update_anchored_leader(here, 0, add(here, off), MOST_M)
        if destination.lag_m == 0.0:
            break
    assert destination.lag_m == 0.0
    assert destination.ned_m == sub((0.0, 40.0, -4.0), add(here, off))


def test_where_it_leads_from_the_first_it_is_where_its_fix_says_at_once() -> None:
    destination = Destination(MISSION)
    destination.update_anchored_leader((0.0, 0.0, -4.0), 0, (7.0, 1.0, -4.0), MOST_M)
    assert destination.ned_m == (-7.0, 39.0, 0.0)
