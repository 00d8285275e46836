"""Whatever comes as SWARM_LIDAR_SCAN: nothing raises, what comes out is sound, and what is sent comes back."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.model.events import LidarScan, Position
from companion.core.perception.obstacle_perception import build_perception
from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing import wire
from companion.mavlink.lidar_scan import LIDAR_SCAN_ID, decode_lidar_scan, encode_lidar_scan
from companion.mavlink.schema.tables.measurements import RAYS_MAX
from companion.sensors.lidar_pieces import LidarPieces
from companion.sensors.table import sensors_of
from tests.unit.core.core_kit import mission
from tests.unit.sensors.lidar_kit import attitude

ME = 3
FLOWN = mission(sensing={"sensor": "multi-layer", "range_m": 12.0})
number = st.floats(width=32)
ranges = st.lists(st.integers(0, 0xFFFF) | st.sampled_from([0, 1, 0xFFFE, 0xFFFF]), max_size=RAYS_MAX)


def message(seed: int, numbers: tuple[float, ...], limits_cm: tuple[int, int], ranges_mm: list[int]) -> Any:
    rng = random.Random(seed)
    padded = [*ranges_mm, *[0] * (RAYS_MAX - len(ranges_mm))]
    return dialect.MAVLink_swarm_lidar_scan_message(
        rng.randrange(2**64), *numbers, *limits_cm, rng.randrange(256), padded
    )


sound_numbers = st.tuples(
    st.floats(0.0, 0.0625, width=32),
    st.floats(-360.0, 360.0, width=32),
    st.floats(-3.0, 3.0, width=32),
    st.floats(-90, 90, width=32),
)
cm = st.integers(0, 0xFFFF)
messages = st.builds(
    message,
    st.integers(0, 2**32),
    sound_numbers | st.tuples(number, number, number, number),
    st.tuples(cm, cm).map(lambda pair: (min(pair), max(pair))) | st.tuples(cm, cm),
    ranges,
)


def check(scan: LidarScan) -> None:
    """As its fields promise."""
    assert 0.0 <= scan.min_m <= scan.max_m
    assert 1 <= len(scan.ranges_m) <= RAYS_MAX
    assert not all(math.isnan(range_m) for range_m in scan.ranges_m)
    for range_m in scan.ranges_m:
        assert math.isnan(range_m) or range_m == math.inf or scan.min_m <= range_m <= scan.max_m
    assert abs(scan.start_rad) <= math.pi + 1e-6
    assert abs(scan.step_rad) * len(scan.ranges_m) >= 1e-4
    assert abs(scan.elevation_rad) <= math.pi / 2 + 1e-6
    assert scan.age_s >= 0.0


@given(
    st.integers(0, 2**63),
    st.floats(0.0, 0.001),
    st.floats(-180.0, 180.0),
    st.floats(0.25, 3.0),
    st.floats(-52.0, 52.0),
    st.integers(0, 255),
    ranges.filter(lambda mm: any(one > 1 for one in mm)),
)
def test_a_piece_comes_back_with_all_its_rays(
    time_us: int, ray_time_s: float, first_deg: float, step_deg: float, elevation_deg: float, turn: int, mm: list[int]
) -> None:
    sent = encode_lidar_scan(
        time_us=time_us,
        ray_time_s=ray_time_s,
        first_bearing_deg=first_deg,
        bearing_step_deg=step_deg,
        elevation_deg=elevation_deg,
        min_m=0.0,
        max_m=655.0,
        turn=turn,
        ranges_mm=mm,
    )
    frame = wire.frame(LIDAR_SCAN_ID, sent, seq=0, system=ME, component=196)
    assert len(frame) <= 12 + 255
    assert wire.decode(frame).get_type() == "SWARM_LIDAR_SCAN"
    piece = decode_lidar_scan(wire.fields(frame))
    assert piece is not None
    assert (piece.time_us, piece.turn) == (time_us, turn)
    assert piece.ray_time_s == pytest.approx(ray_time_s, rel=1e-6)
    assert piece.first_bearing_deg == pytest.approx(first_deg, rel=1e-6)
    assert piece.bearing_step_deg == pytest.approx(step_deg, rel=1e-6)
    assert piece.elevation_deg == pytest.approx(elevation_deg, rel=1e-6)
    expected = tuple(math.nan if one <= 1 else math.inf if one == 0xFFFF else one / 1000.0 for one in mm)
    assert repr(piece.ranges_m) == repr(expected)


@given(st.integers(1, RAYS_MAX), st.integers(0, 3))
def test_a_piece_of_which_no_ray_was_measured_is_none(rays: int, marked: int) -> None:
    """A lidar that measures nothing falls silent: scans that show nothing would seem fresh."""
    assert decode_lidar_scan(message(0, (0.0, 0.0, 1.0, 0.0), (20, 1200), [0] * (rays - 1) + [min(marked, 1)])) is None


@given(st.lists(st.tuples(messages, st.integers(1, 255), st.floats(0.0, 0.2)), min_size=1, max_size=12))
def test_every_piece_that_comes_out_is_sound_and_every_other_is_counted(told: list[tuple[Any, int, float]]) -> None:
    pieces, now_s, out = LidarPieces(), 100.0, 0
    for m, component, later_s in told:
        now_s += later_s
        pieces.attitude(attitude(), now_s)
        pieces.piece(m, component, now_s)
        for scan in pieces.join(now_s):
            out += 1
            check(scan)
    assert out + pieces.without_attitude + pieces.refused == len(told)


@given(
    st.lists(
        st.binary(max_size=300)
        | st.builds(
            lambda m, system, component: bytes(m.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=component))),
            messages,
            st.sampled_from([ME, ME, 7]),
            st.sampled_from([1, 191, 196]),
        ),
        max_size=8,
    ),
    st.randoms(use_true_random=False),
    st.booleans(),
)
def test_no_bytes_of_a_lidars_link_raise(datagrams: list[bytes], rng: Any, is_stream: bool) -> None:
    one = Endpoint(FLOWN, ME, sensors=sensors_of(FLOWN), sensor_streams={"lidar": is_stream})
    still = bytes(attitude().pack(dialect.MAVLink(None, srcSystem=ME, srcComponent=1)))
    now_s = 10.0
    for data in datagrams:
        spoilt = bytearray(data)
        if spoilt and rng.random() < 0.3:
            spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
        one.from_autopilot(still, now_s)
        one.from_sensor(bytes(spoilt), now_s, "lidar")
        one.tick(now_s)
        now_s += 0.05


@given(st.lists(messages, min_size=1, max_size=12), st.tuples(*[st.floats(-1e4, 1e4)] * 6))
def test_whatever_is_told_makes_a_map_of_numbers(told: list[Any], pose: tuple[float, ...]) -> None:
    perception, pieces = build_perception(FLOWN, 1), LidarPieces()
    own = Position((pose[0], pose[1], pose[2]), (pose[3], pose[4], pose[5]))
    for k, m in enumerate(told):
        now_s = 100.0 + 0.05 * k
        pieces.attitude(attitude(0.1, -0.2, 3.0), now_s)
        pieces.piece(m, 196, now_s)
        for scan in pieces.join(now_s):
            perception.integrate_scan(scan, own, now_s, ())
        cloud = perception.observe_obstacles(own.pos_ned_m, own.pos_ned_m, {}, now_s)
        assert all(math.isfinite(number) for number in (*cloud.norths, *cloud.easts))
