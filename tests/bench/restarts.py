"""A served swarm on the wall clock whose companions are killed and stopped, and started again as a service would."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from companion.core.model.states import STEERED, FlightState, SwarmPhase
from companion.mavlink import dialect
from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.drive.children import Child, end, fate
from sim_bridge.drive.links.ports import Address
from sim_bridge.drive.lockstep.processes import start_companion
from sim_bridge.drive.operator import operator_order
from sim_bridge.drive.serve.server import Pacer, PortPlan, Server, open_ports
from sim_bridge.drive.ticks import world_tick
from sim_bridge.judge.metrics import measure
from sim_bridge.judge.recording import Recorder
from sim_bridge.world.airframe.jsbsim_quad import jsbsim_airframes
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.world import DEFAULT_ORIGIN, World

RESTART_S = 0.1  # systemd's RestartSec by default
STEPS_PER_SAMPLE = 5
STILL_MPS = 0.3
HAPPEN_LIMIT_S = 240.0  # anything, on a busy machine
UNDER_WAY_M = 5.0  # of the transit, before a companion is killed
CLOSE_UP_S = 60.0  # simulated, once all are in coverage, for one that fell back to be with the swarm


def swarm_mission(seed: int, n: int = 4) -> Mission:
    """80 m at 2 m/s."""
    return Mission.model_validate(
        {
            "schema": 1,
            "name": "restarts",
            "route": {"d1_enu_m": (0, 0, 6), "d2_enu_m": (80, 0, 6), "vel_leader_mps": 2.0},
            "coverage": {"duration_s": 600.0, "radius_m": 12.0},
            "swarm": {"size": n},
            "sim": {"seed": seed},
        }
    ).with_origin(DEFAULT_ORIGIN)


class ServedSwarm:
    """Vehicles, their server, and a supervisor for each companion. `until` is what makes time pass."""

    def __init__(self, mission: Mission, folder: Path, stack: ExitStack) -> None:
        self.mission = mission
        links = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}
        self.world = World(mission, jsbsim_airframes(mission), links=links)
        self._ports = open_ports(PortPlan(), list(self.world.vehicles))
        stack.callback(self._ports.close)
        self.server = Server(self.world, self._ports, say=lambda _: None)
        stack.callback(self.server.close)
        self._pacer = Pacer(time.monotonic(), 1.0)
        self._folder = folder
        (folder / "mission.toml").write_text(dump_mission(mission))
        self.agents: dict[int, Child] = {}
        stack.callback(lambda: end(list(self.agents.values())))
        self._again_s: dict[int, float] = {}
        self._former: dict[int, tuple[Address, ...]] = {}  # where killed or stopped companions spoke from
        for k in self.world.vehicles:
            self._start(k)
        self._recorder = Recorder()
        self._steps = 0

    def until(self, happened: Callable[[], bool], what: str) -> float:
        """Wall time that it took. RuntimeError when it takes too long."""
        began_s = time.monotonic()
        while not happened():
            if time.monotonic() - began_s > HAPPEN_LIMIT_S:
                raise RuntimeError(f"not within {HAPPEN_LIMIT_S:g} s: {what}")
            self._step()
        return time.monotonic() - began_s

    def take_off(self) -> None:
        """Start the mission, and wait until the swarm is well under way to d2."""
        heard = self.server.hub.transmitter.said
        everyone = self.world.vehicles
        ready = lambda: all(k in heard and heard[k].flight_state == FlightState.READY for k in everyone)  # noqa: E731
        self.until(ready, "all ready")
        for k, vehicle in everyone.items():
            order = operator_order(k, dialect.MAV_CMD_MISSION_START)
            vehicle.autopilot.receive(Link.GROUND, order, self.world.now_s)
        self.until(lambda: all(self.state(k) is FlightState.TRANSIT for k in everyone), "all in transit")
        began = self.ahead_m()
        self.until(lambda: self.ahead_m() > began + UNDER_WAY_M, "under way")

    def state(self, vehicle_id: int) -> FlightState | None:
        """As its last beacon says."""
        heard = self.server.hub.transmitter.said.get(vehicle_id)
        return None if heard is None else FlightState(heard.flight_state)

    def mode(self, vehicle_id: int) -> str:
        """Of its autopilot."""
        return self.world.vehicles[vehicle_id].autopilot.snapshot.mode

    def setpoints(self, vehicle_id: int) -> int:
        """That its autopilot has taken."""
        return self.world.vehicles[vehicle_id].autopilot.snapshot.setpoints

    def speed_mps(self, vehicle_id: int) -> float:
        """True."""
        return math.hypot(*self.world.vehicles[vehicle_id].airframe.state.vel_ned_mps)

    def ahead_m(self) -> float:
        """How far east the foremost vehicle is: the way goes there."""
        return max(position[1] for position in self.world.positions().values())

    def leader(self) -> int | None:
        """Who acts as leader."""
        heard = self.server.hub.transmitter.said
        return next((k for k in self.world.vehicles if k in heard and heard[k].acting_leader == k), None)

    def signal(self, vehicle_id: int, number: signal.Signals) -> None:
        """To this vehicle's companion."""
        if number is signal.SIGCONT:
            self._former.pop(vehicle_id, None)
        else:
            self._former[vehicle_id] = self.server.hub.gate.addresses_of(vehicle_id)
        os.kill(self.agents[vehicle_id].pid, number)

    def arrive(self) -> bool:
        """Wait until the swarm covers d2; whether it has arrived as the metrics have it.

        All may be in coverage before they are together: on a busy computer a companion is started again late, and its
        vehicle has fallen back. Its way to the others takes time of the world, not of the wall clock.
        """
        self.until(lambda: all(self.state(k) is FlightState.COVERAGE for k in self.agents), "all in coverage")
        end_s, look_s = self.world.now_s + CLOSE_UP_S, -math.inf
        has_arrived = False

        def over() -> bool:
            nonlocal look_s, has_arrived
            now_s = self.world.now_s
            if now_s - look_s >= 1.0:
                look_s = now_s
                has_arrived = measure(self._recorder.recording(), self.mission).arrived
            return has_arrived or now_s >= end_s

        self.until(over, "arrived")
        return has_arrived

    def _step(self) -> None:
        self.server.run_step(self._pacer)
        self._steps += 1
        if self._steps % STEPS_PER_SAMPLE == 0:
            self._sample()
        self._supervise()

    def _supervise(self) -> None:
        """Restart=always, RestartSec=RESTART_S."""
        now_s = time.monotonic()
        for k, agent in self.agents.items():
            if fate(agent) is not None and k not in self._again_s:
                self._again_s[k] = now_s + RESTART_S
        for k, again_s in list(self._again_s.items()):
            if now_s >= again_s:
                del self._again_s[k]
                self.agents[k].wait()
                self._start(k)

    def _start(self, k: int) -> None:
        self.agents[k] = start_companion(
            k,
            self._folder / "mission.toml",
            self._folder / f"companion-{k}.log",
            autopilot_port=self._ports.onboard[k].getsockname()[1],
            radio_port=self._ports.radio.getsockname()[1],
            clock="monotonic",
        )

    def _sample(self) -> None:
        """A companion is alive from its first word until it is killed or stopped, however late it speaks.

        By the wall clock (`Server.tick`), one that a busy computer lets wait for half a second counts as dead, and a
        leader that does as it comes to d2 never arrives: it goes on to its place on the ring.
        """
        addresses_of = self.server.hub.gate.addresses_of
        alive = [k for k in self.world.vehicles if addresses_of(k) != self._former.get(k, ())]
        self._recorder.add(world_tick(self.world, self.server.hub.transmitter, alive=alive, answered=alive))


