"""A vehicle's file of returns: passes one behind another, each framed and checked, so that a torn end costs one.

It is only added to: a companion that starts again, and the next flight of the mission, go on behind what is there.
Nothing here needs numpy: returns_reader.py reads such files.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

BYTES_MAX: Final = 128 * 1024 * 1024  # of a file: seven million returns, some two hours among 400 trees/ha
HEAD: Final = struct.Struct("<4sII")  # magic, length, CRC-32 of what follows
MAGIC: Final = b"Uret"


class ReturnsFile:
    """Adds to one vehicle's file."""

    def __init__(self, path: Path, *, bytes_max: int = BYTES_MAX) -> None:
        self.path: Final = path
        self._bytes_max: Final = bytes_max
        self.lost = 0  # passes that were not written

    def write(self, passes: Sequence[bytes]) -> str:
        """Add them; why it could not, in a few words, else empty. Never raises for the disk."""
        data = b"".join(HEAD.pack(MAGIC, len(one), zlib.crc32(one)) + one for one in passes)
        try:
            with self.path.open("ab") as file:
                if file.tell() + len(data) > self._bytes_max:
                    self.lost += len(passes)
                    return f"{self.path.name} is full, at {self._bytes_max / 2**20:g} MiB"
                file.write(data)
        except OSError as error:
            self.lost += len(passes)
            return error.strerror or str(error)
        return ""
