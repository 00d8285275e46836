"""What the disk does not take is kept a while, then counted and said; it changes nothing of the flight."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.journal import journal as journals
from companion.journal.mcap import end
from companion.journal.reading import Flight, Gap, Recorded, read_flight
from companion.journal.recorder import head_of
from companion.journal.replay import replay_flight
from tests.unit.journal.journal_kit import START, MemoryDisk, fly_ticks, recorder_of
from tests.unit.mavlink.endpoint_kit import TICK_S


def read_back(disk: MemoryDisk, folder: Path) -> Flight:
    path = folder / "vehicle-3-flight-0001-0001.mcap"
    path.write_bytes(head_of(START) + b"".join(disk.chunks) + end())
    return Flight(3, 1, {1: path})


def test_chunks_go_to_the_disk_every_quarter_of_a_second() -> None:
    disk = MemoryDisk()
    recorder, _ = recorder_of(disk)
    for k in range(11):
        fly_ticks(recorder, 1, first=k)
        assert len(disk.chunks) == k // 5


def test_a_full_disk_changes_no_output() -> None:
    disk = MemoryDisk()
    disk.error = "No space left on device"
    recorder, one = recorder_of(disk)
    _, plain = recorder_of(MemoryDisk())
    for k in range(60):
        fly_ticks(recorder, 1, first=k)
        fly_ticks(plain, 1, first=k)
    assert recorder.tick(13.0) == plain.tick(13.0)
    assert one.agent.status(13.0) == plain.agent.status(13.0)
    assert recorder.take_lines() == ["black box: No space left on device: kept in memory"]


@pytest.mark.parametrize("fault", ["full", "slow"])
def test_what_is_lost_is_counted_and_said_and_marked_as_a_gap(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journals, "WAITING_BYTES", 10_000)
    disk = MemoryDisk()
    recorder, _ = recorder_of(disk)
    fly_ticks(recorder, 20)
    disk.error, disk.is_slow = ("No space left on device", False) if fault == "full" else ("", True)
    fly_ticks(recorder, 200, first=20)
    assert recorder.journal.lost > 100
    disk.error, disk.is_slow = "", False
    if fault == "slow":
        disk.submit(journals.Batch(tuple(recorder.journal._waiting)[: recorder.journal._under_way], is_synced=True))
    fly_ticks(recorder, 200, first=220)
    recorder.close("ended")
    lines = recorder.take_lines()
    lost = recorder.journal.lost
    assert [line for line in lines if "LOST from" in line]
    assert lines[-1] == f"black box: incomplete: {disk_words(fault)}: {lost} of 420 ticks are LOST"
    items = list(read_flight(read_back(disk, tmp_path)))
    (gap,) = [item for item in items if isinstance(item, Gap)]
    assert (gap.last - gap.first + 1, gap.why) == (lost, disk_words(fault))
    assert sum(isinstance(item, Recorded) and not item.is_end for item in items) == 420 - lost
    replayed = replay_flight(read_back(disk, tmp_path))
    assert replayed.breaks == []  # the chain goes on behind it
    assert replayed.same == gap.first - 1
    assert replayed.stopped == f"gap: ticks {gap.first} to {gap.last} were lost ({gap.why})"
    assert not replayed.is_same


@pytest.mark.parametrize("waiting_bytes", [10_000, 1 << 30])
def test_what_a_disk_that_is_full_to_the_end_has_lost_is_counted(
    waiting_bytes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also what waited for it in memory."""
    monkeypatch.setattr(journals, "WAITING_BYTES", waiting_bytes)
    disk = MemoryDisk()
    recorder, _ = recorder_of(disk)
    fly_ticks(recorder, 20)
    disk.error = "No space left on device"
    fly_ticks(recorder, 100, first=20)
    recorder.close("ended")
    items = list(read_flight(read_back(disk, tmp_path)))
    lost = 120 - sum(isinstance(item, Recorded) for item in items)
    assert recorder.journal.lost == lost > 100
    said = f"black box: incomplete: No space left on device: {lost} of 120 ticks are LOST, and it is not closed"
    assert recorder.take_lines()[-1] == said


