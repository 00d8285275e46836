"""Every recorded flight of PX4 and ArduCopter, flown by ours: as `make conformance`."""

from __future__ import annotations

from mission.model import Personality
from sim_bridge.conformance import conformance, recordings, table


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
