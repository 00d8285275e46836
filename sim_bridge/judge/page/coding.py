"""Series of a replay as short lists of whole numbers: rounded, and coded as differences (docs/reference/replay.md)."""

from __future__ import annotations

import base64
import json
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

Series = dict[str, Any]
DEFLATE_RAW = -15  # as browsers unpack with DecompressionStream("deflate-raw")


def column(values: NDArray[Any], step: float, order: int = 1) -> Series:
    """(T,) numbers, rounded to `step`, as differences of the first or second `order`; nan: no value there.

    A stretch without a value repeats the one before it, so that it costs nothing, and is listed under `gaps`: its first
    row and its length, one stretch after the other.
    """
    known = np.isfinite(values)
    filled = values
    if not known.all():
        last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
        filled = np.where(last >= 0, values[np.maximum(last, 0)], 0.0)
    numbers = np.rint(filled / step).astype(np.int64)
    for _ in range(order):
        numbers = np.diff(numbers, prepend=0)
    coded: Series = {"step": step, "order": order, "is": numbers.tolist()}
    if not known.all():
        edges = np.flatnonzero(np.diff(np.concatenate(([True], known, [True]))))
        coded["gaps"] = np.column_stack((edges[::2], edges[1::2] - edges[::2])).ravel().tolist()
    return coded


def steps(values: NDArray[Any], step: float = 1.0) -> Series:
    """(T,) numbers that seldom change: in which rows they do, coded as differences, and what they are from there on."""
    numbers = np.rint(np.asarray(values, dtype=np.float64) / step).astype(np.int64)
    rows = np.flatnonzero(np.diff(numbers, prepend=numbers[:1] - 1))
    return {"step": step, "rows": np.diff(rows, prepend=0).tolist(), "is": numbers[rows].tolist()}


def toggles(flags: NDArray[np.bool_]) -> list[int]:
    """(T,) rows in which a flag that begins as false changes, coded as differences."""
    rows = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0))
    return [int(row) for row in np.diff(rows, prepend=0)]


def read_column(coded: Series) -> NDArray[np.float64]:
    """Inverse of `column`: its values, to half a step."""
    numbers = np.array(coded["is"], dtype=np.int64)
    for _ in range(coded["order"]):
        numbers = np.cumsum(numbers)
    values: NDArray[np.float64] = numbers.astype(np.float64) * float(coded["step"])
    gaps = coded.get("gaps", [])
    for row, count in zip(gaps[::2], gaps[1::2], strict=True):
        values[row : row + count] = np.nan
    return values


def read_steps(coded: Series, length: int) -> NDArray[np.float64]:
    """Inverse of `steps`: its values, to half a step: (`length`,)."""
    rows = np.cumsum(np.array(coded["rows"], dtype=np.int64))
    counts = np.diff(np.append(rows, length))
    values: NDArray[np.float64] = np.repeat(np.array(coded["is"]) * float(coded["step"]), counts)
    return values


def pack(document: dict[str, Any]) -> str:
    """JSON, deflated, in base64: no character of it means anything in HTML. ValueError for a number that is none."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False, ensure_ascii=False)
    squeezer = zlib.compressobj(9, zlib.DEFLATED, DEFLATE_RAW)
    return base64.b64encode(squeezer.compress(text.encode()) + squeezer.flush()).decode("ascii")


def unpack(packed: str) -> Any:
    """Inverse of `pack`. ValueError, zlib.error for anything else."""
    return json.loads(zlib.decompress(base64.b64decode(packed, validate=True), DEFLATE_RAW))
