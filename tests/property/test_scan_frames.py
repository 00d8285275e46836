"""Whatever an obstacle sensor sends: nothing raises, what is kept is bounded, and each scan that comes out is sound."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from companion.core.model.events import ObstacleScan
from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.sensors.scans import SENSORS_MAX, STEP_MIN_DEG, WAITING_MAX, Scans
from companion.sensors.table import sensors_of
from tests.unit.core.core_kit import mission

ME = 3
SECTORS = 72
EPSILON = 1e-6
EDGES_CM = (0, 1, 19, 20, 799, 800, 801, 0xFFFE, 0xFFFF)
cm = st.integers(0, 0xFFFF) | st.sampled_from(EDGES_CM)


def sectors_cm(rng: random.Random) -> list[int]:
    """72 of them: all alike, edges, anything, or some of each. Drawn one by one they would cost the most by far."""
    edges, different = rng.choice(((1.0, 1), (0.0, 1), (0.0, SECTORS), (1.0, SECTORS), (0.5, SECTORS), (0.9, SECTORS)))
    drawn = [rng.choice(EDGES_CM) if rng.random() < edges else rng.randrange(0x10000) for _ in range(different)]
    return drawn * (SECTORS // different)


seeds = st.integers(0, 2**64)
number = st.floats(width=32)


def distances(
    seed: int, limits_cm: Sequence[int], step_deg: float, start_deg: float, frame: int
) -> dialect.MAVLink_obstacle_distance_message:
    """What is left comes from the seed."""
    rng = random.Random(seed)
    return dialect.MAVLink_obstacle_distance_message(
        rng.randrange(2**64),
        rng.randrange(256),
        sectors_cm(rng),
        rng.randrange(256),
        *limits_cm,
        step_deg,
        start_deg,
        frame,
    )


degrees = st.floats(-360.0, 360.0, width=32)
sound_messages = st.builds(
    distances,
    seeds,
    st.tuples(cm, st.integers(1, 0xFFFF)).map(sorted),
    degrees.filter(lambda step_deg: abs(step_deg) >= STEP_MIN_DEG) | st.sampled_from([5.0, -5.0, 2.5]),
    degrees | st.sampled_from([0.0, -180.0, 45.0]),
    st.sampled_from([0, 1, 12]),
)
messages = sound_messages | st.builds(
    distances,
    seeds,
    st.tuples(cm, cm),
    number | st.just(0.0),
    number,
    st.sampled_from([0, 1, 12]) | st.integers(0, 255),
)
angle = st.floats(-3.14, 3.14)
sound_attitudes = st.builds(dialect.MAVLink_attitude_message, st.integers(0, 2**32 - 1), *[angle] * 3, *[number] * 3)
attitudes = sound_attitudes | st.builds(dialect.MAVLink_attitude_message, st.integers(0, 2**32 - 1), *[number] * 6)


def packed(message: Any, system: int, component: int) -> bytes:
    frame: bytes = message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=component))
    return frame


def check(scan: ObstacleScan) -> None:
    """As its fields promise."""
    assert 0.0 <= scan.min_m <= scan.max_m
    assert any(not math.isnan(range_m) for range_m in scan.ranges_m)
    for range_m in scan.ranges_m:
        assert math.isnan(range_m) or range_m == math.inf or scan.min_m <= range_m <= scan.max_m
    assert abs(scan.start_rad) <= math.pi + EPSILON
    assert scan.step_rad >= math.radians(STEP_MIN_DEG) - EPSILON
    assert 1 <= len(scan.ranges_m) <= 72
    assert len(scan.ranges_m) * scan.step_rad <= math.tau * 1.001
    assert all(math.isfinite(angle) for angle in (scan.roll_rad, scan.pitch_rad, scan.yaw_rad))
    assert scan.age_s >= 0.0


@given(
    st.tuples(sound_attitudes, sound_messages),
    st.lists(st.tuples(messages | attitudes, st.integers(1, 255), st.floats(0.0, 0.2)), max_size=12),
)
def test_every_scan_that_comes_out_is_sound_and_every_other_is_counted(
    first: tuple[Any, Any], told: list[tuple[Any, int, float]]
) -> None:
    scans, now_s, came, out = Scans(), 100.0, 0, 0
    bad_attitudes = 0
    first[1].distances[0] = 300  # one sector at least is measured: it comes out
    for message, component, later_s in ((first[0], 1, 0.0), (first[1], 1, 0.1), *told):
        now_s += later_s
        if message.get_msgId() == dialect.MAVLINK_MSG_ID_ATTITUDE:
            before = scans.refused
            scans.attitude(message, now_s)
            bad_attitudes += scans.refused - before
        else:
            came += 1
            scans.scan(message, component, now_s)
        for scan in scans.join(now_s) if later_s > 0.05 else ():  # some wait for others
            out += 1
            check(scan)
    out += len(scans.join(now_s))
    assert out + scans.without_attitude + scans.refused - bad_attitudes == came
    assert out > 0


@given(st.lists(messages, min_size=1, max_size=60), st.lists(st.integers(0, 255), min_size=1, max_size=60))
def test_what_is_kept_is_bounded(told: list[Any], components: list[int]) -> None:
    scans = Scans()
    for k, message in enumerate(told):
        scans.scan(message, components[k % len(components)], 100.0)
    scans.attitude(dialect.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 100.0)
    found = scans.join(100.0)
    assert len(found) <= WAITING_MAX
    assert len({scan.sensor for scan in found}) <= SENSORS_MAX


@given(
    st.lists(
        st.binary(max_size=300)
        | st.builds(packed, messages | attitudes, st.sampled_from([ME, ME, 7]), st.sampled_from([1, 191, 196])),
        max_size=8,
    ),
    st.randoms(use_true_random=False),
    st.booleans(),
)
def test_no_bytes_of_a_sensors_link_raise(datagrams: list[bytes], rng: Any, is_stream: bool) -> None:
    flown = mission(sensing={})
    streams = {"obstacles": is_stream}
    one = Endpoint(flown, ME, sensors=sensors_of(flown), sensor_streams=streams, autopilot_is_stream=is_stream)
    now_s = 10.0
    for data in datagrams:
        spoilt = bytearray(data)
        if spoilt and rng.random() < 0.3:
            spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
        one.from_sensor(bytes(spoilt), now_s, "obstacles")
        one.from_autopilot(bytes(spoilt), now_s)
        one.tick(now_s)
        now_s += 0.05
