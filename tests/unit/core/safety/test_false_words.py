"""What a false word may do to a setpoint: slow it, and move it at nobody."""

from __future__ import annotations

from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from companion.core.safety.bounds import TOLERANCE_MPS
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.core.core_surroundings import surroundings

FILTER = SafetyFilter.of(mission())
OWN = Position((0.0, 0.0, -8.0), ZERO)
NEAR_M = FILTER.hard_separation_m + 0.6


def test_one_that_claims_to_be_on_top_of_a_vehicle_pushes_it_at_nobody() -> None:
    """Two that are too near contradict one another; who is to be got away from gives first."""
    beside = neighbour(2, (0.0, NEAR_M, 0.0))
    on_top = neighbour(3, (0.0, -0.5, 0.0), vel_ned_mps=(0.0, 3.0, 0.0))
    around = surroundings(OWN, (beside, on_top))
    east = FILTER.apply(ZERO, around, dt_s=10.0).vel_ned_mps[1]
    room_mps = FILTER.response.closing_mps(NEAR_M - FILTER.hard_separation_m - 0.3) / 2.0
    assert 0.0 < east <= room_mps + TOLERANCE_MPS


def test_a_place_that_others_tell_of_slows_and_one_that_was_heard_pushes() -> None:
    def along_mps(*, received: bool, desired_mps: float) -> float:
        report = PeerReport(4, (4.0, 0.0, 0.0), 5.0, silent=True, received=received)
        around = Surroundings(OWN, (), {4: report}, surroundings(OWN).cloud)
        return FILTER.apply((desired_mps, 0.0, 0.0), around, dt_s=10.0).vel_ned_mps[0]

    assert along_mps(received=False, desired_mps=3.0) < -0.1
    assert abs(along_mps(received=True, desired_mps=3.0)) <= TOLERANCE_MPS
    assert along_mps(received=True, desired_mps=-3.0) < -2.0
