"""Recordings of minutes, by the recorder as it flies: compiled, where it can be, as all of this folder is run."""

from __future__ import annotations

from pathlib import Path

from sim_bridge.judge.recording import KEPT_TICKS, Recorder
from tests.unit.judge.tick_kit import a_tick


def test_a_flight_of_two_minutes_and_more_is_read_back_once_and_in_order(tmp_path: Path) -> None:
    """Compiled, a call within a slice was made twice: the file had each minute twice."""
    count = 2 * KEPT_TICKS + 3
    recorder = Recorder(tmp_path)
    for time_s in range(count):
        recorder.add(a_tick(time_s, n=1))
    assert recorder.recording().time_s.tolist() == list(range(count))
