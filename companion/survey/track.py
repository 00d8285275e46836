"""The way of a vehicle that surveys, and how far it could see stems: from these comes the area seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cbor2

from companion.survey.observation import FAR_MAX_M, decode_array, is_within, to_single

TRACK_KIND: Final = 2  # of a record that holds one
_BOUNDS: Final = ((0.0, 1e12), (-FAR_MAX_M, FAR_MAX_M), (-FAR_MAX_M, FAR_MAX_M), (0.0, FAR_MAX_M), (0.0, 1000.0))


@dataclass(frozen=True, slots=True)
class TrackPoint:
    """One point of the way of a vehicle that surveyed. The mission's frame, NED metres from its origin."""

    vehicle_id: int
    at_s: float  # of the vehicle's clock
    north_m: float
    east_m: float
    frame_sd_m: float  # of its own position in the mission's frame
    range_m: float  # level: stems so near could be measured, those that nothing hid


def encode_track(point: TrackPoint) -> bytes:
    """Without the vehicle's id, which its record bears."""
    numbers = (point.north_m, point.east_m, point.frame_sd_m, point.range_m)
    return cbor2.dumps([point.at_s, *map(to_single, numbers)], canonical=True)


def decode_track(body: bytes, vehicle_id: int) -> TrackPoint | None:
    """The point of a record of this vehicle; None for what is malformed or out of bounds."""
    told = decode_array(body, len(_BOUNDS))
    if told is None or not is_within(told, _BOUNDS):
        return None
    return TrackPoint(vehicle_id, *[float(number) for number in told])
