"""A flight as MCAP, read back by the mcap library."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader
from pymavlink import mavutil

from mission.common.frames import LocalFrame, Vec3, Wgs84, ned_to_enu
from mission.document.load import load_mission
from mission.stand.stand import stand_of
from sim_bridge import cli
from sim_bridge.judge import run_folder

Read = dict[str, list[tuple[int, dict[str, Any]]]]


@pytest.fixture(scope="module")
def file(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    assert cli.main(["export", str(run), "--mcap", "--out", str(folder)]) == 0
    return folder / "flight.mcap"


@pytest.fixture(scope="module")
def read(file: Path) -> Read:
    found: Read = {}
    with file.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            found.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
    return found


def logged(run: Path, vehicle: int, kind: str) -> list[Any]:
    """Messages of a telemetry log, by pymavlink."""
    log = mavutil.mavlink_connection(str(run / f"vehicle-{vehicle}.tlog"), dialect="common")
    messages = list(iter(lambda: log.recv_match(type=kind), None))
    log.close()
    return messages


def point(vector: dict[str, float]) -> Vec3:
    return (vector["x"], vector["y"], vector["z"])


def turned(q: dict[str, float], v: Vec3) -> Vec3:
    """`v` turned by the quaternion `q`."""
    axis, w = np.array(point(q)), q["w"]
    t = 2.0 * np.cross(axis, v)
    east, north, up = np.array(v) + w * t + np.cross(axis, t)
    return (float(east), float(north), float(up))


def test_mcap_reads_back_what_was_flown_in_exact_counts(run: Path, file: Path, read: Read) -> None:
    ticks = len(run_folder.load(run).time_s)
    samples = math.ceil(ticks / 2) + (1 if ticks % 2 == 0 else 0)  # every second tick, and the last
    wanted = {"/forest": 1, "/tf": samples, "/swarm/scene": samples, "/swarm/state": samples}
    for k in (1, 2, 3):
        wanted[f"/vehicle_{k}/fix"] = len(logged(run, k, "GLOBAL_POSITION_INT"))
        wanted[f"/vehicle_{k}/scan"] = len(logged(run, k, "OBSTACLE_DISTANCE"))
    read_counts = {topic: len(messages) for topic, messages in read.items()}
    assert {topic: count for topic, count in read_counts.items() if topic != "/log"} == wanted
    assert read_counts["/log"] > 10
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        statistics = summary.statistics
        assert statistics is not None
        told = {summary.channels[k].topic: n for k, n in statistics.channel_message_counts.items()}
        assert told == read_counts
        assert statistics.message_count == sum(read_counts.values())
        (attachment,) = make_reader(stream).iter_attachments()
    assert attachment.data == (run / "mission.toml").read_bytes()


def test_every_message_is_as_its_schema_says(file: Path) -> None:
    seen: Counter[str] = Counter()
    with file.open("rb") as stream:
        for schema, _, message in make_reader(stream).iter_messages():
            assert schema is not None
            assert schema.encoding == "jsonschema"
            seen[schema.name] += 1
            if seen[schema.name] > 20:
                continue
            described, body = json.loads(schema.data), json.loads(message.data)
            jsonschema.validate(body, described)
            assert set(body) == set(described["properties"])
    well_known = {"FrameTransforms", "SceneUpdate", "LocationFix", "LaserScan", "Log"}
    assert set(seen) == {f"foxglove.{name}" for name in well_known} | {"understory.Swarm"}


def test_positions_agree_with_the_telemetry_log_within_5_cm(run: Path, read: Read) -> None:
    mission = load_mission(run / "mission.toml")
    assert mission.origin is not None
    frame = LocalFrame(mission.origin.wgs84)
    for k in (1, 2, 3):
        told = {
            round(m._timestamp * 1e3): ned_to_enu(frame.to_ned(Wgs84(m.lat / 1e7, m.lon / 1e7, m.alt / 1e3)))
            for m in logged(run, k, "GLOBAL_POSITION_INT")
        }
        poses = {round(time_ns / 1e6): point(body["transforms"][k - 1]["translation"]) for time_ns, body in read["/tf"]}
        both = told.keys() & poses.keys()
        assert len(both) > 100
        assert max(math.dist(told[at], poses[at]) for at in both) < 0.05
        for time_ns, fix in read[f"/vehicle_{k}/fix"]:
            place = Wgs84(fix["latitude"], fix["longitude"], fix["altitude"])
            assert math.dist(ned_to_enu(frame.to_ned(place)), told[round(time_ns / 1e6)]) < 1e-6


def test_what_scans_saw_stands_where_trunks_and_vehicles_are(run: Path, read: Read) -> None:
    trees = stand_of(load_mission(run / "mission.toml")).trees
    poses = {time_ns: body["transforms"] for time_ns, body in read["/tf"]}
    off_m = []
    for time_ns, scan in read["/vehicle_2/scan"]:
        if time_ns not in poses:
            continue
        transform = poses[time_ns][1]
        here = point(transform["translation"])
        if here[2] < 3.5:  # near the ground it sees that
            continue
        step = (scan["end_angle"] - scan["start_angle"]) / (len(scan["ranges"]) - 1)
        others = [point(other["translation"]) for other in poses[time_ns] if other is not transform]
        for at, range_m in enumerate(scan["ranges"]):
            if range_m > 0.0:
                angle = scan["start_angle"] + at * step
                seen = turned(transform["rotation"], (range_m * math.cos(angle), range_m * math.sin(angle), 0.0))
                east, north = here[0] + seen[0], here[1] + seen[1]
                to_trees = [math.hypot(east - t.east_m, north - t.north_m) - t.radius_m for t in trees]
                to_others = [math.hypot(east - o[0], north - o[1]) - 0.35 for o in others]
                off_m.append(min(abs(x) for x in (*to_trees, *to_others)))
    assert len(off_m) > 500
    assert np.percentile(off_m, 95) < 0.3  # a sector is 5 degrees wide


def test_roles_phases_and_setpoints_are_those_of_the_flight(run: Path, read: Read) -> None:
    recording = run_folder.load(run)
    roles: dict[str, set[int]] = {}
    phases = []
    for _, state in read["/swarm/state"]:
        for vehicle in state["vehicles"]:
            roles.setdefault(vehicle["role"], set()).add(vehicle["id"])
        leading = [vehicle["id"] for vehicle in state["vehicles"] if vehicle["role"] == "leader"]
        assert state["leader"] == (leading[0] if leading else 0)
        if state["phase"] not in phases:
            phases.append(state["phase"])
    (killed,) = roles["silent"]
    assert killed in roles["leader"]
    assert len(roles["leader"]) == 2  # another leads on
    assert phases[-1] == "coverage"
    assert not recording.agent_alive[-1, killed - 1]
    asked = {round(m._timestamp * 1e3): (m.vy, m.vx, -m.vz) for m in logged(run, 2, "SET_POSITION_TARGET_LOCAL_NED")}
    same = [
        math.dist(point(state["vehicles"][1]["setpoint_enu_mps"]), asked[round(time_ns / 1e6)])
        for time_ns, state in read["/swarm/state"]
        if round(time_ns / 1e6) in asked and state["vehicles"][1]["setpoint_enu_mps"] is not None
    ]
    assert len(same) > 100
    assert max(same) < 2e-3
    words = [body["message"] for _, body in read["/log"]]
    assert any("killed" in text for text in words)
    assert any(text.startswith("leader: vehicle") for text in words)
