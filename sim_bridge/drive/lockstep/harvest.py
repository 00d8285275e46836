"""Records of a simulated flight: a disk for each vehicle, the base station, and the count at the end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from companion.base.station import BaseStation
from companion.cloud.returns_file import ReturnsFile
from companion.cloud.returns_log import SUFFIX
from companion.mavlink.peers.session import Session
from companion.records.exchange import RecordExchange
from companion.records.node import open_base, open_records
from companion.records.record import BASE_ID, LogKey, RecordKind
from companion.records.store import Batch, RecordStore, StoreError, Written
from companion.records.write_queue import DirectWriter
from companion.stand.summarise import DirectFusion
from mission.common.exit_codes import EXIT_ENVIRONMENT
from mission.common.frames import Vec3, enu_to_ned
from mission.document.model import Mission
from mission.stand.stand import Stand
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.errors import StartError
from sim_bridge.world.radio import Radio
from sim_bridge.world.world import World

BASE_FILE: Final = "records.db"
COMPANIONS: Final = "companions"  # folder of their files
ANTENNA_M: Final = 2.0  # above the ground at d1
BASE_MADE_S: Final = 1  # of a flight that has no date
PATIENCE_S: Final = 20.0  # once the flight is over, without one more record at the base station,
COMPLETE_S: Final = 4.0  # and where it has all that it was told of: four vectors
PATIENCE_MAX_S: Final = 300.0


class SimulatedDisk(DirectWriter):
    """A vehicle's disk, which a fault fills."""

    def __init__(self, store: RecordStore) -> None:
        super().__init__(store)
        self._is_full = False
        self._failure: StoreError | None = None

    def fill(self, *, full: bool) -> None:
        """Nothing more is written, or again."""
        self._is_full = full

    def submit(self, batch: Batch) -> bool:
        """Write it, where there is room."""
        if not self._is_full:
            return super().submit(batch)
        self._failure = StoreError("disk full")
        return True

    def take_outcome(self) -> Written | StoreError | None:
        """Its outcome."""
        failure, self._failure = self._failure, None
        return failure or super().take_outcome()


