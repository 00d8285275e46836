"""Counts of a black box: cuts of the safety filter by reason over time, and beacons by sender and fate."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

from companion.journal.channels import Json
from companion.journal.reading import Flight, Recorded, read_flight

BARS = " ▁▂▃▄▅▆▇█"
CELLS = 40  # of a timeline


@dataclass(slots=True)
class CutSpan:
    """Cuts for one reason."""

    times_s: list[float] = field(default_factory=list)
    most_mps: float = 0.0


@dataclass(slots=True)
class Summary:
    """Of one flight of one vehicle."""

    ticks: int = 0
    began_s: float = 0.0  # the flight's first tick; this and the next two on the companion's clock
    first_s: float = 0.0
    last_s: float = 0.0
    cuts: dict[str, CutSpan] = field(default_factory=dict)  # by reason
    beacons: dict[int, Counter[str]] = field(default_factory=dict)  # by sender: fate -> how many
    refused: Counter[str] = field(default_factory=Counter)  # frames and orders, by reason

    def add(self, body: Json, began_s: float | None = None) -> None:
        """One more tick, as recorded. `began_s`: the flight's first; None: the first of these."""
        now_s = float(body["time_s"])
        if not self.ticks:
            self.first_s, self.began_s = now_s, now_s if began_s is None else began_s
        self.last_s, self.ticks = now_s, self.ticks + 1
        for cut in body["cuts"]:
            span = self.cuts.setdefault(cut["reason"], CutSpan())
            span.times_s.append(now_s)
            span.most_mps = max(span.most_mps, cut["by_mps"] or 0.0)
        self.refused.update(body["refused"])
        for fate, senders in body["beacons"].items():
            for sender in senders:
                self.beacons.setdefault(sender, Counter())[fate] += 1

    def fates(self) -> Counter[str]:
        """Beacons of all senders, by fate."""
        return sum(self.beacons.values(), Counter())

    def timeline(self, reason: str, cells: int = CELLS) -> str:
        """The share of ticks that was cut for a reason, over the flight, as a row of bars."""
        counts, length_s = [0] * cells, max(self.last_s - self.first_s, 1e-9)
        for now_s in self.cuts[reason].times_s:
            counts[min(cells - 1, int((now_s - self.first_s) / length_s * cells))] += 1
        full = max(1.0, self.ticks / cells)
        most = len(BARS) - 1
        return "".join(BARS[min(most, math.ceil(most * count / full))] for count in counts)

    def times(self) -> str:
        """Times of its first and last tick, in words; empty: it has no tick."""
        first_s, last_s = self.first_s - self.began_s, self.last_s - self.began_s
        clock = f"which was at {self.began_s:.2f} s of the companion's clock"
        return f", {first_s:.2f} to {last_s:.2f} s after the first, {clock}" if self.ticks else ""

    def lines(self) -> list[str]:
        """A table for people."""
        found = [f"  {self.ticks} ticks{self.times()}"]
        fates = self.fates()
        others = ", ".join(f"{fate} {count}" for fate, count in sorted(fates.items()) if fate != "KEPT") or "none"
        found.append(f"  beacons heard {fates.total()}: kept {fates['KEPT']}, not kept: {others}")
        reasons = ", ".join(f"{reason} {count}" for reason, count in sorted(self.refused.items())) or "none"
        found.append(f"  frames and orders refused: {reasons}")
        for sender, kinds in sorted(self.beacons.items()):
            others = "".join(f", {fate} {count}" for fate, count in sorted(kinds.items()) if fate != "KEPT")
            found.append(f"    of {sender:3}: kept {kinds['KEPT']}{others}")
        for reason, span in sorted(self.cuts.items()):
            share = 100.0 * len(span.times_s) / max(1, self.ticks)
            found.append(
                f"  cut by {reason:12} {share:5.1f} % of ticks, at most {span.most_mps:.2f} m/s"
                f"  |{self.timeline(reason)}|"
            )
        return found if self.cuts else [*found, "  no setpoint was cut"]


def summarise_flight(flight: Flight) -> Summary:
    """Of what a black box has, without running it. BlackBoxError."""
    summary = Summary()
    for item in read_flight(flight):
        if isinstance(item, Recorded) and not item.is_end:
            summary.add(item.body)
    return summary
