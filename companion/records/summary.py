"""A stand in figures, as the acting leader has it in flight, and its form in a record: a CBOR array (RFC 8949)."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

import cbor2

from companion.records.record import BODY_MAX

if TYPE_CHECKING:  # who only reads figures needs nothing that flies
    from companion.mavlink.harvest import StandUpdate

FIELDS: Final = 10
COUNT_MAX: Final = 10_000_000
FIGURE_MAX: Final = 1e6  # of any figure per hectare, and of hectares


class Range(NamedTuple):
    """A figure and its interval; None: nothing tells one yet."""

    value: float
    low: float | None = None
    high: float | None = None

    @property
    def half_width_pct(self) -> float | None:
        """Half of the interval, over the figure, in percent; None: there is none."""
        if self.low is None or self.high is None or self.value <= 0.0:
            return None
        return 50.0 * (self.high - self.low) / self.value


@dataclass(frozen=True, slots=True)
class StandSummary:
    """Figures of the stand from the records that one leader had. They steer nothing at the base station."""

    fused: int  # records of stems and of the way that went in
    stems: int
    seen_ha: float | None  # None, and the rest with it: too little ground was seen yet for figures
    confidence: float  # of the intervals, 0..1
    stems_per_ha: Range | None
    basal_area_m2_per_ha: Range | None

    def __str__(self) -> str:
        stems = f"{self.stems} stem{'s' * (self.stems != 1)}"
        basal = self.basal_area_m2_per_ha
        if basal is None:
            return stems
        if basal.low is None or basal.high is None:
            return f"{stems}; {basal.value:.0f} m2/ha, error not known yet"
        return f"{stems}; {basal.value:.0f} +/- {(basal.high - basal.low) / 2.0:.0f} m2/ha"


class StandFusion(Protocol):
    """Fuses the records that this vehicle has, while it leads: beside the loop, never in it."""

    def take_update(self, *, leads: bool, now_s: float) -> StandUpdate | None:
        """Once a tick; `leads`: this vehicle does. The newest figures, once; None: there are no new ones."""

    def lines(self) -> list[str]:
        """Lines for the operator, since last asked."""


def encode_summary(summary: StandSummary) -> bytes:
    """At most BODY_MAX bytes."""
    counts = [summary.fused, summary.stems, summary.confidence]
    ranges = [summary.stems_per_ha or (None,) * 3, summary.basal_area_m2_per_ha or (None,) * 3]
    return cbor2.dumps([*counts, summary.seen_ha, *ranges[0], *ranges[1]], canonical=True)


def decode_summary(body: bytes) -> StandSummary | None:
    """The summary of a record; None for what is malformed or out of bounds."""
    if len(body) > BODY_MAX:
        return None
    try:
        stream = io.BytesIO(body)
        told = cbor2.load(stream)
    except (cbor2.CBORError, ValueError, OverflowError, TypeError, RecursionError, ArithmeticError, LookupError):
        return None
    if stream.tell() != len(body) or type(told) is not list or len(told) != FIELDS:
        return None
    fused, stems, confidence, seen_ha, *figures = told
    if not (_is_count(fused) and _is_count(stems) and _is_number(confidence, 1.0)):
        return None
    if seen_ha is not None and not _is_number(seen_ha, FIGURE_MAX):
        return None
    ranges = [_range_of(figures[:3]), _range_of(figures[3:])]
    if None in (ranges[0], ranges[1]) and figures != [None] * 6:
        return None
    seen = None if seen_ha is None else float(seen_ha)
    return StandSummary(fused, stems, seen, float(confidence), *ranges)


def _range_of(told: list[Any]) -> Range | None:
    value, low, high = told
    if not _is_number(value, FIGURE_MAX):
        return None
    if low is None and high is None:
        return Range(float(value))
    if not (_is_number(low, FIGURE_MAX) and _is_number(high, FIGURE_MAX) and low <= value <= high):
        return None
    return Range(float(value), float(low), float(high))


def _is_count(told: Any) -> bool:
    return type(told) is int and 0 <= told <= COUNT_MAX


def _is_number(told: Any, most: float) -> bool:
    """Of 0 to `most`, no bool; false for NaN."""
    return type(told) in (int, float) and 0.0 <= told <= most
