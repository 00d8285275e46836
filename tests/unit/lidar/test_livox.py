"""Mid-360: the three kinds of points, what is no point, and the request that has it send them here."""

from __future__ import annotations

import struct
import zlib

import pytest
from fastcrc.crc16 import ibm_3740

from companion.lidar.livox import REQUEST_S, Mid360, start_request
from tests.unit.lidar.lidar_kit import mid360_datagram, mid360_points

POINTS_M = [(3.0, 0.0, 0.0), (0.0, 2.0, 0.5), (0.0, -4.0, -0.2), (-1.0, 0.0, 0.0)]


@pytest.mark.parametrize("kind", [1, 2, 3])
def test_points_become_clockwise_azimuths_ranges_along_the_plane_and_heights(kind: int) -> None:
    found = Mid360().decode(mid360_points(kind, POINTS_M))
    assert [azimuth for azimuth, *_ in found] == [0, 27000, 9000, 18000]
    assert [range_m for _, range_m, _, _ in found] == pytest.approx([3.0, 2.0, 4.0, 1.0], abs=0.002)
    assert [up_m for _, _, up_m, _ in found] == pytest.approx([0.0, 0.5, -0.2, 0.0], abs=0.002)
    assert not any(starts for *_, starts in found)


@pytest.mark.parametrize("kind", [1, 2, 3])
def test_a_pulse_without_an_echo_has_no_direction_and_is_no_return(kind: int) -> None:
    lidar = Mid360()
    assert lidar.decode(mid360_points(kind, [(0.0, 0.0, 0.0)])) == []
    assert lidar.bad == 0


def test_its_inertial_data_are_passed_over() -> None:
    lidar = Mid360()
    assert lidar.decode(mid360_datagram(0, struct.pack("<6f", *range(6)), 1)) == []
    assert lidar.bad == 0


@pytest.mark.parametrize(
    "datagram",
    [
        b"",
        mid360_points(1, POINTS_M)[:-1],
        mid360_points(1, POINTS_M) + b"\0",
        b"\1" + mid360_points(1, POINTS_M)[1:],
        b"\0\1" + mid360_points(1, POINTS_M)[2:],  # of another length, it says
        mid360_datagram(4, b"\0" * 14, 1),
        mid360_datagram(1, b"\0" * 14, 2),
        mid360_datagram(3, b"\0" * 14, 1),
    ],
)
def test_a_datagram_that_is_none_of_its_kinds_is_counted_and_dropped(datagram: bytes) -> None:
    lidar = Mid360()
    assert lidar.decode(datagram) == []
    assert lidar.bad == 1


def test_the_request_names_this_computer_and_has_both_checksums() -> None:
    request = start_request(("192.168.1.5", 56301), 7)
    assert struct.unpack_from("<BBHIHBB", request) == (0xAA, 0, len(request), 7, 0x0100, 0, 0)
    assert struct.unpack_from("<HI", request, 18) == (ibm_3740(request[:18]), zlib.crc32(request[24:]))
    assert request[24:] == (
        struct.pack("<HH", 3, 0)
        + struct.pack("<HHB", 0x0000, 1, 3)
        + struct.pack("<HH4BHH", 0x0006, 8, 192, 168, 1, 5, 56301, 56300)
        + struct.pack("<HHB", 0x001A, 1, 1)
    )


def test_it_is_asked_once_a_second_until_points_come() -> None:
    lidar = Mid360(("127.0.0.1", 56301))
    assert lidar.poll(0.0) != b""
    assert lidar.poll(0.5 * REQUEST_S) == b""
    assert lidar.poll(REQUEST_S) != b""
    lidar.decode(mid360_points(3, POINTS_M))
    assert lidar.poll(5.0) == b""
    assert lidar.poll(5.0 + REQUEST_S) != b""


def test_one_that_is_set_up_already_is_asked_nothing() -> None:
    assert Mid360().poll(0.0) == Mid360().shutdown() == b""


def test_a_refused_parameter_is_told_and_what_is_no_answer_is_not() -> None:
    lidar = Mid360()
    answer = bytearray(struct.pack("<BBHIHBB6xHI", 0xAA, 0, 27, 1, 0x0100, 1, 1, 0, 0) + struct.pack("<BH", 0x20, 6))
    lidar.decode_answer(bytes(answer))
    assert lidar.notes == ["Mid-360 refuses parameter 0x0006: return code 0x20"]
    lidar.notes.clear()
    answer[24] = 0
    for other in (bytes(answer), bytes(answer[:20]), b""):
        lidar.decode_answer(other)
    assert lidar.notes == []
