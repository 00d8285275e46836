"""Returns of a lidar at one stem on one pass, where the fit has them, and their form on disk: CBOR (RFC 8949)."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import Any, Final

import cbor2
import numpy as np
from numpy.typing import NDArray

FORMAT: Final = 1
POINTS_MAX: Final = 4096  # of one stem: a survey pools 1500
BODY_MAX: Final = 160  # bytes of a record
FAR_MAX_M: Final = 1e6
OF_STEM: Final = 1  # flag: the fit counts it as of the stem; else it is of what stands beside, or a stray one
# Of a return, little-endian: metres north, east of the base, up above the origin's ground; seconds after the first
POINT: Final = np.dtype(
    [("north_m", "<f4"), ("east_m", "<f4"), ("up_m", "<f4"), ("at_s", "<f4"), ("ring", "u1"), ("flags", "u1")]
)
Points = NDArray[np.void]


@dataclass(frozen=True, slots=True)
class StemReturns:
    """One pass of one stem. The mission's frame, as its vehicle estimated itself: as in the record of the stem."""

    vehicle_id: int
    body: bytes  # of that record; empty: there is none, as of what is too thin
    first_s: float  # of the vehicle's clock
    north_m: float  # the base
    east_m: float
    ground_up_m: float | None  # of the ground at the stem above the origin's, by rays; None: not seen
    points: Points


def encode_returns(returns: StemReturns) -> bytes:
    """One pass. ValueError for too many points."""
    if len(returns.points) > POINTS_MAX:
        raise ValueError(f"{len(returns.points)} points: must be at most {POINTS_MAX}")
    place = [returns.first_s, returns.north_m, returns.east_m, returns.ground_up_m]
    return cbor2.dumps([FORMAT, returns.vehicle_id, returns.body, *place, returns.points.tobytes()])


def decode_returns(data: bytes) -> StemReturns | None:
    """None for what is malformed, out of bounds, or of another format. A file comes from a disk that may lie."""
    try:
        stream = io.BytesIO(data)
        told = cbor2.load(stream)
    except (cbor2.CBORError, ValueError, OverflowError, TypeError, RecursionError, ArithmeticError, LookupError):
        return None
    if stream.tell() != len(data) or type(told) is not list or len(told) != 8 or told[0] != FORMAT:
        return None
    vehicle_id, body, first_s, north_m, east_m, ground_up_m, blob = told[1:]
    if type(vehicle_id) is not int or not 1 <= vehicle_id <= 250 or type(body) is not bytes or len(body) > BODY_MAX:
        return None
    if not (_is_within(first_s, 0.0, 1e12) and all(_is_within(m, -FAR_MAX_M, FAR_MAX_M) for m in (north_m, east_m))):
        return None
    if ground_up_m is not None and not _is_within(ground_up_m, -FAR_MAX_M, FAR_MAX_M):
        return None
    if type(blob) is not bytes or len(blob) % POINT.itemsize or len(blob) > POINTS_MAX * POINT.itemsize:
        return None
    points = np.frombuffer(blob, dtype=POINT)
    if not all(bool((np.abs(points[axis]) < FAR_MAX_M).all()) for axis in ("north_m", "east_m", "up_m", "at_s")):
        return None  # false for NaN
    ground = None if ground_up_m is None else float(ground_up_m)
    return StemReturns(vehicle_id, body, float(first_s), float(north_m), float(east_m), ground, points)


def _is_within(told: Any, low: float, high: float) -> bool:
    return type(told) in (int, float) and math.isfinite(told) and low <= told <= high
