"""Sensors that nothing is flown by: HYGROMETER_SENSOR, NAMED_VALUE_FLOAT, and the health flags of SYS_STATUS."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import Any, Final, Self

from companion.core.model.events import Event
from companion.mavlink import dialect
from companion.mavlink.codec import PREARM_OK
from companion.mavlink.sensor_source import Finding, PayloadValue, SensorSource, SensorTally
from companion.mavlink.streams import STREAMS_HZ
from mission.document.model import Mission
from mission.schema.payload import HEALTH, NAMED

FRESH_S: Final = 5.0  # drivers send once a second or more often
VALUES_MAX: Final = 64  # between two ticks; beyond, the oldest are lost
SOURCES_MAX: Final = 32  # that a tally names
TEMPERATURE_C: Final = (-90.0, 100.0)  # of air; beyond it, and beyond HUMIDITY_PCT, a sensor says that it knows none
HUMIDITY_PCT: Final = (0.0, 110.0)  # some say a little more than 100 in fog
SYS_STATUS: Final = dialect.MAVLINK_MSG_ID_SYS_STATUS


class PayloadSensors(SensorSource):
    """A vehicle's other sensors, in a mission with [[payload]]: by links of their own, or by way of the autopilot."""

    NAME = "payload"
    TITLE = "payload"
    MESSAGES = {  # noqa: RUF012
        dialect.MAVLINK_MSG_ID_HYGROMETER_SENSOR: "HYGROMETER_SENSOR",
        dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: "NAMED_VALUE_FLOAT",
    }
    HELP = "HYGROMETER_SENSOR, NAMED_VALUE_FLOAT, in a mission with [[payload]]; else taken from the autopilot's link"
    ABOUT = (
        "In a mission with [[payload]]: each source that it names is heard, on a sensor's link or else by way of the "
        "autopilot, with the vehicle's own system id, and is a number. A warning, as nothing is flown by it: what is "
        "not heard is not recorded."
    )
    UNUSED = "has no [[payload]], so nothing would be recorded of this sensor. Add the table, or leave the option out"
    STALE = "no value that is fresh"
    IS_FORWARDED = True
    AUTOPILOT_HZ = {SYS_STATUS: STREAMS_HZ[SYS_STATUS]}  # noqa: RUF012

    def __init__(self) -> None:
        super().__init__(FRESH_S)
        self._values: deque[PayloadValue] = deque(maxlen=VALUES_MAX)
        self._refused = 0
        self._hygrometer: int | None = None  # its number: the first that is heard

    @classmethod
    def is_flown(cls, mission: Mission) -> bool:
        """True if the mission has [[payload]]."""
        return bool(mission.payload)

    @classmethod
    def of(cls, _mission: Mission) -> Self:
        """One vehicle's."""
        return cls()

    def decode(self, m: Any, component: int, now_s: float) -> Event | None:
        """A value, or two, to be recorded: nothing of it is told to who flies."""
        if hasattr(m, "humidity"):
            self._hygrometer = m.id if self._hygrometer is None else self._hygrometer
            if m.id != self._hygrometer:
                return None
        values = list(values_of(m))
        self._values.extend(values)
        if all(math.isfinite(value.value) for value in values):
            self.mark_measured(component, now_s)
        else:
            self._refused += 1
        return None

    def read_autopilot(self, m: Any, _now_s: float) -> None:
        """SYS_STATUS: 1 where all sensors that are there and enabled are healthy, else 0."""
        wanted = m.onboard_control_sensors_present & m.onboard_control_sensors_enabled & ~PREARM_OK
        self._values.append(PayloadValue(HEALTH, float(wanted & ~m.onboard_control_sensors_health == 0)))

    def take_values(self) -> list[PayloadValue]:
        """As they came."""
        values = list(self._values)
        self._values.clear()
        return values

    def counters(self) -> dict[str, int]:
        """Messages whose value is no number."""
        return {"payload values refused": self._refused}

    @classmethod
    def tally(cls, began_s: float) -> PayloadTally:
        """Counts sources."""
        return PayloadTally(began_s)


def values_of(m: Any) -> Iterator[PayloadValue]:
    """Values of a message of `PayloadSensors.MESSAGES`, in the units of mission.schema.payload; NaN: not known."""
    if hasattr(m, "humidity"):
        yield PayloadValue("HYGROMETER_SENSOR.temperature", _within(m.temperature / 100.0, TEMPERATURE_C))
        yield PayloadValue("HYGROMETER_SENSOR.humidity", _within(m.humidity / 100.0, HUMIDITY_PCT))
        return
    yield PayloadValue(f"{NAMED}{m.name.rstrip(chr(0))}", m.value)


def _within(value: float, bounds: tuple[float, float]) -> float:
    return value if bounds[0] <= value <= bounds[1] else math.nan


class PayloadTally(SensorTally):
    """Tally of the sources that are heard in a while."""

    def __init__(self, began_s: float) -> None:
        super().__init__(began_s)
        self._values: dict[tuple[int, int], dict[str, float]] = {}  # by who sent them: source -> the newest

    def note_message(self, m: Any, who: tuple[int, int], _now_s: float) -> bool:
        """One message."""
        values, heard = list(values_of(m)), self._values.setdefault(who, {})
        for value in values:
            if value.source in heard or len(heard) < SOURCES_MAX:
                heard[value.source] = value.value
        return all(math.isfinite(value.value) for value in values)

    def check(self, mission: Mission, vehicle_id: int, ended_s: float, where: str) -> Finding:
        """Names each of the mission's sources that is not heard of this vehicle, or is no number."""
        wanted = [one.source for one in mission.payload if one.source != HEALTH]  # another row is on SYS_STATUS
        own = {
            source: value
            for who, told in self._values.items()
            if who[0] == vehicle_id
            for source, value in told.items()
        }
        found = self._text(ended_s) or f"none on {where}"
        silent = [source for source in wanted if source not in own]
        absurd = [source for source in wanted if source in own and not math.isfinite(own[source])]
        problems = [
            f"not heard: {', '.join(silent)}: is the driver running, with this vehicle's system id, {vehicle_id}? "
            "Does the autopilot send it on this link?"
            if silent
            else "",
            f"no number: {', '.join(absurd)}: is the sensor connected?" if absurd else "",
        ]
        return Finding(found, ", ".join(wanted) or "none", "; ".join(filter(None, problems)), is_warning=True)

    def describe(self, ended_s: float) -> Finding:
        """Sources that were heard; the mission, which `companion preflight` knows, says whether they will do."""
        makes_sense = any(self._arrived_s.values())
        return Finding(self._text(ended_s), "values", "" if makes_sense else "no value is a number")

    def _text(self, ended_s: float) -> str:
        return "; ".join(
            f"{who[0]}/{who[1]}: {self.timing(who, ended_s)[0]:.1f} Hz, "
            + ", ".join(f"{source} {value:g}" for source, value in sorted(told.items()))
            for who, told in sorted(self._values.items())
        )
