"""Telemetry logs as MAVProxy and QGroundControl write them: 8-byte big-endian microseconds, then one raw frame."""

from __future__ import annotations

import struct
from pathlib import Path
from types import TracebackType

from companion.mavlink.frames import whole

BLOCK_BYTES = 1 << 16  # some 20 s of one vehicle's links
_STAMP = struct.Struct(">Q")


class TlogWriter:
    """One file of frames, readable by mavlogdump, MAVExplorer and `mavutil.mavlink_connection`."""

    def __init__(self, path: Path) -> None:
        """OSError when `path` cannot be written. It is written in blocks, the last one by `close`."""
        self._file = path.open("wb", buffering=BLOCK_BYTES)

    def write(self, time_us: int, data: bytes) -> None:
        """Every frame in `data`, stamped with Unix time in microseconds."""
        stamp = _STAMP.pack(time_us)
        self._file.write(b"".join([stamp + data[start:end] for start, end, _ in whole(data)]))

    def close(self) -> None:
        """Flush and close."""
        self._file.close()

    def __enter__(self) -> TlogWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
