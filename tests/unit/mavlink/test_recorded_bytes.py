"""Our own messages as they are on the wire: bytes recorded once, which every later release sends and reads.

After a change of the layout, which other releases do not hear, they are recorded anew:
`python tests/unit/mavlink/test_recorded_bytes.py`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from companion.core.model.beacon import Beacon, BeaconEcho, Candidate, Lease, PeerReport, RelativeReport
from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.framing import wire
from companion.mavlink.lidar_scan import LIDAR_SCAN_ID, decode_lidar_scan, encode_lidar_scan
from companion.mavlink.own_messages import encode_relative_report
from companion.mavlink.packing import pack_ranges, unpack_ranges
from companion.mavlink.relative import RELATIVE_ID, read_relative_report
from mission.common.frames import LocalFrame, Wgs84

OWN = [swarm_beacon.MESSAGE_ID, dialect.MAVLINK_MSG_ID_SWARM_RANGES, RELATIVE_ID, LIDAR_SCAN_ID]
HERE = Wgs84(-33.1234567, 151.7654321, 412.345)
FILE = Path(__file__).parents[2] / "testdata" / "own_messages.txt"
ROWS = [line.split() for line in FILE.read_text("utf-8").splitlines() if not line.startswith("#")]
RECORDED = {name: bytes.fromhex(payload) for name, payload in ROWS}
FULL = Beacon(
    sender=2,
    time_ms=2**32 + 123_456,
    vel_ned_mps=(1.5, -2.25, 0.125),
    ref_ned_mps=(3.0, 0.5, -0.75),
    dest_ned_m=(130.5, -20.25, 1.0),
    route_cost=21.5,
    governor=0.625,
    lease=Lease(250, 4_294_967_295, 249, 10, established=True, heir=248, ends=305_419_896, quorum=True),
    hop=7,
    agreed=True,
    candidate=Candidate(247, 3, 9),
    parent=246,
    phase=SwarmPhase.COVERAGE,
    state=FlightState.RELEASED,
    airborne=True,
    start=True,
    abort=True,
    done=1 << 249 | 5,
    range_m=55.04,
    present=1 << 249 | 7,
    flown=(1 << 250) - 1,
    sighting=PeerReport(245, (20.5, -10.25, 0.5), 12.46, silent=True, relays=3),
    echo=BeaconEcho(244, 65_432, 1.234),
    stop=3,
    position_error_m=2.9,
    accused=243,
)
LEAST = Beacon(
    sender=1,
    time_ms=0,
    vel_ned_mps=(0.0, 0.0, 0.0),
    ref_ned_mps=(0.0, 0.0, 0.0),
    dest_ned_m=None,
    route_cost=0.0,
    governor=0.0,
    lease=None,
    hop=0,
    agreed=False,
    candidate=None,
    parent=0,
    phase=SwarmPhase.ASSEMBLE,
    state=FlightState.WAITING,
    airborne=False,
    start=False,
    abort=False,
    done=0,
    range_m=0.0,
)
BEACONS = {
    "beacon_full": FULL,
    "beacon_least": LEAST,
    "beacon_airborne": replace(LEAST, airborne=True),
    "beacon_start": replace(LEAST, start=True),
    "beacon_abort": replace(LEAST, abort=True),
    "beacon_agreed": replace(LEAST, agreed=True),
    "beacon_destination": replace(LEAST, dest_ned_m=(0.0, 0.0, 0.0)),
    "beacon_lease": replace(LEAST, lease=Lease(1, 2, 3, 4, established=False, quorum=False)),
    "beacon_quorum": replace(LEAST, lease=Lease(1, 2, 3, 4, established=False, quorum=True)),
    "beacon_established": replace(LEAST, lease=Lease(1, 2, 3, 4, established=True, quorum=False)),
    "beacon_sighting": replace(LEAST, sighting=PeerReport(9, (1.0, 2.0, 3.0), 1e9, silent=False)),
    "beacon_silent": replace(LEAST, sighting=PeerReport(9, (1.0, 2.0, 3.0), 0.26, silent=True)),
}
RANGES = ((3, 12.344, 0.05), (4, 700.0, 9.0), (250, 0.0, 0.0))
RELATIVES = {
    "relative_full": RelativeReport(2, 2**32 + 9, (1.5, -2.5), (30.25, -40.5), 0.75, RANGES, 1.236),
    "relative_least": RelativeReport(1, 0, (0.0, 0.0)),
    "relative_unsure": RelativeReport(1, 0, (0.0, 0.0), (0.0, 0.0), 0.0, (), 1e9),
}


LIDAR: dict[str, Any] = {
    "time_us": 2**40 + 7,
    "ray_time_s": 0.00025,
    "first_bearing_deg": -90.5,
    "bearing_step_deg": 0.5,
    "elevation_deg": -7.25,
    "min_m": 0.2,
    "max_m": 20.0,
    "turn": 255,
    "ranges_mm": (0, 1, 200, 12_345, 20_001, 65_534, 65_535, *range(300, 405)),
}


def crc_extras() -> bytes:
    """CRC extra of each of our own messages, in the order of OWN."""
    return bytes(dialect.mavlink_map[k].crc_extra for k in OWN)


def test_ids_and_the_check_of_the_layout_are_as_recorded() -> None:
    assert OWN == [52100, 52101, 52102, 52103]
    assert crc_extras() == RECORDED["crc_extras"]
    assert swarm_beacon.VERSION == 1


@pytest.mark.parametrize("name", BEACONS)
def test_a_beacon_is_sent_as_recorded(name: str) -> None:
    assert swarm_beacon.encode(BEACONS[name], HERE) == RECORDED[name]


@pytest.mark.parametrize("name", RELATIVES)
def test_a_relative_report_is_sent_as_recorded(name: str) -> None:
    assert encode_relative_report(RELATIVES[name]) == RECORDED[name]


def test_ranges_are_sent_as_recorded() -> None:
    assert pack_ranges(RANGES) == RECORDED["ranges"]


def test_a_piece_of_a_lidars_scan_is_sent_and_read_as_recorded() -> None:
    assert encode_lidar_scan(**LIDAR) == RECORDED["lidar_scan"]
    frame = wire.frame(LIDAR_SCAN_ID, RECORDED["lidar_scan"], seq=0, system=3, component=196)
    piece = decode_lidar_scan(wire.fields(frame))
    assert piece is not None
    assert (piece.time_us, piece.turn, piece.min_m, piece.max_m) == (2**40 + 7, 255, 0.2, 20.0)
    assert (piece.first_bearing_deg, piece.bearing_step_deg, piece.elevation_deg) == (-90.5, 0.5, -7.25)
    assert piece.ray_time_s == pytest.approx(0.00025)
    assert repr(piece.ranges_m[:7]) == repr((math.nan, math.nan, 0.2, 12.345, math.inf, math.inf, math.inf))
    assert piece.ranges_m[-1] == 0.404


@pytest.mark.parametrize("name", BEACONS)
def test_a_recorded_beacon_is_read(name: str) -> None:
    said = BEACONS[name]
    frame = wire.frame(swarm_beacon.MESSAGE_ID, RECORDED[name], seq=0, system=said.sender, component=191)
    fields = swarm_beacon.unpack(frame)
    assert fields is not None
    decoded = swarm_beacon.decode(said.sender, fields, LocalFrame(HERE)).said
    report = said.sighting
    if report is not None:
        report = replace(report, age_s=min(819.1, round(report.age_s * 10.0) / 10.0))
    expected = replace(
        said, time_ms=said.time_ms & 0xFFFFFFFF, range_m=round(said.range_m * 10.0) / 10.0, sighting=report
    )
    assert decoded == expected
    assert LocalFrame(HERE).to_ned(Wgs84(fields.lat / 1e7, fields.lon / 1e7, fields.alt / 1e3)) == (0.0, 0.0, 0.0)


def test_recorded_relative_reports_and_ranges_are_read() -> None:
    heard = ((3, 12.34, 0.05), (4, 650.0, 255 * 0.01))
    read = {
        "relative_full": RelativeReport(2, 9, (1.5, -2.5), (30.25, -40.5), 0.75, heard, 1.24),
        "relative_least": RelativeReport(1, 0, (0.0, 0.0)),
        "relative_unsure": RelativeReport(1, 0, (0.0, 0.0), (0.0, 0.0), 0.0, (), 655.34),
    }
    for name, expected in read.items():
        frame = wire.frame(RELATIVE_ID, RECORDED[name], seq=0, system=expected.sender, component=191)
        assert read_relative_report(frame) == expected
    assert unpack_ranges(RECORDED["ranges"]) == heard


if __name__ == "__main__":
    sent = {name: swarm_beacon.encode(said, HERE) for name, said in BEACONS.items()}
    sent |= {name: encode_relative_report(report) for name, report in RELATIVES.items()}
    sent |= {"lidar_scan": encode_lidar_scan(**LIDAR)}
    sent |= {"ranges": pack_ranges(RANGES), "crc_extras": crc_extras()}
    head = "# Payloads of our own MAVLink messages, and their CRC extras: name, hex."
    head += f" Recorded by {Path(__file__).name}.\n"
    FILE.write_text(head + "".join(f"{name} {payload.hex()}\n" for name, payload in sent.items()), encoding="utf-8")
