"""The loop with a black box: what it takes in and sends out, by either clock, is in it with its times."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.journal.reading import find_flights
from companion.journal.recorder import files_of
from companion.journal.replay import replay_flight
from companion.journal.segments import DirectWriter
from companion.mavlink import dialect
from companion.shell import runner as runner_module
from tests.unit.journal.journal_kit import START, recorder_of
from tests.unit.mavlink.endpoint_kit import HOME, heartbeat, packed, position
from tests.unit.mavlink.test_endpoint_peers import beacon_of
from tests.unit.shell.runner_kit import Bench

TICKS = 40


@pytest.mark.parametrize("clock", ["monotonic", "vehicle"])
def test_a_flight_of_the_loop_replays(
    clock: str, bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder, endpoint = recorder_of(DirectWriter(files_of(tmp_path, START, waits_for_disk=False)), clock=clock)
    runner = bench.runner_of(endpoint, recorder, sensors=())
    select = bench.select

    def arrive(*asked: object) -> None:
        k = runner.ticks
        bench.autopilot.arriving.append(packed(HOME, heartbeat(), position(1.0 + k, boot_ms=50 * k)))
        bench.peers.arriving.append(beacon_of(5, time_ms=1000 + 50 * k))
        if clock == "vehicle":
            request = dialect.MAVLink_timesync_message(0, (k + 1) * 50_000_000)
            bench.autopilot.arriving[-1] += packed(request)
        select(*asked)

    monkeypatch.setattr(runner_module.select, "select", arrive)
    bench.waits_left = TICKS + 1
    if clock == "monotonic":
        runner.by_monotonic()
    else:
        runner.by_vehicle(endpoint.hello())
    assert runner.ticks >= TICKS - 1
    recorder.close("stopped by test")
    (flight,) = find_flights(tmp_path)
    replayed = replay_flight(flight)
    assert (replayed.difference, replayed.same, replayed.is_same) == ([], runner.ticks, True)
    assert replayed.summary.beacons[5]["KEPT"] > TICKS // 2
    assert bench.lines == [f"black box: {flight.segments[1]}"]
