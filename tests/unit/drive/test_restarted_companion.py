"""What a companion that is started again hears first."""

from __future__ import annotations

from sim_bridge.drive.lockstep.lockstep import InProcess, Lockstep
from sim_bridge.world.airframe.point_mass import point_mass_airframes
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.world import DEFAULT_ORIGIN, World
from tests.unit.judge.metrics_kit import a_mission


class Listener:
    """A companion that notes how much of the others it is handed in each tick, and answers nothing."""

    def __init__(self, vehicle_id: int) -> None:
        self.id = vehicle_id
        self.heard_bytes: list[int] = []

    def send(self, from_peers: bytes, _from_autopilot: bytes, _now_s: float, _from_sensor: bytes = b"") -> None:
        self.heard_bytes.append(len(from_peers))

    def receive(self) -> tuple[bytes, bytes]:
        return b"", b""

    def kill(self) -> None: ...

    def fill_disk(self, *, full: bool) -> None: ...

    def close(self) -> None: ...


def test_it_hears_nothing_of_what_was_on_the_air_while_it_was_dead() -> None:
    mission = a_mission(n=3).with_origin(DEFAULT_ORIGIN)
    world = World(mission, point_mass_airframes(mission), links={Link.ONBOARD: StreamProfile.ONBOARD})
    lockstep = Lockstep(world, [InProcess(mission, k) for k in (1, 2)])
    for _ in range(40):
        lockstep.tick()
    again = Listener(3)
    lockstep.join(again)
    for _ in range(40):
        lockstep.tick()
    assert 0 < max(again.heard_bytes[:2]) <= max(again.heard_bytes[2:])
