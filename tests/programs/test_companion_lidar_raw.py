"""`companion lidar --raw` from the outside: a lidar's bytes on a pty or a socket become SWARM_LIDAR_SCAN on another."""

from __future__ import annotations

import select
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from companion.mavlink.framing.frames import Framing
from companion.mavlink.lidar_scan import LIDAR_SCAN_ID, decode_lidar_scan
from tests.programs.test_companion_lidar import Pty, bound_socket, child, end_child, free_port
from tests.unit.lidar.lidar_kit import ld_revolution, mid360_points, post


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def test_an_ld19_sends_every_ray_where_the_mission_flies_by_them(opened: ExitStack) -> None:
    pty, agent = Pty(opened), opened.enter_context(bound_socket())
    to = f"udpout://127.0.0.1:{agent.getsockname()[1]}"
    options = ["--model", "ld19", "--lidar", f"serial://{pty.path}:230400", "--id", "3", "--to", to]
    with child(*options, "--raw", "scan-1deg", "--upside-down") as (process, stderr):
        revolution, framing, found = ld_revolution(post(90.0, 2.1, 4.0)), Framing(), False
        for _ in range(20_000):
            pty.write(revolution)
            if not select.select([agent], [], [], 0.005)[0]:
                continue
            (incoming,) = framing.read_messages(agent.recv(2048))
            assert (incoming.message_id, incoming.system, incoming.component) == (LIDAR_SCAN_ID, 3, 196)
            piece = decode_lidar_scan(incoming.message)
            assert piece is not None
            assert (piece.bearing_step_deg, piece.elevation_deg, piece.max_m) == (-1.0, 0.0, 12.0)
            if piece.first_bearing_deg == -0.5 and piece.ranges_m[-3:] == (2.1, 2.1, 2.1):
                found = set(piece.ranges_m[:-3]) == {4.0}
                break
        assert found
        end_child(process)
        assert "scans arrive" in stderr.read()


def test_a_mid360_sends_layers(opened: ExitStack) -> None:
    agent = opened.enter_context(bound_socket())
    lidar = opened.enter_context(bound_socket())
    here = ("127.0.0.1", free_port())
    options = ["--model", "mid360", "--lidar", f"udpin://{here[0]}:{here[1]}", "--id", "3", "--raw", "multi-layer"]
    with child(*options, "--to", f"udpout://127.0.0.1:{agent.getsockname()[1]}") as (process, _):
        points = [(0.0, -2.0, 0.0), (0.0, -2.0, 2.0)]
        found: dict[float, float] = {}
        framing = Framing()
        for _ in range(20_000):
            lidar.sendto(mid360_points(3, points), here)
            if select.select([agent], [], [], 0.005)[0]:
                for incoming in framing.read_messages(agent.recv(2048)):
                    piece = decode_lidar_scan(incoming.message)
                    assert piece is not None
                    found[round(piece.elevation_deg)] = min(piece.ranges_m)
            if len(found) == 2:
                break
        assert {deg: round(range_m, 2) for deg, range_m in found.items()} == {1: 2.0, 44: 2.83}
        end_child(process)
