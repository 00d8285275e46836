"""The stand in flight: figures while a vehicle leads, the same from the same records whoever leads."""

from __future__ import annotations

import io
import random
from pathlib import Path

import pytest

from companion.records.record import LogKey, Record, RecordKind
from companion.records.store import MEMORY, Batch, RecordStore
from companion.records.summary import decode_summary
from companion.stand import in_flight
from companion.stand.figures.intervals import CONFIDENCE
from companion.stand.in_flight import answer, serve
from companion.stand.records import StoredRecord
from companion.stand.summarise import DirectFusion, summarise
from companion.stand.update import PERIOD_S
from mission.document.model import Mission
from tests.unit.stand.stand_kit import Survey, records_of, regular_stand, rows_of

SIZE_M = (40.0, 30.0)


def mission_of(**survey: object) -> Mission:
    route = {"d1_enu_m": [0.0, 0.0, 4.0], "d2_enu_m": [40.0, 0.0, 4.0], "vel_leader_mps": 2.0, "at_end": "land"}
    sensing = {"sensor": "multi-layer", "range_m": 12.0}
    return Mission.model_validate({"schema": 1, "route": route, "sensing": sensing, "survey": survey})


@pytest.fixture(scope="module")
def records() -> list[StoredRecord]:
    survey = Survey(seed=3, vehicles=4)
    return records_of(
        regular_stand(3, 400.0, east_m=SIZE_M[0], north_m=SIZE_M[1]), rows_of((0.0, 0.0), SIZE_M, survey), survey
    )


def kept(records: list[StoredRecord], me: int, path: Path | str = MEMORY) -> RecordStore:
    store = RecordStore(path, me, lambda: 99)
    others = [Record(*LogKey(r.vehicle_id, r.log_id), r.number, RecordKind(r.kind), r.made_s, r.body) for r in records]
    store.write(Batch(others=others))
    return store


def test_figures_come_while_it_leads_once_in_a_period_and_when_there_is_news(records: list[StoredRecord]) -> None:
    half = len(records) // 2
    store = kept(records[:half], 1)
    fusion = DirectFusion(store, mission_of())
    assert fusion.take_update(leads=False, now_s=0.0) is None
    first = fusion.take_update(leads=True, now_s=1.0)
    assert first is not None
    assert first.kind == RecordKind.SUMMARY
    assert fusion.take_update(leads=True, now_s=1.0 + PERIOD_S - 0.1) is None
    assert fusion.take_update(leads=True, now_s=1.0 + PERIOD_S) is None  # nothing new
    store.write(
        Batch(
            others=[
                Record(*LogKey(r.vehicle_id, r.log_id), r.number, RecordKind(r.kind), r.made_s, r.body) for r in records
            ]
        )
    )
    second = fusion.take_update(leads=True, now_s=1.0 + 2.0 * PERIOD_S)
    assert second is not None
    told = [decode_summary(update.body) for update in (first, second)]
    assert told[0] is not None
    assert told[1] is not None
    assert (told[0].fused, told[1].fused) == (half, len(records))
    assert second.basal_area_pct is not None
    assert first.basal_area_pct is None or second.basal_area_pct < first.basal_area_pct


def test_a_new_leader_has_the_same_stand_from_the_same_records(records: list[StoredRecord]) -> None:
    """In whatever order they came to it, and with what the one before told among them."""
    shuffled = records.copy()
    random.Random(1).shuffle(shuffled)
    before = DirectFusion(kept(records, 1), mission_of()).take_update(leads=True, now_s=0.0)
    assert before is not None
    theirs = StoredRecord(1, 5, 1, before.kind, 0.0, before.body)
    after = DirectFusion(kept([theirs, *shuffled], 2), mission_of()).take_update(leads=True, now_s=0.0)
    assert after == before


def test_intervals_are_as_sure_as_the_mission_asks(records: list[StoredRecord]) -> None:
    plain = summarise(records, mission_of())
    loose = summarise(records, mission_of(until={"basal_area_pct": 10.0, "confidence": 0.6}))
    assert (plain.confidence, loose.confidence) == (CONFIDENCE, 0.6)
    assert plain.basal_area_m2_per_ha is not None
    assert loose.basal_area_m2_per_ha is not None
    assert loose.basal_area_m2_per_ha.value == plain.basal_area_m2_per_ha.value
    wide, narrow = plain.basal_area_m2_per_ha.half_width_pct, loose.basal_area_m2_per_ha.half_width_pct
    assert wide is not None
    assert narrow is not None
    assert narrow < 0.6 * wide


def test_before_there_is_ground_enough_stems_are_counted_and_no_figures_told(records: list[StoredRecord]) -> None:
    few = summarise(records[:12], mission_of())
    assert (few.basal_area_m2_per_ha, few.seen_ha) == (None, None)
    assert summarise([], mission_of()).stems == 0


def test_the_child_answers_each_line_with_a_summary(
    tmp_path: Path, records: list[StoredRecord], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(in_flight, "yield_to_others", lambda: "")
    kept(records, 1, tmp_path / "1.db").close()
    told = io.StringIO()
    serve(mission_of(), tmp_path / "1.db", io.StringIO("\n\n"), told)
    lines = told.getvalue().splitlines()
    assert len(lines) == 2
    for line in lines:
        took, _, body = line.partition(" ")
        assert float(took) >= 0.0
        assert decode_summary(bytes.fromhex(body)) == summarise(records, mission_of())


def test_the_child_says_why_there_is_none(tmp_path: Path) -> None:
    assert answer(mission_of(), tmp_path / "none.db") == "! no such file"


def test_too_many_observations_are_said_and_end_nothing(
    monkeypatch: pytest.MonkeyPatch, records: list[StoredRecord], tmp_path: Path
) -> None:
    monkeypatch.setattr("companion.stand.fusion.fuse.MAX_OBSERVATIONS", 3)
    fusion = DirectFusion(kept(records, 1), mission_of())
    assert fusion.take_update(leads=True, now_s=0.0) is None
    (line,) = fusion.lines()
    assert line.startswith("stand: not fused: ")
    assert fusion.lines() == []
    kept(records, 1, tmp_path / "1.db").close()
    assert in_flight.answer(mission_of(), tmp_path / "1.db").startswith("! must be at most 3")


def test_the_child_fuses_nothing_at_a_priority_that_it_cannot_lower(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: int) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr("os.setpriority", refuse)
    told = io.StringIO()
    serve(mission_of(), tmp_path / "1.db", io.StringIO("\n"), told)
    assert told.getvalue() == "! priority cannot be lowered: Operation not permitted\n"
