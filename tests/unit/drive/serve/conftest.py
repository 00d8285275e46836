"""A served world on free ports, and clients that join it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from mission.document.load import parse_mission
from mission.document.model import Mission
from sim_bridge.drive.serve.server import PortPlan, Ports, Server, open_ports
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import PROFILES
from sim_bridge.world.world import DEFAULT_ORIGIN, World
from tests.unit.drive.serve.server_kit import MISSION, READY_S, Peer, ignore


@pytest.fixture
def mission() -> Mission:
    return parse_mission(MISSION).with_origin(DEFAULT_ORIGIN)


@pytest.fixture
def world(mission: Mission) -> World:
    world = World(mission, lambda _frame, place, _seed: PointMass(place, 0.0), links=PROFILES)
    while world.now_s < READY_S:
        world.step(0.05)
    return world


@pytest.fixture
def ports() -> Iterator[Ports]:
    opened = open_ports(PortPlan(), (1, 2, 3))
    yield opened
    opened.close()


@pytest.fixture
def served(world: World, ports: Ports) -> Iterator[Server]:
    made = Server(world, ports, say=ignore)
    yield made
    made.close()


@pytest.fixture
def join(ports: Ports) -> Iterator[Callable[[str], Peer]]:
    """A client of "ground", "radio", or a vehicle's "1" ..."""
    peers = []

    def connect(where: str) -> Peer:
        bound = ports.onboard[int(where)] if where.isdigit() else getattr(ports, where)
        peers.append(Peer(bound.getsockname()[1]))
        return peers[-1]

    yield connect
    for peer in peers:
        peer.socket.close()
