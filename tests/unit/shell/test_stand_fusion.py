"""Fusion beside the loop: it never waits, the child is there while the vehicle leads, and its errors are survived."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

import pytest

from companion.mavlink.harvest import StandUpdate
from companion.records.record import LogKey, Record, RecordKind
from companion.records.store import Batch, RecordStore
from companion.records.summary import StandSummary, encode_summary
from companion.shell import stand_fusion
from companion.shell.stand_fusion import ANSWER_S, BUSY_SHARE, FusionChild, FusionError, FusionProcess, read_answer
from companion.stand.update import PERIOD_S
from companion.survey.observation import STEM_KIND, encode
from tests.unit.mission.mission_file_kit import FULL
from tests.unit.stand.stand_kit import said

LIMIT_S = 30.0


class Held:
    """A child that takes as long as the test wants, and answers what it wants."""

    def __init__(self) -> None:
        self.go, self.done, self.ended = threading.Event(), threading.Event(), threading.Event()
        self.answer: tuple[float, StandSummary] | Exception = (0.1, summary(10))

    def request_summary(self) -> tuple[float, StandSummary]:
        assert self.go.wait(LIMIT_S)
        self.go.clear()
        self.done.set()
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def end(self) -> None:
        self.ended.set()

    def kill(self) -> None:
        self.go.set()


def summary(fused: int) -> StandSummary:
    return StandSummary(fused, 3, None, 0.95, None, None)


def answered(fusion: FusionProcess, child: Held, now_s: float, *, leads: bool = True) -> StandUpdate | None:
    """Lets the child answer, and the loop take it."""
    child.go.set()
    assert child.done.wait(LIMIT_S)
    child.done.clear()
    while fusion._is_asked:
        found = fusion.take_update(leads=leads, now_s=now_s)
    return found


@pytest.mark.sources
def test_the_loop_does_not_wait_and_has_the_figures_later() -> None:
    child = Held()
    fusion = FusionProcess(child)
    assert fusion.take_update(leads=True, now_s=0.0) is None
    assert fusion.take_update(leads=True, now_s=9.0) is None
    update = answered(fusion, child, 10.0)
    assert update is not None
    assert update.body == encode_summary(summary(10))
    fusion.close()


@pytest.mark.sources
def test_who_does_not_lead_has_neither_thread_nor_child_and_who_does_no_more_ends_it() -> None:
    before, child = threading.active_count(), Held()
    fusion = FusionProcess(child)
    assert fusion.take_update(leads=False, now_s=0.0) is None
    assert threading.active_count() == before
    fusion.take_update(leads=True, now_s=1.0)
    assert not child.ended.is_set()
    assert answered(fusion, child, 2.0, leads=False) is None  # it leads no more: its figures are nobody's
    assert child.ended.wait(LIMIT_S)
    fusion.close()
    assert threading.active_count() == before


@pytest.mark.sources
@pytest.mark.parametrize(("took_s", "rests_s"), [(0.1, PERIOD_S), (2.0, 2.0 / BUSY_SHARE)])
def test_a_share_of_one_core_is_all_that_it_takes(took_s: float, rests_s: float) -> None:
    child = Held()
    fusion = FusionProcess(child)
    child.answer = (took_s, summary(10))
    fusion.take_update(leads=True, now_s=0.0)
    answered(fusion, child, 100.0)
    for now_s, is_asked in ((100.0 + rests_s - 0.1, False), (100.0 + rests_s, True)):
        fusion.take_update(leads=True, now_s=now_s)
        assert fusion._is_asked is is_asked
    fusion.close()


@pytest.mark.sources
def test_what_goes_wrong_is_said_once_and_tried_again() -> None:
    child = Held()
    fusion = FusionProcess(child)
    child.answer = FusionError("no memory")
    for now_s in (0.0, ANSWER_S + 1.0):
        fusion.take_update(leads=True, now_s=now_s)
        assert answered(fusion, child, now_s + 0.5) is None
    assert fusion.lines() == ["stand: not fused: no memory"]
    assert child.ended.is_set()
    child.answer = (0.1, summary(10))
    fusion.take_update(leads=True, now_s=1e3)
    assert answered(fusion, child, 1e3) is not None
    fusion.close()


@pytest.mark.sources
def test_figures_of_no_more_records_are_no_news() -> None:
    child = Held()
    fusion = FusionProcess(child)
    for now_s, is_news in ((0.0, True), (100.0, False)):
        fusion.take_update(leads=True, now_s=now_s)
        assert (answered(fusion, child, now_s) is not None) is is_news
    fusion.close()


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("", "ended"),
        ("! no such file", "no such file"),
        ("0.1", "none"),
        ("0.1 00", "none"),
        ("x 00", "none"),
        ("nan " + encode_summary(summary(1)).hex(), "none"),
        ("0.1 zz", "none"),
    ],
)
def test_an_answer_that_is_none_is_an_error(line: str, why: str) -> None:
    with pytest.raises(FusionError, match=why):
        read_answer(line)


def test_a_child_that_says_nothing_in_time_is_given_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(stand_fusion, "ANSWER_S", 0.0)
    child = FusionChild(tmp_path, tmp_path, (sys.executable, "-c", "import sys; sys.stdin.read()"))
    with pytest.raises(FusionError, match="no answer within"):
        child.request_summary()
    child.end()


def test_a_child_that_ends_is_said_and_can_be_asked_again(tmp_path: Path) -> None:
    child = FusionChild(tmp_path, tmp_path, (sys.executable, "-c", "input()"))
    for _ in range(2):
        with pytest.raises(FusionError, match="child process ended"):
            child.request_summary()
        child.end()


@pytest.mark.sources
def test_the_real_child_fuses_the_records_of_a_file_that_is_in_use(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(FULL)
    store = RecordStore(tmp_path / "1.db", 1, lambda: 9)
    body = encode(said(2, north_m=3.0, east_m=4.0))
    store.write(Batch(others=[Record(*LogKey(2, 5), 1, RecordKind(STEM_KIND), 20.0, body)]))
    child = FusionChild(tmp_path / "m.toml", tmp_path / "1.db")
    took_s, found = child.request_summary()
    assert (found.fused, found.stems) == (1, 1)
    assert took_s >= 0.0
    assert child._process is not None
    assert os.getpriority(os.PRIO_PROCESS, child._process.pid) == 19  # whatever the companion's is
    assert Path(f"/proc/{child._process.pid}/oom_score_adj").read_text() == "1000\n"
    store.write(Batch(others=[Record(*LogKey(3, 5), 1, RecordKind(STEM_KIND), 20.0, body)]))
    assert child.request_summary()[1].fused == 2
    child.end()
    store.close()
