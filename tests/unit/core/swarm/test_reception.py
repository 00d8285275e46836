"""What reception does to the election: those that have a GNSS fix come first, by how well, and none claims more."""

from __future__ import annotations

import math

import pytest

from companion.core.model.beacon import Candidate, Lease
from companion.core.model.states import FlightState, Reception, SwarmPhase
from companion.core.swarm.priorities import BARRED_S, Priorities, Resignation, score_of
from companion.core.swarm.swarm import Swarm
from companion.core.vehicle.failsafe import LOW_BATTERY_PERCENT
from companion.core.vehicle.operator_orders import OperatorOrders
from tests.unit.core.core_kit import beacon, mission, neighbour, picture
from tests.unit.core.ranging_kit import ranging_mission

MISSION = ranging_mission(swarm={"gnss": [1, 3], "leader_priority": [1, 2]})
ABOVE = 3  # the list's length and 1


@pytest.mark.parametrize(
    ("vehicle", "reception", "priority"),
    [
        (1, Reception.GOOD, 2 + ABOVE),
        (1, Reception.POOR, 2 + ABOVE),
        (1, Reception.NONE, 2),
        (2, Reception.NONE, 1),
        (3, Reception.GOOD, ABOVE),  # not listed, and before 2, which is
        (3, Reception.NONE, 0),
        (4, Reception.NONE, 0),
    ],
)
def test_one_that_hears_satellites_precedes_all_that_do_not(vehicle: int, reception: Reception, priority: int) -> None:
    assert Priorities(MISSION).of(vehicle, reception) == priority


@pytest.mark.parametrize(
    ("vehicle", "priority", "believed"),
    [
        (1, 5, True),
        (1, 2, True),
        (1, 4, False),
        (2, 1, True),
        (2, 1 + ABOVE, False),
        (3, ABOVE, True),
        (4, ABOVE, False),
    ],
)
def test_only_what_the_mission_gives_a_vehicle_is_believed(vehicle: int, priority: int, believed: bool) -> None:
    swarm = Swarm(MISSION, 2 if vehicle == 1 else 1, OperatorOrders())
    told = beacon(vehicle, candidate=Candidate(vehicle, priority, 9))
    assert (swarm.sanitise_beacon(told, 1.0).candidate is not None) is believed
    lease = Lease(vehicle, 1000, priority, 9, established=True)
    swarm.receive_beacon(beacon(vehicle, lease=lease), 1.0)
    held = swarm.election.lease
    assert (held is not None and held.leader == vehicle) is believed


def test_a_radio_is_set_to_no_less_than_any_phase_asks_for() -> None:
    """One that told 0 m would alarm nobody when it falls silent."""
    radio = MISSION.radio
    least_m = min(radio.transit_range_m, radio.full_range_m)
    swarm = Swarm(MISSION, 1, OperatorOrders())
    assert swarm.sanitise_beacon(beacon(2, range_m=0.0), 1.0).range_m == least_m
    for told_m in (least_m, radio.full_range_m):
        assert swarm.sanitise_beacon(beacon(2, range_m=told_m), 1.0).range_m == told_m


@pytest.mark.parametrize(
    ("phase", "is_compact"),
    [
        (SwarmPhase.GATHER, True),
        (SwarmPhase.TRANSIT, True),
        (SwarmPhase.COVERAGE, False),
        (SwarmPhase.RETURN, True),
        (SwarmPhase.LAND, False),
    ],
)
def test_a_swarm_keeps_as_compact_on_the_way_back_as_on_the_way_out(phase: SwarmPhase, *, is_compact: bool) -> None:
    """On the ring it has spread: with that range it would also come back, and land twice as wide as it took off."""
    radio, swarm = MISSION.radio, Swarm(MISSION, 1, OperatorOrders())
    swarm.phases.adopt_phase(phase, 1.0)
    assert swarm.formation_range_m == (radio.transit_range_m if is_compact else radio.full_range_m)


