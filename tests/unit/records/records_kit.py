"""A few nodes and the air between them, for the tests of records."""

from __future__ import annotations

import itertools
import random
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.records.exchange import RecordExchange
from companion.records.frames import read_record
from companion.records.record import BASE_ID, Record, RecordKind
from companion.records.signed.exchange import SignedExchange
from companion.records.signed.keys import RecordKeys
from companion.records.signed.messages import read_signed_record
from companion.records.store import RecordStore
from companion.records.write_queue import DirectWriter, RecordWriter

Keys = Callable[[int, int], RecordKeys | None]  # of a node, in a mission of this hash
KEYS: Keys | None = None  # of all; None: without
TICK_S = 0.05
BEACON_BYTES = 150  # of one in a small swarm, every second tick


class Air:
    """Nodes by id, of which each has its file in `folder`; `links`: pairs that hear each other, None: all do."""

    def __init__(
        self, folder: Path, *, members: int, loss: float = 0.0, seed: int = 1, rate_kbps: float = 1000.0
    ) -> None:
        self.nodes: dict[int, RecordExchange] = {}
        self.links: set[frozenset[int]] | None = None
        self.now_s = 0.0
        self.sent: list[tuple[int, bytes]] = []  # frames on the air, with their senders
        self._folder, self._members, self._loss, self._rate_kbps = folder, members, loss, rate_kbps
        self._rng = random.Random(seed)
        self._logs = itertools.count(0xA0)
        self._senders: dict[int, wire.Sender] = {}
        self._ticks = 0
        self.keys = KEYS or (lambda _me, _mission_hash: None)

    def start(
        self,
        me: int,
        *,
        records_max: int | None = None,
        writer: Callable[[RecordStore], RecordWriter] = DirectWriter,
        epoch: int = 1,
        mission_hash: int = 0,
    ) -> RecordExchange:
        """A node starts, or starts again, with its file as it is."""
        keys = self.keys(me, mission_hash)
        file = self._folder / f"{me}.db"
        store = RecordStore(file, me, lambda: next(self._logs), records_max=records_max, keys=keys)
        if me == BASE_ID:
            epoch = store.made(epoch)
        common = (store, writer(store), me, self._members, self._rate_kbps)
        if keys is None:
            self.nodes[me] = RecordExchange(*common, epoch=epoch, mission_hash=mission_hash)
        else:
            self.nodes[me] = SignedExchange(*common, keys=keys, epoch=epoch)
        self._senders[me] = wire.Sender(me, COMPONENT)
        return self.nodes[me]

    def as_made(self, record: Record) -> Record:
        """A record as its writer has it: signed, in a swarm with keys."""
        keys = self.keys(record.vehicle_id, 0)
        return record if keys is None else keys.sign(record)

    def stop(self, me: int, *, with_disk: bool = False) -> None:
        """A node is gone, with what it kept in memory."""
        self.nodes.pop(me).store.close()
        if with_disk:
            for file in self._folder.glob(f"{me}.db*"):
                file.unlink()

    def run(self, for_s: float, each_s: Callable[[], None] = lambda: None) -> None:
        """So much time passes; `each_s` is called once a second."""
        for _ in range(round(for_s / TICK_S)):
            if self._ticks % 20 == 0:
                each_s()
            self._ticks += 1
            self.now_s = self._ticks * TICK_S
            beacon = BEACON_BYTES if self._ticks % 2 == 0 else 0
            frames = [
                (me, self._senders[me].frame(*frame))
                for me, node in self.nodes.items()
                for frame in node.frames(self.now_s, 0 if me == BASE_ID else beacon)
            ]
            self.sent += frames
            for sender, frame in frames:
                self._broadcast(sender, frame)

    def _broadcast(self, sender: int, frame: bytes) -> None:
        for me, node in self.nodes.items():
            linked = self.links is None or frozenset((sender, me)) in self.links
            if me != sender and linked and self._rng.random() >= self._loss:
                assert node.receive(frame, self.now_s)

    def at_base(self) -> list[tuple[int, int, bytes]]:
        """What the base station has on its disk: vehicle, number, body."""
        found = self.nodes[BASE_ID].store.records(RecordKind.STEM)
        return [(vehicle_id, number, body) for vehicle_id, number, _, body in found]


def record_in(frame: bytes) -> Record | None:
    """Signed or not."""
    return read_record(frame) or read_signed_record(frame)


def chain(*ids: int) -> set[frozenset[int]]:
    """Links of each with the next alone."""
    return {frozenset(pair) for pair in itertools.pairwise(ids)}


def stem(vehicle_id: int, count: int, size: int = 60) -> bytes:
    """A body that no other record has."""
    return f"stem {count} of vehicle {vehicle_id}".encode().ljust(size, b".")


def making(air: Air, *ids: int, until_s: float) -> Callable[[], None]:
    """Each of these makes a record a second."""
    counts = Counter[int]()

    def each_s() -> None:
        for me in ids:
            if me in air.nodes and air.now_s < until_s:
                counts[me] += 1
                air.nodes[me].append(RecordKind.STEM, stem(me, counts[me]), air.now_s)

    return each_s


def swarm(folder: Path, members: int, *, loss: float = 0.0, seed: int = 1, rate_kbps: float = 1000.0) -> Air:
    air = Air(folder, members=members, loss=loss, seed=seed, rate_kbps=rate_kbps)
    for me in (*range(1, members + 1), BASE_ID):
        air.start(me)
    return air
