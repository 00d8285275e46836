"""Lockstep: the world moves when every companion has answered, so a flight is the same at any speed, to the bit.

Each tick at simulated time t, every companion is handed what its links carry: the beacons that have reached it, the
scan of its obstacle sensor, then its autopilot's messages, of which the last is a TIMESYNC request with t. It runs once
and answers with a beacon (when due), its setpoint and the TIMESYNC answer. When all answers are in, they are merged in
the order of ids.

One that is stopped is handed nothing and not waited for; it reads what has come meanwhile when it resumes.
Telemetry may be late; the request is no telemetry and never is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

from companion.cloud.returns_file import ReturnsFile
from companion.core.stages import FLIGHT_STAGES, StageFactory
from companion.mavlink.beacon import Reader
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.harvest import RecordLink
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.peers.guard import Guard
from companion.payload.recorder import payload_of
from companion.sensors.table import sensors_of
from companion.survey.of_mission import survey_of
from mission.document.model import Mission
from mission.schema.kinds import Lie
from sim_bridge.drive.links.inbox import Inbox
from sim_bridge.drive.links.insider import Insiders
from sim_bridge.drive.links.outsider import Outsider
from sim_bridge.drive.links.radio_node import RadioNode
from sim_bridge.drive.links.transmitter import Transmitter
from sim_bridge.drive.lockstep.black_box import WAIVED, SimulatedBox, run_recorded
from sim_bridge.drive.ticks import world_tick
from sim_bridge.judge.tick import Tick
from sim_bridge.world.autopilot import Link
from sim_bridge.world.world import TICK_S, World


class CompanionLostError(Exception):
    """A companion that died, or did not answer."""

    def __init__(self, vehicle_id: int, why: str) -> None:
        super().__init__(f"companion {vehicle_id}: {why}")
        self.vehicle_id = vehicle_id
        self.why = why


class Companion(Protocol):
    """One agent at the other end of its links."""

    @property
    def id(self) -> int:
        """The vehicle's system id."""

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes = b"") -> None:
        """Hand over one tick's datagrams."""

    def receive(self) -> tuple[bytes, bytes]:
        """Its answer (to the peers, to the autopilot). CompanionLostError when there is none."""

    def kill(self) -> None:
        """End it at once and without a word; `close` follows."""

    def fill_disk(self, *, full: bool) -> None:
        """Let it write no more to its disk, or again."""

    def close(self) -> None:
        """Let go of it; ends a process."""


class RecordDisk(Protocol):
    """The disk that one vehicle's records are written to."""

    def fill(self, *, full: bool) -> None:
        """Let nothing more be written there, or again."""


class InProcess:
    """An agent in this process: byte buffers instead of sockets, the same codec."""

    def __init__(
        self,
        mission: Mission,
        vehicle_id: int,
        *,
        beacons: Reader | None = None,
        stages: StageFactory = FLIGHT_STAGES,
        records: RecordLink | None = None,
        disk: RecordDisk | None = None,
        guard: Guard | None = None,
        orders: OrderBook | None = None,
        box: SimulatedBox | None = None,
        returns: ReturnsFile | None = None,
    ) -> None:
        """`beacons`: shared with the others of this process, which then decode each frame once.

        `stages`: of its agent. `records`: of a mission that surveys, on `disk`. `guard`: of its radio, in a swarm
        with keys; `orders`: of the operator's key there. `box`: its black box, made for these two. `returns`: where a
        survey's are kept.
        """
        self.endpoint = Endpoint(
            mission,
            vehicle_id,
            sensors=sensors_of(mission),
            beacons=beacons,
            stages=stages,
            survey=survey_of(mission, vehicle_id, keeps_returns=returns is not None),
            payload=payload_of(mission, vehicle_id),
            records=records if box is None else box.link(records),
            guard=guard if box is None else box.guard,
            orders=orders if box is None else box.orders,
        )
        self._disk, self._box, self._returns = disk, box, returns
        self._is_disk_full = False
        # As `--waive all`, and `--unsigned` without keys, of a companion that is a process
        self.endpoint.agent.waive(WAIVED, unsigned=guard is None)
        self._recorder = None if box is None else box.record_endpoint(self.endpoint)
        self._answer = (b"", b"")

    @property
    def id(self) -> int:
        """The vehicle's system id."""
        return self.endpoint.id

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes = b"") -> None:
        """Runs the agent at once."""
        self._run(from_peers, from_autopilot, now_s, from_sensor)
        if self._returns is not None:
            passes = self.endpoint.take_returns()
            if passes and not self._is_disk_full:
                self._returns.write(passes)

    def _run(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes) -> None:
        if self._recorder is not None:
            self._answer = run_recorded(self._recorder, from_peers, from_sensor, from_autopilot, now_s)
            return
        self.endpoint.from_peers(from_peers, now_s)
        if from_sensor:
            self.endpoint.from_sensor(from_sensor, now_s)
        self.endpoint.from_autopilot(from_autopilot, now_s)
        out = self.endpoint.tick(now_s)
        self._answer = (out.peers + b"".join(out.records), out.autopilot)

    def receive(self) -> tuple[bytes, bytes]:
        """The agent's answer."""
        return self._answer

    def kill(self) -> None:
        """Nothing to end."""

    def fill_disk(self, *, full: bool) -> None:
        """It writes records, returns and its black box alone."""
        self._is_disk_full = full
        if self._disk is not None:
            self._disk.fill(full=full)
        if self._box is not None:
            self._box.fill(full=full)

    def close(self) -> None:
        """Ends its black box."""
        if self._recorder is not None:
            self._recorder.close("ended")


