"""The keys of a simulated fleet: as good as drawn at random, and the same for the same seed; and what they sign."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Final

from companion.keys.crypto import public_key
from companion.keys.fleet_folder import file_name
from companion.keys.key_file import render_keyring
from companion.keys.keyring import OPERATOR, Keyring
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.peers.guard import SignedGuard
from companion.mavlink.peers.session import BASE_ID, OPERATOR_ID, Session, open_session
from mission.common.durable_files import replace_file
from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.drive.operator import SignedOperator
from sim_bridge.world.world import World


class OrderDisk:
    """A vehicle's disk, as far as its orders go: it outlives its companion."""

    def __init__(self) -> None:
        self.kept = b""

    def save(self, state: bytes, *, wait: bool) -> bool:  # noqa: ARG002
        """As `Marks`."""
        self.kept = state
        return True


class FleetKeys:
    """Keyrings of a mission's vehicles and its operator, and a guard for each start of a companion."""

    def __init__(self, mission: Mission) -> None:
        self._seed: Final = mission.sim.seed
        self._digest: Final = hashlib.sha256(dump_mission(mission).encode()).digest()  # of the file in the run folder
        self._starts: Final = dict[int, int]()
        self._size: Final = mission.swarm.size
        self.sessions: Final = dict[int, Session]()  # by node, of its last start
        self.disks: Final = {k: OrderDisk() for k in range(1, mission.swarm.size + 1)}
        owners = range(1, mission.swarm.size + 1)
        self._vehicles: Final = {k: public_key(self._draw("seed", k)) for k in owners}

    def keyring(self, owner: int) -> Keyring:
        """A vehicle's, or the operator's."""
        operator = public_key(self._draw("seed", OPERATOR))
        return Keyring(
            owner, self._draw("seed", owner), {0: self._draw("secret", 0)}, 0, operator, dict(self._vehicles)
        )

    def write_files(self, folder: Path) -> None:
        """A key file of each vehicle, for companions that are processes, in a folder of its own. OSError."""
        folder.mkdir(mode=0o700)
        for vehicle in self._vehicles:
            replace_file(folder / file_name(vehicle), render_keyring(self.keyring(vehicle)).encode())

    def guard(self, node: int) -> SignedGuard:
        """Of the next start of a vehicle's companion, or of the base station."""
        self._starts[node] = self._starts.get(node, 0) + 1
        owner = OPERATOR if node in (BASE_ID, OPERATOR_ID) else node
        self.sessions[node] = open_session(self.keyring(owner), node, self._digest, self._boot(node))
        return SignedGuard(self.sessions[node])

    def orders(self, vehicle: int) -> OrderBook:
        """Of the start for which `guard` was called last."""
        disk = self.disks[vehicle]
        return OrderBook(
            operator=public_key(self._draw("seed", OPERATOR)),
            digest=self._digest,
            me=vehicle,
            size=self._size,
            boot=self._boot(vehicle),
            marks=disk,
            kept=disk.kept,
        )

    def operator(self, world: World) -> SignedOperator:
        """The operator, with the key: amid the starts, so that all are in reach; heard and hearing as far as any."""
        world.radio.set_range(OPERATOR_ID, math.inf)
        north, east, down = (0.5 * (min(axis) + max(axis)) for axis in zip(*world.positions().values(), strict=True))
        return SignedOperator(
            self.keyring(OPERATOR),
            self._digest,
            self._size,
            self.guard(OPERATOR_ID),
            seed=self._seed,
            pos_ned_m=(north, east, down),
        )

    def _boot(self, node: int) -> int:
        return int.from_bytes(self._draw(f"boot {self._starts[node]}", node)[:4], "little") or 1

    def _draw(self, what: str, owner: int) -> bytes:
        return hashlib.sha256(f"understory simulated fleet: {self._seed}, {what}, {owner}".encode()).digest()


def key_files(keys: FleetKeys | None, folder: Path) -> Callable[[int], Path | None]:
    """The files of companions that are processes: written, and where they are. OSError."""
    if keys is None:
        return lambda _vehicle_id: None
    keys.write_files(folder)
    return lambda vehicle_id: folder / file_name(vehicle_id)
