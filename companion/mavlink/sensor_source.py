"""The contract of a sensor: one class says all that endpoint, command line, preflight, doctor and log need of it.

Pure: no sockets, no clock. A sensor's driver sends MAVLink messages of its kind to the companion, with the vehicle's
own system id, on a link of its own (`--sensor NAME=URL`) or on that of another sensor: any sensor's link may carry any
sensor's messages. `companion.sensors.table` lists the classes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, Final, NamedTuple

from companion.core.model.events import Event
from mission.document.model import Mission

COMPONENTS_MAX: Final = 8  # drivers of one kind on one vehicle


@dataclass(frozen=True, slots=True)
class Finding:
    """One row of preflight or doctor. `fix`: what to mend; empty: all is well. `is_warning`: it does not ground."""

    found: str
    wanted: str
    fix: str = ""
    is_warning: bool = False


class PayloadValue(NamedTuple):
    """A value that is to be recorded, and steers nothing."""

    source: str  # as a mission's [[payload]] names it
    value: float  # in its unit there; NaN: the sensor knows none


class SensorSource(ABC):
    """One kind of sensor by its class attributes and class methods; one vehicle's, in flight, by an instance."""

    NAME: ClassVar[str]  # of `--sensor NAME=URL`, and of the rows in preflight and doctor
    TITLE: ClassVar[str]  # in the log, for people: "range radio"
    MESSAGES: ClassVar[Mapping[int, str]]  # those of its driver: id -> MAVLink's name
    HELP: ClassVar[str]  # one line, of the command line
    ABOUT: ClassVar[str]  # what its row in preflight is about, for the reference
    UNUSED: ClassVar[str]  # what a mission lacks that does not fly by it; a companion refuses such a link
    STALE: ClassVar[str]  # what is missing when it falls silent, for the log
    NEEDS_LINK: ClassVar[str] = ""  # why a flight by it must be given a link; empty: it may come another way
    IS_FORWARDED: ClassVar[bool] = False  # may come by way of the autopilot, until it has come by a sensor's link
    AUTOPILOT_HZ: ClassVar[Mapping[int, float]] = {}  # messages of the own autopilot that it needs -> rate

    def __init__(self, fresh_s: float) -> None:
        """`fresh_s`: after which a driver that was heard counts as lost."""
        self._fresh_s = fresh_s
        self._measured_s: dict[int, float] = {}  # by component: when what came last was measured

    # --- which missions fly by it ---

    @classmethod
    @abstractmethod
    def is_flown(cls, mission: Mission) -> bool:
        """True if vehicles of this mission fly by it."""

    @classmethod
    @abstractmethod
    def of(cls, mission: Mission) -> SensorSource:
        """One vehicle's, in a mission that flies by it."""

    # --- in flight; times are the local clock's, s ---

    @abstractmethod
    def decode(self, m: Any, component: int, now_s: float) -> Event | None:
        """A message of its driver, of this vehicle, as an event of the core; None: nothing to tell (yet)."""

    def read_autopilot(self, _m: Any, _now_s: float) -> None:
        """Take in one of AUTOPILOT_HZ's messages, from the own autopilot."""
        raise NotImplementedError(f"{type(self).__name__} asks the autopilot for messages, and reads none")

    def collect(self, _now_s: float) -> list[Event]:
        """Events that waited for the tick, oldest first."""
        return []

    def take_values(self) -> list[PayloadValue]:
        """Values for the mission's [[payload]], since last asked."""
        return []

    def counters(self) -> dict[str, int]:
        """Messages that were dropped, by the reason, for the log."""
        return {}

    def freshness(self, now_s: float) -> dict[int, bool]:
        """Components that were heard ever -> whether what they measured last is fresh."""
        return {component: now_s - at_s <= self._fresh_s for component, at_s in self._measured_s.items()}

    def mark_measured(self, component: int, measured_s: float) -> None:
        """A driver has told something that makes sense, measured at `measured_s`."""
        if component in self._measured_s or len(self._measured_s) < COMPONENTS_MAX:
            self._measured_s[component] = measured_s

    # --- on the ground ---

    @classmethod
    @abstractmethod
    def tally(cls, began_s: float) -> SensorTally:
        """A new tally, of a window of listening that begins at `began_s`."""


class SensorTally(ABC):
    """Tally of what one kind of sensor's drivers send in a while. Times are of one monotonic clock, s."""

    def __init__(self, began_s: float) -> None:
        self._began_s = began_s
        self._arrived_s: dict[tuple[int, int], list[float]] = {}  # by system and component

    def add(self, m: Any, system: int, component: int, now_s: float) -> None:
        """Count one message, with its fields as attributes."""
        times_s = self._arrived_s.setdefault((system, component), [])
        if self.note_message(m, (system, component), now_s):
            times_s.append(now_s)

    @abstractmethod
    def note_message(self, m: Any, who: tuple[int, int], now_s: float) -> bool:
        """Keep what one message says; False: it makes no sense."""

    @abstractmethod
    def check(self, mission: Mission, vehicle_id: int, ended_s: float, where: str) -> Finding:
        """The row of a preflight. `where`: the links on which was listened."""

    @abstractmethod
    def describe(self, ended_s: float) -> Finding:
        """The row of a doctor, who knows no mission. Asked only where something was heard."""

    def describe_view(self) -> str:
        """Surroundings in words, for a second row of the doctor; empty: a sensor that sees none."""
        return ""

    @property
    def is_empty(self) -> bool:
        """Nothing was heard."""
        return not self._arrived_s

    def timing(self, who: tuple[int, int], ended_s: float) -> tuple[float, float]:
        """Rate (Hz) and longest gap (s) of one driver."""
        times_s = self._arrived_s[who]
        gap_s = max(after - before for before, after in pairwise([self._began_s, *times_s, ended_s]))
        return len(times_s) / max(ended_s - self._began_s, 1e-3), gap_s
