"""The operator's file: counts only grow, whatever is lost, and whoever shares it."""

from __future__ import annotations

import json
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from companion.mavlink.orders.order import NO_FLIGHT
from companion.order import order_file
from companion.order.order_file import MISSIONS_MAX, OperatorFile
from companion.order.station import OrderFileError

MISSION, OTHER = b"m" * 32, b"o" * 32


def keep(flight: bytes) -> bytes:
    return flight


def test_counts_grow_with_the_clock_and_without_it(tmp_path: Path) -> None:
    times = iter([1000, 1000, 5, 2000])
    file = OperatorFile(tmp_path / "k.orders", lambda: next(times))
    assert [file.next_order(MISSION, keep, only_stops=False)[0] for _ in range(4)] == [1000, 1001, 1002, 2000]


def test_flight_is_kept_for_each_mission(tmp_path: Path) -> None:
    path = tmp_path / "k.orders"
    file = OperatorFile(path, lambda: 1)
    assert not file.knows_flight(MISSION)
    assert (
        file.next_order(MISSION, lambda last: b"flight A" if last == NO_FLIGHT else last, only_stops=False)[1]
        == b"flight A"
    )
    assert file.next_order(OTHER, keep, only_stops=False)[1] == NO_FLIGHT
    again = OperatorFile(path, lambda: 1)
    assert again.next_order(MISSION, keep, only_stops=False) == (3, b"flight A", "")
    assert (again.knows_flight(MISSION), again.knows_flight(OTHER)) == (True, False)


def test_file_is_the_owners_and_bounded(tmp_path: Path) -> None:
    path = tmp_path / "k.orders"
    file = OperatorFile(path, lambda: 1)
    for k in range(MISSIONS_MAX + 10):
        file.next_order(k.to_bytes(32, "little"), lambda _: b"flight A", only_stops=False)
    assert path.stat().st_mode & 0o777 == 0o600
    assert len(json.loads(path.read_text())["flights"]) == MISSIONS_MAX
    assert file.knows_flight((MISSIONS_MAX + 9).to_bytes(32, "little"))


def test_two_programs_that_share_it_never_give_one_count_twice(tmp_path: Path) -> None:
    def take(_: int) -> list[int]:
        file = OperatorFile(tmp_path / "k.orders", lambda: 1)
        return [file.next_order(MISSION, keep, only_stops=False)[0] for _ in range(25)]

    with ThreadPoolExecutor(4) as pool:
        taken = [counter for counters in pool.map(take, range(4)) for counter in counters]
    assert sorted(taken) == list(range(1, 101))


@pytest.mark.parametrize(
    "text",
    [
        '{"counter": true, "flights": {}}',
        '{"counter": 18446744073709551615, "flights": {}}',
        '{"counter": 1, "flights": {"no digest": "0000000000000000"}}',
        '{"counter": 1, "flights": {"aa": "0000000000000000"}}',
        "",
        "{",
        "[]",
        "{}",
        '{"counter": -1, "flights": {}}',
        '{"counter": 1, "flights": {"a": "zz"}}',
        "[" * 20_000,
    ],
)
def test_file_that_is_none_is_refused_and_left(tmp_path: Path, text: str) -> None:
    path = tmp_path / "k.orders"
    path.write_text(text)
    with pytest.raises(OrderFileError, match=r"k\.orders: is no file of an operator's orders"):
        OperatorFile(path, lambda: 1).next_order(MISSION, keep, only_stops=False)
    assert path.read_text() == text


def test_count_that_cannot_be_written_is_not_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = OperatorFile(tmp_path / "k.orders", lambda: 1)
    file.next_order(MISSION, keep, only_stops=False)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        file.next_order(MISSION, keep, only_stops=False)
    monkeypatch.undo()
    assert file.next_order(MISSION, keep, only_stops=False)[0] == 2


def test_what_only_stops_is_counted_by_the_clock_above_all_that_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a full disk; and no count that was sent so is given again, also by the disk that has room again."""
    file = OperatorFile(tmp_path / "k.orders", lambda: 1000)
    file.next_order(MISSION, lambda _: b"flight A", only_stops=False)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        file.next_order(MISSION, keep, only_stops=False)
    monkeypatch.setattr(file, "_clock_ms", lambda: 5)
    assert file.next_order(MISSION, keep, only_stops=True) == (1001, b"flight A", "No space left on device")
    monkeypatch.setattr(file, "_clock_ms", lambda: 2000)
    assert file.next_order(MISSION, keep, only_stops=True)[0] == 2000
    monkeypatch.undo()
    monkeypatch.setattr(file, "_clock_ms", lambda: 5)
    assert file.next_order(MISSION, keep, only_stops=True) == (2001, b"flight A", "")


def test_what_only_stops_goes_out_beside_a_file_that_is_none(tmp_path: Path) -> None:
    path = tmp_path / "k.orders"
    path.write_text("garbage")
    file = OperatorFile(path, lambda: 7)
    assert file.next_order(MISSION, keep, only_stops=True)[:2] == (7, NO_FLIGHT)
    assert file.next_order(MISSION, keep, only_stops=True)[0] == 8
    assert path.read_text() == "garbage"


def test_disk_that_hangs_keeps_no_order_waiting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, answers = OperatorFile(tmp_path / "k.orders", lambda: 7), threading.Event()
    monkeypatch.setattr(order_file, "DISK_S", 0.01)
    monkeypatch.setattr(os, "fsync", lambda _: answers.wait())
    try:
        with pytest.raises(TimeoutError):
            file.next_order(MISSION, keep, only_stops=False)
        assert file.next_order(MISSION, keep, only_stops=True) == (7, NO_FLIGHT, "the disk does not answer")
    finally:
        answers.set()
