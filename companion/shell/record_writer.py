"""Writes to the disk beside the loop: a card that takes half a second to sync must not keep a setpoint waiting.

The thread does nothing but this: it sends nothing, and a loop that hangs leaves the autopilot alone all the same.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Final, Generic, TypeVar

from companion.records.store import Batch, RecordStore, StoreError, Written

JOIN_S: Final = 2.0  # at the end, for the last write
Work = TypeVar("Work")
Result = TypeVar("Result")


class BesideLoop(Generic[Work, Result]):
    """Does work in a thread, with one piece under way at most."""

    def __init__(self, work: Callable[[Work], Result], name: str) -> None:
        self._work = work
        self._pieces: queue.Queue[Work | None] = queue.Queue(maxsize=1)
        self._outcomes: queue.Queue[Result] = queue.Queue(maxsize=2)  # one more at the end
        self._is_under_way = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def submit(self, piece: Work) -> bool:
        """False while another one is under way."""
        if self._is_under_way:
            return False
        self._is_under_way = True
        self._pieces.put_nowait(piece)
        return True

    def take_outcome(self) -> Result | None:
        """Outcome of a piece, once it is there."""
        try:
            outcome = self._outcomes.get_nowait()
        except queue.Empty:
            return None
        self._is_under_way = False
        return outcome

    def close(self) -> None:
        """After the piece that is under way."""
        if self._thread.is_alive():
            try:
                self._pieces.put(None, timeout=JOIN_S)
            except queue.Full:
                return
            self._thread.join(JOIN_S)

    def _run(self) -> None:
        while (piece := self._pieces.get()) is not None:
            self._outcomes.put(self._work(piece))


class ThreadedWriter(BesideLoop[Batch, Written | StoreError]):
    """A `RecordWriter`."""

    def __init__(self, store: RecordStore) -> None:
        def write(batch: Batch) -> Written | StoreError:
            try:
                return store.write(batch)
            except StoreError as error:
                return error

        super().__init__(write, "records")
