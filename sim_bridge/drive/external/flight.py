"""Companions over external autopilots, stepped on the wall clock: radio, simulated sensors and faults between them."""

from __future__ import annotations

import math
import signal
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from companion.core.model.states import FlightState
from companion.mavlink import dialect
from mission.document.model import Mission
from mission.schema.faults import FaultKind
from mission.stand.stand import stand_of
from sim_bridge.drive.children import Child, ForkClient, end, fate, loss, signal_group
from sim_bridge.drive.external.autopilots import SILENT_S, Autopilots, silent_ones, still_up
from sim_bridge.drive.external.sensors import Sensors
from sim_bridge.drive.external.truth import told_by
from sim_bridge.drive.faults import ENDING, Faults
from sim_bridge.drive.links.hub import RadioHub
from sim_bridge.drive.links.inbox import LateLine
from sim_bridge.drive.links.ports import Address, Reader, bound_socket
from sim_bridge.drive.live.live import ages_s
from sim_bridge.drive.live.map import Map
from sim_bridge.drive.lockstep.black_box import FOLDER_NAME
from sim_bridge.drive.lockstep.harvest import Harvest, describe_records
from sim_bridge.drive.lockstep.processes import fill_disk, start_companion
from sim_bridge.drive.operator import operator_order
from sim_bridge.judge.estimate_errors import ErrorFigures, EstimateErrors
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.observer import Observer
from sim_bridge.judge.progress import Progress
from sim_bridge.judge.recording import Recorder
from sim_bridge.judge.tick import Tick
from sim_bridge.world.contacts import Contacts, Touched
from sim_bridge.world.radio import radio_of

STEP_S = 0.01  # how often beacons are handed on
STEPS_PER_SAMPLE = 5  # 20 Hz
START_LIMIT_S = 120.0  # ... to all companions being ready; then the order is given to those that are
ORDER_S = 1.0


