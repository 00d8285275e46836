"""A stand in figures as a record: what is written comes back, and which of them counts at the base station."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.base.station import BaseStation
from companion.mavlink.beacon import COMPONENT, MESSAGE_ID, encode
from companion.mavlink.framing import wire
from companion.mavlink.harvest import StandUpdate
from companion.records.exchange import RecordExchange
from companion.records.record import BASE_ID, BODY_MAX, RecordKind
from companion.records.store import MEMORY, RecordStore
from companion.records.summary import COUNT_MAX, Range, StandSummary, decode_summary, encode_summary
from companion.records.write_queue import DirectWriter
from mission.common.frames import Wgs84
from tests.unit.core.core_kit import beacon, lease
from tests.unit.records.records_kit import Air

FULL = StandSummary(430, 38, 0.123, 0.95, Range(312.5, 270.0, 361.0), Range(23.0, 19.0, 27.0))
HERE = Wgs84(48.0, 9.0, 460.0)


def of(stems: int, fused: int) -> StandSummary:
    return StandSummary(fused, stems, None, 0.95, None, None)


@pytest.mark.parametrize(
    ("summary", "text"),
    [
        (FULL, "38 stems; 23 +/- 4 m2/ha"),
        (StandSummary(9, 1, None, 0.9, None, None), "1 stem"),
        (StandSummary(9, 12, 0.04, 0.9, Range(300.0), Range(23.0)), "12 stems; 23 m2/ha, error not known yet"),
        (StandSummary(COUNT_MAX, COUNT_MAX, 1e6, 1.0, Range(1e6, 0.0, 1e6), Range(1e6, 1.0, 1e6)), ""),
    ],
)
def test_a_summary_comes_back_is_short_and_reads_as_a_line(summary: StandSummary, text: str) -> None:
    body = encode_summary(summary)
    assert len(body) <= BODY_MAX
    assert decode_summary(body) == summary
    assert str(summary) == text or not text


@pytest.mark.parametrize(("figure", "pct"), [(Range(20.0, 18.0, 24.0), 15.0), (Range(20.0), None), (Range(0.0), None)])
def test_half_of_the_interval_in_percent(figure: Range, pct: float | None) -> None:
    assert figure.half_width_pct == pct


def test_whose_interval_does_not_hold_its_figure_is_none() -> None:
    wrong = StandSummary(430, 38, 0.1, 0.95, Range(312.5, 270.0, 361.0), Range(23.0, 24.0, 27.0))
    assert decode_summary(encode_summary(wrong)) is None


def station(*told: tuple[int, StandSummary], names: int = 0) -> BaseStation:
    """A base station that has been told these by vehicles, and has heard a beacon that names a leader."""
    exchange = RecordExchange(*(RecordStore(MEMORY, BASE_ID, lambda: 1), _writer(), BASE_ID, 4, 1000.0), epoch=1)
    for vehicle_id, summary in told:
        exchange._note_summary(vehicle_id, encode_summary(summary))
    one = BaseStation(exchange)
    if names:
        said = beacon(3, lease=lease(names, 7, established=True))
        one.receive(wire.Sender(3, COMPONENT).frame(MESSAGE_ID, encode(said, HERE)), 1.0)
    return one


def _writer() -> DirectWriter:
    return DirectWriter(RecordStore(MEMORY, BASE_ID, lambda: 1))


@pytest.mark.sources
def test_the_stand_is_as_the_acting_leader_has_it() -> None:
    assert station().text == "0 of 0 records delivered"
    told = ((1, of(38, 430)), (2, of(41, 380)))
    assert station(*told).text == "0 of 0 records delivered; 38 stems"
    assert station(*told, names=2).text == "0 of 0 records delivered; 41 stems"
    assert station(*told, names=4).text == "0 of 0 records delivered; 38 stems"  # it has not told yet


@pytest.mark.sources
def test_a_vehicles_newest_is_the_one_of_the_most_records() -> None:
    assert station((1, of(40, 400)), (1, of(38, 430)), (1, of(12, 100))).text.endswith("; 38 stems")


class Fused:
    """A fusion that has figures when the test says so."""

    def __init__(self) -> None:
        self.told: list[StandSummary] = []
        self.led: list[tuple[bool, float]] = []
        self.said = ["stand: not fused: no"]

    def take_update(self, *, leads: bool, now_s: float) -> StandUpdate | None:
        self.led.append((leads, now_s))
        if not self.told:
            return None
        summary = self.told.pop()
        return StandUpdate(int(RecordKind.SUMMARY), encode_summary(summary), 17.0, str(summary))

    def lines(self) -> list[str]:
        return [self.said.pop()] if self.said else []


def test_what_a_leader_fuses_reaches_the_base_station_as_a_record_and_survives_its_restart(tmp_path: Path) -> None:
    air, fusion = Air(tmp_path, members=2), Fused()
    air.start(BASE_ID)
    store = RecordStore(tmp_path / "1.db", 1, lambda: 9)
    air.start(1)
    air.nodes[1] = RecordExchange(*(store, DirectWriter(store), 1, 2, 1000.0), fusion=fusion)
    assert air.nodes[1].take_stand(leads=True, now_s=0.0) is None
    fusion.told.append(FULL)
    update = air.nodes[1].take_stand(leads=False, now_s=1.0)
    assert update is not None
    assert update.basal_area_pct == 17.0
    assert fusion.led == [(True, 0.0), (False, 1.0)]
    assert "stand: not fused: no" in air.nodes[1].lines()
    air.run(10.0)
    assert air.nodes[BASE_ID].summaries == {1: FULL}
    assert str(air.nodes[BASE_ID].progress()) == "1 of 1 records delivered"
    air.stop(BASE_ID)
    assert air.start(BASE_ID).summaries == {1: FULL}
    store.close()
