"""Chunks of a black box, written to the disk beside the loop."""

from __future__ import annotations

import contextlib
import queue

from companion.journal import journal
from companion.journal.segments import SegmentFiles
from companion.shell.record_writer import JOIN_S, BesideLoop


class ThreadedChunks(BesideLoop[journal.Batch, journal.Outcome]):
    """A `ChunkWriter` of a black box."""

    def __init__(self, files: SegmentFiles) -> None:
        super().__init__(files.write, "black box")
        self._files = files

    def finish(self, batch: journal.Batch) -> None:
        """The last batch, behind the one under way; a disk that hangs is not waited for."""
        with contextlib.suppress(queue.Full):
            self._pieces.put(batch, timeout=JOIN_S)
        self.close()
        if not self._thread.is_alive():
            self._files.close()
