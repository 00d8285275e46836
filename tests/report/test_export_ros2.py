"""A flight as a rosbag2, read back by rosbags and by Foxglove's MCAP reader."""

from __future__ import annotations

import errno
import math
import shutil
import struct
import sys
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.reader import make_reader
from pymavlink import mavutil
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Writer

from companion.mavlink import dialect
from companion.sensors.scans import Reading
from mission.document.load import load_mission
from mission.stand.stand import stand_of
from sim_bridge import cli
from sim_bridge.judge import run_folder
from sim_bridge.judge.export.axes import quaternions_enu, to_flu
from sim_bridge.judge.export.ros2.log import laser_sweep
from sim_bridge.judge.export.telemetry import begins_us, frames

KINDS = {
    "odom": "nav_msgs/msg/Odometry",
    "cmd_vel": "geometry_msgs/msg/TwistStamped",
    "scan": "sensor_msgs/msg/LaserScan",
    "battery": "sensor_msgs/msg/BatteryState",
}
SOURCES = {
    "odom": "LOCAL_POSITION_NED",
    "cmd_vel": "SET_POSITION_TARGET_LOCAL_NED",
    "scan": "OBSTACLE_DISTANCE",
    "battery": "BATTERY_STATUS",
}


class Bag(NamedTuple):
    folder: Path
    kinds: dict[str, str]
    messages: dict[str, list[tuple[int, Any]]]  # ns of the log, message


