"""Broadcast estimates of where vehicles are, held against where they are."""

from __future__ import annotations

import math
from typing import Any

import pytest

from companion.core.model.beacon import RelativeReport
from companion.core.model.states import SwarmPhase
from companion.mavlink.beacon import WireBeacon
from companion.mavlink.own_messages import DESTINATION, ESTABLISHED
from sim_bridge.judge.estimate_recorder import HANDOVER_S, EstimateRecorder
from sim_bridge.judge.tick import Tick
from tests.unit.judge.metrics_kit import a_mission
from tests.unit.judge.tick_kit import a_tick

D2_NE_M = (0.0, 100.0)  # of `a_mission`, 10 m up
NOTHING = WireBeacon(**dict.fromkeys(WireBeacon._fields, 0) | {"members": b""})
PLACES = ((0.0, 0.0, -10.0), (0.0, -10.0, -10.0))  # vehicles 1 and 2


def tick(
    time_s: float,
    *,
    leader: int = 1,
    dest: tuple[float, float] = (0.0, 100.0),
    phase: SwarmPhase = SwarmPhase.TRANSIT,
    **changes: Any,
) -> Tick:
    """Two vehicles in the air that have both told in this tick that `leader` leads, and its vector to d2."""
    flags = DESTINATION | (ESTABLISHED if leader else 0)
    said = {
        k: NOTHING._replace(
            time_boot_ms=round(1000 * time_s), dest_x=dest[0], dest_y=dest[1], leader=leader, phase=phase, flags=flags
        )
        for k in (1, 2)
    }
    values: dict[str, Any] = {
        "pos_ned_m": PLACES,
        "on_ground": (False, False),
        "said": said,
        "said_s": {1: time_s, 2: time_s},
        "north_off_rad": (0.0, 0.0),
        "asked_ned_mps": ((0.0, 3.0, 0.0), (0.0, 3.0, 0.0)),
    }
    return a_tick(time_s, n=2, **(values | changes))


def heard(*ticks: Tick) -> Any:
    recorder = EstimateRecorder(a_mission())
    for one in ticks:
        recorder.add(one)
    return recorder.figures()


def word(time_s: float, to_leader: tuple[float, float], sd_m: float = 0.5) -> dict[int, RelativeReport]:
    return {2: RelativeReport(2, round(1000 * time_s), (0.0, 0.0), to_leader, sd_m)}


def test_the_error_of_a_flight_is_that_of_what_followers_told_of_their_leader() -> None:
    told = heard(tick(0.0), tick(0.1, words=word(0.1, (0.6, 10.0))), tick(0.2, words=word(0.2, (0.0, 10.8), 0.4)))
    assert told.relative_error_m == pytest.approx(math.sqrt((0.36 + 0.64) / 2))
    assert told.relative_error_sds == pytest.approx(math.sqrt((1.2**2 + 2.0**2) / 2))


def test_what_was_told_before_counts_once_and_on_the_ground_not_at_all() -> None:
    first = word(0.1, (0.0, 10.5))
    told = heard(tick(0.0), tick(0.1, words=first), tick(0.2, words=first))
    assert told.relative_error_m == pytest.approx(0.5)
    assert heard(tick(0.0), tick(0.1, words=first, on_ground=(False, True))).relative_error_m is None


def test_a_leader_errs_at_d2_by_where_its_vector_leads_along_its_own_north() -> None:
    covers = SwarmPhase.COVERAGE
    right = heard(tick(0.0), tick(0.1, phase=covers), tick(0.2, phase=covers, dest=(9.0, 9.0)))
    assert right.leader_error_d2_m == pytest.approx(0.0)  # the first word counts
    turned = heard(tick(0.0), tick(0.1, phase=covers, north_off_rad=(0.02, 0.0)))
    assert turned.leader_error_d2_m == pytest.approx(2.0 * 100.0 * math.sin(0.01))


def test_an_heir_jumps_by_what_its_vector_leads_elsewhere_than_its_predecessors() -> None:
    told = heard(tick(0.0), tick(0.1), tick(0.2, leader=2, dest=(0.3, 110.4)), tick(0.3, leader=2, dest=(7.0, 110.0)))
    assert told.handover_jump_m == pytest.approx(0.5)
    assert heard(tick(0.0), tick(0.1), tick(0.2)).handover_jump_m is None


def test_setpoints_count_from_the_loss_of_a_leader_until_a_while_after_its_heir_acts() -> None:
    def asked(east_mps: float) -> dict[str, Any]:
        return {"asked_ned_mps": ((0.0, east_mps, 0.0), (0.0, 3.0, 0.0))}

    led = [tick(0.0), tick(0.1, **asked(1.0))]
    assert heard(*led).handover_step_mps is None
    lost = [*led, tick(0.2, leader=0, **asked(0.9)), tick(0.3, leader=2, dest=(0.0, 110.0), **asked(0.7))]
    assert heard(*lost).handover_step_mps == pytest.approx(0.2)
    late_s = 0.3 + HANDOVER_S
    late = [tick(late_s - 0.1, leader=2, **asked(0.7)), tick(late_s + 0.1, leader=2, **asked(5.0))]
    assert heard(*lost, *late).handover_step_mps == pytest.approx(0.2)


def test_of_external_vehicles_nothing_is_known() -> None:
    told = heard(tick(0.0), tick(0.1, north_off_rad=(), asked_ned_mps=(), words=word(0.1, (5.0, 5.0))))
    assert set(told.as_dict().values()) == {None}
