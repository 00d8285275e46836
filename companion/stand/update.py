"""Updates of the stand in flight, made of summaries, and their period. Nothing here needs numpy."""

from __future__ import annotations

from typing import Final

from companion.mavlink.harvest import StandUpdate
from companion.records.record import RecordKind
from companion.records.summary import StandSummary, encode_summary

PERIOD_S: Final = 15.0  # at least, between two summaries of one leader


def update_of(summary: StandSummary) -> StandUpdate:
    """Of a summary."""
    basal = summary.basal_area_m2_per_ha
    pct = None if basal is None else basal.half_width_pct
    return StandUpdate(int(RecordKind.SUMMARY), encode_summary(summary), pct, str(summary) if summary.stems else "")
