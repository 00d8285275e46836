"""The operator's own file, beside the key: the count of its orders, and the flight that each mission is in.

Two programs of one operator may share it: it is locked from reading the count until the next one is on the disk. What
only stops vehicles waits for no disk: where the file cannot be had it is counted by the clock, above all that is known.
"""

from __future__ import annotations

import fcntl
import json
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

from companion.mavlink.orders.order import COUNTER_MAX, NO_FLIGHT, NONCE_BYTES
from companion.order.station import Numbered, OrderFileError, reason_of
from mission.common.durable_files import write_durably

T = TypeVar("T")
SUFFIX: Final = ".orders"
MISSIONS_MAX: Final = 64  # whose flights are kept; the oldest go
MISSION_BYTES: Final = 32  # of a mission file's SHA-256
BYTES_MAX: Final = 1 << 16
DISK_S: Final = 1.0  # that a disk may take: a card that hangs keeps no order waiting, nor the repeats of the last one


class OperatorFile:
    """An `OrderFile` in a file. The clock makes counts of a lost file greater than those before."""

    def __init__(self, path: Path, clock_ms: Callable[[], int]) -> None:
        self._path, self._clock_ms = path, clock_ms
        self._memory = threading.Lock()
        self._counter = 0  # the highest that this process has read or given,
        self._flights: dict[str, str] = {}  # and the flights as it read or chose them last

    def next_order(self, digest: bytes, choose: Callable[[bytes], bytes], *, only_stops: bool) -> Numbered:
        """As `OrderFile`. OrderFileError: what is there is none, and a count from anew could be too low."""
        try:
            return self._within_time(lambda: self._write_next(digest, choose))
        except (OSError, OrderFileError) as error:
            if not only_stops:
                raise
            with self._memory:
                self._counter = max(self._counter + 1, self._clock_ms(), 1)
                flight = choose(bytes.fromhex(self._flights.get(digest.hex(), NO_FLIGHT.hex())))
                return Numbered(self._counter, flight, reason_of(error))

    def knows_flight(self, digest: bytes) -> bool:
        """A START of this mission was sent before. OrderFileError, OSError."""
        state = self._within_time(self._read_state)
        return bool(state["flights"].get(digest.hex(), NO_FLIGHT.hex()) != NO_FLIGHT.hex())

    def _within_time(self, use: Callable[[], T]) -> T:
        """The result of `use`. TimeoutError, an OSError: the disk takes too long; `use` goes on in its thread."""
        found: list[T] = []
        errors: list[OSError | OrderFileError] = []

        def run() -> None:
            try:
                found.append(use())
            except (OSError, OrderFileError) as error:
                errors.append(error)

        thread = threading.Thread(target=run, name="orders", daemon=True)
        thread.start()
        thread.join(DISK_S)
        if errors:
            raise errors[0]
        if not found:
            raise TimeoutError(110, "the disk does not answer", str(self._path))
        return found[0]

    def _write_next(self, digest: bytes, choose: Callable[[bytes], bytes]) -> Numbered:
        lock = os.open(f"{self._path}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            state = self._read_state()
            with self._memory:
                counter = max(state["counter"] + 1, self._counter + 1, self._clock_ms(), 1)
            flights: dict[str, str] = state["flights"]
            flight = choose(bytes.fromhex(flights.pop(digest.hex(), NO_FLIGHT.hex())))
            flights[digest.hex()] = flight.hex()
            for oldest in list(flights)[:-MISSIONS_MAX]:
                del flights[oldest]
            write_durably(self._path, json.dumps({"counter": counter, "flights": flights}, indent=1).encode() + b"\n")
            self._remember(counter, flights)
        finally:
            os.close(lock)
        return Numbered(counter, flight)

    def _remember(self, counter: int, flights: dict[str, str]) -> None:
        with self._memory:
            self._counter, self._flights = max(self._counter, counter), dict(flights)

    def _read_state(self) -> dict[str, Any]:
        try:
            with self._path.open("rb") as file:
                text = file.read(BYTES_MAX)
        except FileNotFoundError:
            return {"counter": 0, "flights": {}}
        try:
            state = json.loads(text)
            counter, flights = state["counter"], state["flights"]
            whole = type(counter) is int and 0 <= counter < COUNTER_MAX  # True is no count
            whole = whole and all(
                len(bytes.fromhex(mission)) == MISSION_BYTES and len(bytes.fromhex(flight)) == NONCE_BYTES
                for mission, flight in flights.items()
            )
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            whole = False
        if not whole:
            raise OrderFileError(f"{self._path}: is no file of an operator's orders: move it away to begin anew")
        self._remember(counter, flights)
        return {"counter": counter, "flights": dict(flights)}