@pytest.mark.parametrize("seen", [100, 103, 105])  # ticks; of a chunk, or some more
def test_a_loss_at_the_very_end_is_marked_and_the_box_closed(
    seen: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journals, "WAITING_BYTES", 10_000)
    disk = MemoryDisk()
    recorder, _ = recorder_of(disk)
    fly_ticks(recorder, 20)
    disk.error = "No space left on device"
    fly_ticks(recorder, seen, first=20)
    recorder.from_peers(b"since the last tick", 20.0)
    disk.error = ""  # somebody made room
    recorder.close("ended")
    flight = read_back(disk, tmp_path)
    (gap,) = [item for item in read_flight(flight) if isinstance(item, Gap)]
    assert (gap.last, gap.last - gap.first + 1) == (20 + seen, recorder.journal.lost)
    said = f"black box: incomplete: No space left on device: {recorder.journal.lost} of {20 + seen} ticks are LOST"
    assert recorder.take_lines()[-1] == said
    replayed = replay_flight(flight)
    assert (replayed.breaks, replayed.same) == ([], gap.first - 1)
    assert replayed.stopped == f"gap: ticks {gap.first} to {gap.last} were lost (No space left on device)"
    assert replayed.ends.startswith("ended at ")
    assert replayed.head == recorder.journal.link.hex()


def disk_words(fault: str) -> str:
    return "No space left on device" if fault == "full" else "slow disk"


def test_a_short_refusal_of_the_disk_loses_nothing(tmp_path: Path) -> None:
    disk = MemoryDisk()
    recorder, _ = recorder_of(disk)
    fly_ticks(recorder, 20)
    disk.error = "Input/output error"
    fly_ticks(recorder, 100, first=20)
    disk.error = ""
    fly_ticks(recorder, 120, first=120)
    recorder.close("ended")
    assert recorder.take_lines() == [
        "black box: Input/output error: kept in memory",
        "black box: the disk takes it again",
    ]
    assert replay_flight(read_back(disk, tmp_path)).same == 240


def test_memory_that_waits_for_the_disk_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journals, "WAITING_BYTES", 10_000)
    disk = MemoryDisk()
    disk.is_slow = True
    recorder, _ = recorder_of(disk)
    for k in range(400):
        fly_ticks(recorder, 1, first=k)
        assert recorder.journal._waiting_bytes < 30_000
        assert recorder.journal._chunk_ticks <= 6


def test_a_flood_does_not_push_out_what_was_recorded_before(tmp_path: Path) -> None:
    """Of any link, by anybody in reach of the radio: what is beyond a rate is a gap."""
    disk = MemoryDisk()
    recorder, _ = recorder_of(disk)
    fly_ticks(recorder, 20)
    for k in range(20, 420):  # 20 s
        for _ in range(10):
            recorder.from_peers(bytes(20_000), 10.0 + k * TICK_S)  # 4 MB/s
        fly_ticks(recorder, 1, first=k)
    fly_ticks(recorder, 400, first=420)
    recorder.close("ended")
    assert sum(map(len, disk.chunks)) < journals.BURST_BYTES + 41 * journals.RATE_BYTES_S
    gaps = [item for item in read_flight(read_back(disk, tmp_path)) if isinstance(item, Gap)]
    assert {gap.why for gap in gaps} == {"flood"}
    assert sum(gap.last - gap.first + 1 for gap in gaps) == recorder.journal.lost > 100
    assert recorder.take_lines()[0].startswith("black box: flood: ticks are LOST from ")
    assert replay_flight(read_back(disk, tmp_path)).breaks == []


def test_the_disk_is_waited_for_once_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[bool] = []
    disk = MemoryDisk()
    submit = disk.submit
    monkeypatch.setattr(disk, "submit", lambda batch: (synced.append(batch.is_synced), submit(batch))[1])
    recorder, _ = recorder_of(disk)
    fly_ticks(recorder, 81)
    assert synced == [True, False, False, False] * 4
