"""Findings in all flights: held together for the table, the JSON and the exit code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mission.document.model import Personality
from sim_bridge.conformance.check import Check
from sim_bridge.conformance.explained import EXPLAINED, EXPLAINED_MAX, Explained, Verdict
from sim_bridge.conformance.steps import StepRow

FIGURES = ("t10_s", "t63_s", "t90_s", "overshoot", "settled_error")


@dataclass(frozen=True, slots=True)
class Flight:
    """One recording, compared."""

    name: str
    personality: Personality
    checks: tuple[Check, ...]
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Report:
    """All of them, and the velocity steps. `complete`: every recording of the project was flown."""

    flights: tuple[Flight, ...]
    steps: tuple[StepRow, ...]
    complete: bool = False

    @property
    def holds(self) -> bool:
        """Every flight and every step; and no more explained than may be."""
        few = all(len(self.explained(personality)) <= EXPLAINED_MAX for personality in Personality)
        return (
            few
            and not self.unused()
            and all(flight.verdict.holds for flight in self.flights)
            and all(row.within for row in self.steps)
        )

    def explained(self, personality: Personality) -> list[Explained]:
        """The differences that occurred, each once."""
        flights = [flight for flight in self.flights if flight.personality is personality]
        return list(dict.fromkeys(why for flight in flights for _, _, why in flight.verdict.explained))

    def unused(self) -> list[tuple[Explained, str]]:
        """Explanations of what was different in no flight; asked only when all of them were flown."""
        if not self.complete:
            return []
        used = {(why, difference.what) for flight in self.flights for _, difference, why in flight.verdict.explained}
        return [(why, what) for why in EXPLAINED for what in sorted(why.what) if (why, what) not in used]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "holds": self.holds,
            "flights": [_flight(flight) for flight in self.flights],
            "explained": {
                personality.value: [
                    {"check": why.check, "what": sorted(why.what), "reason": why.reason}
                    for why in self.explained(personality)
                ]
                for personality in Personality
            },
            "steps": [
                {
                    "step": row.kind,
                    "personality": row.personality.value,
                    "recorded": dict(zip(FIGURES, row.recorded, strict=True)),
                    "ours": dict(zip(FIGURES, row.ours, strict=True)),
                    "within": row.within,
                }
                for row in self.steps
            ],
        }


def _flight(flight: Flight) -> dict[str, Any]:
    verdict = flight.verdict
    explained = [difference for _, difference, _ in verdict.explained]
    return {
        "recording": flight.name,
        "personality": flight.personality.value,
        "holds": verdict.holds,
        "checks": [
            {
                "check": check.name,
                "summary": check.summary,
                "differences": [
                    {
                        "what": difference.what,
                        "recorded": difference.recorded,
                        "ours": difference.ours,
                        "explained": difference in explained,
                    }
                    for difference in check.differences
                ],
            }
            for check in flight.checks
        ],
        "stale": [why.reason for why in verdict.stale],
    }
