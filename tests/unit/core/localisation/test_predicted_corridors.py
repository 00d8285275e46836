"""Lanes of those that trees hide: where they were heard last, and whither they flew."""

from __future__ import annotations

import pytest

from companion.core.guidance import formation
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.movement import Guidance
from companion.core.localisation.peer_table import PeerTable
from companion.core.localisation.predicted_corridors import (
    FROM_S,
    GAIN_PER_S,
    LEAST_MPS,
    LIMIT_MPS,
    REACH_M,
    UNTIL_S,
    PredictedCorridor,
    keep_clear_of,
    lane,
)
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO
from mission.common.frames import Vec3
from tests.unit.core.core_kit import heard_beacon, mission
from tests.unit.core.core_surroundings import surroundings

HERE: Vec3 = (100.0, 50.0, -8.0)
EAST: Vec3 = (0.0, 3.0, 0.0)
CLEAR_M = 6.2


def eastward(rel_ned_m: Vec3) -> PredictedCorridor:
    found = lane(rel_ned_m, EAST)
    assert found is not None
    return found


def lanes(
    age_s: float, *, here: Vec3 = HERE, rel_ned_m: Vec3 = (4.0, -8.0, 0.0), vel: Vec3 = EAST
) -> list[PredictedCorridor]:
    """Of a vehicle that was heard so long ago."""
    table = PeerTable(size=8)
    table.store_beacon(heard_beacon(2, rel_ned_m=rel_ned_m, vel_ned_mps=vel, airborne=True), HERE, 10.0)
    return table.predict_corridors(here, 10.0 + age_s, range_m=30.0)


def wish(state: FlightState, *lanes: PredictedCorridor, layer_m: float | None = None) -> Vec3:
    """Of a leader bound east at 3 m/s."""
    return Guidance(mission(sensing={}), 1).find_desired(
        GuidanceInput(
            surroundings(Position((0.0, 50.0, -8.0), ZERO)),
            state=state,
            phase=SwarmPhase.TRANSIT,
            route=formation.LEADER_ROUTE,
            range_m=30.0,
            role=Role.LEADER,
            governor=1.0,
            lease_freshness=1.0,
            goal=((0.0, 130.0, -8.0), 4.0),
            size=3,
            corridors=lanes,
            layer_m=layer_m,
        )
    )


@pytest.mark.parametrize("along_m", [-20.0, 0.0, 20.0])
def test_vehicle_beside_a_lane_moves_away_from_it_and_not_along_it(along_m: float) -> None:
    north, east, down = keep_clear_of([eastward((5.0, along_m, 0.0))], clear_m=CLEAR_M)  # the lane is north of it
    assert (east, down) == pytest.approx((0.0, 0.0))
    assert north == pytest.approx(-GAIN_PER_S * (CLEAR_M - 5.0))
    assert keep_clear_of([eastward((-5.0, along_m, 0.0))], clear_m=CLEAR_M)[0] == pytest.approx(-north)


def test_nearer_to_the_lane_the_push_is_stronger() -> None:
    pushes = [-keep_clear_of([eastward((off_m, 0.0, 0.0))], clear_m=CLEAR_M)[0] for off_m in (5.1, 5.5, 5.9, 6.1)]
    assert pushes == sorted(pushes, reverse=True)
    assert 0.0 < pushes[-1] < pushes[0] <= LIMIT_MPS


@pytest.mark.parametrize(
    "place", [(8.0, 0.0, 0.0), (5.0, REACH_M + 1.0, 0.0), (5.0, -REACH_M - 1.0, 0.0), (5.0, 0.0, 9.0)]
)
def test_lane_that_is_far_off_moves_nobody(place: Vec3) -> None:
    assert keep_clear_of([eastward(place)], clear_m=CLEAR_M) == ZERO


def test_lanes_on_both_sides_cancel() -> None:
    assert keep_clear_of([eastward((5.0, 0.0, 0.0)), eastward((-5.0, 0.0, 0.0))], clear_m=CLEAR_M) == pytest.approx(
        ZERO
    )


def test_one_that_stood_has_no_lane() -> None:
    assert lane((5.0, 0.0, 0.0), (0.0, 0.9 * LEAST_MPS, 3.0)) is None
    assert lanes(3.0, vel=ZERO) == []


def test_one_that_is_not_heard_any_more_has_a_lane_for_a_while() -> None:
    assert lanes(FROM_S - 0.1) == []
    (one,) = lanes(FROM_S + 0.1)
    assert (one.rel_ned_m, one.course) == ((4.0, -8.0, 0.0), pytest.approx((0.0, 1.0)))
    assert lanes(UNTIL_S + 0.1) == []


def test_lane_stays_where_it_was_while_the_vehicle_itself_moves() -> None:
    (one,) = lanes(3.0, here=(103.0, 51.0, -8.0))
    assert one.rel_ned_m == pytest.approx((1.0, -9.0, 0.0))


def test_one_that_has_left_the_range_has_no_lane() -> None:
    assert lanes(3.0, rel_ned_m=(29.5, 0.0, 0.0)) == []


@pytest.mark.parametrize("state", [FlightState.TRANSIT, FlightState.SEEKING, FlightState.HOLD])
def test_vehicle_keeps_off_the_lanes_of_the_hidden_under_way_and_when_it_holds(state: FlightState) -> None:
    off = wish(state, eastward((4.0, -10.0, 0.0)))
    assert off == pytest.approx((wish(state)[0] - LIMIT_MPS, *wish(state)[1:]))


@pytest.mark.parametrize(
    ("state", "layer_m", "keeps_off"),
    [
        (FlightState.HOLD, 6.0, False),
        (FlightState.TRANSIT, 6.0, False),
        (FlightState.HOLD, 8.0, False),
        (FlightState.TRANSIT, 8.0, True),
    ],
)
def test_in_layers_of_height_only_who_flies_at_the_missions_keeps_off_lanes(
    state: FlightState, layer_m: float, keeps_off: bool
) -> None:
    """Who stands is to be where the others take it to be."""
    hidden = eastward((4.0, -10.0, 0.0))
    assert (wish(state, hidden, layer_m=layer_m) != wish(state, layer_m=layer_m)) is keeps_off


def test_vehicle_on_its_place_at_the_tree_leaves_lanes_alone() -> None:
    assert wish(FlightState.COVERAGE, eastward((4.0, -10.0, 0.0))) == wish(FlightState.COVERAGE)
