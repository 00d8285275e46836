"""Every recorded flight of PX4 and ArduCopter, flown by ours: as `make conformance`."""

from __future__ import annotations

import json

import pytest

from mission.document.model import Personality
from sim_bridge import cli
from sim_bridge.conformance import RECORDINGS, conformance, recordings, replay, table
from sim_bridge.conformance.recording import load

FLIGHT = RECORDINGS / "px4_loss_sp_RCACT4.tlog.xz"


def test_every_answer_and_sequence_is_as_recorded_or_explained() -> None:
    report = conformance(recordings())
    assert len(report.flights) == 14
    assert list(table.findings(report)) == [
        line for line in table.findings(report) if not line.startswith(("NOT EXPLAINED", "NO LONGER TRUE"))
    ]
    assert [row for row in report.steps if not row.within] == []
    assert {row.personality for row in report.steps} == set(Personality)
    assert all(len(report.explained(personality)) <= 3 for personality in Personality)
    assert report.holds
    page = table.markdown(report)
    assert all(f"| {flight.name} |" in page for flight in report.flights)


def test_our_flight_is_the_same_each_time() -> None:
    recorded = load(FLIGHT)
    once, again = (replay(recorded)[1].heard for _ in range(2))
    assert [frame.data for frame in once] == [frame.data for frame in again]


def test_one_recording_by_itself(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["conformance", str(FLIGHT), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [flight["recording"] for flight in told["flights"]] == ["px4_loss_sp_RCACT4"]
    assert told["holds"]
