"""What the base station says of records that it cannot know of: those of vehicles that have flown out of range."""

from __future__ import annotations

import pytest

from companion.base.command import describe, describe_unknown
from companion.base.pace import Pace
from companion.base.station import BaseStation
from companion.core.model.states import FlightState
from companion.mavlink.beacon import COMPONENT, MESSAGE_ID, encode
from companion.mavlink.framing import wire
from companion.records.exchange import RecordExchange
from companion.records.record import BASE_ID
from companion.records.store import MEMORY, RecordStore
from companion.records.write_queue import DirectWriter
from mission.common.frames import Wgs84
from tests.unit.core.core_kit import beacon

HERE = Wgs84(48.0, 9.0, 460.0)
FLOWN = 0b10111  # 1, 2, 3 and one that is none of the mission's


@pytest.fixture
def station() -> BaseStation:
    """Of a swarm of four."""
    store = RecordStore(MEMORY, BASE_ID, lambda: 1)
    return BaseStation(RecordExchange(store, DirectWriter(store), BASE_ID, 4, 1000.0, epoch=1))


def hear(station: BaseStation, sender: int, now_s: float, *, flown: int, state: FlightState) -> None:
    said = beacon(sender, flown=flown, state=state)
    station.receive(wire.Sender(sender, COMPONENT).frame(MESSAGE_ID, encode(said, HERE)), now_s)


def test_vehicles_that_have_flown_out_of_range_may_hold_more(station: BaseStation) -> None:
    assert describe(station, Pace(), 1.0) == "0 of 0 records delivered, no vehicle in range"
    hear(station, 1, 1.0, flown=FLOWN, state=FlightState.TRANSIT)
    text = "0 of 0 records delivered, vehicles 1 in range; 2, 3 out of range: may hold more"
    assert describe(station, Pace(), 1.0) == text
    hear(station, 2, 2.0, flown=0b0010, state=FlightState.RETURNING)  # as one that has heard nobody yet
    assert station.may_hold_more(2.0) == [3]
    assert station.may_hold_more(60.0) == [1, 2, 3]


def test_one_that_was_seen_to_land_has_told_of_all(station: BaseStation) -> None:
    hear(station, 1, 1.0, flown=0b0001, state=FlightState.LANDED)
    assert describe_unknown(station, 60.0) == ""
    hear(station, 1, 61.0, flown=0b0001, state=FlightState.TAKING_OFF)
    assert describe_unknown(station, 120.0) == "1 out of range: may hold more"