class ExternalFlight:
    """Companions over `autopilots` that are ready, and what is kept of the flight. Time starts now."""

    def __init__(
        self,
        mission: Mission,
        autopilots: Autopilots,
        folder: Path,
        stack: ExitStack,
        map_: Map | None = None,
        *,
        black_box: bool = False,
    ) -> None:
        """`stack` ends the companions and closes the files. `map_`: where it is watched. StartError, OSError.

        `black_box`: each companion keeps one.
        """
        self.mission = mission
        self._keeps_black_box = black_box
        self._map = map_
        self.recorder = Recorder(folder)
        self._errors = EstimateErrors()
        self.over = False  # what follows is not a part of the record
        self.stand = stand = stand_of(mission, folder)
        self.radio = radio_of(mission, stand)
        self._contacts = Contacts(stand, reach_m=mission.vehicle_radius_m, ground=mission.sensing is not None)
        self._touched: dict[int, Touched] = {}
        self.observer = Observer(mission, autopilots.ids, folder, self.stand)
        stack.callback(self.observer.close)
        self._autopilots = autopilots
        self._began_s = time.monotonic()
        radio_socket = stack.enter_context(bound_socket("the companions' radio", 0))
        self.harvest = Harvest(mission, stand, self.radio, folder) if mission.keeps_records else None
        if self.harvest is not None:
            stack.callback(self.harvest.close)
        ids, positions = autopilots.ids, autopilots.positions
        self._hub = RadioHub(radio_socket, ids, self.radio, positions, self.note, self.harvest)
        autopilots.listener.listen(radio_socket, self._from_radio)
        autopilots.to_companion = self._to_companion
        self._sockets = {k: stack.enter_context(bound_socket(f"companion {k}", 0)) for k in autopilots.ids}
        self._addresses: dict[int, Address] = {}
        self._sensors = Sensors(mission, stand, autopilots, stack)
        self.companions: dict[int, Child] = {}
        self.forks = stack.enter_context(ForkClient())
        stack.callback(lambda: end(list(self.companions.values())))
        self._folder, self._radio_port = folder, radio_socket.getsockname()[1]
        self._logs = logs = folder / "companions"
        logs.mkdir()
        for k, bound in self._sockets.items():
            autopilots.listener.listen(bound, self._companion_reader(k))
            self.companions[k] = self._start(k, logs / f"companion-{k}.log")
        self._running = set(self.companions)
        self.faults = Faults(mission.sim.faults)
        self._stopped: frozenset[int] = frozenset()
        self._full: frozenset[int] = frozenset()  # companions' disks
        self._lines = {k: LateLine() for k in autopilots.ids}  # from each autopilot to its companion
        self._silent: set[int] = set()
        self._started = False
        self._ordered_s = -math.inf
        self._steps = 0
        self._due_s = time.monotonic()
        self.last = self._emit(time.monotonic())

    @property
    def now_s(self) -> float:
        """Wall time since the flight began."""
        return time.monotonic() - self._began_s

    def note(self, text: str) -> None:
        """Something for people."""
        self.observer.events.append((self.now_s, text))

    def step(self) -> bool:
        """Until STEP_S later; True when that took a sample."""
        while (wait_s := self._due_s - time.monotonic()) > 0.0:
            self._autopilots.listener.poll(wait_s)
        self._autopilots.listener.poll(0.0)
        self._due_s = max(self._due_s + STEP_S, time.monotonic() - STEP_S)  # what is missed is not made up for
        self._hub.deliver(self.now_s)
        self._sensors.send_due(self.now_s, self.faults.blind)
        for vehicle_id in self._autopilots.ids:
            self._hand_over(vehicle_id)
        self._steps += 1
        if self._steps % STEPS_PER_SAMPLE:
            return False
        now_s = time.monotonic()
        self._autopilots.request_streams(now_s)
        self._watch_companions()
        self._apply()
        self._watch_autopilots(now_s)
        self.last = self._emit(now_s)
        if not self.over:
            self.recorder.add(self.last)
            self._autopilots.add_errors(self._errors)
            if self._map is not None and self._map.due(self.last.time_s):
                self._map.asked()  # nothing can be asked for here; how many look is told there
                self._map.row(self.recorder.last, [None] * len(self._autopilots.ids), ages_s(self.last))
        return True

    def finished(self) -> str | None:
        """The reason why the flight is over, or None."""
        return self.observer.finished(self.last)

    def order_start(self) -> None:
        """The operator allows the flight once every companion is ready, and says so until every beacon repeats it."""
        states = {k: said.flight_state for k, said in self.last.said.items() if k in self._running}
        waiting = [k for k in sorted(self._running) if states.get(k, FlightState.WAITING) == FlightState.WAITING]
        if not self._started and (not waiting or self.now_s > START_LIMIT_S):
            without = f" without {', '.join(map(str, waiting))}" if waiting else ""
            self.note(f"operator: start{without}")
            self._started = True
        if self._started:
            self._order(dialect.MAV_CMD_MISSION_START, dialect.SWARM_BEACON_FLAGS_START)

    def order_land(self) -> list[int]:
        """All are to land; those that have not yet. One without a companion is told by us."""
        waited_for = still_up(self._autopilots.telemetry, self._silent)
        if self._order(dialect.MAV_CMD_NAV_LAND, dialect.SWARM_BEACON_FLAGS_ABORT):
            for vehicle_id in waited_for:
                if vehicle_id not in self._running:
                    self._autopilots.land(vehicle_id)
        return waited_for

    def landings_unsaid(self) -> list[int]:
        """Vehicles whose companions still say that they land: each has yet to hear that it is down, and to say so."""
        said = self._hub.transmitter.said
        return [k for k in sorted(self._running) if k in said and said[k].flight_state == FlightState.LANDING]

    def note_left_behind(self) -> None:
        """Name the vehicles in the air, or armed, without a companion or an autopilot that speaks."""
        for vehicle_id, heard in self._autopilots.telemetry.items():
            if not heard.armed and heard.on_ground:
                continue
            if vehicle_id in self._silent:
                self.note(f"autopilot {vehicle_id}: armed when it was last heard, and silent: not waited for")
            elif vehicle_id not in self._running:
                self.note(f"vehicle {vehicle_id} has no companion: its autopilot is told to land")

    def show(self, progress: Progress) -> None:
        """Events, and from time to time the status."""
        for time_s, text in self.observer.events:
            progress.event(time_s, text)
            if self._map is not None:
                self._map.event(time_s, text)
        self.observer.events.clear()
        if progress.due(self.now_s):
            progress.show(self.observer.status(self.last, 1.0))

    def tell_records(self) -> dict[str, Any]:
        """Records made and delivered, said and as figures; none of a mission that does not survey."""
        if self.harvest is None:
            return {}
        figures = self.harvest.figures(self._running)
        for line in describe_records(figures):
            self.note(line)
        return figures

    def errors(self) -> ErrorFigures:
        """Errors of the autopilots' estimates, and what rests on these."""
        by_truth = {k: told for k, told in self._autopilots.truths().items() if k in self._autopilots.by_truth}
        return self._errors.figures(told_by(self._autopilots.ids, by_truth))

    def _order(self, command: int, flag: int) -> bool:
        """To all companions that do not repeat it in their beacons; False when it is too early to say it again."""
        if self.now_s - self._ordered_s < ORDER_S:
            return False
        self._ordered_s = self.now_s
        for vehicle_id in self._running:
            said = self._hub.transmitter.said.get(vehicle_id)
            if said is None or not said.flags & flag:
                self._to_companion(vehicle_id, operator_order(vehicle_id, command))
        return True

    def _emit(self, now_s: float) -> Tick:
        """`now_s`: wall time. Positions are those last known, however old, by truth where it is told."""
        ids, hub = self._autopilots.ids, self._hub
        telemetry = [self._autopilots.telemetry[k] for k in ids]
        self._observe_contacts()
        alive = sorted(self._running - self._silent - self._touched.keys())
        return Tick(
            time_s=self.now_s,
            pos_ned_m=tuple([self._autopilots.position(k) for k in ids]),
            vel_ned_mps=tuple([self._autopilots.velocity(k) for k in ids]),
            on_ground=tuple([heard.on_ground for heard in telemetry]),
            armed=tuple([heard.armed for heard in telemetry]),
            mode=("",) * len(ids),
            range_m=tuple([self.radio.range_m(k) for k in ids]),
            touched=tuple([str(self._touched.get(k, "")) for k in ids]),
            alive=tuple(alive),
            answered=tuple([k for k in alive if hub.gate.is_alive(k, now_s)]),
            said=dict(hub.transmitter.said),
            said_s=dict(hub.transmitter.said_s),
            frames={},
            words=dict(hub.transmitter.words),
            north_off_rad=(),
            asked_ned_mps=(),
        )

    def _observe_contacts(self) -> None:
        """Notes each vehicle's first contact, as far as the positions that we have tell: nothing breaks here."""
        for k in self._autopilots.ids:
            heard = self._autopilots.telemetry[k]
            pos_ned_m = self._autopilots.position(k)
            what = self._contacts.find_contact(k, pos_ned_m, self._autopilots.velocity(k), on_ground=heard.is_down)
            if what is not None:
                self._touched.setdefault(k, what)

    def _apply(self) -> None:
        """Let the faults happen whose time has come; none while all are to land."""
        began: list[FaultEvent] = []
        if self.over:
            ended = self.faults.lift()
        else:
            answering = sorted(self._running - self._stopped)
            phase, leader = self.last.phase(answering), self.last.leader(answering)
            began, ended = self.faults.advance(self.now_s, alive=self._running, phase=phase, leader=leader)
        for event in began:
            self.note(event.begins())
            for vehicle_id in event.vehicles if event.kind in ENDING else ():
                signal_group(self.companions[vehicle_id], signal.SIGKILL)
        for event in ended:
            self.note(event.ends())
            for vehicle_id in event.vehicles if event.kind is FaultKind.RESTART else ():
                self._start_again(vehicle_id)
                self._full -= {vehicle_id}  # the other one's
        for kind in {event.kind: None for event in (*began, *ended)}:
            self._sensors.strike(kind, self.faults.in_force(kind))
        full = frozenset(self.faults.in_force(FaultKind.DISK_FULL))
        for vehicle_id in (full ^ self._full) & self._running:
            fill_disk(self.companions[vehicle_id], full=vehicle_id in full)
        self._full = full
        for vehicle_id in self.faults.stopped ^ self._stopped:
            stops = vehicle_id in self.faults.stopped
            signal_group(self.companions[vehicle_id], signal.SIGSTOP if stops else signal.SIGCONT)
        self._stopped = self.faults.stopped
        self.radio.cut_off, self.radio.cut_links = self.faults.cut_off, self.faults.cut_links

    def _start(self, vehicle_id: int, log_file: Path) -> Child:
        return start_companion(
            vehicle_id,
            self._folder / "mission.toml",
            log_file,
            autopilot_port=self._sockets[vehicle_id].getsockname()[1],
            radio_port=self._radio_port,
            clock="monotonic",
            program=self.forks,
            sensor_ports=self._sensors.ports(vehicle_id),
            records_file=None if self.harvest is None else self.harvest.path(vehicle_id),
            black_box=self._folder / FOLDER_NAME if self._keeps_black_box else None,
        )

    def _start_again(self, vehicle_id: int) -> None:
        """Another companion for a vehicle whose one has ended."""
        end([self.companions[vehicle_id]])
        self._addresses.pop(vehicle_id, None)
        count = len(list(self._logs.glob(f"companion-{vehicle_id}*.log")))
        self.companions[vehicle_id] = self._start(vehicle_id, self._logs / f"companion-{vehicle_id}-{count + 1}.log")
        self._running.add(vehicle_id)

    def _watch_companions(self) -> None:
        for vehicle_id in sorted(self._running):
            how = fate(self.companions[vehicle_id])
            if how is not None:
                self._running.discard(vehicle_id)
                self.observer.tell_once(self.now_s, loss(vehicle_id, how))

    def _watch_autopilots(self, now_s: float) -> None:
        silent = silent_ones(self._autopilots.telemetry, now_s)
        for vehicle_id in sorted(silent ^ self._silent):
            how = f"silent for {SILENT_S:g} s" if vehicle_id in silent else "heard again"
            self.note(f"autopilot {vehicle_id}: {how}")
        self._silent = silent

    def _from_radio(self, data: bytes, address: Address, now_s: float) -> None:
        self._hub.receive_datagram(data, address, now_s, self.now_s)

    def _to_companion(self, vehicle_id: int, data: bytes) -> None:
        self._lines[vehicle_id].put(data, self.now_s, self.faults.late_s.get(vehicle_id, 0.0))
        self._hand_over(vehicle_id)

    def _hand_over(self, vehicle_id: int) -> None:
        for data in self._lines[vehicle_id].pop_arrived(self.now_s):
            self.observer.log_traffic(self.now_s, vehicle_id, data)
            address = self._addresses.get(vehicle_id)
            if address is None:
                continue
            try:
                self._sockets[vehicle_id].sendto(data, address)
            except OSError:  # it has just ended: _watch_companions finds out
                self._addresses.pop(vehicle_id)

    def _companion_reader(self, vehicle_id: int) -> Reader:
        def forward_datagram(data: bytes, address: Address, _now_s: float) -> None:
            self._addresses[vehicle_id] = address
            self.observer.log_traffic(self.now_s, vehicle_id, b"", data)
            self._autopilots.router.send(vehicle_id, data)

        return forward_datagram
