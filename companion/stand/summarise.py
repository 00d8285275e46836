"""The stand in figures, from the records that one vehicle has: what the acting leader sends to the base station."""

from __future__ import annotations

import math
from collections.abc import Iterable

from companion.mavlink.harvest import StandUpdate
from companion.records.store import RecordStore
from companion.records.summary import Range, StandSummary
from companion.stand.figures.estimate import figures_of
from companion.stand.figures.intervals import CONFIDENCE, Estimate
from companion.stand.fusion.fuse import TooManyError, fuse
from companion.stand.records import RecordLike, StoredRecord, harvest_of
from companion.stand.update import PERIOD_S, update_of
from mission.document.model import Mission


class DirectFusion:
    """Fuses while the caller waits: where time stands still meanwhile, as in a simulation in lockstep."""

    def __init__(self, store: RecordStore, mission: Mission) -> None:
        self._store = store
        self._mission = mission
        self._due_s = -math.inf
        self._fused = 0  # records, in the last summary
        self._lines: list[str] = []

    def take_update(self, *, leads: bool, now_s: float) -> StandUpdate | None:
        """As `StandFusion` has it."""
        if not leads or now_s < self._due_s:
            return None
        self._due_s = now_s + PERIOD_S
        try:
            summary = summarise((StoredRecord(*row) for row in self._store.rows()), self._mission)
        except TooManyError as error:
            self._lines.append(f"stand: not fused: {error}")
            return None
        is_news = summary.fused > self._fused
        self._fused = summary.fused
        return update_of(summary) if is_news else None

    def lines(self) -> list[str]:
        """As `StandFusion` has it."""
        said, self._lines = self._lines, []
        return said


def summarise(records: Iterable[RecordLike], mission: Mission) -> StandSummary:
    """Of `records`, in any order. TooManyError: more observations than fusion takes."""
    harvest = harvest_of(records)
    fusion = fuse(harvest.observations, mission.without_satellites, harvest.track)
    until = None if mission.survey is None else mission.survey.until
    confidence = CONFIDENCE if until is None else until.confidence
    ground = figures_of(harvest, fusion, area_m=mission.surveyed_enu_m, confidence=confidence)
    figures = ground.figures
    return StandSummary(
        fused=len(harvest.observations) + len(harvest.track),
        stems=len(fusion.stems),
        seen_ha=None if figures is None else figures.seen_ha,
        confidence=confidence,
        stems_per_ha=None if figures is None else _range_of(figures.stems_per_ha),
        basal_area_m2_per_ha=None if figures is None else _range_of(figures.basal_area_m2_per_ha),
    )


def _range_of(told: Estimate) -> Range:
    return Range(told.value, told.low, told.high)