class Harvest:
    """The disks of a swarm that surveys, which outlive its companions, and its base station at d1.

    A `RadioNode` of the lockstep.
    """

    def __init__(
        self, mission: Mission, stand: Stand, radio: Radio, folder: Path | None, keys: FleetKeys | None = None
    ) -> None:
        """`folder`: of the run; None: all is kept in memory, and a companion that starts again has lost its disk.

        `keys`: of a swarm that has them. StartError: the base station's file cannot be written.
        """
        self.disks: Final = dict[int, SimulatedDisk]()  # those of companions in this process
        self._mission = mission
        self._folder = folder
        self._rng = np.random.default_rng([mission.sim.seed, 0x4A8E57])
        self._links: Final = dict[int, RecordExchange]()
        self._unwritten: Final = Counter[int]()  # by vehicle, of companions that have ended and were started again
        path = None if folder is None else folder / BASE_FILE
        self._keys = keys
        guard = None if keys is None else keys.guard(BASE_ID)
        session = self._session(BASE_ID)
        try:
            records = open_base(mission, path, self._draw, made_s=BASE_MADE_S, is_synced=False, session=session)
        except StoreError as error:
            raise StartError(f"{path}: cannot be written: {error}", EXIT_ENVIRONMENT) from None
        self.base: Final = BaseStation(records, guard)
        self._pos_ned_m = base_place(mission, stand)
        radio.set_range(BASE_ID, mission.radio.full_range_m)
        self._over_s: float | None = None
        self._delivered = -1
        self._delivered_s = 0.0

    # --- the radio node ---

    @property
    def id(self) -> int:
        """Of the base station."""
        return BASE_ID

    @property
    def pos_ned_m(self) -> Vec3:
        """Above d1, on a mast."""
        return self._pos_ned_m

    def receive(self, data: bytes, now_s: float) -> None:
        """A datagram reaches the base station."""
        self.base.receive(data, now_s)

    def tick(self, now_s: float) -> list[bytes]:
        """Frames that the base station sends."""
        return self.base.tick(now_s)

    # --- the vehicles ---

    def path(self, vehicle_id: int) -> Path | None:
        """The file of one vehicle's records."""
        return None if self._folder is None else self._folder / COMPANIONS / f"records-{vehicle_id}.db"

    def open(self, vehicle_id: int) -> RecordExchange:
        """The records of a companion that starts in this process, from its disk as it is; its guard is there before."""
        path = self.path(vehicle_id)
        if path is not None:
            path.parent.mkdir(exist_ok=True)
        before = self._links.get(vehicle_id)
        if before is not None:
            self._unwritten[vehicle_id] += sum(before.unwritten)
            if path is not None:
                before.store.close()
        self._links[vehicle_id] = link = open_records(
            self._mission,
            vehicle_id,
            path,
            self._draw,
            writer=lambda store: self._disk(vehicle_id, store),
            fusion=lambda store: None if self._mission.survey is None else DirectFusion(store, self._mission),
            is_synced=False,
            session=self._session(vehicle_id),
        )
        return link

    def returns(self, vehicle_id: int) -> ReturnsFile | None:
        """The file of one vehicle's returns, which nobody takes but a cloud afterwards; None: nothing is surveyed."""
        path = self.path(vehicle_id)
        return None if path is None or self._mission.survey is None else ReturnsFile(path.with_suffix(SUFFIX))

    def _session(self, node: int) -> Session | None:
        return None if self._keys is None else self._keys.sessions[node]

    def _disk(self, vehicle_id: int, store: RecordStore) -> SimulatedDisk:
        disk = self.disks[vehicle_id] = SimulatedDisk(store)
        return disk

    def _draw(self) -> int:
        return int(self._rng.integers(1 << 32))

    # --- the end ---

    def has_all(self, now_s: float) -> bool:
        """At the end of a flight: no more is to be waited for."""
        if self._over_s is None:
            self._over_s = now_s
        progress = self.base.progress
        if progress.delivered != self._delivered:
            self._delivered, self._delivered_s = progress.delivered, now_s
        waited_s = now_s - max(self._delivered_s, self._over_s)
        is_complete = progress.delivered == progress.made
        return waited_s > (COMPLETE_S if is_complete else PATIENCE_S) or now_s - self._over_s > PATIENCE_MAX_S

    def figures(self, alive: Collection[int]) -> dict[str, Any]:
        """Records made and delivered, by what is on all disks now, and by what never came onto one.

        `alive`: vehicles whose companions still run. Processes tell only their logs what was not written.
        """
        at_base = {key: holding.count for key, holding in self.base.records.store.holdings().items()}
        made = self._made()
        lacking: dict[int, int] = {}
        for key, count in made.items():
            lost = count - at_base.get(key, 0)
            if lost > 0:
                lacking[key.vehicle_id] = lacking.get(key.vehicle_id, 0) + lost
        unwritten, pending = Counter(self._unwritten), 0
        for vehicle_id, link in self._links.items():
            without_room, next_ones = link.unwritten
            unwritten[vehicle_id] += without_room
            if vehicle_id not in alive:
                unwritten[vehicle_id] += next_ones
            elif next_ones:
                pending += next_ones
                lacking[vehicle_id] = lacking.get(vehicle_id, 0) + next_ones
        unwritten = +unwritten
        return {
            "records_made": sum(made.values()) + unwritten.total() + pending,
            "records_delivered": sum(at_base.values()),
            "records_lost": {str(k): count for k, count in sorted(lacking.items()) if k not in alive},
            "records_waiting": {str(k): count for k, count in sorted(lacking.items()) if k in alive},
            "records_unwritten": {str(k): count for k, count in sorted(unwritten.items())},
        }

    def _made(self) -> dict[LogKey, int]:
        """Of each log, how many its writer, or anybody, has."""
        made: dict[LogKey, int] = {}
        for vehicle_id in range(1, self._mission.swarm.size + 1):
            with self._opened(vehicle_id) as store:
                for key, holding in {} if store is None else store.holdings().items():
                    made[key] = max(made.get(key, 0), holding.last)
        return made

    def own_records(self) -> dict[int, list[tuple[int, bytes]]]:
        """Kinds and bodies of what each vehicle has recorded itself, as far as its disk can be read."""
        found: dict[int, list[tuple[int, bytes]]] = {}
        for vehicle_id in range(1, self._mission.swarm.size + 1):
            with self._opened(vehicle_id) as store:
                if store is not None:
                    found[vehicle_id] = [
                        (kind, row[-1]) for kind in RecordKind for row in store.records(kind) if row[0] == vehicle_id
                    ]
        return found

    @contextmanager
    def _opened(self, vehicle_id: int) -> Iterator[RecordStore | None]:
        """The store on a vehicle's disk; None: there is none, or it cannot be read."""
        link, path = self._links.get(vehicle_id), self.path(vehicle_id)
        store: RecordStore | None = None
        if link is None and path is not None and path.exists():
            with suppress(StoreError):
                store = RecordStore(path, vehicle_id, self._draw)
        yield store if link is None else link.store
        if store is not None:
            store.close()

    def close(self) -> None:
        """Let go of all files."""
        for link in (*self._links.values(), self.base.records):
            link.store.close()


def harvest_of(
    mission: Mission, world: World, folder: Path | None, stack: ExitStack, keys: FleetKeys | None
) -> Harvest | None:
    """The records, of a mission that keeps some; `stack` lets go of them. `keys`: of a swarm that has them."""
    if not mission.keeps_records:
        return None
    harvest = Harvest(mission, world.stand, world.radio, folder, keys)
    stack.callback(harvest.close)
    return harvest


def base_place(mission: Mission, stand: Stand) -> Vec3:
    """Position of the base station's antenna, NED m: at d1, on a mast."""
    east_m, north_m, _ = mission.route.d1_enu_m
    return enu_to_ned((east_m, north_m, stand.ground_up_m(east_m, north_m) + ANTENNA_M))


def describe_records(figures: Mapping[str, Any]) -> list[str]:
    """Lines for people of `Harvest.figures`."""
    lines = [f"base station: {figures['records_delivered']} of {figures['records_made']} records delivered"]
    for vehicle_id, count in figures["records_lost"].items():
        lines.append(f"records lost with vehicle {vehicle_id}, which never came back: {count}")
    for vehicle_id, count in figures["records_waiting"].items():
        lines.append(f"records still on vehicle {vehicle_id}, out of reach of the base station: {count}")
    for vehicle_id, count in figures["records_unwritten"].items():
        lines.append(f"records not written by vehicle {vehicle_id}, whose disk was full or companion ended: {count}")
    return lines
