"""Other sensors: messages as drivers and autopilots send them, as values in the units of a mission."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega, common

from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.sensor_source import PayloadValue
from companion.preflight.report import Check, Verdict, check_of
from companion.sensors.payload import PayloadSensors, PayloadTally
from companion.sensors.table import kinds_of, sensors_of
from tests.unit.core.core_kit import mission

ME, OTHER = 3, 4
AUTOPILOT, DRIVER = 1, 158
PAYLOAD = [
    {"name": "light", "unit": "lx", "source": "NAMED_VALUE_FLOAT.light"},
    {"name": "warmth", "unit": "degC", "source": "HYGROMETER_SENSOR.temperature"},
    {"name": "health", "unit": "1", "source": "SYS_STATUS.health"},
]
FLOWN = mission(payload=PAYLOAD)
WINDOW_S = 4.0
GYRO, BATTERY, PREARM = 0x01, 0x2000000, dialect.MAV_SYS_STATUS_PREARM_CHECK


def sent(message: Any, system: int = ME, component: int = DRIVER) -> bytes:
    """As others' programs pack it."""
    mav = common.MAVLink(None, srcSystem=system, srcComponent=component)
    frame: bytes = message.pack(mav)
    return frame


def light(value: float = 812.5, name: bytes = b"light", **who: int) -> bytes:
    return sent(common.MAVLink_named_value_float_message(1000, name, value), **who)


def air(temperature_c: float = 18.25, humidity_pct: float = 71.5, id_: int = 0, **who: int) -> bytes:
    message = common.MAVLink_hygrometer_sensor_message(id_, round(100 * temperature_c), round(100 * humidity_pct))
    return sent(message, **who)


def status(present: int, enabled: int, health: int) -> bytes:
    message = ardupilotmega.MAVLink_sys_status_message(present, enabled, health, 0, 12000, 0, 80, *[0] * 6)
    return sent(message, component=AUTOPILOT)


def endpoint() -> Endpoint:
    return Endpoint(FLOWN, ME, sensors=sensors_of(FLOWN), sensor_streams={"payload": False})


def values(one: Endpoint) -> dict[str, float]:
    return {value.source: value.value for value in one.sensors.take_values()}


def test_only_a_mission_with_the_table_reads_them() -> None:
    assert list(kinds_of(FLOWN)) == ["payload"]
    assert kinds_of(mission()) == {}


def test_a_drivers_values_come_in_the_units_of_the_mission() -> None:
    one = endpoint()
    one.from_sensor(light() + air(), 10.0, "payload")
    assert values(one) == {
        "NAMED_VALUE_FLOAT.light": 812.5,
        "HYGROMETER_SENSOR.temperature": 18.25,
        "HYGROMETER_SENSOR.humidity": 71.5,
    }
    assert values(one) == {}
    assert one.sensors.sources[0].freshness(12.0) == {DRIVER: True}
    assert one.sensors.sources[0].freshness(16.0) == {DRIVER: False}


def test_a_name_of_ten_characters_is_whole() -> None:
    one = endpoint()
    one.from_sensor(light(name=b"light_lx_a"), 10.0, "payload")
    assert values(one) == {"NAMED_VALUE_FLOAT.light_lx_a": 812.5}


def test_the_autopilot_tells_them_too() -> None:
    one = endpoint()
    one.from_autopilot(light(component=AUTOPILOT) + air(), 10.0)
    assert set(values(one)) == {
        "NAMED_VALUE_FLOAT.light",
        "HYGROMETER_SENSOR.temperature",
        "HYGROMETER_SENSOR.humidity",
    }


def test_what_comes_by_a_drivers_link_is_not_taken_from_the_autopilot_again_and_the_rest_is() -> None:
    one = endpoint()
    one.from_sensor(light(5.0), 10.0, "payload")
    one.from_autopilot(light(4.0) + air(), 10.1)
    assert values(one)["NAMED_VALUE_FLOAT.light"] == 5.0
    one.from_autopilot(light(4.0) + air(20.0), 10.2)
    assert values(one) == {"HYGROMETER_SENSOR.temperature": 20.0, "HYGROMETER_SENSOR.humidity": 71.5}


def test_another_vehicles_are_not_taken() -> None:
    one = endpoint()
    one.from_sensor(light(system=OTHER), 10.0, "payload")
    assert values(one) == {}
    assert one.sensors.foreign("payload") == {OTHER}


