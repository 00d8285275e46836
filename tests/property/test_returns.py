"""Returns of stems come back as they went, and no bytes of a disk are more than that, or an error."""

from __future__ import annotations

import math

import cbor2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from companion.cloud.returns import FAR_MAX_M, POINT, StemReturns, decode_returns, encode_returns

METRES = st.floats(-1000.0, 1000.0, width=32)
POINTS = st.lists(st.tuples(METRES, METRES, METRES, METRES, st.integers(0, 255), st.integers(0, 1)), max_size=20)
ANYTHING = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.binary(max_size=60), st.text(max_size=9))


@given(st.integers(1, 250), st.binary(max_size=160), st.floats(0.0, 1e6), METRES, METRES, st.none() | METRES, POINTS)
def test_returns_come_back_as_they_went(
    vehicle_id: int,
    body: bytes,
    first_s: float,
    north_m: float,
    east_m: float,
    ground_m: float | None,
    rows: list[tuple[float, ...]],
) -> None:
    one = StemReturns(vehicle_id, body, first_s, north_m, east_m, ground_m, np.array(rows, dtype=POINT))
    back = decode_returns(encode_returns(one))
    assert back is not None
    assert (back.vehicle_id, back.body, back.first_s, back.ground_up_m) == (vehicle_id, body, first_s, ground_m)
    assert np.array_equal(back.points, one.points)


@given(st.binary(max_size=200))
def test_garbage_is_none(data: bytes) -> None:
    assert decode_returns(data) is None


@given(st.lists(ANYTHING, min_size=7, max_size=7))
def test_what_is_decoded_is_within_bounds(told: list[object]) -> None:
    back = decode_returns(cbor2.dumps([1, *told]))
    assert back is None or (
        1 <= back.vehicle_id <= 250 and math.isfinite(back.north_m) and abs(back.east_m) <= FAR_MAX_M
    )


@given(arrays(np.uint8, st.integers(0, 10).map(lambda n: n * POINT.itemsize)))
def test_points_that_are_no_numbers_are_none(blob: np.ndarray) -> None:
    back = decode_returns(cbor2.dumps([1, 3, b"", 0.0, 0.0, 0.0, None, blob.tobytes()]))
    assert back is None or all(np.isfinite(back.points[axis]).all() for axis in ("north_m", "east_m", "up_m", "at_s"))
