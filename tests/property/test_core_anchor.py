"""Wherever satellites say that a leader is, its way to d2 changes by no more than it may in a tick."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from companion.core.localisation.destination import Destination
from companion.core.model.vectors import add, norm, sub
from tests.unit.core.ranging_kit import ranging_mission

MISSION = ranging_mission(swarm={"gnss": [1, 2]})
metres = st.floats(-6.0, 6.0)
MOST_M = 0.025


@given(
    offs=st.lists(st.tuples(metres, metres), min_size=1, max_size=6),
    went=st.lists(st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)), min_size=30, max_size=60),
    data=st.data(),
)
def test_a_leader_goes_over_to_its_fixes_by_so_much_in_a_tick_and_gets_there(
    offs: list[tuple[float, float]], went: list[tuple[float, float]], data: st.DataObject
) -> None:
    destination = Destination(MISSION)
    here = (0.0, 0.0, -4.0)
    destination.update_anchored_leader(here, 0, here, MOST_M)
    off = (0.0, 0.0, 0.0)
    for step in went:
        if data.draw(st.booleans()):
            off = (*data.draw(st.sampled_from(offs)), 0.0)
        fixes = data.draw(st.booleans())
        before, moved = destination.ned_m, (*step, 0.0)
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
