"""The way of a vehicle that surveys, and how far it could see stems: from these comes the area seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cbor2

from companion.survey.observation import FAR_MAX_M, decode_array, is_within, to_single

TRACK_KIND: Final = 2  # of a record that holds one
_FAR: Final = (-FAR_MAX_M, FAR_MAX_M)
_BOUNDS: Final = ((0.0, 1e12), _FAR, _FAR, (0.0, FAR_MAX_M), (0.0, 1000.0))
_SHIFT_BOUNDS: Final = (_FAR, _FAR)  # of two more numbers, which earlier vehicles did not record


@dataclass(frozen=True, slots=True)
class TrackPoint:
    """One point of the way of a vehicle that surveyed. The mission's frame, NED metres from its origin."""

    vehicle_id: int
    at_s: float  # of the vehicle's clock
    north_m: float
    east_m: float
    frame_sd_m: float  # of its own position in the mission's frame
    range_m: float  # level: stems so near could be measured, those that nothing hid
    # Mission's frame less the own odometry's, north and east: what was added to this place, and to those of stems seen
    # then. Without it both are of the odometry, which drifts and does not jump.
    shift_ne_m: tuple[float, float] | None = None


def encode_track(point: TrackPoint) -> bytes:
    """Without the vehicle's id, which its record bears."""
    numbers = (point.north_m, point.east_m, point.frame_sd_m, point.range_m, *(point.shift_ne_m or ()))
    return cbor2.dumps([point.at_s, *map(to_single, numbers)], canonical=True)


def decode_track(body: bytes, vehicle_id: int) -> TrackPoint | None:
    """The point of a record of this vehicle; None for what is malformed or out of bounds."""
    for bounds in ((*_BOUNDS, *_SHIFT_BOUNDS), _BOUNDS):
        told = decode_array(body, len(bounds))
        if told is not None and is_within(told, bounds):
            at_s, north_m, east_m, frame_sd_m, range_m, *shift = [float(number) for number in told]
            shift_ne_m = (shift[0], shift[1]) if shift else None
            return TrackPoint(vehicle_id, at_s, north_m, east_m, frame_sd_m, range_m, shift_ne_m)
    return None
