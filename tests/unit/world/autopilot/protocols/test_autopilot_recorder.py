"""What a recorder on the vehicle hears besides the companion's link."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame
from mission.document.model import Personality
from sim_bridge.world.autopilot import Link, StreamProfile, make_autopilot
from tests.unit.world.autopilot.autopilot_kit import ORIGIN, STEP_S, Wire, long
from tests.unit.world.autopilot.px4 import px4_kit
from tests.unit.world.autopilot.px4.px4_kit import Body

RATES_HZ = {"GLOBAL_POSITION_INT": 4.0, "ATTITUDE": 4.0, "GPS_RAW_INT": 2.0, "BATTERY_STATUS": 1.0}
KINDS = pytest.mark.parametrize("personality", list(Personality))


class Recorded(Wire):
    """A vehicle in the simulator's lockstep, heard by a recorder or not."""

    def __init__(self, personality: Personality, *, recorded: bool = True) -> None:
        super().__init__(onboard_system=1)
        self.body = Body()
        links = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}
        self.autopilot = make_autopilot(personality, 1, self.body, LocalFrame(ORIGIN), links=links)
        self.recorded = recorded
        self.onboard = b""
        self.record = b""

    def run(self, seconds: float) -> Recorded:
        for _ in range(round(seconds / STEP_S)):
            self.step()
            self.onboard += b"".join(self.autopilot.transmit(Link.ONBOARD, self.now_s))
            if self.recorded:
                self.record += self.autopilot.record(self.now_s)
        return self

    def flight(self) -> Recorded:
        """Armed after a minute, and mostly refused to do more: answers, texts and a mode change."""
        self.run(60.0)
        for message in (
            long(px4_kit.ARM, 1.0),
            long(px4_kit.SET_MODE, 1.0, 4.0),
            long(px4_kit.TAKEOFF, 0, 0, 0, 0, 0, 0, 5.0),
        ):
            self.send(message)
            self.run(1.0)
        return self.run(10.0)


def messages(data: bytes) -> list[Any]:
    return mav.MAVLink(None).parse_buffer(bytearray(data)) or []


@KINDS
def test_it_hears_where_the_vehicle_is_and_how_a_few_times_a_second(personality: Personality) -> None:
    vehicle = Recorded(personality).run(60.0)
    vehicle.record = b""
    vehicle.run(10.0)
    heard = messages(vehicle.record)
    assert Counter(m.get_type() for m in heard) == {kind: 10 * hz for kind, hz in RATES_HZ.items()}
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in heard} == {(1, 1)}
    place = next(m for m in heard if m.get_type() == "GLOBAL_POSITION_INT")
    truth = LocalFrame(ORIGIN).to_wgs84(vehicle.body.pos)
    assert (place.lat, place.lon) == (round(truth.lat_deg * 1e7), round(truth.lon_deg * 1e7))


@KINDS
def test_a_companion_is_told_the_same_bytes_whether_anybody_records(personality: Personality) -> None:
    alone = Recorded(personality, recorded=False).flight()
    recorded = Recorded(personality).flight()
    assert alone.onboard == recorded.onboard
    assert recorded.record


def test_px4s_texts_are_heard_as_a_companion_is_not_told_them() -> None:
    vehicle = Recorded(Personality.PX4).flight()
    assert "STATUSTEXT" not in {m.get_type() for m in messages(vehicle.onboard)}
    texts = [m.text for m in messages(vehicle.record) if m.get_type() == "STATUSTEXT"]
    assert texts
    assert len(texts) == len(set(texts))


def test_ardupilots_texts_are_on_its_companions_link_alone() -> None:
    vehicle = Recorded(Personality.ARDUPILOT).flight()
    assert "STATUSTEXT" in {m.get_type() for m in messages(vehicle.onboard)}
    assert "STATUSTEXT" not in {m.get_type() for m in messages(vehicle.record)}


@KINDS
def test_what_a_companion_has_streamed_to_it_is_not_recorded_twice(personality: Personality) -> None:
    vehicle = Recorded(personality).run(60.0)
    vehicle.send(long(px4_kit.SET_INTERVAL, float(mav.MAVLINK_MSG_ID_ATTITUDE), 50_000.0))
    vehicle.send(long(px4_kit.SET_INTERVAL, float(mav.MAVLINK_MSG_ID_GPS_RAW_INT), 1_000_000.0))
    vehicle.record = vehicle.onboard = b""
    vehicle.run(10.0)
    recorded = Counter(m.get_type() for m in messages(vehicle.record))
    assert Counter(m.get_type() for m in messages(vehicle.onboard))["ATTITUDE"] == 200
    assert "ATTITUDE" not in recorded
    assert recorded["GPS_RAW_INT"] == 20  # seldom on that link


def test_battery_and_attitude_tell_what_the_vehicle_has() -> None:
    flight = px4_kit.Flight().airborne()
    flight.body.yaw = 1.25
    battery, attitude = (flight.ask(long(px4_kit.REQUEST, float(number)))[0] for number in (147, 30))
    state = flight.autopilot._readings.battery
    assert state.consumed_mah > 10.0
    assert {name: getattr(battery, name) for name in battery.fieldnames} == {
        "id": 0,
        "battery_function": 1,  # MAV_BATTERY_FUNCTION_ALL
        "type": 1,  # MAV_BATTERY_TYPE_LIPO
        "temperature": 32767,
        "voltages": [round(state.voltage_v * 1000.0)] + [65535] * 9,
        "current_battery": round(state.current_a * 100.0),
        "current_consumed": round(state.consumed_mah),
        "energy_consumed": -1,
        "battery_remaining": round(state.remaining * 100.0),
        "time_remaining": 0,
        "charge_state": mav.MAV_BATTERY_CHARGE_STATE_OK,
        "voltages_ext": [0] * 4,
        "mode": 0,
        "fault_bitmask": 0,
    }
    assert (attitude.roll, attitude.pitch, attitude.yaw) == (0.0, 0.0, 1.25)
    assert attitude.time_boot_ms == round(flight.now_s * 1000.0)
