"""LD06 and LD19: packets, checksum, angles between the two ends, and finding back into step."""

from __future__ import annotations

import pytest

from companion.lidar.ldrobot import LdLidar, crc8
from tests.unit.lidar.lidar_kit import everywhere, ld_crc8, ld_packet, ld_revolution, post

# The packet that the maker's manual takes as its example.
EXAMPLE = bytes.fromhex(
    "542c6808ab7ee000e4dc00e2d900e5d500e3d300e4d000e9cd00e4ca00e2c700e9c500e5c200e5c000e5be823a1a50"
)


def test_the_makers_example_has_the_right_checksum_and_its_ranges() -> None:
    assert crc8(EXAMPLE[:-1]) == EXAMPLE[-1] == 0x50
    found = list(LdLidar().decode(EXAMPLE))
    assert [azimuth for azimuth, *_ in found][:: len(found) - 1] == [0x7EAB, 0x82BE]
    assert [range_m for _, range_m, _, _ in found[:3]] == [0.224, 0.220, 0.217]


def test_checksums_agree() -> None:
    assert all(crc8(bytes([value, 7])) == ld_crc8(bytes([value, 7])) for value in range(256))


def test_points_lie_evenly_between_start_and_end_and_a_revolution_starts_where_they_cross_zero() -> None:
    found = list(LdLidar().decode(ld_packet(340.0, 351.0, [1.0] * 12) + ld_packet(352.0, 3.0, [0.0] * 12)))
    assert [azimuth for azimuth, *_ in found] == [*range(34000, 36000, 100), 0, 100, 200, 300]
    assert [starts for *_, starts in found] == [*[False] * 20, True, False, False, False]
    assert {range_m for _, range_m, _, _ in found[12:]} == {0.0}


def test_packets_that_overlap_begin_no_revolution() -> None:
    """By a degree where one in seven begins, also at the seam."""
    lidar, at_deg, starts_deg = LdLidar(), 90.0, []
    for packet in range(7 * 38):
        at_deg -= 1.0 if packet % 7 == 0 else 0.0
        data = ld_packet(at_deg % 360.0, (at_deg + 11.0) % 360.0, [3.0] * 12)
        starts_deg += [azimuth / 100.0 for azimuth, _, _, starts in lidar.decode(data) if starts]
        at_deg += 12.0
    turns = int(at_deg // 360.0)
    assert starts_deg == pytest.approx([0.0] * turns, abs=1.0)


def test_an_overlap_at_the_seam_begins_one_revolution() -> None:
    data = b"".join(ld_packet(at_deg, (at_deg + 11.0) % 360.0, [3.0] * 12) for at_deg in (336.0, 350.0, 359.0, 10.0))
    assert [azimuth for azimuth, _, _, starts in LdLidar().decode(data) if starts] == [0]


@pytest.mark.parametrize("size", [1, 2, 46, 48])
def test_packets_may_break_anywhere(size: int) -> None:
    data = ld_revolution(post(90.0, 3.0, 8.0))
    lidar = LdLidar()
    found = [one for at in range(0, len(data), size) for one in lidar.decode(data[at : at + size])]
    assert (found, lidar.bad) == (list(LdLidar().decode(data)), 0)
    assert len(found) == 456


def test_a_packet_with_a_wrong_byte_is_dropped_alone() -> None:
    data = bytearray(ld_revolution(everywhere(4.0)))
    data[47 * 3 + 20] ^= 0x10
    lidar = LdLidar()
    found = list(lidar.decode(bytes(data)))
    assert (len(found), lidar.bad) == (456 - 12, 47)
    assert {range_m for _, range_m, _, _ in found} == {4.0}


def test_bytes_of_garbage_are_counted() -> None:
    lidar = LdLidar()
    assert not list(lidar.decode(b"\x00\xff\x55" * 200))
    assert lidar.bad == 600 - 46


def test_it_is_never_spoken_to() -> None:
    assert LdLidar().poll(0.0) == LdLidar().shutdown() == b""
