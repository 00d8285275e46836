"""Reading a lidar's link in turns."""

from __future__ import annotations

import os
from collections import deque

import pytest

from companion.lidar.command import FRESH_MAX, Reader, Refusals
from companion.lidar.livox import Mid360
from companion.lidar.mounting import Mounting
from companion.lidar.sectors import Limits, SectorScan
from companion.shell.urls import Scheme, Url
from tests.unit.lidar.lidar_kit import mid360_points


class Queue:
    """A link with datagrams that have come already."""

    errors = lost = 0
    up = True

    def __init__(self, fd: int, datagrams: list[bytes]) -> None:
        self._fd = fd
        self._waiting = deque(datagrams)

    def fileno(self) -> int:
        return self._fd

    def recv(self) -> bytes | None:
        return self._waiting.popleft() if self._waiting else None

    def send(self, data: bytes) -> None:
        raise AssertionError(data)

    def close(self) -> None: ...


def test_of_a_backlog_only_the_newest_datagrams_are_in_a_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    readable, writable = os.pipe()
    os.close(writable)  # at its end: always readable
    now_s = [0.0]
    monkeypatch.setattr("companion.lidar.command.time.monotonic", lambda: now_s[0])
    old, new = mid360_points(3, [(1.0, 0.0, 0.0)]), mid360_points(3, [(2.0, 0.0, 0.0)])
    link = Queue(readable, [old] * 300 + [new] * FRESH_MAX)
    scan = SectorScan(Limits(0.1, 40.0, 0.1), Mounting())
    reader = Reader(Url(Scheme.UDP_IN, "127.0.0.1", 56301), link, Mid360(), scan, None)
    assert reader.read_scans() == []
    now_s[0] = 0.1
    link._waiting.append(new)
    (scan_cm,) = reader.read_scans()
    assert scan_cm[0] == 200
    os.close(readable)


@pytest.mark.parametrize(
    ("datagrams", "lost", "advice"),
    [
        ([b"\x37" * 900, mid360_points(3, [(1.0, 0.0, 0.0)])[:-1]], 0, "2 datagrams are no points of a Mid-360"),
        ([], 2, "2 datagrams at udpin://127.0.0.1:56301 are too long"),
        ([], 0, "nothing is received at udpin://127.0.0.1:56301"),
    ],
)
def test_a_mid360_without_points_is_not_looked_for_on_a_serial_line(
    datagrams: list[bytes], lost: int, advice: str
) -> None:
    readable, writable = os.pipe()
    os.close(writable)
    link = Queue(readable, datagrams)
    link.lost = lost
    scan = SectorScan(Limits(0.1, 40.0, 0.1), Mounting())
    reader = Reader(Url(Scheme.UDP_IN, "127.0.0.1", 56301), link, Mid360(), scan, None)
    assert reader.read_scans() == []
    assert advice in reader.describe_silence()
    assert "baud" not in reader.describe_silence()
    os.close(readable)


def test_of_a_while_in_which_nothing_is_sent_it_is_not_said_who_listens() -> None:
    refusals = Refusals(Url(Scheme.UDP_OUT, "127.0.0.1", 14570))
    assert refusals.update(20, 10) == "nobody listens at udpout://127.0.0.1:14570"
    assert refusals.update(20, 10) == ""  # the lidar is unplugged
    assert refusals.update(21, 10) == ""  # refused, which is told with the next
    assert refusals.update(40, 20) == ""
    assert refusals.update(60, 20) == "scans to udpout://127.0.0.1:14570 are refused no more"
    assert refusals.update(80, 20) == ""
