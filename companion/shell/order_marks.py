"""The file in which a vehicle's orders outlive its process, and a power cut: written whole, or as it was before.

In the air it is written by a thread: a card that takes half a second to sync must not keep a setpoint waiting, and an
order to land not for the card.
"""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path
from typing import Final

from mission.common.durable_files import write_durably

KEPT_MAX: Final = 4096  # more is none of ours
JOIN_S: Final = 2.0  # at the end, for the last write


class FileMarks:
    """`Marks` in a file of mode 0600; `kept` is what was there when it was opened."""

    def __init__(self, path: Path, *, beside_loop: bool = True) -> None:
        """`beside_loop`: what need not be waited for is written by a thread. OSError when the folder is not there."""
        self._path: Final = path
        self._folder: Final = path.parent
        if not self._folder.is_dir():
            raise FileNotFoundError(2, "no such folder", str(self._folder))
        self.kept = b""
        with contextlib.suppress(FileNotFoundError), path.open("rb") as file:
            self.kept = file.read(KEPT_MAX)
        self._beside_loop: Final = beside_loop
        self._changed: Final = threading.Condition()
        self._disk: Final = threading.Lock()  # one write at a time
        self._latest: tuple[bytes, int] | None = None  # to be written by the thread
        self._count = self._written = 0  # states in their order: an older one never replaces a newer
        self._failed = False  # the last write of the thread
        self._closed = False
        self._thread: threading.Thread | None = None

    def save(self, state: bytes, *, wait: bool) -> bool:
        """As `Marks`; of what is not waited for: False when the write before it has failed."""
        with self._changed:
            self._count += 1
            count = self._count
            if not wait and self._beside_loop:
                self._latest = (state, count)
                if self._thread is None:
                    self._thread = threading.Thread(target=self._run, name="orders", daemon=True)
                    self._thread.start()
                self._changed.notify()
                return not self._failed
        return self._write(state, count)

    def close(self) -> None:
        """After what is under way."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(JOIN_S)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._latest is not None or self._closed)
                latest, self._latest = self._latest, None
            if latest is None:
                return
            self._failed = not self._write(*latest)

    def _write(self, state: bytes, count: int) -> bool:
        with self._disk:
            if count < self._written:
                return True
            try:
                write_durably(self._path, state)
            except OSError:
                return False
            self._written = count
        return True
