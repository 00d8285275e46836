"""One flight of n companions in lockstep, its run folder, and its verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from companion.core.model.states import SwarmPhase
from companion.core.stages import StageFactory
from companion.mavlink import dialect
from companion.mavlink.beacon import Reader
from mission.document.load import dump_mission
from mission.document.model import Mission
from mission.schema.faults import FaultKind
from mission.stand.stand import stand_of
from sim_bridge.drive.children import ForkClient, loss
from sim_bridge.drive.entrant.stages import BY_OURS, Entrant
from sim_bridge.drive.faults import ENDING, Faults, immune_of, keep_faults
from sim_bridge.drive.garbage import collect_less
from sim_bridge.drive.interrupts import no_more_interrupts
from sim_bridge.drive.live.live import Live
from sim_bridge.drive.lockstep.airframes_made import counted
from sim_bridge.drive.lockstep.black_box import FOLDER_NAME, Boxes
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys, key_files
from sim_bridge.drive.lockstep.harvest import Harvest, describe_records, harvest_of
from sim_bridge.drive.lockstep.lockstep import Companion, CompanionLostError, InProcess, Lockstep
from sim_bridge.drive.lockstep.processes import Launcher, RadioSocket
from sim_bridge.drive.operator import Operator, SignedOperator, operator_order
from sim_bridge.judge import run_folder
from sim_bridge.judge.estimate_recorder import EstimateRecorder
from sim_bridge.judge.metrics.stems import measure_stems
from sim_bridge.judge.observer import Observer
from sim_bridge.judge.outcome import Outcome, conclude
from sim_bridge.judge.progress import Progress, Status
from sim_bridge.judge.recording import Recorder, Trace
from sim_bridge.judge.run_folder import BEACONS_LOST, MISSION_NAME
from sim_bridge.judge.tick import Tick
from sim_bridge.world.airframe.base import AirframeFactory
from sim_bridge.world.airframe.jsbsim_quad import jsbsim_airframes
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.sensors.table import link_name
from sim_bridge.world.strikes import strike
from sim_bridge.world.world import World

INTERRUPTED = "interrupted"  # why a flight ended
ORIGINAL_NAME = "mission.original.toml"
BEACONS_REMEMBERED = 1024  # four from each of 256 vehicles: more than are under way at a time
LINKS = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}


class Flight:
    """A world with its companions, and what is kept of the flight. `tick` until `finished` is not None."""

    def __init__(
        self,
        mission: Mission,
        companions: list[Companion],
        world: World,
        folder: Path | None,
        live: Live | None = None,
        start: Callable[[int], Companion] | None = None,
        harvest: Harvest | None = None,
        keyholder: SignedOperator | None = None,
    ) -> None:
        """`start`: another companion for a vehicle, for faults that restart one; None: one in this process.

        `harvest`: the records, of a mission that surveys; `keyholder`: the operator of a swarm with keys.
        """
        self._start = start or (lambda vehicle_id: InProcess(mission, vehicle_id))
        self.mission = mission  # with what viewers of `live` have done by now
        self.harvest = harvest
        self.keyholder = keyholder
        self.lockstep = Lockstep(world, companions, harvest, keyholder)
        self.recorder = Recorder(folder)
        self.estimates = EstimateRecorder(mission)
        self.trace = Trace()
        self.observer = Observer(mission, world.vehicles, folder, world.stand)
        self._recording = folder is not None
        self._live = live
        self.faults = Faults(mission.sim.faults, immune_of(mission, still_air=world.still_air))
        self._operator = Operator(mission, keyholder)
        self._lost: set[int] = set()
        self._full: frozenset[int] = frozenset()  # companions' disks
        self._ended: str | None = None  # why the flight is over, though records may still be on their way
        self.end_s: float | None = None  # when it was over, or was found not to be last
        self._unrecorded_s: float | None = None  # when the tick began that is still to be recorded

    @property
    def world(self) -> World:
        """The vehicles."""
        return self.lockstep.world

    @property
    def last(self) -> Tick:
        """The tick that was flown last."""
        return self.lockstep.last

    @property
    def events(self) -> list[tuple[float, str]]:
        """Events of the flight, for people, with their times."""
        return self.observer.events

    def tick(self) -> None:
        """TICK_S of simulated time."""
        now_s = self.world.now_s
        self._apply(now_s)
        if self._operator.orders_start(now_s, self.lockstep.companions, self.last.said):
            self._order(dialect.MAV_CMD_MISSION_START)
        self.lockstep.tick(meanwhile=self.record)
        self._unrecorded_s = now_s
        self.tell_lost(now_s)

    def tell_lost(self, now_s: float) -> None:
        """Reports companions that are gone, each once."""
        for vehicle_id, why in self.lockstep.lost.items():
            if vehicle_id not in self._lost:
                self._lost.add(vehicle_id)
                self.observer.tell_once(now_s, loss(vehicle_id, why))

    def show_events(self, progress: Progress) -> None:
        """Each once."""
        for time_s, text in self.events:
            progress.event(time_s, text)
            if self._live is not None:
                self._live.map.event(time_s, text)
        self.events.clear()

    def record(self) -> None:
        """Sample and log the last tick, once. By itself in the next tick; to be called after the last one."""
        if self._unrecorded_s is not None:
            self.recorder.add(self.last)
            self.estimates.add(self.last)
            self.trace.add(self.last)
            if self._live is not None:
                self._live.kept(self)
            self._record_bytes(self._unrecorded_s)
            self._unrecorded_s = None

    def finished(self) -> str | None:
        """The reason why the flight is over, or None: before that, records on their way may arrive."""
        if self._ended is None:
            self._ended, self.end_s = self.observer.finished(self.last), self.last.time_s
        if self._ended is None or self.harvest is None or not self.lockstep.answering:
            return self._ended
        return self._ended if self.harvest.has_all(self.world.now_s) else None

    def phase(self) -> SwarmPhase:
        """As the acting leader announces it, else the furthest that anyone has."""
        return self.last.phase(self.last.answered)

    def leader(self) -> int | None:
        """The vehicle that acts as leader."""
        return self.last.leader(self.last.answered)

    def status(self, real_time_factor: float) -> Status:
        """A glance at the swarm."""
        status = self.observer.status(self.last, real_time_factor)
        return status if self.harvest is None else replace(status, records=self.harvest.base.text)

    def intervene(self, fault: Mapping[str, Any]) -> None:
        """Let a fault begin with the next tick; `fault`: as in [[sim.faults]], without a time.

        MissionError: this mission cannot have it; ValueError: it strikes nobody. A mission that has it flies the same.
        """
        mission = self.mission.with_faults([{**fault, "at_s": self.world.now_s}], place="the map")
        self.faults.add(mission.sim.faults[-1])
        self.mission = mission

    def close(self) -> None:
        """End the companions, record what is left and close the logs."""
        for companion in list(self.lockstep.companions.values()):
            companion.close()
        self.record()
        self.observer.close()

    def tell_records(self) -> dict[str, Any]:
        """Records made and delivered, said and as figures; none of a mission that does not survey."""
        if self.harvest is None:
            return {}
        figures = self.harvest.figures(self.lockstep.companions)
        self.events.extend((self.world.now_s, line) for line in describe_records(figures))
        return figures

    def _apply(self, now_s: float) -> None:
        """Let the faults happen whose time has come."""
        if not self.mission.sim.faults:
            return
        began, ended = self.faults.advance(
            now_s, alive=self.lockstep.companions, phase=self.phase(), leader=self.leader()
        )
        for event in began:
            self.events.append((now_s, event.begins()))
            for vehicle_id in event.vehicles if event.kind in ENDING else ():
                self.lockstep.kill(vehicle_id)
                self._lost.add(vehicle_id)  # has been said
        for event in ended:
            for vehicle_id in event.vehicles if event.kind is FaultKind.RESTART else ():
                self.lockstep.join(self._start(vehicle_id))
                self._lost.discard(vehicle_id)
                self._full -= {vehicle_id}  # the other one's
        self.events.extend((now_s, event.ends()) for event in ended)
        self.lockstep.stopped, self.lockstep.late_s = self.faults.stopped, self.faults.late_s
        self.lockstep.blind = self.faults.blind
        self.lockstep.set_attackers(self.faults.lies, self.faults.in_force(FaultKind.OUTSIDER))
        for kind in {event.kind: None for event in (*began, *ended)}:
            strike(self.world, kind, self.faults.in_force(kind))
        self.world.radio.cut_off, self.world.radio.cut_links = self.faults.cut_off, self.faults.cut_links
        full = frozenset(self.faults.in_force(FaultKind.DISK_FULL))
        for vehicle_id in (full ^ self._full).intersection(self.lockstep.companions):
            self.lockstep.companions[vehicle_id].fill_disk(full=vehicle_id in full)
        self._full = full

    def _order(self, command: int) -> None:
        """The operator's word to every companion, over its autopilot's ground-station link; by radio with a key."""
        if self.keyholder is not None:
            self.keyholder.start(self.world.now_s)
            return
        for vehicle in self.world.vehicles.values():
            vehicle.autopilot.receive(Link.GROUND, operator_order(vehicle.id, command), self.world.now_s)

    def _record_bytes(self, now_s: float) -> None:
        for vehicle_id, data in self.lockstep.to_companion.items():
            beacons = b"".join(self.lockstep.beacons.get(vehicle_id, ()))
            self.observer.log_traffic(
                now_s, vehicle_id, data + beacons, self.lockstep.from_companion.get(vehicle_id, b"")
            )
        if self._recording:  # as the vehicles stand now: nothing has moved since that tick
            for vehicle_id, vehicle in self.world.vehicles.items():
                if heard := vehicle.autopilot.record(self.world.now_s):
                    self.observer.log_traffic(self.world.now_s, vehicle_id, heard)


def fly(
    mission: Mission,
    folder: Path | None,
    progress: Progress,
    *,
    in_process: bool = False,
    factor: float | None = None,
    airframes: AirframeFactory | None = None,
    watch: Callable[[Flight], None] | None = None,
    programs: Mapping[int, Sequence[str]] = MappingProxyType({}),
    live: Live | None = None,
    entrant: Entrant = BY_OURS,
    keys: FleetKeys | None = None,
    black_box: bool = False,
) -> Outcome:
    """Fly `mission` (with an origin) into the empty `folder`. `factor`: times real time, None as fast as it goes.

    `folder` None: only the outcome is wanted, no file is written; ValueError unless `in_process`. `entrant`: what flies
    in place of ours; ValueError unless `in_process`, as a companion that is a process is a board's. LawError: its law.
    `watch` is called after every tick: a test or a benchmark may interfere there. `programs`: what to start as
    `companion` for a vehicle, where it is not this installation's. `live`: where it is watched, at its own pace.
    `keys`: sign the radio. KeyboardInterrupt ends the flight, not the report. Raises AirframeError without jsbsim,
    MissionError for a stem map that is not in `folder`. `black_box`: each companion keeps one in `folder`.
    """
    if folder is not None:
        run_folder.write(folder / MISSION_NAME, dump_mission(mission).encode())
    elif not in_process:
        raise ValueError("folder = None: companions that are processes read the mission there")
    if not in_process and not entrant.is_ours:
        raise ValueError(f"{entrant.note()}: companions that are processes fly ours")
    stages = entrant.stages()
    if live is not None and folder is not None:
        live.map.begin(folder / MISSION_NAME, live.title, mission.swarm.size)
    started_s = time.perf_counter()
    with ExitStack() as stack:
        forks = None if in_process else stack.enter_context(ForkClient())  # it loads while the world is made
        with progress.working("making the stand"):
            stand = stand_of(mission, folder)
        make = counted(airframes or jsbsim_airframes(mission), mission.swarm.size, progress)
        world = World(mission, make, links=LINKS, stand=stand)
        lost_early: list[CompanionLostError] = []
        companions: list[Companion] = []
        harvest = harvest_of(mission, world, folder, stack, keys)
        if forks is None or folder is None:
            beacons = Reader(world.frame, remembers=BEACONS_REMEMBERED)
            boxes = Boxes(mission, folder if black_box else None, entrant.note())
            stack.callback(boxes.tell_losses, lambda line: progress.event(world.now_s, line))
            start: Callable[[int], Companion] = partial(_in_process, mission, beacons, stages, harvest, keys, boxes)
            companions += [start(k) for k in world.vehicles]
        else:
            radio = RadioSocket()
            stack.callback(radio.close)
            drivers, sensor = None, link_name(mission)
            if sensor:
                drivers = RadioSocket()
                stack.callback(drivers.close)
            logs = folder / "companions"
            logs.mkdir()
            files = (
                _records_file(harvest),
                key_files(keys, folder / "keys"),
                folder / FOLDER_NAME if black_box else None,
            )
            links = Launcher(folder / MISSION_NAME, logs, radio, forks, programs, drivers, sensor, *files)
            start = links.start_again
            companions += links.launch(
                list(world.vehicles),
                lost_early.append,
                lambda count: progress.stage("starting companions", count, len(world.vehicles)),
            )
        keyholder = None if keys is None else keys.operator(world)
        flight = Flight(mission, companions, world, folder, live, start, harvest, keyholder)
        flight.lockstep.insiders.sign_with({} if keys is None else keys.sessions)
        stack.callback(flight.close)
        flight.lockstep.lost.update({error.vehicle_id: error.why for error in lost_early})
        flight.tell_lost(0.0)
        began_flying_s = time.perf_counter()
        stack.callback(collect_less())
        try:
            ended = _run(flight, progress, factor, watch, live)
        except KeyboardInterrupt:
            ended = INTERRUPTED
        flown_s = time.perf_counter() - began_flying_s
        lost = [world.radio.missed_share(k) for k in world.vehicles]
        records = {**flight.tell_records(), BEACONS_LOST: [None if one is None else round(one, 4) for one in lost]}
        own_records = {} if harvest is None else harvest.own_records()
    if forks is not None and forks.failure is not None:
        flight.observer.tell_once(flight.world.now_s, loss(0, forks.failure))
    flight.show_events(progress)  # what happened since the last tick
    if folder is not None:
        keep_faults(flight.faults, flight.world.now_s, folder, progress)
        if flight.mission is not mission:  # as flown: with what viewers have done
            flown = dump_mission(flight.mission).encode()
            run_folder.keep_file(folder / MISSION_NAME, flown, partial(progress.event, flight.world.now_s))
    no_more_interrupts()  # what follows is what a flight is flown for
    with progress.working("measuring the flight"):
        recording = flight.recorder.recording()
        return conclude(
            recording,
            flight.mission,
            folder,
            ended,
            flown_s=flown_s,
            wall_s=time.perf_counter() - started_s,
            trace_hash=flight.trace.hexdigest(),
            faults=flight.faults.happened,
            end_s=flight.end_s,
            stand=stand,
            estimates=flight.estimates.figures(),
            stems=measure_stems(own_records, recording, mission, stand),
            entrant=entrant.figures(),
            records=records,
        )


def _records_file(harvest: Harvest | None) -> Callable[[int], Path | None]:
    return (lambda _vehicle_id: None) if harvest is None else harvest.path


def _in_process(
    mission: Mission,
    beacons: Reader,
    stages: StageFactory,
    harvest: Harvest | None,
    keys: FleetKeys | None,
    boxes: Boxes,
    vehicle_id: int,
) -> InProcess:
    """A companion in this process, with the disk that its vehicle has."""
    guard, orders = (None, None) if keys is None else (keys.guard(vehicle_id), keys.orders(vehicle_id))
    records = None if harvest is None else harvest.open(vehicle_id)
    disk = None if harvest is None else harvest.disks[vehicle_id]
    one = partial(InProcess, mission, vehicle_id, beacons=beacons, stages=stages, records=records, disk=disk)
    returns = None if harvest is None else harvest.returns(vehicle_id)
    return one(guard=guard, orders=orders, box=boxes.make_box(vehicle_id, guard, orders), returns=returns)


def _run(
    flight: Flight,
    progress: Progress,
    factor: float | None,
    watch: Callable[[Flight], None] | None,
    live: Live | None,
) -> str:
    """Tick until the end; why it ended."""
    if live is not None:
        live.await_look(flight, lambda: flight.show_events(progress))
    began_s = time.perf_counter()
    while True:
        flight.show_events(progress)
        if (ended := flight.finished()) is not None:
            return ended
        if live is not None:
            live.wait(flight, lambda: flight.show_events(progress))
        flight.tick()
        if watch is not None:
            watch(flight)
        now_s = flight.world.now_s
        if progress.due(now_s):
            progress.show(flight.status(now_s / max(time.perf_counter() - began_s, 1e-9)))
        if factor is not None and live is None:
            time.sleep(max(0.0, began_s + now_s / factor - time.perf_counter()))
