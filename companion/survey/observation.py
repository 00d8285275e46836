"""A stem as one vehicle measured it on one pass, and its form on disk and on the air: a CBOR array (RFC 8949)."""

from __future__ import annotations

import io
import math
import struct
from dataclasses import astuple, dataclass
from enum import IntEnum
from typing import Any, Final

import cbor2

STEM_KIND: Final = 1  # of a record that holds one
BODY_MAX: Final = 160  # bytes
REASON_MAX: Final = 40  # characters
FAR_MAX_M: Final = 1e6  # from the mission's origin
RAYS_MAX: Final = 1_000_000
FIELDS: Final = 16  # of the array


class Grade(IntEnum):
    """Reliability of a measurement."""

    GOOD = 0
    FAIR = 1
    POOR = 2


@dataclass(frozen=True, slots=True)
class StemObservation:
    """One stem as one vehicle measured it on one pass.

    Positions: the mission's frame, NED metres from its origin, as that vehicle estimated itself.
    """

    vehicle_id: int
    first_s: float  # of the vehicle's clock, and
    last_s: float  # the time of the last ray that went into it
    north_m: float  # axis at the height of the cut
    east_m: float
    position_sd_m: float  # of the axis relative to the vehicle's own track: fit and own motion during the pass
    frame_sd_m: float  # of the vehicle's own position in the mission's frame meanwhile: common to all that it saw then
    cut_up_m: float  # height of the cut above the ground at the stem
    diameter_m: float  # at the cut
    diameter_sd_m: float
    dbh_m: float  # at 1.3 m above the ground: measured there, or by taper from the cut
    dbh_sd_m: float  # with the error that the taper adds
    is_dbh_measured: bool  # rays cut it within 0.3 m of breast height
    lean_rad: float | None  # None: not measured
    arc_share: float  # of the circumference with rays on it, 0..1
    rays: int
    grade: Grade
    reason: str  # why it is not GOOD, <= 40 characters; "" when it is


# Of the fields of the array in their order, without the last four: least and greatest; the times come first
_BOUNDS: Final = (
    (0.0, 1e12),
    (0.0, 1e12),
    (-FAR_MAX_M, FAR_MAX_M),
    (-FAR_MAX_M, FAR_MAX_M),
    (0.0, FAR_MAX_M),
    (0.0, FAR_MAX_M),
    (-100.0, 200.0),
    (0.001, 20.0),
    (0.0, 20.0),
    (0.001, 20.0),
    (0.0, 20.0),
)


def encode(observation: StemObservation) -> bytes:
    """At most BODY_MAX bytes; without the vehicle's id, which its record bears. ValueError for too long a reason."""
    if len(observation.reason) > REASON_MAX or not observation.reason.isascii():
        raise ValueError(f"reason = {observation.reason!r}: must be at most {REASON_MAX} ASCII characters")
    _, first_s, last_s, *numbers, measured, lean, arc, rays, grade, reason = astuple(observation)
    rounded: list[Any] = [to_single(number) for number in numbers]
    lean_told = None if lean is None else to_single(lean)
    told = [first_s, last_s, *rounded, measured, lean_told, to_single(arc), rays, int(grade), reason]
    return cbor2.dumps(told, canonical=True)


def decode(body: bytes, vehicle_id: int) -> StemObservation | None:
    """The observation of a record of this vehicle; None for what is malformed or out of bounds."""
    told = decode_array(body, FIELDS + 1)
    if told is None or not is_within(told[:11], _BOUNDS) or told[1] < told[0]:
        return None
    numbers = [float(number) for number in told[:11]]
    measured, lean, arc, rays, grade, reason = told[11:]
    if not isinstance(measured, bool) or not is_within((arc,), ((0.0, 1.0),)):
        return None
    if lean is not None and not is_within((lean,), ((0.0, math.pi / 2.0),)):
        return None
    if type(rays) is not int or not 0 <= rays <= RAYS_MAX or type(grade) is not int or grade not in tuple(Grade):
        return None
    if type(reason) is not str or len(reason) > REASON_MAX or not reason.isprintable():
        return None
    lean_rad = None if lean is None else float(lean)
    first_s, last_s, north_m, east_m, position_sd_m, frame_sd_m, cut_up_m, *diameters = numbers
    diameter_m, diameter_sd_m, dbh_m, dbh_sd_m = diameters
    return StemObservation(
        vehicle_id=vehicle_id,
        first_s=first_s,
        last_s=last_s,
        north_m=north_m,
        east_m=east_m,
        position_sd_m=position_sd_m,
        frame_sd_m=frame_sd_m,
        cut_up_m=cut_up_m,
        diameter_m=diameter_m,
        diameter_sd_m=diameter_sd_m,
        dbh_m=dbh_m,
        dbh_sd_m=dbh_sd_m,
        is_dbh_measured=measured,
        lean_rad=lean_rad,
        arc_share=float(arc),
        rays=rays,
        grade=Grade(grade),
        reason=reason,
    )


def decode_array(body: bytes, length: int) -> list[Any] | None:
    """A CBOR array of so many elements that is all of `body`; None for anything else."""
    if len(body) > BODY_MAX:
        return None
    try:
        stream = io.BytesIO(body)
        told = cbor2.load(stream)
    except (cbor2.CBORError, ValueError, OverflowError, TypeError, RecursionError, ArithmeticError, LookupError):
        return None
    if stream.tell() != len(body) or type(told) is not list or len(told) != length:
        return None
    return told


def is_within(numbers: Any, bounds: Any) -> bool:
    """True if each is a number, no bool, within its bounds; false for NaN."""
    return all(
        type(number) in (int, float) and low <= number <= high
        for number, (low, high) in zip(numbers, bounds, strict=True)
    )


def to_single(number: float) -> float:
    """The nearest of single precision: 5 bytes."""
    return float(struct.unpack("<f", struct.pack("<f", number))[0])
