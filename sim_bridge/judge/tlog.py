"""Telemetry logs as MAVProxy and QGroundControl write them: 8-byte big-endian microseconds, then one raw frame."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from companion.mavlink.framing.frames import whole

BLOCK_BYTES = 1 << 16  # some 20 s of one vehicle's links
_STAMP = struct.Struct(">Q")


class TlogWriter:
    """One file of frames, readable by mavlogdump, MAVExplorer and `mavutil.mavlink_connection`.

    A file that cannot be written (disk full) is given up, what it holds by then is kept: a log is not the flight.
    """

    def __init__(self, path: Path, given_up: Callable[[str], None] = lambda _why: None) -> None:
        """OSError when `path` cannot be opened. It is written in blocks, the last one by `close`.

        `given_up` is called at most once, with the file and why it cannot be written.
        """
        self._path = path
        self._given_up = given_up
        self._file: BinaryIO | None = path.open("wb", buffering=BLOCK_BYTES)

    def write(self, time_us: int, data: bytes) -> None:
        """Every frame in `data`, stamped with Unix time in microseconds."""
        if self._file is None:
            return
        stamp = _STAMP.pack(time_us)
        try:
            self._file.write(b"".join([stamp + data[start:end] for start, end, _ in whole(data)]))
        except OSError as error:
            with contextlib.suppress(OSError):  # it flushes once more
                self._file.close()
            self._give_up(error)

    def close(self) -> None:
        """Flush and close."""
        if self._file is None:
            return
        try:
            self._file.close()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self._file = None
        self._given_up(f"{self._path}: cannot be written: {error.strerror}; the log ends here")

    def __enter__(self) -> TlogWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
