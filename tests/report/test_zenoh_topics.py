"""A flight as ROS 2 topics over a real Zenoh session: all that its bag has, at the same times; and scans of others."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from pymavlink import mavutil
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from mission.document.load import dump_mission
from sim_bridge import cli
from tests.flights import short_mission

zenoh = pytest.importorskip("zenoh", reason="of the extra `zenoh`")
pytest.importorskip("xxhash", reason="of the extra `zenoh`")

from sim_bridge.drive.live.rmw_zenoh import Topic, attachment, gid_of  # noqa: E402

STORE = get_typestore(Stores.ROS2_JAZZY)
LIMIT_S = 60.0  # of waiting for what has been sent
SCAN = "sensor_msgs/msg/LaserScan"


class Heard(NamedTuple):
    kind: str
    body: Any
    attachment: bytes


class Peer:
    """A session of others, which hears all of a ROS domain and its graph; at a socket file: no port, no multicast."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.endpoint = f"unixsock-stream/{folder / 'zenoh.sock'}"
        self.domain = domain
        self.heard: dict[str, list[Heard]] = {}
        self.tokens: list[str] = []
        self.gone = threading.Event()
        self.react: Callable[[str, Any], None] = lambda _topic, _body: None
        config = zenoh.Config()
        config.insert_json5("mode", '"peer"')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("listen/endpoints", json.dumps([self.endpoint]))
        self.session = zenoh.open(config)
        self._kept = [
            self.session.declare_subscriber(f"{domain}/**", self._hear),
            self.session.liveliness().declare_subscriber(f"@ros2_lv/{domain}/**", self._note_token),
        ]

    def _hear(self, sample: Any) -> None:
        topic, name, type_hash = str(sample.key_expr).partition("/")[2].rsplit("/", 2)
        kind = name.replace("::dds_::", "/").replace("::", "/").removesuffix("_")
        assert type_hash == STORE.hash_rihs01(kind)
        body = STORE.deserialize_cdr(bytes(sample.payload), kind)
        self.heard.setdefault(f"/{topic}", []).append(Heard(kind, body, bytes(sample.attachment)))
        self.react(f"/{topic}", body)

    def _note_token(self, sample: Any) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self.tokens.append(str(sample.key_expr))
        else:
            self.gone.set()  # the other session is closed; on this link that comes after all else


@pytest.fixture
def peer(tmp_path: Path) -> Iterator[Peer]:
    one = Peer(tmp_path, domain=7)
    yield one
    one.session.close()


def mission_file(folder: Path) -> Path:
    mission = short_mission(
        swarm={"size": 2},
        sensing={},
        forest={"stand": {"density_per_ha": 200.0}},
        sim={"seed": 1, "time_limit_s": 40.0},
    )
    file = folder / "mission.toml"
    file.write_text(dump_mission(mission), encoding="utf-8")
    return file


def fly(folder: Path, peer: Peer, *options: str) -> Path:
    """Flown to its time limit, with all agents in this process; the run folder, once the peer has heard all."""
    file, out = mission_file(folder), folder / "run"
    command = ["fly", str(file), "--agents", "in-process", "--zenoh", peer.endpoint, "--ros-domain", str(peer.domain)]
    assert cli.main([*command, "--out", str(out), *options]) in (0, 1)
    assert peer.gone.wait(LIMIT_S)
    return out


def ns(header: Any) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


class Flown(NamedTuple):
    peer: Peer
    run: Path


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flown]:
    """One flight, heard to its end."""
    folder = tmp_path_factory.mktemp("heard")
    one = Peer(folder, domain=7)
    yield Flown(one, fly(folder, one))
    one.session.close()


def test_what_is_heard_live_is_what_the_bag_has(flown: Flown, tmp_path: Path) -> None:
    (peer, run), bag = flown, tmp_path / "bag"
    assert cli.main(["export", str(run), "--ros2bag", str(bag)]) == 0
    with AnyReader([bag]) as reader:
        topics = {connection.topic for connection in reader.connections}
        for connection in reader.connections:
            live = peer.heard[connection.topic]
            stored = [reader.deserialize(data, connection.msgtype) for _, _, data in reader.messages([connection])]
            if connection.topic == "/tf":
                compare_transforms(live, stored)
                continue
            assert {one.kind for one in live} == {connection.msgtype}
            assert len(live) == len(stored) > 30
            for one, other in zip(live, stored, strict=True):
                assert bytes(STORE.serialize_cdr(one.body, one.kind)) == bytes(
                    STORE.serialize_cdr(other, connection.msgtype)
                )
    assert set(peer.heard) == topics | {"/clock", "/diagnostics"}


def compare_transforms(live: list[Heard], stored: list[Any]) -> None:
    """Those of two vehicles at one time may be in another order; truth between two ticks is interpolated in a bag."""

    def rows(messages: list[Any]) -> dict[tuple[int, str], Any]:
        return {(ns(t.header), t.child_frame_id): t.transform for m in messages for t in m.transforms}

    found, wanted = rows([one.body for one in live]), rows(stored)
    assert found.keys() == wanted.keys()
    off_m = [
        math.dist((a.x, a.y, a.z), (b.x, b.y, b.z))
        for a, b in ((found[key].translation, wanted[key].translation) for key in wanted)
    ]
    assert max(off_m) < 0.02


