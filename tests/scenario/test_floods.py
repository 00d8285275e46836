"""Companions as processes, flooded over real sockets: each tick is answered, the flight goes on, and it is told."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest

from companion.mavlink import dialect
from companion.mavlink.framing.frames import Framing
from companion.shell.floods import OVER_S
from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.drive.lockstep import processes
from sim_bridge.drive.lockstep.lockstep import Lockstep
from sim_bridge.drive.lockstep.processes import HELLO_LIMIT_S, PROGRAM, CompanionProcess, RadioSocket
from sim_bridge.drive.operator import operator_order
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.sensors.table import link_name
from sim_bridge.world.world import DEFAULT_ORIGIN, TICK_S, World
from tests.bench.setpoint_gaps import SETPOINT_ID, point_mass

FLOOD = 6000  # datagrams between two ticks: more than a kernel's queue of 2 MB keeps of the shortest
FLOODED_S = 3.0
LINKS = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}
FLYING_S = 30.0  # to be in the air and steered


class Flooded(CompanionProcess):
    """Before each tick's datagrams come so many of others on these links, from the genuine address."""

    def __init__(self, vehicle_id: int, folder: Path, radio: RadioSocket, drivers: RadioSocket, sensor: str) -> None:
        super().__init__(
            vehicle_id, folder / "mission.toml", folder / f"{vehicle_id}.log", radio, PROGRAM, drivers, sensor
        )
        self.links: Sequence[RadioSocket] = ()
        self.data = b""

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes = b"") -> None:
        """As a companion's."""
        for link in self.links:
            for _ in range(FLOOD):
                link.send(self.id, self.data)
        super().send(from_peers, from_autopilot, now_s, from_sensor)


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def mission() -> Mission:
    return Mission.model_validate(
        {
            "schema": 1,
            "name": "floods",
            "route": {"d1_enu_m": (0, 0, 5), "d2_enu_m": (30, 0, 5), "vel_leader_mps": 2.0},
            "coverage": {"duration_s": 3600.0},
            "swarm": {"size": 2},
            "sensing": {"sensor": "scan-1deg", "range_m": 12.0},
        }
    ).with_origin(DEFAULT_ORIGIN)


@pytest.mark.parametrize("data", [b"\xfd", b"\xfd\xff\0\0\0\x02\xbf" * 30], ids=["one byte", "claims"])
@pytest.mark.sources
def test_a_flight_goes_on_while_radio_and_sensor_are_flooded_and_the_operator_is_told(
    data: bytes, tmp_path: Path, opened: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "ANSWER_LIMIT_S", 60.0)  # a queue of 2 MB is some work on a busy machine
    flown = mission()
    (tmp_path / "mission.toml").write_text(dump_mission(flown))
    radio, drivers = RadioSocket(), RadioSocket()
    opened.callback(radio.close)
    opened.callback(drivers.close)
    companions = [Flooded(k, tmp_path, radio, drivers, link_name(flown)) for k in (1, 2)]
    for one in companions:
        opened.callback(one.close)
    for one in companions:
        one.meet(time.monotonic() + HELLO_LIMIT_S)
    lockstep = Lockstep(World(flown, point_mass, links=LINKS), companions)
    world, framing = lockstep.world, Framing()
    texts: list[str] = []

    def tick() -> bool:
        """Whether vehicle 1 was given a setpoint."""
        lockstep.tick()
        assert lockstep.lost == {}
        answer = lockstep.from_companion[1]
        for m in framing.parse(answer):
            if m.get_msgId() == dialect.MAVLINK_MSG_ID_STATUSTEXT:
                texts.append(m.text)
        return SETPOINT_ID in answer

    while not tick():
        assert world.now_s < FLYING_S
        if round(world.now_s / TICK_S) % 20 == 0:
            for k, vehicle in world.vehicles.items():
                start = operator_order(k, dialect.MAV_CMD_MISSION_START)
                vehicle.autopilot.receive(Link.GROUND, start, world.now_s)
    companions[0].links, companions[0].data = (radio, drivers), data
    steered = [tick() for _ in range(round(FLOODED_S / TICK_S))]
    assert all(steered)
    companions[0].links = ()
    for _ in range(round((OVER_S + 4.0) / TICK_S)):
        tick()
    for link in ("peers' link", "lidar's link"):
        begun = [text for text in texts if text.startswith(f"{link} flooded: ")]
        over = [text for text in texts if text.startswith(f"{link} flood over: ")]
        assert (len(begun), len(over)) == (1, 1), texts
        assert 0 < int(over[0].split()[-3]) < FLOOD * FLOODED_S / TICK_S
    logged = (tmp_path / "1.log").read_text()
    assert all(text in logged for text in texts if "flood" in text)
    assert " flooded: " not in (tmp_path / "2.log").read_text()