@pytest.mark.parametrize("phase", [SwarmPhase.COVERAGE, SwarmPhase.RETURN, SwarmPhase.LAND])
def test_from_the_tree_on_the_radio_has_all_of_its_range(phase: SwarmPhase) -> None:
    """They leave it as widely as they have spread about it."""
    swarm = Swarm(MISSION, 2, OperatorOrders())
    swarm.receive_beacon(beacon(1, lease=Lease(1, 1000, 2, 9, established=True)), 1.0)
    assert swarm.radio_range_m(airborne=True, misses=False) == MISSION.radio.transit_range_m
    swarm.phases.adopt_phase(phase, 1.0)
    assert swarm.radio_range_m(airborne=True, misses=False) == MISSION.radio.full_range_m


@pytest.mark.parametrize(
    ("battery_percent", "reception", "score"),
    [
        (100, Reception.GOOD, 10),
        (99, Reception.POOR, 4),
        (99, Reception.NONE, 2),
        (39, Reception.NONE, 0),
        (None, Reception.GOOD, 0),
    ],
)
def test_how_good_it_is_counts_in_the_score(battery_percent: int | None, reception: Reception, score: int) -> None:
    assert score_of(battery_percent, reception) == score


def test_where_all_have_satellites_the_list_is_all_there_is() -> None:
    mission = ranging_mission(swarm={"gnss": "all", "leader_priority": [2, 1]})
    swarm = Swarm(mission, 1, OperatorOrders())
    assert Priorities(mission).of(1, Reception.GOOD) == 1
    swarm.receive_beacon(beacon(2, lease=Lease(2, 1000, 5, 9, established=True)), 1.0)
    assert swarm.election.lease is None


def test_a_swarm_whose_leader_has_lost_its_place_does_not_leave_d1_until_it_has_it_again() -> None:
    """It would turn back at once."""
    swarm = Swarm(MISSION, 1, OperatorOrders())
    swarm.phases.adopt_phase(SwarmPhase.GATHER, 0.0)
    swarm.roster.done = 0b1111
    for k in range(50):
        swarm.decide_phase(picture(now_s=0.1 * k, is_position_lost=True), 0.0)
    assert swarm.phases.phase is SwarmPhase.GATHER
    assert [say.text for say in swarm.take_reports()] == ["position uncertain: waiting at d1"]
    for k in range(50, 100):
        swarm.decide_phase(picture(now_s=0.1 * k), 0.0)
    assert swarm.phases.phase > SwarmPhase.GATHER


@pytest.mark.parametrize(("battery_percent", "out_s"), [(60, BARRED_S), (19, math.inf)])
@pytest.mark.parametrize("hears", [True, False])
def test_a_leader_that_had_to_resign_does_not_lead_by_turns(battery_percent: int, out_s: float, hears: bool) -> None:
    """It took the lead back each time that its battery was at 20 % again, or a scan came, and nobody decided."""
    swarm = Swarm(mission(swarm={"size": 3, "leader_priority": [1]}), 1, OperatorOrders())
    led_s: list[float] = []
    for k in range(600):
        now_s, flaps = 0.1 * k, 100 <= k < 200 and k % 10 < 5
        now = picture(
            now_s=now_s,
            state=FlightState.TRANSIT,
            airborne=True,
            battery_percent=battery_percent if flaps else max(20, battery_percent),
            neighbours=[neighbour(2, (10.0, 0.0, 0.0))] if hears else [],
        )
        swarm.run_period(now, resigns=flaps)
        led_s += [now_s] if swarm.election.acts else []
    assert 9.9 in [round(at_s, 1) for at_s in led_s]
    again_s = min([at_s for at_s in led_s if at_s > 12.0], default=math.inf)
    if not hears:
        assert again_s < 22.0  # nobody else would lead
    elif out_s == math.inf:
        assert again_s == math.inf
    else:
        assert 19.4 + out_s < again_s < 25.0 + out_s


def test_who_was_out_by_a_low_battery_may_lead_with_one_that_is_not() -> None:
    resignation, near = Resignation(), [neighbour(2, (10.0, 0.0, 0.0))]

    def is_out(now_s: float, battery_percent: int) -> bool:
        now = picture(now_s=now_s, state=FlightState.TRANSIT, battery_percent=battery_percent, neighbours=near)
        return resignation.update(now, leads=now_s == 0.0, resigns=battery_percent < LOW_BATTERY_PERCENT)

    assert [is_out(now_s, percent) for now_s, percent in ((0.0, 19), (20.0, 24), (40.0, 25))] == [True, True, False]
