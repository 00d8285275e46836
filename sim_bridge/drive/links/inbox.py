"""Data on its way to one companion: telemetry that comes late, and what waits while it stands still."""

from __future__ import annotations

from collections import deque
from typing import Final

from mission.schema.fault_kinds import PARAMETERS

UNREAD_MAX_BYTES: Final = 60_000  # a link, about what a kernel keeps of small datagrams; the newest are lost beyond
UNDER_WAY_MAX = round(PARAMETERS["late_s"].most * 500)  # datagrams: more than any autopilot sends


class LateLine:
    """Datagrams that arrive so much after they were sent, and never before an earlier one."""

    def __init__(self) -> None:
        self._under_way: deque[tuple[float, bytes]] = deque(maxlen=UNDER_WAY_MAX)

    def put(self, data: bytes, now_s: float, late_s: float) -> None:
        """Sent now."""
        self._under_way.append((now_s + late_s, data))

    def pop_arrived(self, now_s: float) -> list[bytes]:
        """Datagrams that have arrived since the last call: none overtakes an earlier one."""
        arrived = []
        while self._under_way and self._under_way[0][0] <= now_s:
            arrived.append(self._under_way.popleft()[1])
        return arrived


class Inbox:
    """The links of one companion, up to where it reads them."""

    def __init__(self) -> None:
        self._line = LateLine()
        self._beacons: list[bytes] = []
        self._telemetry: list[bytes] = []
        self._scans: list[bytes] = []

    def put(self, beacons: bytes, telemetry: bytes, scans: bytes, now_s: float, late_s: float) -> None:
        """Takes in what the radio delivers now, and what the autopilot and the obstacle sensor send now."""
        self._line.put(telemetry, now_s, late_s)
        _append_bounded(self._beacons, beacons)
        _append_bounded(self._scans, scans)
        for data in self._line.pop_arrived(now_s):
            _append_bounded(self._telemetry, data)

    def drain_links(self) -> tuple[bytes, bytes, bytes]:
        """All that waits there, read at once: beacons, telemetry, scans."""
        found = b"".join(self._beacons), b"".join(self._telemetry), b"".join(self._scans)
        self._beacons.clear()
        self._telemetry.clear()
        self._scans.clear()
        return found


def _append_bounded(unread: list[bytes], data: bytes) -> None:
    if data and sum(map(len, unread)) + len(data) <= UNREAD_MAX_BYTES:
        unread.append(data)