def test_the_graph_knows_a_node_and_publishers_of_each_vehicle(flown: Flown) -> None:
    peer = flown.peer
    parts = [token.split("/") for token in peer.tokens]
    assert {one[1] for one in parts} == {"7"}
    nodes = {(one[7], one[8]) for one in parts if one[5] == "NN"}
    assert nodes == {("%", "understory"), ("%vehicle_1", "understory"), ("%vehicle_2", "understory")}
    published = {one[9].replace("%", "/") for one in parts if one[5] == "MP"}
    assert published == set(peer.heard)
    for topic, heard in peer.heard.items():
        (token,) = [token for token in peer.tokens if f"/{topic.replace('/', '%')}/" in token]
        times_ns = [int.from_bytes(one.attachment[8:16], "little") for one in heard]
        wanted = [attachment(k, time_ns, gid_of(token)) for k, time_ns in enumerate(times_ns, start=1)]
        assert [one.attachment for one in heard] == wanted
        assert times_ns == sorted(times_ns)


def test_clock_and_diagnostics_tell_of_the_simulation(flown: Flown) -> None:
    peer = flown.peer
    clock = [one.body.clock for one in peer.heard["/clock"]]
    times_ns = np.array([one.sec * 1_000_000_000 + one.nanosec for one in clock])
    assert set(np.diff(times_ns).tolist()) == {50_000_000}  # of a tick
    last = peer.heard["/diagnostics"][-1].body
    assert [one.name for one in last.status] == ["vehicle_1", "vehicle_2"]
    values = {pair.key: pair.value for pair in last.status[0].values}
    assert values["leader"] == "1"
    assert values["mode"] == "OFFBOARD"
    assert last.status[0].level == 0
    assert {one.message for message in peer.heard["/diagnostics"] for one in message.body.status} >= {"", "transit"}


def test_scans_of_others_take_the_place_of_the_simulated_ones(
    peer: Peer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Vehicle 1 is told of a wall 5 m to its left and nothing else; its first scans are in an unknown frame."""
    topic = Topic(peer.domain, "/vehicle_1/scan", SCAN, STORE.hash_rihs01(SCAN))
    publisher = peer.session.declare_publisher(topic.key)
    ranges = np.full(360, math.inf, np.float32)
    ranges[80:101] = 5.0
    sent = 0

    def answer(name: str, body: Any) -> None:
        nonlocal sent
        if name == "/vehicle_1/odom":
            sent += 1
            frame = body.child_frame_id if sent > 20 else "laser"
            header = STORE.types["std_msgs/msg/Header"](body.header.stamp, frame)
            step = math.radians(1.0)
            message = STORE.types[SCAN](
                header, 0.0, 359 * step, step, 0.0, 0.0, 0.2, 8.0, ranges, np.zeros(0, np.float32)
            )
            publisher.put(bytes(STORE.serialize_cdr(message, SCAN)))

    peer.react = answer
    run = fly(tmp_path, peer, "--zenoh-scans", "1", "--speed", "8")
    said = capsys.readouterr().err
    assert said.count("vehicle 1: scan refused: header.frame_id = 'laser': must be 'vehicle_1/base_link'") == 1
    told = {k: logged_scans(run, k) for k in (1, 2)}
    assert len(told[1]) > 100
    sectors = {tuple(m.distances) for m in told[1]}
    (only,) = sectors  # never a simulated one
    assert {k for k, cm in enumerate(only) if cm == 500} == {52, 53, 54, 55, 56}  # clockwise: to the left
    assert {cm for k, cm in enumerate(only) if cm != 500} == {801}
    assert len({tuple(m.distances) for m in told[2]}) > 10  # those of vehicle 2 are simulated
    assert "/vehicle_2/scan" in peer.heard
    assert len(peer.heard.get("/vehicle_1/scan", [])) == 0 or all(
        one.attachment == b"" for one in peer.heard["/vehicle_1/scan"]
    )
    assert any("/MS/" in token and "%vehicle_1%scan" in token for token in peer.tokens)


def logged_scans(run: Path, vehicle: int) -> list[Any]:
    log = mavutil.mavlink_connection(str(run / f"vehicle-{vehicle}.tlog"), dialect="common")
    messages = list(iter(lambda: log.recv_match(type="OBSTACLE_DISTANCE"), None))
    log.close()
    return messages


def test_a_flight_is_the_same_whoever_listens(flown: Flown, tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    cli.main(["fly", str(mission_file(tmp_path)), "--agents", "in-process", "--out", str(plain)])
    hashes = [json.loads((folder / "metrics.json").read_text("utf-8"))["trace_hash"] for folder in (flown.run, plain)]
    assert hashes[0] == hashes[1]


def test_where_nobody_listens_it_says_so_and_flies_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim_bridge.drive.live.zenoh_session.CONNECT_MS", 50)
    out = tmp_path / "run"
    endpoint = f"unixsock-stream/{tmp_path / 'nobody.sock'}"
    assert cli.main(["fly", str(mission_file(tmp_path)), "--zenoh", endpoint, "--out", str(out)]) == 3
    said = capsys.readouterr().err
    assert f"--zenoh {endpoint}: no session: " in said
    assert "ros2 run rmw_zenoh_cpp rmw_zenohd" in said
    assert not out.exists()
