"""One value of another sensor, where it was measured, and its form on disk and on the air: a CBOR array (RFC 8949)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cbor2

from companion.survey.observation import FAR_MAX_M, decode_array, is_within, to_single

PAYLOAD_KIND: Final = 3  # of a record that holds one
VALUE_MAX: Final = 1e9  # of any quantity, in whatever unit
NAME_MAX: Final = 16  # characters
UNIT_MAX: Final = 12
FIELDS: Final = 7  # of the array
_BOUNDS: Final = (
    (-VALUE_MAX, VALUE_MAX),
    (-FAR_MAX_M, FAR_MAX_M),
    (-FAR_MAX_M, FAR_MAX_M),
    (-FAR_MAX_M, FAR_MAX_M),
    (0.0, FAR_MAX_M),
)


@dataclass(frozen=True, slots=True)
class PayloadSample:
    """One value. Its time is that of its record: `made_s`, of the vehicle's clock.

    Position: the mission's frame, metres from its origin, as the vehicle estimated itself when the value came.
    """

    vehicle_id: int
    name: str  # as the mission names it
    unit: str
    value: float  # single precision
    north_m: float
    east_m: float
    up_m: float  # above the origin's ground
    position_sd_m: float  # of the vehicle's own position in the mission's frame, level


def encode_sample(sample: PayloadSample) -> bytes:
    """Without the vehicle's id, which its record bears: at most 60 bytes."""
    numbers = (sample.value, sample.north_m, sample.east_m, sample.up_m, sample.position_sd_m)
    return cbor2.dumps([sample.name, sample.unit, *map(to_single, numbers)], canonical=True)


def decode_sample(body: bytes, vehicle_id: int) -> PayloadSample | None:
    """The sample of a record of this vehicle; None for what is malformed or out of bounds."""
    told = decode_array(body, FIELDS)
    if told is None or not is_within(told[2:], _BOUNDS):
        return None
    name, unit = told[:2]
    if not (_is_word(name, NAME_MAX) and _is_word(unit, UNIT_MAX)):
        return None
    return PayloadSample(vehicle_id, name, unit, *[float(number) for number in told[2:]])


def _is_word(told: object, longest: int) -> bool:
    """Printable ASCII without spaces, and not empty."""
    return type(told) is str and 0 < len(told) <= longest and all("!" <= letter <= "~" for letter in told)
