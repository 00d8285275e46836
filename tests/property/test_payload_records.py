"""Samples of other sensors come back as they went, garbage is none, and no flood of values makes more records."""

from __future__ import annotations

import math

import cbor2
from hypothesis import given
from hypothesis import strategies as st

from companion.mavlink.harvest import PayloadPlace
from companion.mavlink.sensor_source import PayloadValue
from companion.payload.recorder import PayloadRecorder
from companion.payload.sample import VALUE_MAX, PayloadSample, decode_sample, encode_sample
from companion.survey.observation import BODY_MAX
from tests.unit.core.core_kit import mission

PERIOD_S = 0.5
LIGHT = "NAMED_VALUE_FLOAT.light"
FLOWN = mission(payload=[{"name": "light", "unit": "lx", "period_s": PERIOD_S, "source": LIGHT}])
WORDS = st.text(st.characters(min_codepoint=0x21, max_codepoint=0x7E), min_size=1, max_size=12)


def single(least: float, most: float) -> st.SearchStrategy[float]:
    return st.floats(least, most, width=32)


@given(WORDS, WORDS, single(-1e8, 1e8), st.tuples(*[single(-1e5, 1e5)] * 3), single(0.0, 1e3))
def test_a_sample_comes_back_as_it_went(
    name: str, unit: str, value: float, place: tuple[float, float, float], sd_m: float
) -> None:
    sample = PayloadSample(3, name, unit, value, *place, sd_m)
    body = encode_sample(sample)
    assert len(body) <= 60 < BODY_MAX
    assert decode_sample(body, 3) == sample


@given(st.binary(max_size=80))
def test_garbage_is_no_sample(body: bytes) -> None:
    sample = decode_sample(body, 3)
    assert sample is None or abs(sample.value) <= VALUE_MAX


@given(st.lists(st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=20)), max_size=9))
def test_arrays_of_anything_are_samples_only_within_bounds(told: list[object]) -> None:
    sample = decode_sample(cbor2.dumps(told), 3)
    assert sample is None or (all(map(math.isfinite, (sample.value, sample.up_m))) and sample.position_sd_m >= 0.0)


@given(st.lists(st.tuples(st.integers(0, 40), st.lists(st.floats(), max_size=4), st.booleans()), max_size=60))
def test_no_flood_of_values_makes_more_than_one_record_a_period(
    ticks: list[tuple[int, list[float], bool]],
) -> None:
    recorder, now_s, times = PayloadRecorder(FLOWN, 1), 0.0, list[float]()
    for steps, values, airborne in ticks:
        now_s += 0.05 * steps
        told = [PayloadValue(LIGHT, value) for value in values]
        found = recorder.take_records(told, PayloadPlace(0.0, 0.0, 4.0, 1.0), now_s, airborne=airborne)
        assert len(found) <= (airborne and bool(values))
        times += [now_s] * len(found)
        assert len(recorder.take_says()) <= 1
    for first, third in zip(times, times[2:], strict=False):  # one may come late, and the next in time
        assert third - first > PERIOD_S - 1e-6
