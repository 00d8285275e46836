"""Drivers of the sensors of `[[payload]]`: what they tell of the fields, with noise of their own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from companion.mavlink import dialect
from companion.mavlink.framing import wire
from mission.common.frames import Vec3
from mission.document.model import Mission
from mission.schema.payload import NAMED
from mission.stand.stand import Stand
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.payload.fields import FieldsOfStand
from sim_bridge.world.sensors.simulated import SimulatedSensor

PERIOD_S: Final = 0.25  # between two messages of a driver
LIGHT_SD: Final = 0.02  # of a value
TEMPERATURE_SD_C: Final = 0.1
HUMIDITY_SD_PCT: Final = 0.5
SALT: Final = 0x9A71  # apart from the seeds of placement, wind, radio and the others


class PayloadModels(SimulatedSensor):
    """Drivers of all vehicles. Each draws from `seed` and its vehicle's id alone, once for each message."""

    def __init__(self, ids: Sequence[int], sources: Sequence[str], stand: Stand, *, seed: int) -> None:
        """`sources`: of the mission's [[payload]]. Every NAMED_VALUE_FLOAT is light, whatever its name."""
        super().__init__("payload", by_autopilot=True)
        self._fields = FieldsOfStand(stand)
        self._named = [source.removeprefix(NAMED) for source in sources if source.startswith(NAMED)]
        self._has_hygrometer = any(source.startswith("HYGROMETER_SENSOR.") for source in sources)
        self._drivers = {k: wire.Sender(k, dialect.MAV_COMP_ID_PERIPHERAL) for k in ids}
        self._rngs = {k: np.random.default_rng([seed, SALT, k]) for k in ids}
        self._sent = dict.fromkeys(ids, -1)  # periods, of each vehicle

    def frames(
        self, vehicle_id: int, state: AirframeState, _positions_ned_m: Mapping[int, Vec3], now_s: float
    ) -> bytes:
        """HYGROMETER_SENSOR and NAMED_VALUE_FLOAT, or nothing."""
        due = math.floor(now_s / PERIOD_S + 1e-6)
        if due == self._sent[vehicle_id]:
            return b""
        self._sent[vehicle_id] = due
        truth, send = self._fields.at(state.pos_ned_m), self._drivers[vehicle_id].pack
        draws = self._rngs[vehicle_id].standard_normal(2 + len(self._named)).tolist()
        found: list[Any] = []
        if self._has_hygrometer:
            temperature_c = truth.temperature_c + TEMPERATURE_SD_C * draws[0]
            humidity_pct = min(100.0, max(0.0, truth.humidity_pct + HUMIDITY_SD_PCT * draws[1]))
            found.append(
                dialect.MAVLink_hygrometer_sensor_message(0, round(100.0 * temperature_c), round(100.0 * humidity_pct))
            )
        time_ms = round(self.stamp_s(now_s) * 1e3) & 0xFFFFFFFF
        for name, draw in zip(self._named, draws[2:], strict=True):
            light_lx = truth.light_lx * (1.0 + LIGHT_SD * draw)
            found.append(dialect.MAVLink_named_value_float_message(time_ms, name.encode(), light_lx))
        return b"".join(map(send, found))


def payload_models_of(mission: Mission, stand: Stand, ids: Sequence[int]) -> PayloadModels | None:
    """In a mission with [[payload]]; SYS_STATUS is the autopilot's own."""
    sources = [one.source for one in mission.payload]
    return PayloadModels(ids, sources, stand, seed=mission.sim.seed) if sources else None