class Lockstep:
    """Drives a world and its companions, one tick at a time. Lost companions are left behind and named in `lost`.

    `last` is the Tick that was made last; before the first, how the world begins.
    """

    def __init__(
        self,
        world: World,
        companions: Sequence[Companion],
        base: RadioNode | None = None,
        operator: RadioNode | None = None,
    ) -> None:
        """`base`: the base station, of a mission that surveys; `operator`: of a signed swarm."""
        self.world = world
        self._nodes = [node for node in (base, operator) if node is not None]
        self.companions = {c.id: c for c in sorted(companions, key=lambda c: c.id)}
        self.lost: dict[int, str] = {}
        self.stopped: frozenset[int] = frozenset()  # of companions
        self.late_s: Mapping[int, float] = MappingProxyType({})  # by id: how late this vehicle's telemetry is
        self.blind: frozenset[int] = frozenset()  # vehicles whose optical sensors tell nothing
        self._inboxes = {vehicle_id: Inbox() for vehicle_id in self.companions}
        self.to_companion: dict[int, bytes] = {}  # the last tick's traffic, for what records it
        self.from_companion: dict[int, bytes] = {}
        self.beacons: dict[int, tuple[bytes, ...]] = {}
        self.insiders = Insiders(world.mission)
        self._outsider: Outsider | None = None  # none before it begins
        self.transmitter = Transmitter(world.radio, self.insiders)
        self.last = self._emit()

    def set_attackers(self, lies: Mapping[int, Lie], beside: Collection[int]) -> None:
        """Set the lie of each insider, by id, and the vehicles beside which radios without keys send, from now on."""
        self.insiders.set_lies(lies)
        if beside and self._outsider is None:
            self._outsider = Outsider(self.world.mission, self.world.radio)
            self._nodes.append(self._outsider)
        if self._outsider is not None:
            self._outsider.beside = min(beside, default=0)

    def tick(self, meanwhile: Callable[[], None] = lambda: None) -> None:
        """One agents' tick and TICK_S of the world.

        `meanwhile` is called while the companions think: the world, and the traffic kept here, are then still those
        that the last tick left.
        """
        now_s = self.world.now_s
        handed_out = {}
        for vehicle_id, companion in self.companions.items():
            autopilot, inbox = self.world.vehicles[vehicle_id].autopilot, self._inboxes[vehicle_id]
            telemetry = b"".join(autopilot.transmit(Link.ONBOARD, now_s))
            sensed = b""
            for sensor, data in self.world.sense(vehicle_id):
                if sensor.is_optical and vehicle_id in self.blind:
                    continue
                if sensor.by_autopilot:
                    telemetry += data
                else:
                    sensed += data
            late_s = self.late_s.get(vehicle_id, 0.0)
            inbox.put(self.world.radio.deliver(vehicle_id, now_s), telemetry, sensed, now_s, late_s)
            if vehicle_id in self.stopped:
                continue
            beacons, telemetry, sensed = inbox.drain_links()
            telemetry += autopilot.timesync_request(now_s)
            handed_out[vehicle_id] = sensed + telemetry
            companion.send(beacons, telemetry, now_s, sensed)
        meanwhile()
        self.to_companion, self.from_companion, self.beacons = handed_out, {}, {}
        self._place_radios()
        for vehicle_id in self.world.vehicles:
            if vehicle_id in handed_out:
                self._take_answer(self.companions[vehicle_id], now_s)
            # While the next companions still think: physics is most of this program's work.
            self.world.step_vehicle(vehicle_id, TICK_S)
        for node in self._nodes:
            node.receive(self.world.radio.deliver(node.id, now_s), now_s)
            for frame in node.tick(now_s):
                self.world.radio.send(node.id, frame, now_s, aside=True)
        self.world.advance_clock(TICK_S)
        self.last = self._emit()

    def _place_radios(self) -> None:
        positions = self.world.positions()
        for node in self._nodes:
            positions[node.id] = node.pos_ned_m
        self.world.radio.place(positions)

    def _emit(self) -> Tick:
        return world_tick(
            self.world,
            self.transmitter,
            alive=self.companions,
            answered=self.from_companion,
            frames=self.beacons,
        )

    def _take_answer(self, companion: Companion, now_s: float) -> None:
        try:
            to_peers, to_autopilot = companion.receive()
        except CompanionLostError as lost:
            self.drop(lost)
            return
        self.from_companion[companion.id] = to_autopilot
        self.world.vehicles[companion.id].autopilot.receive(Link.ONBOARD, to_autopilot, now_s)
        self.beacons[companion.id] = self.transmitter.send(companion.id, to_peers, now_s)

    @property
    def answering(self) -> list[int]:
        """Vehicles whose companions have not ended and are not stopped."""
        return [vehicle_id for vehicle_id in self.companions if vehicle_id not in self.stopped]

    def kill(self, vehicle_id: int) -> None:
        """End this companion at once and without a word."""
        self.companions[vehicle_id].kill()
        self.drop(CompanionLostError(vehicle_id, "killed"))

    def join(self, companion: Companion) -> None:
        """A companion that was started again, of a vehicle that has none: what its radio got meanwhile nobody heard."""
        self.world.radio.deliver(companion.id, self.world.now_s)
        self.lost.pop(companion.id, None)
        self._inboxes[companion.id] = Inbox()
        self.companions = dict(sorted([*self.companions.items(), (companion.id, companion)]))

    def drop(self, lost: CompanionLostError) -> None:
        """Go on without this companion; its vehicle stays, with its autopilot alone."""
        companion = self.companions.pop(lost.vehicle_id, None)
        if companion is not None:
            self.lost[lost.vehicle_id] = lost.why
            companion.close()
