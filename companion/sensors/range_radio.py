"""Range radios (two-way ranging between vehicles, ultra-wideband): SWARM_RANGES."""

from __future__ import annotations

from typing import Any, Self

from companion.core.localisation.integrity.own_ranges import MEASURED_S
from companion.core.model.events import Event, Ranges
from companion.core.vehicle.autopilot_state import Delay
from companion.mavlink import dialect
from companion.mavlink.packing import unpack_ranges
from companion.mavlink.sensor_source import COMPONENTS_MAX, Finding, SensorSource, SensorTally
from mission.document.model import Mission

PUNCTUAL_S = 0.05  # a tick: so much later is none, and ages stay to the bit
NAMED_MAX = 16  # vehicles
GAP_MAX_S = 2.0  # twice what the slowest radio takes (ranging.rate_hz)


class RangeRadio(SensorSource):
    """A vehicle's range radio, in a mission with [ranging] whose `radio` is true."""

    NAME = "ranges"
    TITLE = "range radio"
    MESSAGES = {dialect.MAVLINK_MSG_ID_SWARM_RANGES: "SWARM_RANGES"}  # noqa: RUF012
    HELP = "SWARM_RANGES of a range radio, in a mission with [ranging]"
    ABOUT = (
        "In a mission with `[ranging]`, unless its `radio` is false: the range radio is heard on a sensor's link, "
        "with the vehicle's own system id, has measured vehicles of the mission and nothing else, and has no gap above "
        f"{GAP_MAX_S:g} s. A warning: some of the others were not measured. At least one other's radio must be on."
    )
    UNUSED = "has no [ranging], or its radio = false, so nothing would go by this radio"
    STALE = "no range that is fresh"
    NEEDS_LINK = "it has [ranging]"

    @classmethod
    def is_flown(cls, mission: Mission) -> bool:
        """True if it says that vehicles have range radios."""
        return mission.has_range_radios

    @classmethod
    def of(cls, _mission: Mission) -> Self:
        """One vehicle's."""
        return cls(MEASURED_S)

    def __init__(self, fresh_s: float) -> None:
        super().__init__(fresh_s)
        self._delays: dict[int, Delay] = {}  # by component
        self._untimely = 0

    def decode(self, m: Any, component: int, now_s: float) -> Event | None:
        """SWARM_RANGES, told at once, as much older as it came later than the quickest of its driver's.

        None: by its driver's clock it is an old one that is sent again, or one from ahead.
        """
        late_s = self._lateness_s(component, m.time_boot_ms, now_s)
        if late_s is None:
            self._untimely += 1
            return None
        ranges = unpack_ranges(m.ranges)
        if ranges:
            self.mark_measured(component, now_s - late_s)
        if late_s > 0.0:
            ranges = tuple([(vehicle, metres, age_s + late_s) for vehicle, metres, age_s in ranges])
        return Ranges(ranges)

    def _lateness_s(self, component: int, time_boot_ms: int, now_s: float) -> float | None:
        if time_boot_ms == 0:
            return 0.0
        delay = self._delays.get(component)
        if delay is None:
            if len(self._delays) >= COMPONENTS_MAX:
                return None
            delay = self._delays[component] = Delay()
        if not delay.accept_time(time_boot_ms / 1e3, now_s):
            return None
        return delay.late_s if delay.late_s > PUNCTUAL_S else 0.0

    def counters(self) -> dict[str, int]:
        """Frames whose time does not go on from the one before."""
        return {"range frames out of their time": self._untimely}

    @classmethod
    def tally(cls, began_s: float) -> RangeTally:
        """Counts SWARM_RANGES."""
        return RangeTally(began_s)


class RangeTally(SensorTally):
    """Tally of what range radios send in a while, and whether a mission can be flown by it."""

    def __init__(self, began_s: float) -> None:
        super().__init__(began_s)
        self._measured: dict[tuple[int, int], set[int]] = {}  # vehicles, by who measured them

    def note_message(self, m: Any, who: tuple[int, int], _now_s: float) -> bool:
        """One SWARM_RANGES."""
        ranges = unpack_ranges(m.ranges)
        self._measured.setdefault(who, set()).update(vehicle for vehicle, _, _ in ranges)
        return bool(ranges)

    def check(self, mission: Mission, vehicle_id: int, ended_s: float, where: str) -> Finding:
        """Against the vehicles of the mission."""
        others = set(range(1, mission.swarm.size + 1)) - {vehicle_id}
        wanted = f"ranges to {_named(others) or 'nobody: it is alone'}, no gap above {GAP_MAX_S:g} s"
        heard = sorted(self._arrived_s)
        own = [who for who in heard if who[0] == vehicle_id]
        found = self._text(ended_s) or f"no SWARM_RANGES on {where}"
        if not own:
            fix = (
                f"its driver must send with this vehicle's system id, {vehicle_id}"
                if heard
                else "is the driver running, and does it send there? Is another vehicle's radio on? Else give its link "
                "as --sensor ranges=URL"
            )
            return Finding(found, wanted, fix, is_warning=not heard and not others)
        measured = {vehicle for who in own for vehicle in self._measured[who]}
        gap_s = max(self.timing(who, ended_s)[1] for who in own)
        problems = {
            f"{_named(measured - others)} are no other vehicles of this mission": bool(measured - others),
            "it measures nobody: is another vehicle's radio on, and in reach?": not measured & others,
            "what holds its ranges up? A busy computer, a slow link": gap_s > GAP_MAX_S,
        }
        fix = "; ".join(text for text, there in problems.items() if there)
        if fix:
            return Finding(found, wanted, fix, is_warning=not others)
        silent = others - measured
        return Finding(found, wanted, f"not measured: {_named(silent)}" if silent else "", is_warning=True)

    def describe(self, ended_s: float) -> Finding:
        """Whom it measured; the mission, which `companion preflight` knows, says whether that will do."""
        measures = any(self._measured.values())
        fix = "" if measures else "it measures nobody: is another vehicle's radio on, and in reach?"
        return Finding(self._text(ended_s), "SWARM_RANGES with ranges", fix)

    def _text(self, ended_s: float) -> str:
        return "; ".join(
            f"{system}/{component}: {self.timing((system, component), ended_s)[0]:.1f} Hz, longest gap "
            f"{self.timing((system, component), ended_s)[1]:.2f} s, ranges to {_named(vehicles) or 'nobody'}"
            for (system, component), vehicles in sorted(self._measured.items())
        )


def _named(vehicles: set[int]) -> str:
    """System ids for people, at most NAMED_MAX of them."""
    named = [str(vehicle) for vehicle in sorted(vehicles)]
    return ", ".join(named[:NAMED_MAX]) + (" ..." if len(named) > NAMED_MAX else "")
