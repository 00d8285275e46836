"""LaserScan of others as sectors: where each beam goes, what REP 117 says of ranges, and what is refused."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from companion.mavlink.framing import wire
from companion.sensors.scans import decoded
from sim_bridge.drive.live.laser_scans import ForeignScans, sectors_of
from sim_bridge.judge.export.ros2.log import laser_sweep
from sim_bridge.judge.export.ros2.messages import SCAN, VehicleMessages
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.lidar import Scan
from sim_bridge.world.sensors.scan import SECTORS

TYPES = get_typestore(Stores.ROS2_JAZZY).types
FRAME = "vehicle_1/base_link"
STILL = AirframeState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), on_ground=True, throttle=0.0)


def scan(ranges: list[float], first_deg: float = 0.0, step_deg: float = 5.0, **changes: Any) -> Any:
    header = TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](0, 0), changes.get("frame_id", FRAME))
    message = TYPES[SCAN](
        header,
        math.radians(first_deg),
        0.0,
        math.radians(step_deg),
        0.0,
        0.0,
        changes.get("range_min", 0.2),
        changes.get("range_max", 8.0),
        np.array(ranges, np.float32),
        np.zeros(0, np.float32),
    )
    for field in ("angle_min", "angle_increment"):
        setattr(message, field, changes.get(field, getattr(message, field)))
    return message


def read(message: Any, now_s: float = 10.0, stamped_s: float = 10.0) -> Scan:
    return sectors_of(message, FRAME, now_s, stamped_s)


@pytest.mark.parametrize(("bearing_deg", "sector"), [(0.0, 0), (90.0, 54), (-90.0, 18), (180.0, 36), (-2.4, 0)])
def test_a_beam_counter_clockwise_from_ahead_is_in_the_sector_clockwise_from_it(
    bearing_deg: float, sector: int
) -> None:
    ranges_m = read(scan([3.0], bearing_deg)).ranges_m
    assert ranges_m[sector] == 3.0
    assert sum(map(math.isnan, ranges_m)) == SECTORS - 1


def test_ranges_mean_what_rep_117_says_and_the_nearest_beam_of_a_sector_counts() -> None:
    beams = [math.nan, math.inf, -math.inf, 9.0, 4.0]
    first = [read(scan([beam])).ranges_m[0] for beam in beams]
    assert math.isnan(first[0])
    assert first[1:] == [math.inf, pytest.approx(0.2), math.inf, 4.0]
    assert read(scan([math.inf, 5.0, math.nan, 3.0, 6.0], -2.0, 1.0)).ranges_m[0] == 3.0


def test_a_simulated_scan_goes_out_and_comes_back_the_same() -> None:
    rng = np.random.default_rng(3)
    told = tuple(np.round(rng.uniform(0.3, 8.0, SECTORS), 2).tolist())
    sent = Scan(9.9, told, 0.2, 8.0)

    ours: Any = SimpleNamespace(frames=lambda vehicle_id, *_rest: bytes([vehicle_id]))
    model = ForeignScans(ours, {1: lambda _now_s: sent})
    reading = decoded(wire.decode(model.frames(1, STILL, {}, 10.0)), 0, 10.0)
    assert reading is not None
    message = VehicleMessages(1, 0, TYPES).scan(10.0, laser_sweep(reading, 0.0)).body
    assert read(message).ranges_m == pytest.approx(told, abs=1e-5)
    assert model.frames(2, STILL, {}, 10.0) == b"\2"
    assert ForeignScans(ours, {1: lambda _now_s: None}).frames(1, STILL, {}, 10.0) == b""


def test_a_stamp_is_believed_where_it_can_be() -> None:
    for stamped_s, taken_s in ((9.7, 9.7), (8.0, 10.0), (10.5, 10.0), (-1e9, 10.0)):
        assert read(scan([1.0]), 10.0, stamped_s).taken_s == taken_s


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frame_id": "laser"}, "header.frame_id = 'laser': must be 'vehicle_1/base_link'"),
        ({"angle_increment": 0.0}, "angle_increment = 0: must not be 0"),
        ({"angle_min": math.nan}, "angle_min = nan: must be finite"),
        ({"range_max": math.inf}, "range_max = inf: must be finite"),
        ({"range_min": 9.0}, "range_min, range_max = 9.0, 8.0: must rise, within 0 to 600"),
    ],
)
def test_a_scan_that_makes_no_sense_is_refused_with_field_and_value(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read(scan([1.0], **changes))


def test_a_scan_without_beams_is_refused() -> None:
    with pytest.raises(ValueError, match="ranges: 0 of them"):
        read(scan([]))
