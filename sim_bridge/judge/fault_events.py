"""Simulated faults that happened, as a run folder keeps them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from mission.schema.fault_kinds import FORMS, PARAMETERS
from mission.schema.faults import Fault, FaultKind, Lie
from sim_bridge.options.fault_forms import LEADER as LEADER

FILE_NAME = "faults.json"
SILENCING = (FaultKind.KILL, FaultKind.RESTART, FaultKind.STOP)  # of companions

# When one begins, and when it is over, for people. {which}: vehicles; {lasts}: " for 3 s", or nothing; {for_s};
# numbers by their names.
WORDS: Final = {
    FaultKind.KILL: ("{which} killed", ""),
    FaultKind.RESTART: ("{which} killed, started again after {for_s:g} s", "{which} started again"),
    FaultKind.STOP: ("{which} stopped{lasts}", "{which} resumes"),
    FaultKind.PARTITION: ("{which} cut off from the others{lasts}", "{which} reconnected"),
    FaultKind.BASE_LOST: ("{which} and the base station apart{lasts}", "{which} and the base station in reach again"),
    FaultKind.LATE: ("telemetry of {which} {late_s:g} s late{lasts}", "telemetry of {which} on time again"),
    FaultKind.BLIND: ("{which} blind{lasts}", "{which} sees again"),
    FaultKind.WIND: (
        "wind about {which}: {wind_mps[0]:g} m/s east, {wind_mps[1]:g} m/s north{lasts}",
        "the wind about {which} is as before",
    ),
    FaultKind.GNSS_OUTAGE: ("no satellites at {which}{lasts}", "satellites at {which} again"),
    FaultKind.GNSS_DRIFT: (
        "GNSS of {which} drifts: {drift_mps[0]:g} m/s east, {drift_mps[1]:g} m/s north{lasts}",
        "GNSS of {which} is true again",
    ),
    FaultKind.POSITION_JUMP: (
        "position of {which} jumps {jump_m[0]:g} m east, {jump_m[1]:g} m north{lasts}",
        "position of {which} is true again",
    ),
    FaultKind.POSITION_FREEZE: ("position of {which} freezes{lasts}", "position of {which} is true again"),
    FaultKind.POSITION_DRIFT: (
        "position of {which} alone drifts: {drift_mps[0]:g} m/s east, {drift_mps[1]:g} m/s north{lasts}",
        "position of {which} is true again",
    ),
    FaultKind.HEIGHT_ERROR: ("height of {which} {height_m:g} m too large{lasts}", "height of {which} is true again"),
    FaultKind.MOTOR: ("a motor of {which} failed", ""),
    FaultKind.SCAN_ERRORS: (
        "scans of {which} with {noise_m:g} m more noise, {delay_s:g} s later{lasts}",
        "scans of {which} are as before",
    ),
    FaultKind.RANGE_ERRORS: (
        "ranges of {which} {bias_m:g} m too long, with {noise_m:g} m more noise{lasts}",
        "ranges of {which} are as before",
    ),
    FaultKind.PILOT: ("a pilot takes over {which}", ""),
    FaultKind.DISK_FULL: ("disk of {which} full{lasts}", "disk of {which} has room again"),
    FaultKind.INSIDER: ("beacons of {which} lie: {lie}{lasts}", "beacons of {which} are true again"),
    FaultKind.OUTSIDER: ("a radio beside {which} forges frames{lasts}", "the radio beside {which} is silent"),
}


@dataclass(frozen=True, slots=True)
class FaultEvent:
    """A fault that happened."""

    kind: FaultKind
    vehicles: tuple[int, ...]
    at_s: float
    until_s: float | None = None  # None: it has no end
    asked: str = ""  # as `spelled`
    # As in [[sim.faults]]; None: its kind has no such
    late_s: float | None = None
    wind_mps: tuple[float, float] | None = None  # east, north
    drift_mps: tuple[float, float] | None = None  # east, north
    jump_m: tuple[float, float] | None = None  # east, north
    height_m: float | None = None
    bias_m: float | None = None
    noise_m: float | None = None
    delay_s: float | None = None
    lie: Lie | None = None

    @property
    def numbers(self) -> tuple[float, ...]:
        """Of its kind, in the order of its row."""
        return numbers(self)

    def begins(self) -> str:
        """For people."""
        leader = f" {LEADER}@" in self.asked
        which = f"{LEADER} {self.vehicles[0]}" if leader else _named(self.vehicles)
        for_s = 0.0 if self.until_s is None else self.until_s - self.at_s
        lasts = "" if self.until_s is None else f" for {for_s:g} s"
        values = {name: getattr(self, name) for name in FORMS[self.kind].parameters}
        return f"fault: {WORDS[self.kind][0].format(which=which, lasts=lasts, for_s=for_s, lie=self.lie, **values)}"

    def ends(self) -> str:
        """For people; empty: it never does."""
        words = WORDS[self.kind][1]
        return words and f"fault over: {words.format(which=_named(self.vehicles))}"


def numbers(fault: Fault | FaultEvent) -> tuple[float, ...]:
    """The parameters of its kind, in the order of its row."""
    found: list[float] = []
    for name in FORMS[fault.kind].parameters:
        value = getattr(fault, name)
        found += value if PARAMETERS[name].level else (value,)
    return tuple(found)


def _named(vehicles: Sequence[int]) -> str:
    return f"vehicle{'s' * (len(vehicles) > 1)} {', '.join(map(str, vehicles))}"


def silenced(faults: Iterable[FaultEvent], now_s: float) -> frozenset[int]:
    """Vehicles whose companions were killed, or are stopped or not back at `now_s`: lost on purpose."""
    silent = [one for one in faults if one.kind in SILENCING and (one.until_s is None or one.until_s > now_s)]
    return frozenset(k for event in silent for k in event.vehicles)
