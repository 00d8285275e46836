"""A served world whose vehicles carry obstacle sensors: what program gets their scans, and how it learns where from."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.core.model.events import LidarScan, ObstacleScan
from companion.mavlink import dialect as mav
from companion.sensors.obstacle_sensor import ObstacleSensor
from companion.sensors.raw_lidar import RawLidar
from mission.document.load import parse_mission
from mission.document.model import Mission
from sim_bridge.drive.serve import notice
from sim_bridge.drive.serve.server import CLIENT_SILENCE_S, STEP_S, PortPlan, Ports, Server, open_ports
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import PROFILES
from sim_bridge.world.world import DEFAULT_ORIGIN, World
from tests.unit.drive.serve.server_kit import MISSION, Peer, ignore, turn

TREE = "[sensing]\n[forest]\ntrees = [{ base_enu_m = [3.0, 9.5], trunk_radius_m = 0.2, height_m = 20.0 }]\n"


@pytest.fixture
def mission() -> Mission:
    return parse_mission(MISSION + TREE).with_origin(DEFAULT_ORIGIN)


@pytest.fixture
def ports() -> Iterator[Ports]:
    opened = open_ports(PortPlan(first_sensor=0), (1, 2, 3))
    yield opened
    opened.close()


@pytest.fixture
def served(mission: Mission, ports: Ports) -> Iterator[Server]:
    world = World(mission, lambda _frame, place, _seed: PointMass(place, 0.0), links=PROFILES)
    made = Server(world, ports, say=ignore)
    yield made
    made.close()


def sensor(ports: Ports, vehicle_id: int) -> Peer:
    return Peer(ports.sensors[vehicle_id].getsockname()[1])


def test_whoever_speaks_to_a_sensor_gets_its_scans_and_no_others(served: Server, ports: Ports) -> None:
    agent, stranger = sensor(ports, 2), sensor(ports, 3)
    agent.send(b"anything")
    turn(served, steps=round(2.0 / STEP_S))
    scans = agent.messages()
    assert stranger.messages() == []
    assert {m.get_type() for m in scans} == {"OBSTACLE_DISTANCE"}
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in scans} == {(2, mav.MAV_COMP_ID_OBSTACLE_AVOIDANCE)}
    assert 19 <= len(scans) <= 21
    for client in (agent, stranger):
        client.socket.close()


@pytest.mark.parametrize(
    ("table", "receiver", "lasts_s"),
    [
        ("[sensing]", ObstacleSensor(1.0), 0.0),
        ('[sensing]\nsensor = "scan-1deg"\nrange_m = 12.0', RawLidar(1.0), 0.1),
    ],
)
def test_scans_are_not_late_where_the_world_falls_behind(
    table: str, receiver: ObstacleSensor | RawLidar, lasts_s: float, ports: Ports
) -> None:
    mission = parse_mission(MISSION + TREE.replace("[sensing]", table)).with_origin(DEFAULT_ORIGIN)
    world = World(mission, lambda _frame, place, _seed: PointMass(place, 0.0), links=PROFILES)
    served = Server(world, ports, say=ignore)
    agent = sensor(ports, 2)
    slow_s, stall_s, fast_s = 2.0 * STEP_S, 3.0, STEP_S / 2.0  # wall time of a step
    now_s, ages_s = 100.0, []
    for wall_s in (*[slow_s] * 400, stall_s, *[fast_s] * 50, *[STEP_S] * 400):
        now_s += wall_s
        agent.send(b"anything")
        turn(served, now_s=now_s)
        receiver.read_autopilot(mav.MAVLink_attitude_message(0, *(0.0,) * 6), now_s)
        for message in agent.messages():
            receiver.decode(message, message.get_srcComponent(), now_s)
        for scan in receiver.collect(now_s):
            assert isinstance(scan, ObstacleScan | LidarScan)
            ages_s.append((wall_s, scan.age_s))
    served.close()
    agent.socket.close()
    behind, caught_up = ([age_s for at_s, age_s in ages_s if at_s == wall_s] for wall_s in (slow_s, STEP_S))
    assert min(len(behind), len(caught_up)) >= 38
    assert max(behind) <= 2.0 * lasts_s + 0.001  # by the wall clock a turn lasts twice as long
    assert max(caught_up[-38:]) <= lasts_s + 0.05


def test_client_that_falls_silent_is_forgotten(served: Server, ports: Ports) -> None:
    agent = sensor(ports, 1)
    agent.send(b"anything")
    turn(served, steps=100)
    assert agent.messages()
    turn(served, steps=100, now_s=CLIENT_SILENCE_S + 1.0)
    agent.datagrams()
    turn(served, steps=100, now_s=CLIENT_SILENCE_S + 1.0)
    assert agent.datagrams() == []
    agent.socket.close()


def test_notice_names_each_sensors_port_and_companions_are_told_of_theirs(mission: Mission, ports: Ports) -> None:
    told = notice.where(mission, Path("m.toml"), ports, 1.0)
    for vehicle in told["vehicles"]:
        port = ports.sensors[vehicle["id"]].getsockname()[1]
        assert vehicle["obstacles"] == {"port": port}
        command = vehicle["companion"]
        assert command[command.index("--sensor") + 1] == f"obstacles=udpout://127.0.0.1:{port}"
        assert f"vehicle {vehicle['id']}  127.0.0.1:{port}" in notice.table(told, None)


def test_without_sensing_no_sensor_is_named(mission: Mission) -> None:
    ports = open_ports(PortPlan(), (1, 2, 3))
    told = notice.where(mission, Path("m.toml"), ports, 1.0)
    ports.close()
    assert "driver" not in notice.table(told, None)
    assert all("--sensor" not in vehicle["companion"] for vehicle in told["vehicles"])


def test_notice_has_the_base_station_of_a_mission_that_surveys_alone(mission: Mission, ports: Ports) -> None:
    assert notice.where(mission, Path("m.toml"), ports, 1.0)["base"] is None
    assert "companion base" not in notice.table(notice.where(mission, Path("m.toml"), ports, 1.0), None)
    lidar = {"sensor": "scan-1deg", "range_m": 12.0}
    surveys = Mission.model_validate({**mission.model_dump(by_alias=True), "sensing": lidar, "survey": {}})
    told = notice.where(surveys, Path("m.toml"), ports, 1.0)
    radio = f"udpout://127.0.0.1:{ports.radio.getsockname()[1]}"
    assert told["base"][1:] == ["base", "m.toml", "--listen", radio, "--records", "records.db", "--unsigned"]
    assert f"companion base m.toml --listen {radio} --records records.db --unsigned" in notice.table(told, None)


def test_scans_by_way_of_the_autopilot_come_with_its_onboard_stream() -> None:
    mission = parse_mission(MISSION + TREE + '[sim.lidar]\nvia = "autopilot"\n').with_origin(DEFAULT_ORIGIN)
    ports = open_ports(PortPlan(), (1, 2, 3))
    world = World(mission, lambda _frame, place, _seed: PointMass(place, 0.0), links=PROFILES)
    served = Server(world, ports, say=ignore)
    companion = Peer(ports.onboard[2].getsockname()[1])
    companion.send(b"anything")
    turn(served, steps=round(2.0 / STEP_S))
    scans = [m for m in companion.messages() if m.get_type() == "OBSTACLE_DISTANCE"]
    served.close()
    ports.close()
    companion.socket.close()
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in scans} == {(2, mav.MAV_COMP_ID_OBSTACLE_AVOIDANCE)}
    assert 19 <= len(scans) <= 21
