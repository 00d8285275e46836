"""Sensors of installed packages: entry points of the group `understory.sensors`, each a class as SensorSource asks."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, ClassVar, Final, Protocol

from companion.core.model.events import Event
from companion.mavlink import dialect
from companion.mavlink.sensor_source import SensorSource, SensorTally
from mission.common import entry_points
from mission.common.entry_points import EntryPointError
from mission.document.model import Mission

GROUP: Final = entry_points.SENSORS
TEXTS: Final = ("NAME", "TITLE", "HELP", "ABOUT", "UNUSED", "STALE")


class Sensor(Protocol):
    """All that a sensor's class must have of its own; `SensorSource`, which it must inherit from, has the rest."""

    NAME: ClassVar[str]
    TITLE: ClassVar[str]
    MESSAGES: ClassVar[Mapping[int, str]]
    HELP: ClassVar[str]
    ABOUT: ClassVar[str]
    UNUSED: ClassVar[str]
    STALE: ClassVar[str]

    @classmethod
    def is_flown(cls, mission: Mission) -> bool:
        """True if vehicles of this mission, which names it, can fly by it."""

    @classmethod
    def of(cls, mission: Mission) -> SensorSource:
        """One vehicle's."""

    @classmethod
    def tally(cls, began_s: float) -> SensorTally:
        """A new tally of what drivers send: SensorTally with `note_message`, `check` and `describe`."""

    def decode(self, m: Any, component: int, now_s: float) -> Event | None:
        """One message of its driver."""


METHODS: Final[dict[str, Callable[..., Any]]] = {
    "is_flown": Sensor.__dict__["is_flown"].__func__,
    "of": Sensor.__dict__["of"].__func__,
    "tally": Sensor.__dict__["tally"].__func__,
    "decode": Sensor.decode,
}


def installed_names() -> list[str]:
    """Names of the sensors that installed packages have."""
    return entry_points.installed_names(GROUP)


@cache
def load_sensor(name: str) -> type[SensorSource]:
    """The class of that name. EntryPointError: no package has it, or it is no sensor."""
    found = entry_points.find_installed(GROUP, name)
    if found is None:
        named = ", ".join(installed_names()) or "there is none"
        raise EntryPointError(f"{name}: no installed package has an entry point {GROUP} of that name ({named})")
    kind = found.load()
    wrong = _wrong_of(kind, name)
    if wrong:
        raise EntryPointError(f"{found.title}: {wrong}")
    assert isinstance(kind, type)
    return kind


def _wrong_of(kind: object, name: str) -> str:
    """The first wrong of a class against `Sensor`; empty: none."""
    if not (isinstance(kind, type) and issubclass(kind, SensorSource)):
        return "must be a class that inherits from companion.mavlink.sensor_source.SensorSource"
    for text in TEXTS:
        if not isinstance(getattr(kind, text, None), str):
            return f"{kind.__name__}.{text}: must be a str"
    if name != kind.NAME:
        return f"{kind.__name__}.NAME = {kind.NAME!r}: must be the entry point's name, {name!r}"
    messages = getattr(kind, "MESSAGES", None)
    if not isinstance(messages, Mapping) or not messages:
        return f"{kind.__name__}.MESSAGES: must be a dict of a MAVLink message's id -> its name, and not empty"
    strange = [id_ for id_ in messages if id_ not in dialect.mavlink_map]
    if strange:
        return f"{kind.__name__}.MESSAGES: {strange[0]!r}: no message of companion/mavlink/swarm.xml has that id"
    if inspect.isabstract(kind):
        missing = ", ".join(sorted(kind.__abstractmethods__))
        return f"{kind.__name__} must define {missing}: see docs/how-to/add-a-sensor.md"
    for method, form in METHODS.items():
        arguments = list(inspect.signature(form).parameters)
        given = inspect.signature(getattr(kind, method))
        try:
            given.bind(*arguments[0 if method == "decode" else 1 :])
        except TypeError:
            return f"{kind.__name__}.{method}{given}: must take {method}({', '.join(arguments[1:])})"
    return ""
