"""Surroundings: what the safety filter keeps clear of."""

from __future__ import annotations

from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from companion.core.safety.surroundings import Surroundings
from tests.unit.core.core_surroundings import surroundings

OWN = Position((0.0, 0.0, -8.0), ZERO)


def test_the_filter_keeps_clear_of_each_place_where_a_silent_vehicle_may_hover() -> None:
    hovering = {
        2: PeerReport(2, (9.0, 0.0, 0.0), 20.0, silent=True, elsewhere=((0.0, 9.0, 0.0), (0.0, 0.0, 9.0))),
        3: PeerReport(3, (4.0, 0.0, 0.0), 0.1, silent=False),  # heard: it is among the neighbours
    }
    found = Surroundings(OWN, (), hovering, surroundings(OWN).cloud)
    assert found.silent_ned_m == [(9.0, 0.0, 0.0)]
    assert found.told_ned_m == [(0.0, 9.0, 0.0), (0.0, 0.0, 9.0)]
