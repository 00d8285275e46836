"""What stands in the way: vehicles in the air that no companion steers, silent or heard."""

from __future__ import annotations

import pytest

from companion.core.model.beacon import PeerReport
from companion.core.model.states import CLIMBING, STEERED, FlightState
from companion.core.perception.obstacle_cloud import find_hovering
from tests.unit.core.core_kit import neighbour

REL = (3.0, 4.0, -1.0)


@pytest.mark.parametrize("airborne", [True, False], ids=["in_air", "on_ground"])
@pytest.mark.parametrize("state", list(FlightState))
def test_heard_vehicle_in_the_air_that_is_neither_steered_nor_climbing_stands(
    state: FlightState, airborne: bool
) -> None:
    one = neighbour(3, REL, age_s=0.2, state=state, airborne=airborne)
    stands = airborne and state not in STEERED | CLIMBING
    expected = {3: PeerReport(3, REL, 0.2, silent=False)} if stands else {}
    assert find_hovering({}, [one]) == expected


def test_silent_vehicles_stand_beside_those_that_are_heard() -> None:
    silent = {2: PeerReport(2, (9.0, 0.0, 0.0), 4.0, silent=True)}
    pilots = neighbour(3, REL, state=FlightState.RELEASED, airborne=True)
    assert list(find_hovering(silent, [pilots, neighbour(4, REL, airborne=True)])) == [2, 3]
    assert list(silent) == [2]
