"""What benchmarks are told in."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Row:
    """One figure: what was wanted, what was seen."""

    what: str
    wanted: str
    seen: str
    reached: bool

    def __str__(self) -> str:
        return f"| {self.what} | {self.wanted} | {self.seen} | {'yes' if self.reached else '**no**'} |"


def spread(values: Sequence[float], unit: str) -> str:
    """Median and range."""
    return f"median {statistics.median(values):.2f}{unit} ({min(values):.2f} to {max(values):.2f})"
