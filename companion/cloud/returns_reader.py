"""Reads vehicles' files of returns: behind what is torn it goes on at the next pass that is whole."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from companion.cloud.returns import POINT, POINTS_MAX, StemReturns, decode_returns
from companion.cloud.returns_file import BYTES_MAX, HEAD, MAGIC

PASS_BYTES_MAX: Final = POINTS_MAX * POINT.itemsize + 512


class ReturnsFileError(Exception):
    """A file that holds no returns; the message names it."""


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
    at = data.find(MAGIC)
    while 0 <= at <= len(data) - HEAD.size:
        _, length, crc = HEAD.unpack_from(data, at)
        first = at + HEAD.size
        one = data[first : first + length]
        if length <= PASS_BYTES_MAX and len(one) == length and zlib.crc32(one) == crc:
            yield HEAD.size + length, one
            at = data.find(MAGIC, first + length)
        else:
            at = data.find(MAGIC, at + 1)