@contextmanager
def served_swarm(mission: Mission, folder: Path) -> Iterator[ServedSwarm]:
    """Under way to d2; its companions end with the block."""
    with ExitStack() as stack:
        swarm = ServedSwarm(mission, folder, stack)
        swarm.take_off()
        yield swarm


@dataclass(frozen=True, slots=True)
class Kill:
    """What followed one kill -9, in seconds of wall time after it."""

    held_s: float  # the autopilot's own failsafe: HOLD
    still_s: float  # slower than STILL_MPS
    up_s: float  # the first beacon of the next companion
    rejoined_s: float  # steered with the swarm again


def kill(swarm: ServedSwarm, victim: int) -> Kill:
    """kill -9 of one companion in flight, until it has rejoined."""
    gate, former = swarm.server.hub.gate, swarm.server.hub.gate.addresses_of(victim)
    times: dict[str, float] = {}
    began_s = time.monotonic()
    swarm.signal(victim, signal.SIGKILL)

    def rejoined() -> bool:
        is_new = gate.addresses_of(victim) != former
        seen = {
            "held": swarm.mode(victim) == "HOLD",
            "still": swarm.speed_mps(victim) < STILL_MPS,
            "up": is_new,
            "rejoined": is_new
            and swarm.mode(victim) == "OFFBOARD"
            and swarm.state(victim) in STEERED - {FlightState.HOLD},
        }
        for name, is_so in seen.items():
            if is_so:
                times.setdefault(name, time.monotonic() - began_s)
        return "rejoined" in times

    swarm.until(rejoined, f"companion {victim} rejoined; so far {times}")
    return Kill(*(times.get(name, math.inf) for name in ("held", "still", "up", "rejoined")))


def kills(seed: int, folder: Path) -> tuple[list[Kill], bool]:
    """One flight in which a follower's companion is killed, then the leader's; and whether the swarm arrives."""
    with served_swarm(swarm_mission(seed), folder) as swarm:
        done = []
        for leads in (False, True):
            swarm.until(lambda: swarm.leader() is not None, "a leader")
            leader = swarm.leader()
            follower = next(k for k in swarm.agents if k != leader)
            done.append(kill(swarm, leader if leads and leader is not None else follower))
            phase = max(heard.phase for heard in swarm.server.hub.transmitter.said.values())
            assert phase <= SwarmPhase.COVERAGE
        return done, swarm.arrive()