@pytest.fixture(scope="module")
def bag(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Bag:
    folder = tmp_path_factory.mktemp("out") / "bag"
    assert cli.main(["export", str(run), "--ros2bag", str(folder)]) == 0
    kinds: dict[str, str] = {}
    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([folder]) as reader:  # by the definitions that the bag itself holds
        for connection, time_ns, data in reader.messages():
            kinds[connection.topic] = connection.msgtype
            found.setdefault(connection.topic, []).append((time_ns, reader.deserialize(data, connection.msgtype)))
    return Bag(folder, kinds, found)


def logged(run: Path, vehicle: int, kind: str) -> list[Any]:
    """Messages of a telemetry log, by pymavlink."""
    log = mavutil.mavlink_connection(str(run / f"vehicle-{vehicle}.tlog"), dialect="common")
    messages = list(iter(lambda: log.recv_match(type=kind), None))
    log.close()
    return messages


def ms(time_ns: int) -> int:
    return round(time_ns / 1e6)


def stamp_ns(header: Any) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def xyz(vector: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([vector.x, vector.y, vector.z])


def rotation(q: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Matrix of a quaternion, by its textbook."""
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def from_angles(roll: float, pitch: float, yaw: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Front-right-down -> NED, turn by turn."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


NED_TO_ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
FLU_TO_FRD = np.diag([1, -1, -1])


def test_a_bag_has_every_topic_of_every_vehicle_in_full(run: Path, bag: Bag) -> None:
    wanted = {"/tf": "tf2_msgs/msg/TFMessage"}
    for k in (1, 2, 3):
        wanted |= {f"/vehicle_{k}/{name}": kind for name, kind in KINDS.items()}
        for name, source in SOURCES.items():
            assert len(bag.messages[f"/vehicle_{k}/{name}"]) == len(logged(run, k, source)) > 30
    assert bag.kinds == wanted
    assert len(bag.messages["/tf"]) == sum(len(bag.messages[f"/vehicle_{k}/odom"]) for k in (1, 2, 3))


def test_stamps_are_those_of_simulated_time_and_rise(run: Path, bag: Bag) -> None:
    ticks_ms = {round(float(time_s) * 1e3) for time_s in run_folder.load(run).time_s}
    start_us = min(begins_us(run / f"vehicle-{k}.tlog") for k in (1, 2, 3))
    for topic, messages in bag.messages.items():
        times_ns = [time_ns for time_ns, _ in messages]
        assert times_ns == sorted(times_ns)
        headers = [t.header for _, m in messages for t in m.transforms] if topic == "/tf" else []
        headers = headers or [m.header for _, m in messages]
        assert {stamp_ns(header) for header in headers} == set(times_ns)
        at_ms = {ms(time_ns - start_us * 1000) for time_ns in times_ns}
        assert len(at_ms & ticks_ms) > 0.95 * len(at_ms)
        assert max(at_ms) > (29_000 if topic.startswith("/vehicle_1/") else 60_000)  # it is killed then


def test_frames_are_those_of_rep_105(bag: Bag) -> None:
    parents = {}
    for _, message in bag.messages["/tf"]:
        parents |= {t.child_frame_id: t.header.frame_id for t in message.transforms}
    wanted: dict[str, str] = {}
    for k in (1, 2, 3):
        wanted |= {f"vehicle_{k}/odom": "map", f"vehicle_{k}/base_link": f"vehicle_{k}/odom"}
        (frame,) = {(m.header.frame_id, m.child_frame_id) for _, m in bag.messages[f"/vehicle_{k}/odom"]}
        assert frame == (f"vehicle_{k}/odom", f"vehicle_{k}/base_link")
        for name, of in (("cmd_vel", "odom"), ("scan", "base_link"), ("battery", "base_link")):
            assert {m.header.frame_id for _, m in bag.messages[f"/vehicle_{k}/{name}"]} == {f"vehicle_{k}/{of}"}
    assert parents == wanted


def test_odometry_is_what_the_autopilot_reported(run: Path, bag: Bag) -> None:
    for k in (1, 2, 3):
        places = {round(m._timestamp * 1e3): m for m in logged(run, k, "LOCAL_POSITION_NED")}
        attitudes = {round(m._timestamp * 1e3): m for m in logged(run, k, "ATTITUDE")}
        moved_mps = 0.0
        for time_ns, m in bag.messages[f"/vehicle_{k}/odom"]:
            place, attitude = places[ms(time_ns)], attitudes[ms(time_ns)]
            pose, twist = m.pose.pose, m.twist.twist
            assert xyz(pose.position) == pytest.approx([place.y, place.x, -place.z], abs=1e-6)
            turned = rotation(pose.orientation)
            reported = from_angles(attitude.roll, attitude.pitch, attitude.yaw)
            assert turned == pytest.approx(NED_TO_ENU @ reported @ FLU_TO_FRD, abs=1e-6)
            assert turned @ xyz(twist.linear) == pytest.approx([place.vy, place.vx, -place.vz], abs=1e-6)
            rates = [attitude.rollspeed, -attitude.pitchspeed, -attitude.yawspeed]
            assert xyz(twist.angular) == pytest.approx(rates, abs=1e-6)
            moved_mps = max(moved_mps, float(np.linalg.norm(xyz(twist.linear))))
        assert moved_mps > 1.5


def test_map_to_base_link_is_where_the_vehicle_was_in_truth(run: Path, bag: Bag) -> None:
    recording = run_folder.load(run)
    start_us = min(begins_us(run / f"vehicle-{k}.tlog") for k in (1, 2, 3))
    rows = {round(float(time_s) * 1e3): row for row, time_s in enumerate(recording.time_s)}
    met = 0
    for time_ns, message in bag.messages["/tf"]:
        row = rows.get(ms(time_ns - start_us * 1000))
        if row is not None:
            to_odom, to_base = message.transforms
            k = int(to_odom.child_frame_id.partition("/")[0].removeprefix("vehicle_"))
            turn = rotation(to_odom.transform.rotation)
            place = xyz(to_odom.transform.translation) + turn @ xyz(to_base.transform.translation)
            north, east, down = recording.pos_ned_m[row, k - 1]
            assert place == pytest.approx([east, north, -down], abs=1e-3)
            met += 1
    assert met > 1000


def test_setpoints_and_battery_are_those_of_the_log(run: Path, bag: Bag) -> None:
    for k in (1, 2, 3):
        asked = [[m.vy, m.vx, -m.vz] for m in logged(run, k, "SET_POSITION_TARGET_LOCAL_NED")]
        found = [xyz(m.twist.linear) for _, m in bag.messages[f"/vehicle_{k}/cmd_vel"]]
        assert np.array(found) == pytest.approx(np.array(asked), abs=1e-6)
        for reported, (_, m) in zip(
            logged(run, k, "BATTERY_STATUS"), bag.messages[f"/vehicle_{k}/battery"], strict=True
        ):
            assert m.percentage == pytest.approx(reported.battery_remaining / 100.0)
            assert m.voltage == pytest.approx(reported.voltages[0] / 1000.0)
            assert m.current == pytest.approx(-reported.current_battery / 100.0)
            assert m.power_supply_status == (m.POWER_SUPPLY_STATUS_DISCHARGING if m.current < 0.0 else 0)
            assert m.power_supply_technology == m.POWER_SUPPLY_TECHNOLOGY_LIPO
            assert math.isnan(m.temperature)
            assert math.isnan(m.capacity)


def test_what_scans_saw_stands_where_trunks_and_vehicles_are(run: Path, bag: Bag) -> None:
    trees = stand_of(load_mission(run / "mission.toml")).trees
    places: dict[int, dict[int, Any]] = {}
    for time_ns, message in bag.messages["/tf"]:
        to_odom, to_base = message.transforms
        k = int(to_odom.child_frame_id.partition("/")[0].removeprefix("vehicle_"))
        place = xyz(to_odom.transform.translation) + xyz(to_base.transform.translation)
        places.setdefault(ms(time_ns), {})[k] = (place, rotation(to_base.transform.rotation))
    off_m, free = [], 0
    for time_ns, scan in bag.messages["/vehicle_2/scan"]:
        assert -math.pi - 1e-6 <= scan.angle_min < scan.angle_max <= math.pi + 1e-6
        assert scan.angle_max == pytest.approx(scan.angle_min + 71 * scan.angle_increment, abs=1e-5)
        free += int(np.isinf(scan.ranges).sum())
        near = places.get(ms(time_ns), {})
        if len(near) < 3 or near[2][0][2] < 3.5:  # near the ground it sees that
            continue
        here, turned = near[2]
        for at, range_m in enumerate(scan.ranges):
            if np.isfinite(range_m):
                assert scan.range_min <= range_m <= scan.range_max
                angle = scan.angle_min + at * scan.angle_increment
                seen = here + turned @ np.array([range_m * math.cos(angle), range_m * math.sin(angle), 0.0])
                to_trees = [math.hypot(seen[0] - t.east_m, seen[1] - t.north_m) - t.radius_m for t in trees]
                to_others = [math.hypot(*(seen - near[k][0])[:2]) - 0.35 for k in (1, 3)]
                off_m.append(min(abs(x) for x in (*to_trees, *to_others)))
    assert len(off_m) > 500
    assert free > 500
    assert np.percentile(off_m, 95) < 0.3  # a sector is 5 degrees wide


def test_foxgloves_mcap_reader_reads_the_same_messages(bag: Bag) -> None:
    counts: Counter[str] = Counter()
    (file,) = bag.folder.glob("*.mcap")
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            assert schema.name == bag.kinds[channel.topic]
            time_ns, read = bag.messages[channel.topic][counts[channel.topic]]
            counts[channel.topic] += 1
            assert message.log_time == time_ns
            if channel.topic != "/tf":  # CDR, little-endian: stamp, then the frame's name with its length and a 0
                kind, seconds, nanoseconds, length = struct.unpack_from("<4sIII", message.data)
                assert (kind, seconds * 1_000_000_000 + nanoseconds) == (b"\0\1\0\0", time_ns)
                assert message.data[16 : 16 + length] == read.header.frame_id.encode() + b"\0"
    assert counts == {topic: len(messages) for topic, messages in bag.messages.items()}


def test_foxgloves_decoder_of_ros_2_reads_the_same_of_every_topic(bag: Bag) -> None:
    """By the definitions in the bag, too, but with another's parser and another's CDR."""
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="of the extra `dev`")
    (file,) = bag.folder.glob("*.mcap")
    counts: Counter[str] = Counter()
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            time_ns, read = bag.messages[channel.topic][counts[channel.topic]]
            counts[channel.topic] += 1
            assert message.log_time == time_ns
            assert plain(decoded) == plain(read)
    assert counts == {topic: len(messages) for topic, messages in bag.messages.items()}
    assert len(counts) == 13  # four of each of three vehicles, and /tf


def plain(value: Any) -> Any:
    """Fields of a message of either library as dicts, lists and numbers; nan as a word, as it equals nothing."""
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(one) for one in value]
    if isinstance(value, float | np.floating):
        return "nan" if math.isnan(value) else float(value)
    if isinstance(value, int | str | bool | np.integer):
        return value
    names = [name for name in getattr(value, "__slots__", None) or vars(value) if not name.startswith("_")]
    return {name: plain(getattr(value, name)) for name in names if not name.isupper()}


def test_the_same_flight_makes_the_same_bag(run: Path, bag: Bag, tmp_path: Path) -> None:
    assert cli.main(["export", str(run), "--ros2bag", str(tmp_path / "bag")]) == 0
    for name in ("bag.mcap", "metadata.yaml"):
        assert (tmp_path / "bag" / name).read_bytes() == (bag.folder / name).read_bytes()


def test_a_bag_is_never_written_over(run: Path, bag: Bag, capsys: pytest.CaptureFixture[str]) -> None:
    before = (bag.folder / "bag.mcap").stat()
    assert cli.main(["export", str(run), "--ros2bag", str(bag.folder)]) == 2
    assert f"{bag.folder} is there already: must be a new folder" in capsys.readouterr().err
    assert (bag.folder / "bag.mcap").stat() == before


def test_a_disk_that_is_full_leaves_no_half_bag(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    written = 0

    def full(*_args: Any) -> None:
        nonlocal written
        written += 1
        if written > 100:
            raise OSError(errno.ENOSPC, "No space left on device", "bag.mcap")

    monkeypatch.setattr(Writer, "write", full)
    assert cli.main(["export", str(run), "--ros2bag", str(tmp_path / "bag")]) != 0
    assert "No space left on device" in capsys.readouterr().err
    assert not (tmp_path / "bag").exists()


def test_without_the_extra_it_says_what_to_install(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "rosbags"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "sim_bridge.judge.export.ros2.bag", raising=False)
    monkeypatch.delattr("sim_bridge.judge.export.ros2.bag", raising=False)
    assert cli.main(["export", str(run), "--ros2bag", str(tmp_path / "bag")]) == 3
    assert "is not installed: in the checkout, pip install -e '.[sim,ros2]'" in capsys.readouterr().err


def test_without_telemetry_logs_there_is_no_bag(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("recording.npz", "mission.toml"):
        shutil.copyfile(run / name, tmp_path / name)
    assert cli.main(["export", str(tmp_path), "--ros2bag", str(tmp_path / "bag")]) == 2
    assert "has no telemetry log" in capsys.readouterr().err
    assert not (tmp_path / "bag").exists()


def test_a_flight_without_scans_is_said_to_have_none(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("recording.npz", "mission.toml"):
        shutil.copyfile(run / name, tmp_path / name)
    for k in (1, 2, 3):
        kept = b"".join(
            struct.pack(">Q", round(time_s * 1e6)) + frame
            for time_s, message_id, frame in frames(run / f"vehicle-{k}.tlog", 0)
            if message_id != dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE
        )
        (tmp_path / f"vehicle-{k}.tlog").write_bytes(kept)
    assert cli.main(["export", str(tmp_path), "--ros2bag", str(tmp_path / "bag")]) == 0
    assert "no scans: the flight's telemetry logs hold none" in capsys.readouterr().out
    with AnyReader([tmp_path / "bag"]) as reader:
        assert {f"/vehicle_{k}/{name}" for k in (1, 2, 3) for name in ("odom", "cmd_vel", "battery")} | {"/tf"} == set(
            reader.topics
        )


def test_attitudes_that_lean_turn_as_rotation_matrices_do() -> None:
    random = np.random.default_rng(1)
    angles = random.uniform((-math.pi, -1.5, -math.pi), (math.pi, 1.5, math.pi), (200, 3))
    quaternions = quaternions_enu(angles)
    vectors = random.normal(size=(200, 3))
    turned = to_flu(vectors, quaternions)
    for angle, (x, y, z, w), vector, flu in zip(angles.tolist(), quaternions.tolist(), vectors, turned, strict=True):
        matrix = NED_TO_ENU @ from_angles(*angle) @ FLU_TO_FRD
        q = type("Q", (), {"x": x, "y": y, "z": z, "w": w})
        assert rotation(q) == pytest.approx(matrix, abs=1e-12)
        assert flu == pytest.approx(matrix.T @ vector, abs=1e-12)


def reading(start_deg: float, step_deg: float, *ranges_m: float, from_north: bool = False) -> Reading:
    return Reading(0, ranges_m, start_deg, step_deg, 0.2, 8.0, from_north, 0.0, 0.0)


def test_a_sensor_that_looks_to_one_side_keeps_its_sides() -> None:
    sweep = laser_sweep(reading(-30.0, 30.0, 1.0, 2.0, 3.0), 0.0)  # left, ahead, right
    assert (sweep.first_rad, sweep.step_rad) == pytest.approx((math.radians(-30), math.radians(30)))
    assert sweep.ranges_m.tolist() == [3.0, 2.0, 1.0]  # right, ahead, left


@pytest.mark.parametrize("start_deg", [-90.0, 0.0, 45.0, 200.0, 360.0])
def test_a_full_turn_begins_behind_wherever_the_sensor_begins(start_deg: float) -> None:
    sweep = laser_sweep(reading(start_deg, 90.0, 1.0, 2.0, 3.0, 4.0), 0.0)
    angles = sweep.first_rad + sweep.step_rad * np.arange(4)
    assert -math.pi - 1e-6 <= angles[0] < -math.pi / 2 + 1e-6
    for range_m, angle in zip(sweep.ranges_m, angles, strict=True):
        clockwise = math.radians(start_deg + 90.0 * (range_m - 1.0))
        assert math.remainder(angle + clockwise, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_sectors_from_north_turn_with_the_vehicle() -> None:
    sweep = laser_sweep(reading(0.0, 90.0, 5.0, from_north=True), math.radians(90.0))  # it flies east: north is left
    assert sweep.first_rad == pytest.approx(math.radians(90.0))
