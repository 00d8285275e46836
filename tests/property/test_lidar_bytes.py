"""Whatever bytes come from where a lidar is read: nothing raises, little is kept, and true packets are found again."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.lidar.driver import Driver
from companion.lidar.ldrobot import HEADER, LdLidar
from companion.lidar.livox import Mid360
from companion.lidar.models import MODELS
from companion.lidar.mounting import SECTORS, Mounting
from companion.lidar.rays import RayScan
from companion.lidar.rplidar import LOCK_SAMPLES, RpLidar
from companion.lidar.sectors import UNKNOWN_CM, SectorScan, obstacle_distance
from companion.mavlink.framing import wire
from companion.mavlink.lidar_scan import LIDAR_SCAN_ID, decode_lidar_scan
from mission.schema.kinds import RAW_LIDARS, SensorClass
from tests.unit.lidar.lidar_kit import (
    RPLIDAR_HEALTHY,
    RPLIDAR_INFO,
    RPLIDAR_SCANNING,
    everywhere,
    ld_revolution,
    mid360_datagram,
    mid360_points,
    rplidar_revolution,
)

SAMPLE_BYTES, PACKET_BYTES = 5, 47
marks = st.sampled_from([b"\xa5", b"\xa5\x5a", RPLIDAR_INFO[:9], RPLIDAR_HEALTHY, RPLIDAR_SCANNING, HEADER, b"\x54"])
garbage = st.lists(st.binary(max_size=80) | marks, max_size=12).map(b"".join)
layouts = st.builds(mid360_datagram, st.integers(0, 4), st.binary(max_size=1400), st.integers(0, 200)) | st.binary(
    max_size=1500
)
whole_points = st.tuples(st.sampled_from([(1, 14), (2, 8), (3, 10)]), st.integers(1, 96), st.randoms()).map(
    lambda drawn: mid360_datagram(drawn[0][0], drawn[2].randbytes(drawn[0][1] * drawn[1]), drawn[1])
)


def is_sound(name: str, driver: Driver, reads: list[bytes]) -> None:
    """Returns are within their bounds, and what they make is a message."""
    limits = MODELS[name].limits
    sectors = SectorScan(limits, Mounting())
    sender = wire.Sender(3, 196)
    raw = SensorClass.MULTI_LAYER if name == "mid360" else SensorClass.SCAN_1DEG
    rays = RayScan(limits, Mounting(), RAW_LIDARS[raw])
    for k, data in enumerate(reads):
        returns = list(driver.decode(data))
        for azimuth_cdeg, range_m, up_m, _ in returns:
            assert 0 <= azimuth_cdeg < 36000
            assert range_m >= 0.0
            assert math.isfinite(range_m)
            assert math.isfinite(up_m)
        for payload in rays.update(returns, 0.1 * k):
            piece = decode_lidar_scan(wire.fields(sender.frame(LIDAR_SCAN_ID, payload)))
            assert piece is not None
            assert all(
                not limits.min_m > range_m and not limits.max_m < range_m < math.inf for range_m in piece.ranges_m
            )
        for scan_cm in sectors.update(returns, 0.1 * k):
            assert len(scan_cm) == SECTORS
            near_cm, far_cm = round(limits.min_m * 100), round(limits.max_m * 100)
            assert all(near_cm <= cm <= far_cm + 1 or cm == UNKNOWN_CM for cm in scan_cm)
            assert wire.decode(sender.pack(obstacle_distance(scan_cm, limits, 0.1 * k))).distances == scan_cm


@given(st.lists(garbage, max_size=6))
def test_serial_lidars_take_any_bytes(reads: list[bytes]) -> None:
    for name in ("rplidar-a", "ld19"):
        driver = MODELS[name].make()
        is_sound(name, driver, reads)
        driver.poll(1.0)
        assert len(driver.notes) <= sum(map(len, reads)) // 10


@given(st.lists(layouts | whole_points, max_size=6))
def test_a_mid360_takes_any_datagram(datagrams: list[bytes]) -> None:
    driver = Mid360()
    is_sound("mid360", driver, datagrams)
    for data in datagrams:
        driver.decode_answer(data)
    assert len(driver.notes) <= len(datagrams)


@given(garbage, st.integers(1, 200))
def test_what_is_kept_between_two_reads_is_less_than_what_is_needed_to_find_a_packet(data: bytes, size: int) -> None:
    rplidar, ld = RpLidar(), LdLidar()
    for at in range(0, len(data), size):
        list(rplidar.decode(data[at : at + size]))
        list(ld.decode(data[at : at + size]))
        assert len(rplidar._buffer) < LOCK_SAMPLES * SAMPLE_BYTES
        assert len(ld._buffer) < PACKET_BYTES


@given(garbage)
def test_after_any_garbage_a_revolution_or_two_are_read_right(data: bytes) -> None:
    rplidar = RpLidar()
    list(rplidar.decode(data))
    found = list(rplidar.decode(2 * rplidar_revolution(everywhere(4.0))))
    assert {range_m for _, range_m, _, _ in found[-360:]} == {4.0}
    assert len(found) >= 360
    ld = LdLidar()
    list(ld.decode(data))
    assert [range_m for _, range_m, _, _ in ld.decode(2 * ld_revolution(everywhere(4.0)))][-456:] == [4.0] * 456


@pytest.mark.parametrize("cut", range(PACKET_BYTES))
def test_an_ld_is_joined_at_any_byte(cut: int) -> None:
    found = list(LdLidar().decode(ld_revolution(everywhere(4.0))[cut:]))
    assert {range_m for _, range_m, _, _ in found} == {4.0}
    assert len(found) >= 456 - 12


@given(layouts)
def test_a_datagram_between_others_spoils_none_of_them(datagram: bytes) -> None:
    driver = Mid360()
    good = mid360_points(3, [(2.0, 0.0, 0.0)])
    first = list(driver.decode(good))
    list(driver.decode(datagram))
    assert list(driver.decode(good)) == first
