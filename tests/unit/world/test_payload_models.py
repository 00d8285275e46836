"""The bridge's other sensors: fields with a shape, told with noise that is seeded, and nothing without [[payload]]."""

from __future__ import annotations

import numpy as np
import pytest

from companion.mavlink.framing.frames import Framing
from mission.document.model import Mission
from mission.schema.trees import StandTree
from mission.stand.stand import Stand
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.payload.drivers import HUMIDITY_SD_PCT, LIGHT_SD, TEMPERATURE_SD_C, PayloadModels
from sim_bridge.world.sensors.payload.fields import LIGHT_LX, FieldsOfStand
from sim_bridge.world.sensors.table import simulated_sensors
from tests.flights import short_mission

ZERO = (0.0, 0.0, 0.0)
BELOW = (0.0, 0.0, -4.0)  # of the crown
ASIDE = (30.0, 0.0, -4.0)
CROWN = Stand(trees=[StandTree(0.0, 0.0, 0.2, 20.0, 8.0, 3.0, "spruce")])
SOURCES = ["NAMED_VALUE_FLOAT.light", "HYGROMETER_SENSOR.temperature", "SYS_STATUS.health"]


def told(seed: int = 1, vehicle_id: int = 1, times: int = 400, place: tuple[float, float, float] = ASIDE) -> np.ndarray:
    """Rows of light, temperature, humidity."""
    model = PayloadModels([1, 2], SOURCES, CROWN, seed=seed)
    state = AirframeState(place, ZERO, ZERO, ZERO, False, 0.0)
    rows = []
    for k in range(times * 5):
        messages = Framing().read_messages(model.frames(vehicle_id, state, {}, k * 0.05))
        if messages:
            air, light = (one.message for one in messages)
            rows.append((light.value, air.temperature / 100.0, air.humidity / 100.0))
    return np.array(rows)


def test_it_is_darker_cooler_and_moister_below_a_crown() -> None:
    fields = FieldsOfStand(CROWN)
    below, aside, above = fields.at(BELOW), fields.at((0.0, 30.0, -4.0)), fields.at((0.0, 0.0, -25.0))
    assert aside.light_lx == above.light_lx == LIGHT_LX
    assert below.light_lx == pytest.approx(LIGHT_LX * np.exp(-0.25 * 12.0))
    assert below.temperature_c < aside.temperature_c - 1.5
    assert below.humidity_pct > aside.humidity_pct + 10.0


def test_it_is_warmer_to_the_north_and_cooler_above() -> None:
    fields = FieldsOfStand(Stand())
    assert fields.at((100.0, 0.0, 0.0)).temperature_c == pytest.approx(fields.at(ZERO).temperature_c + 2.0)
    assert fields.at((0.0, 0.0, -100.0)).temperature_c == pytest.approx(fields.at(ZERO).temperature_c - 0.65)


@pytest.mark.parametrize("place", [BELOW, ASIDE])
def test_sensors_tell_the_truth_within_their_noise(place: tuple[float, float, float]) -> None:
    truth, rows = FieldsOfStand(CROWN).at(place), told(place=place)
    sds = np.array([LIGHT_SD * truth.light_lx, TEMPERATURE_SD_C, HUMIDITY_SD_PCT])
    assert len(rows) == 400
    assert np.all(np.abs(rows.mean(axis=0) - np.array(truth)) < 4.0 * sds / np.sqrt(400))
    assert rows.std(axis=0) == pytest.approx(sds, rel=0.2)


def test_noise_is_of_the_seed_and_the_vehicle() -> None:
    assert np.array_equal(told(times=20), told(times=20))
    assert not np.array_equal(told(times=20), told(seed=2, times=20))
    assert not np.array_equal(told(times=20), told(vehicle_id=2, times=20))


def test_a_mission_without_payload_has_none() -> None:
    plain = short_mission()
    assert "payload" not in [sensor.name for sensor in simulated_sensors(plain, Stand(), [1])]
    table = {"payload": [{"name": "light", "unit": "lx", "source": SOURCES[0]}]}
    carrying = Mission.model_validate({**plain.model_dump(by_alias=True), **table})
    assert "payload" in [sensor.name for sensor in simulated_sensors(carrying, Stand(), [1])]
