"""The contract of a driver: bytes of a lidar -> returns. Sans-IO: links and clock are the command's."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

# One pulse, in the lidar's own frame: azimuth from its zero in 0.01 degree, clockwise seen from above, 0 to 35999;
# range along its plane in m, 0 where nothing came back; height above that plane in m; True for the first of a
# revolution. A plain tuple: some lidars make 200,000 a second.
Return = tuple[int, float, float, bool]


class Driver(Protocol):
    """One lidar. Nothing raises, whatever the bytes; at most one packet and one read are kept."""

    bad: int  # bytes that are part of no packet, of a lidar on Ethernet datagrams
    notes: list[str]  # what the lidar said of itself, for the log; the reader empties it

    def poll(self, now_s: float) -> bytes:
        """Request to be sent to the lidar now, if any; times are monotonic. Asked in every turn of the loop."""

    def decode(self, data: bytes) -> Iterable[Return]:
        """Returns in the bytes read, which may break anywhere, or in one datagram."""

    def shutdown(self) -> bytes:
        """Request that stops it, if there is one."""
