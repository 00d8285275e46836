"""Bodies of survey records: what is written comes back, and no bytes raise."""

from __future__ import annotations

import dataclasses
import math

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.records.summary import decode_summary, encode_summary
from companion.survey.observation import BODY_MAX, REASON_MAX, Grade, StemObservation, decode, encode
from companion.survey.track import TrackPoint, decode_track, encode_track

single = {"width": 32, "allow_nan": False, "allow_infinity": False}
place = st.floats(-9e5, 9e5, **single)
size = st.floats(0.0, 10.0, **single)
diameter = st.floats(0.0625, 10.0, **single)
time_s = st.floats(0.0, 1e10, allow_nan=False)
reason = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=REASON_MAX)
observations = st.builds(
    StemObservation,
    vehicle_id=st.integers(1, 250),
    first_s=st.just(0.0) | st.floats(0.0, 5.0),
    last_s=st.floats(5.0, 1e10),
    north_m=place,
    east_m=place,
    position_sd_m=size,
    frame_sd_m=size,
    cut_up_m=st.floats(-90.0, 190.0, **single),
    diameter_m=diameter,
    diameter_sd_m=size,
    dbh_m=diameter,
    dbh_sd_m=size,
    is_dbh_measured=st.booleans(),
    lean_rad=st.none() | st.floats(0.0, 1.5, **single),
    arc_share=st.floats(0.0, 1.0, **single),
    rays=st.integers(0, 1_000_000),
    grade=st.sampled_from(list(Grade)),
    reason=reason,
)


@given(observations)
def test_an_observation_comes_back_and_is_short(observation: StemObservation) -> None:
    body = encode(observation)
    assert len(body) <= BODY_MAX
    assert decode(body, observation.vehicle_id) == observation


@given(st.integers(1, 250), time_s, place, place, size, size, st.none() | st.tuples(place, place))
def test_a_track_point_comes_back(
    vehicle_id: int, at_s: float, n: float, e: float, sd: float, m: float, shift_ne_m: tuple[float, float] | None
) -> None:
    point = TrackPoint(vehicle_id, at_s, n, e, sd, m, shift_ne_m)
    assert decode_track(encode_track(point), vehicle_id) == point


@given(st.binary(max_size=200))
def test_no_bytes_raise(body: bytes) -> None:
    decode(body, 1)
    decode_track(body, 1)


@given(observations, st.data())
def test_broken_bodies_do_not_raise(observation: StemObservation, data: st.DataObject) -> None:
    body = bytearray(encode(observation))
    body[data.draw(st.integers(0, len(body) - 1))] = data.draw(st.integers(0, 255))
    found = decode(bytes(body), 1)
    assert found is None or all(
        math.isfinite(value) for value in dataclasses.astuple(found) if isinstance(value, float)
    )


EVEN = StemObservation(
    1, 0.0, 1.0, 2.0, 3.0, 0.1, 1.0, 1.3, 0.2, 0.01, 0.2, 0.01, True, None, 0.5, 100, Grade.GOOD, ""
)  # fmt: skip


@pytest.mark.parametrize(
    ("k", "value"),
    [(0, math.nan), (1, -1.0), (2, math.inf), (2, "x"), (7, 0.0), (9, 1e9), (11, 1), (12, 2.0), (13, 1.5), (14, -1),
     (14, True), (15, 3), (16, "x" * 41), (16, "a\nb"), (16, 5)],
)  # fmt: skip
def test_a_value_out_of_bounds_is_refused(k: int, value: object) -> None:
    told = cbor2.loads(encode(EVEN))
    told[k] = value
    assert decode(cbor2.dumps(told), 1) is None


def test_what_follows_the_array_is_refused() -> None:
    assert decode(encode(EVEN) + b"\0", 1) is None


def test_too_long_a_reason_is_not_written() -> None:
    with pytest.raises(ValueError, match="at most 40"):
        encode(dataclasses.replace(EVEN, reason="x" * 41))


@given(st.binary(max_size=300) | st.lists(st.none() | st.floats() | st.integers(), max_size=11).map(cbor2.dumps))
def test_no_bytes_raise_as_a_summary(body: bytes) -> None:
    summary = decode_summary(body)
    assert summary is None or decode_summary(encode_summary(summary)) == summary
