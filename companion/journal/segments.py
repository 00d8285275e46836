"""Files of a black box: one flight of one vehicle in segments, appended to, bounded in size.

FOLDER/vehicle-3-flight-0007-0001.mcap. A segment that is full is closed and the next one begun; so is one to which a
write fails: what is torn there stays as it is. When the vehicle has more than `bytes_max`, or FILES_MAX, whole files
go, oldest first: those of earlier flights, then the first of this one, which then cannot be replayed any more.
"""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from companion.journal import mcap
from companion.journal.journal import Batch, Outcome

SEGMENT_BYTES: Final = 32 << 20
_DISK_ERRORS: Final = (errno.ENOSPC, errno.EIO, errno.EDQUOT)
BYTES_MAX: Final = 1 << 30  # of one vehicle; 6 hours with all of PX4's streams, 14 with those that are asked for
FILES_MAX: Final = 10_000  # of one vehicle: a companion that is started again and again makes small ones
NAME: Final = re.compile(r"vehicle-(\d+)-flight-(\d+)-(\d+)\.mcap")


def segment_key(path: Path) -> tuple[int, int, int] | None:
    """Vehicle, flight and number of a segment; None: it is none."""
    match = NAME.fullmatch(path.name)
    return None if match is None else (int(match[1]), int(match[2]), int(match[3]))


def find_segments(folder: Path, vehicle_id: int | None = None) -> dict[tuple[int, int, int], Path]:
    """Segments in a folder by vehicle, flight and number, in that order. OSError."""
    found = {key: path for path in folder.iterdir() if (key := segment_key(path)) is not None}
    return dict(sorted((key, path) for key, path in found.items() if vehicle_id in (None, key[0])))


class SegmentFiles:
    """Writes the segments of one flight. Nothing is opened before the first batch: no disk delays a start."""

    def __init__(
        self,
        folder: Path,
        vehicle_id: int,
        head: bytes,
        *,
        segment_bytes: int = SEGMENT_BYTES,
        bytes_max: int = BYTES_MAX,
        waits_for_disk: bool = True,
    ) -> None:
        """`head`: how each segment begins. `waits_for_disk`: fsync, as a flight needs it and a simulation does not."""
        self.folder: Final = folder
        self._vehicle_id: Final = vehicle_id
        self._head: Final = head
        self._segment_bytes: Final = segment_bytes
        self._bytes_max: Final = bytes_max
        self._waits_for_disk: Final = waits_for_disk
        self._flight = 0  # its number, once it is known
        self._segment = 0
        self._fd = -1
        self._size = 0
        self._lines: list[str] = []

    def write(self, batch: Batch) -> Outcome:
        """Append a batch, chunk by chunk."""
        written = 0
        self._lines = []
        try:
            for chunk in batch.chunks:
                if self._fd >= 0 and self._size + len(chunk) > self._segment_bytes:
                    self._end_segment()
                if self._fd < 0:
                    self._begin_segment()
                self._append(chunk)
                written += 1
            if batch.is_synced and self._waits_for_disk and self._fd >= 0:
                os.fsync(self._fd)
        except OSError as error:
            self._let_go()
            why = error.strerror or str(error)
            if error.errno not in _DISK_ERRORS:  # of a folder that cannot be one: it is to be named
                why = f"{self.folder}: {why}"
            return Outcome(written, why, tuple(self._lines))
        return Outcome(written, "", tuple(self._lines))

    def close(self) -> None:
        """The end of the flight."""
        try:
            if self._fd >= 0:
                self._end_segment()
        except OSError:
            self._let_go()

    def _begin_segment(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        known = find_segments(self.folder, self._vehicle_id)
        if not self._flight:
            self._flight = 1 + max((flight for _, flight, _ in known), default=0)
        self._give_up_oldest(known)
        name = f"vehicle-{self._vehicle_id}-flight-{self._flight:04d}-{self._segment + 1:04d}.mcap"
        path = self.folder / name
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        self._fd = os.open(path, flags, 0o644)
        self._size = 0
        try:
            self._append(self._head)
        except OSError:  # full: the name is free again, or each try would leave a file
            self._let_go()
            path.unlink(missing_ok=True)
            raise
        self._segment += 1
        if self._segment == 1:
            self._lines.append(f"black box: {path}")
        if self._waits_for_disk:
            _sync_folder(self.folder)

    def _give_up_oldest(self, known: dict[tuple[int, int, int], Path]) -> None:
        sizes = {key: path.stat().st_size for key, path in known.items() if path.is_file()}  # no folder, dead link
        total, files = sum(sizes.values()) + self._segment_bytes, len(sizes) + 1
        for key in sizes:
            if total <= self._bytes_max and files <= FILES_MAX:
                break
            path = known[key]
            path.unlink()
            total, files = total - sizes[key], files - 1
            own = ", the beginning of this flight: it cannot be replayed" if key[1] == self._flight else ""
            self._lines.append(f"black box: no room for more: given up {path.name}{own}")

    def _append(self, data: bytes) -> None:
        left: Sequence[int] | memoryview = memoryview(data)
        while left:
            count = os.write(self._fd, left)  # type: ignore[arg-type]
            self._size += count
            left = left[count:]

    def _end_segment(self) -> None:
        self._append(mcap.end())
        if self._waits_for_disk:
            os.fsync(self._fd)
        self._let_go()

    def _let_go(self) -> None:
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)


class DirectWriter:
    """Writes while the caller waits; a full disk can be played."""

    def __init__(self, files: SegmentFiles) -> None:
        self._files: Final = files
        self._outcome: Outcome | None = None
        self._is_full = False

    def fill(self, *, full: bool) -> None:
        """Nothing more is written, or again: a fault of a simulated disk."""
        self._is_full = full

    def submit(self, batch: Batch) -> bool:
        """Write it."""
        self._outcome = Outcome(0, "disk full") if self._is_full else self._files.write(batch)
        return True

    def take_outcome(self) -> Outcome | None:
        """Its outcome."""
        outcome, self._outcome = self._outcome, None
        return outcome

    def finish(self, batch: Batch) -> None:
        """The last batch, and the end of the file."""
        self.submit(batch)
        if not self._is_full:
            self._files.close()


def _sync_folder(folder: Path) -> None:
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
