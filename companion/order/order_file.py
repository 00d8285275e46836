"""The operator's own file, beside the key: the count of its orders, and the flight that each mission is in.

Two programs of one operator may share it: it is locked from reading the count until the next one is on the disk.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from companion.mavlink.orders.order import COUNTER_MAX, NO_FLIGHT, NONCE_BYTES
from mission.common.durable_files import write_durably

SUFFIX: Final = ".orders"
MISSIONS_MAX: Final = 64  # whose flights are kept; the oldest go
BYTES_MAX: Final = 1 << 16


class OrderFileError(ValueError):
    """The file is not one of these; the message names it."""


class OperatorFile:
    """An `OrderFile` in a file. The clock only makes counts of a lost file greater than those before."""

    def __init__(self, path: Path, clock_ms: Callable[[], int]) -> None:
        self._path, self._clock_ms = path, clock_ms

    def next_order(self, digest: bytes, choose: Callable[[bytes], bytes]) -> tuple[int, bytes]:
        """As `OrderFile`. OrderFileError: what is there is none, and a count from anew could be too low."""
        lock = os.open(f"{self._path}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            state = self._read_state()
            counter = max(state["counter"] + 1, self._clock_ms(), 1)
            if counter > COUNTER_MAX:
                raise OrderFileError(f"{self._path}: counter = {counter}: must be at most {COUNTER_MAX}")
            flights: dict[str, str] = state["flights"]
            flight = choose(bytes.fromhex(flights.pop(digest.hex(), NO_FLIGHT.hex())))
            flights[digest.hex()] = flight.hex()
            for oldest in list(flights)[:-MISSIONS_MAX]:
                del flights[oldest]
            write_durably(self._path, json.dumps({"counter": counter, "flights": flights}, indent=1).encode() + b"\n")
        finally:
            os.close(lock)
        return counter, flight

    def knows_flight(self, digest: bytes) -> bool:
        """A START of this mission was sent before."""
        return bool(self._read_state()["flights"].get(digest.hex(), NO_FLIGHT.hex()) != NO_FLIGHT.hex())

    def _read_state(self) -> dict[str, Any]:
        try:
            with self._path.open("rb") as file:
                text = file.read(BYTES_MAX)
        except FileNotFoundError:
            return {"counter": 0, "flights": {}}
        try:
            state = json.loads(text)
            flights = state["flights"]
            whole = isinstance(state["counter"], int) and all(
                len(bytes.fromhex(flight)) == NONCE_BYTES for flight in flights.values()
            )
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            whole = False
        if not whole or state["counter"] < 0:
            raise OrderFileError(f"{self._path}: is no file of an operator's orders: move it away to begin anew")
        return {"counter": state["counter"], "flights": dict(flights)}
