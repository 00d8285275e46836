"""A vehicle's file of returns: passes one behind another, each framed and checked, so that a torn end costs one.

It is only added to: a companion that starts again, and the next flight of the mission, go on behind what is there.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from companion.cloud.returns import POINT, POINTS_MAX, StemReturns, decode_returns

BYTES_MAX: Final = 128 * 1024 * 1024  # of a file: seven million returns, some two hours among 400 trees/ha
PASS_BYTES_MAX: Final = POINTS_MAX * POINT.itemsize + 512
_HEAD: Final = struct.Struct("<4sII")  # magic, length, CRC-32 of what follows
_MAGIC: Final = b"Uret"


class ReturnsFileError(Exception):
    """A file that holds no returns; the message names it."""


class ReturnsFile:
    """Adds to one vehicle's file."""

    def __init__(self, path: Path, *, bytes_max: int = BYTES_MAX) -> None:
        self.path: Final = path
        self._bytes_max: Final = bytes_max
        self.lost = 0  # passes that were not written

    def write(self, passes: Sequence[bytes]) -> str:
        """Add them; why it could not, in a few words, else empty. Never raises for the disk."""
        data = b"".join(_HEAD.pack(_MAGIC, len(one), zlib.crc32(one)) + one for one in passes)
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


def read_returns(path: Path) -> tuple[list[StemReturns], int]:
    """Passes in a file, in their order, and bytes of it that are none. ReturnsFileError: unreadable, or it has none."""
    try:
        if path.stat().st_size > BYTES_MAX:
            raise ReturnsFileError(f"{path}: is larger than {BYTES_MAX // 2**20} MiB: no file of returns")
        data = path.read_bytes()
    except OSError as error:
        raise ReturnsFileError(f"{path}: {error.strerror}") from None
    found = [(size, returns) for size, one in _passes(data) if (returns := decode_returns(one)) is not None]
    if data and not found:
        raise ReturnsFileError(f"{path}: holds no returns of a survey")
    return [returns for _, returns in found], len(data) - sum(size for size, _ in found)


def _passes(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Whole ones with the bytes that they take; behind what is torn it goes on at the next."""
    at = data.find(_MAGIC)
    while 0 <= at <= len(data) - _HEAD.size:
        _, length, crc = _HEAD.unpack_from(data, at)
        first = at + _HEAD.size
        one = data[first : first + length]
        if length <= PASS_BYTES_MAX and len(one) == length and zlib.crc32(one) == crc:
            yield _HEAD.size + length, one
            at = data.find(_MAGIC, first + length)
        else:
            at = data.find(_MAGIC, at + 1)
