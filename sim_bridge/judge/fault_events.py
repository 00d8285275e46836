"""Simulated faults that happened, as a run folder keeps them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mission.schema.faults import FaultKind
from sim_bridge.options.fault_forms import LEADER as LEADER

FILE_NAME = "faults.json"
SILENCING = (FaultKind.KILL, FaultKind.RESTART, FaultKind.STOP)  # of companions


@dataclass(frozen=True, slots=True)
class FaultEvent:
    """A fault that happened."""

    kind: FaultKind
    vehicles: tuple[int, ...]
    at_s: float
    until_s: float | None = None  # None: it has no end
    late_s: float | None = None
    asked: str = ""  # as `spelled`
    wind_mps: tuple[float, float] | None = None  # east, north

    def begins(self) -> str:
        """For people."""
        leader = f" {LEADER}@" in self.asked
        which = f"{LEADER} {self.vehicles[0]}" if leader else _named(self.vehicles)
        lasts = "" if self.until_s is None else f" for {self.until_s - self.at_s:g} s"
        match self.kind:
            case FaultKind.KILL:
                return f"fault: {which} killed"
            case FaultKind.RESTART:
                return f"fault: {which} killed, started again after {(self.until_s or self.at_s) - self.at_s:g} s"
            case FaultKind.STOP:
                return f"fault: {which} stopped{lasts}"
            case FaultKind.PARTITION:
                return f"fault: {which} cut off from the others{lasts}"
            case FaultKind.LATE:
                return f"fault: telemetry of {which} {self.late_s:g} s late{lasts}"
            case FaultKind.BLIND:
                return f"fault: {which} blind{lasts}"
            case FaultKind.WIND:
                east_mps, north_mps = self.wind_mps or (0.0, 0.0)
                return f"fault: wind about {which}: {east_mps:g} m/s east, {north_mps:g} m/s north{lasts}"

    def ends(self) -> str:
        """For people."""
        match self.kind:
            case FaultKind.KILL:
                return ""
            case FaultKind.RESTART:
                return f"fault over: {_named(self.vehicles)} started again"
            case FaultKind.STOP:
                return f"fault over: {_named(self.vehicles)} resumes"
            case FaultKind.PARTITION:
                return f"fault over: {_named(self.vehicles)} reconnected"
            case FaultKind.LATE:
                return f"fault over: telemetry of {_named(self.vehicles)} on time again"
            case FaultKind.BLIND:
                return f"fault over: {_named(self.vehicles)} sees again"
            case FaultKind.WIND:
                return f"fault over: the wind about {_named(self.vehicles)} is as before"


def _named(vehicles: Sequence[int]) -> str:
    return f"vehicle{'s' * (len(vehicles) > 1)} {', '.join(map(str, vehicles))}"


def silenced(faults: Iterable[FaultEvent], now_s: float) -> frozenset[int]:
    """Vehicles whose companions were killed, or are stopped or not back at `now_s`: lost on purpose."""
    silent = [one for one in faults if one.kind in SILENCING and (one.until_s is None or one.until_s > now_s)]
    return frozenset(k for event in silent for k in event.vehicles)
