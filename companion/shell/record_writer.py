"""Writes records to the disk beside the loop: a card that takes half a second to sync must not keep a setpoint waiting.

The thread does nothing but this: it sends nothing, and a loop that hangs leaves the autopilot alone all the same.
"""

from __future__ import annotations

import queue
import threading
from typing import Final

from companion.records.store import Batch, RecordStore, StoreError, Written

JOIN_S: Final = 2.0  # at the end, for the last write


class ThreadedWriter:
    """A `RecordWriter` with one batch under way at most."""

    def __init__(self, store: RecordStore) -> None:
        self._store = store
        self._batches: queue.Queue[Batch | None] = queue.Queue(maxsize=1)
        self._outcomes: queue.Queue[Written | StoreError] = queue.Queue(maxsize=1)
        self._thread = threading.Thread(target=self._run, name="records", daemon=True)
        self._thread.start()

    def submit(self, batch: Batch) -> bool:
        """False while another one is under way."""
        try:
            self._batches.put_nowait(batch)
        except queue.Full:
            return False
        return True

    def take_outcome(self) -> Written | StoreError | None:
        """Outcome of the batch, once it is there."""
        try:
            return self._outcomes.get_nowait()
        except queue.Empty:
            return None

    def close(self) -> None:
        """After the batch that is under way."""
        if self._thread.is_alive():
            try:
                self._batches.put(None, timeout=JOIN_S)
            except queue.Full:
                return
            self._thread.join(JOIN_S)

    def _run(self) -> None:
        while (batch := self._batches.get()) is not None:
            try:
                self._outcomes.put(self._store.write(batch))
            except StoreError as error:
                self._outcomes.put(error)