def test_the_first_of_two_hygrometers_counts() -> None:
    one = endpoint()
    one.from_sensor(air(20.0, id_=1) + air(30.0, id_=0), 10.0, "payload")
    assert values(one)["HYGROMETER_SENSOR.temperature"] == 20.0


@pytest.mark.parametrize(("temperature_c", "humidity_pct"), [(-327.68, 50.0), (20.0, 655.35), (150.0, 50.0)])
def test_what_a_sensor_says_when_it_knows_none_is_no_number(temperature_c: float, humidity_pct: float) -> None:
    one = endpoint()
    one.from_sensor(air(temperature_c, humidity_pct), 10.0, "payload")
    assert any(math.isnan(value) for value in values(one).values())
    assert one.sensors.sources[0].counters() == {"payload values refused": 1}


@pytest.mark.parametrize(
    ("present", "enabled", "health", "flag"),
    [
        (GYRO | BATTERY, GYRO | BATTERY, GYRO | BATTERY, 1.0),
        (GYRO | BATTERY, GYRO | BATTERY, GYRO, 0.0),
        (GYRO | BATTERY, GYRO, GYRO, 1.0),  # what is switched off is not asked for
        (GYRO | PREARM, GYRO | PREARM, GYRO, 1.0),  # a check before arming is no sensor
    ],
)
def test_health_is_of_all_sensors_that_are_there_and_enabled(
    present: int, enabled: int, health: int, flag: float
) -> None:
    one = endpoint()
    one.from_autopilot(status(present, enabled, health), 10.0)
    assert one.sensors.take_values() == [PayloadValue("SYS_STATUS.health", flag)]


def test_a_flood_between_two_ticks_is_bounded() -> None:
    source = PayloadSensors()
    for k in range(1000):
        source.decode(dialect.MAVLink_named_value_float_message(0, b"light", float(k)), DRIVER, 10.0)
    kept = source.take_values()
    assert len(kept) == 64
    assert kept[-1].value == 999.0


# --- on the ground ----------------------------------------------------------------------------------------------------


def heard(*told: tuple[Any, int]) -> Check:
    tally = PayloadTally(100.0)
    for m, system in told:
        tally.add(m, system, DRIVER, 101.0)
    return check_of("payload", tally.check(FLOWN, ME, 100.0 + WINDOW_S, "udpin://x:1"))


LIGHT = dialect.MAVLink_named_value_float_message(0, b"light", 812.5)
AIR = dialect.MAVLink_hygrometer_sensor_message(0, 1825, 7150)


def test_preflight_passes_when_each_source_is_heard() -> None:
    check = heard((LIGHT, ME), (AIR, ME))
    assert (check.verdict, check.fix) == (Verdict.PASS, "")
    assert "3/158: 0.5 Hz, HYGROMETER_SENSOR.humidity 71.5" in check.found
    assert "NAMED_VALUE_FLOAT.light 812.5" in check.found


@pytest.mark.parametrize(
    ("told", "fix"),
    [
        ((), "not heard: NAMED_VALUE_FLOAT.light, HYGROMETER_SENSOR.temperature"),
        (((AIR, ME),), "not heard: NAMED_VALUE_FLOAT.light: is the driver running, with this vehicle's system id, 3?"),
        (((AIR, ME), (LIGHT, OTHER)), "not heard: NAMED_VALUE_FLOAT.light"),
        (
            ((AIR, ME), (dialect.MAVLink_named_value_float_message(0, b"light", math.nan), ME)),
            "no number: NAMED_VALUE_FLOAT.light: is the sensor connected?",
        ),
    ],
)
def test_preflight_warns_of_what_is_not_heard_by_name(told: tuple[tuple[Any, int], ...], fix: str) -> None:
    check = heard(*told)
    assert check.verdict is Verdict.WARN
    assert fix in check.fix


def test_doctor_names_what_it_heard_and_that_it_was_no_number() -> None:
    tally = PayloadTally(100.0)
    tally.add(LIGHT, ME, DRIVER, 101.0)
    assert check_of("payload", tally.describe(104.0)).verdict is Verdict.PASS
    silent = PayloadTally(100.0)
    silent.add(dialect.MAVLink_named_value_float_message(0, b"light", math.nan), ME, DRIVER, 101.0)
    assert check_of("payload", silent.describe(104.0)).fix == "no value is a number"
