"""Records: how many reach the base station and how soon, and what beacons lose by it on a slow radio.

`python -m tests.bench records`. The deliveries are whole flights in lockstep, of point masses; the beacons' ages are
those of the simulator's radio alone, with the companions' own exchange of records and beacons of their size.
"""

from __future__ import annotations

import itertools
import random
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from companion.keys.keyring import OPERATOR
from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import SIGNATURE_BYTES, SIGNED, frames
from companion.mavlink.peers.session import open_session
from companion.records.exchange import RecordExchange
from companion.records.frames import is_record_frame
from companion.records.record import BASE_ID, RecordKind
from companion.records.signed.exchange import SignedExchange
from companion.records.signed.keys import record_keys
from companion.records.store import MEMORY, RecordStore
from companion.records.write_queue import DirectWriter
from mission.document.model import Mission
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.world.radio import Radio
from tests.bench.forged_records import FORGED, FORGED_HZ, Forger, log_of
from tests.bench.table import Row, spread
from tests.flights import flown, short_mission
from tests.unit.mavlink.signing_kit import MISSION, keyring

SEEDS = (1, 2, 3, 4, 5)
BEACON_BYTES = 118  # of the frame, n = 8, measured in flight
MANIFEST_BYTES = 265  # of the frame, once a second behind a beacon, in a swarm with keys
BODY_BYTES = 120  # of a stem or less
STEP_S = 0.001  # of the radio's time
TICK_STEPS = 50
RATE_KBPS = 250.0


def records() -> Iterator[Row]:
    """Deliveries, then ages."""
    for signed, loss in itertools.product((False, True), (0.0, 0.3)):
        flights = [Delivery.of(seed, loss=loss, signed=signed) for seed in SEEDS]
        kind = "signed records" if signed else "records"
        yield from delivery_rows(f"{kind}, n = 8, one a second each, {loss:.0%} loss, 250 kbit/s, seeds 1-5", flights)
    faults: list[dict[str, Any]] = [
        {"kind": "kill", "phase": "transit", "at_s": 3.0},
        {"kind": "kill", "phase": "coverage", "at_s": 5.0},
        {"kind": "partition", "vehicles": [6, 7, 8], "phase": "transit", "at_s": 2.0, "for_s": 60.0},
        {"kind": "restart", "vehicles": [5], "phase": "transit", "at_s": 6.0, "for_s": 2.0},
    ]
    for signed in (False, True):
        flights = [Delivery.of(seed, loss=0.3, faults=faults, signed=signed) for seed in SEEDS]
        kind = "signed, at" if signed else "at"
        yield from delivery_rows(f"the same {kind} 30 % with two leaders killed, a split of 60 s, a restart", flights)
    yield from forged_rows()
    for signed, (who, makers) in itertools.product(
        (False, True), (("two vehicles", (1, 2)), ("all eight", range(1, 9)))
    ):
        for how, is_lockstep in (
            ("ticks at any time, as on boards", False),
            ("all ticks at once, as in lockstep", True),
        ):
            pairs = [
                (
                    age_p99_s(seed, makers=(), is_lockstep=is_lockstep, signed=signed),
                    age_p99_s(seed, makers=makers, is_lockstep=is_lockstep, signed=signed),
                )
                for seed in SEEDS
            ]
            more = [100.0 * (with_s / without_s - 1.0) for without_s, with_s in pairs]
            without, with_them = ([1e3 * pair[at] for pair in pairs] for at in (0, 1))
            seen = f"{spread(without, ' ms')} without, {spread(with_them, ' ms')} with: {spread(more, ' %')} more"
            kind = "signed records" if signed else "records"
            what = f"beacons' p99 age, n = 8, 250 kbit/s, {who} with {kind} without end, {how}"
            most = 10.0 if signed else 5.0  # a signed record is half as long again, and a beacon may wait for one
            yield Row(what, f"<= {most:g} % more", seen, max(more) <= most)


# --- whole flights ---


@dataclass(frozen=True, slots=True)
class Delivery:
    """Records of one flight."""

    made: int
    delivered: int
    lost: int  # with vehicles that never came back, or before they were on a disk: named by the flight
    waiting: int
    duplicates: int
    last_s: float  # from the last record that was made to the last that came
    forged: int = 0  # at the base station

    @classmethod
    def of(
        cls,
        seed: int,
        *,
        loss: float,
        faults: list[dict[str, Any]] | None = None,
        signed: bool = False,
        liar: Forger | None = None,
    ) -> Delivery:
        """Fly 40 m and back, a record a second of each vehicle in the air, and one of its way every two.

        `signed`: a swarm with keys; `liar`: one of it forges records.
        """
        mission = surveying(seed, loss=loss, faults=faults or [])
        maker = Maker()

        def watch(flight: Flight) -> None:
            maker(flight)
            if liar is not None:
                liar(flight)

        with tempfile.TemporaryDirectory() as folder:
            outcome, _ = flown(mission, Path(folder), watch=watch, keys=FleetKeys(mission) if signed else None)
            bodies = maker.at_base()
        figures = outcome.summary
        return cls(
            figures["records_made"],
            figures["records_delivered"],
            sum(figures["records_lost"].values()) + sum(figures["records_unwritten"].values()),
            sum(figures["records_waiting"].values()),
            len(bodies) - len(set(bodies)),
            max(0.0, maker.delivered_s - maker.made_s),
            sum(body.startswith(FORGED) for body in bodies),
        )


def delivery_rows(what: str, flights: list[Delivery]) -> Iterator[Row]:
    """Each record is delivered, or named as lost with its vehicle."""
    made, delivered, lost = (sum(getattr(f, name) for f in flights) for name in ("made", "delivered", "lost"))
    accounted = all(f.delivered + f.lost == f.made for f in flights)
    share = f"{delivered} of {made} ({100.0 * delivered / made:.2f} %), {lost} named as lost with a vehicle"
    yield Row(f"{what}: delivered", "all, or named as lost", share, accounted)
    duplicates = sum(f.duplicates for f in flights)
    yield Row("- duplicates", "0", f"{duplicates}", duplicates == 0)
    yield Row("- the last one comes, after it was made", "told", spread([f.last_s for f in flights], " s"), True)


def forged_rows() -> Iterator[Row]:
    """Vehicle 3 forges records of all others, the base station's word, and says that it has all."""
    for signed in (False, True):
        flights = [Delivery.of(seed, loss=0.0, signed=signed, liar=Forger(3)) for seed in SEEDS]
        kind = "signed" if signed else "without keys"
        what = f"records, n = 8, {kind}, one member forges {FORGED_HZ} a second in others' names, seeds 1-5"
        forged, late = sum(f.forged for f in flights), spread([f.last_s for f in flights], " s")
        yield Row(
            f"{what}: forged at the base station", "0" if signed else "told", f"{forged}", not (signed and forged)
        )
        made, delivered = (sum(getattr(f, name) for f in flights) for name in ("made", "delivered"))
        accounted = all(f.delivered == f.made for f in flights)
        if signed:
            yield Row("- delivered, of those that were made", "all", f"{delivered} of {made}", accounted)
            yield Row("- the last one comes, after it was made", "told", late, True)


def surveying(seed: int, *, loss: float, faults: list[dict[str, Any]], n: int = 8) -> Mission:
    """A mission whose swarm comes back."""
    mission = short_mission(
        swarm={"size": n},
        route={"at_end": "return"},
        radio={"bit_rate_kbps": RATE_KBPS},
        sim={"seed": seed, "radio_loss": loss, "faults": faults},
        sensing={"sensor": "scan-1deg", "range_m": 12.0},
    )
    return Mission.model_validate({**mission.model_dump(by_alias=True), "survey": {}})


class Maker:
    """Appends a record a second to each companion whose vehicle flies; for `flown(watch=...)`."""

    def __init__(self) -> None:
        self.made_s = self.delivered_s = 0.0
        self.lost: set[int] = set()  # vehicles without a companion
        self._count = 0
        self._ticks = 0
        self._delivered = 0
        self._bodies: list[bytes] = []

    def __call__(self, flight: Flight) -> None:
        """After a tick."""
        self._ticks += 1
        self.lost = set(flight.lockstep.lost)
        now_s = flight.world.now_s
        assert flight.harvest is not None
        delivered = flight.harvest.base.progress.delivered
        if delivered != self._delivered:
            self._delivered, self.delivered_s = delivered, now_s
            self._bodies = [body for _, _, _, body in flight.harvest.base.records.store.records(RecordKind.STEM)]
        if self._ticks % 20:
            return
        for vehicle_id, companion in flight.lockstep.companions.items():
            if not flight.world.vehicles[vehicle_id].airframe.state.on_ground:
                self._count += 1
                self.made_s = now_s
                log_of(companion).append(RecordKind.STEM, b"%d" % self._count + bytes(BODY_BYTES - 8), now_s)

    def at_base(self) -> list[bytes]:
        """Bodies at the base station; no two records have the same."""
        return self._bodies


# --- the radio alone ---


def age_p99_s(
    seed: int, *, makers: Any, is_lockstep: bool, signed: bool = False, for_s: float = 60.0, n: int = 8
) -> float:
    """p99 of the age of what each vehicle knows of each other by beacons, n vehicles in range of all and of the base.

    `makers`: vehicles that always have records to send; none: there are no records at all. After the first 10 s.
    """
    rng = random.Random(seed)
    radio = Radio(range_m=100.0, loss=0.0, delay_s=0.0, seed=seed, bit_rate_kbps=RATE_KBPS)
    ids = [*range(1, n + 1), BASE_ID]
    radio.place({me: (float(me), 0.0, 0.0) for me in ids})
    logs = itertools.count(1)
    nodes = {me: _exchange(me, n, logs.__next__, signed=signed) for me in ids} if makers else {}
    senders = {me: wire.Sender(me, COMPONENT, SIGNED * signed) for me in ids}
    mac = bytes(SIGNATURE_BYTES * signed)
    phase = {me: 0 if is_lockstep else rng.randrange(TICK_STEPS) for me in ids}
    beacon_phase = {me: 0 if is_lockstep else rng.randrange(2) for me in ids}
    sent = np.full((BASE_ID + 1, BASE_ID + 1), -1)  # by receiver and sender: step at which what was heard was sent
    ages = np.zeros(1000, dtype=int)  # how often each age, in steps
    for step in range(round(for_s / STEP_S)):
        now_s = step * STEP_S
        for me in ids:
            if step % TICK_STEPS != phase[me]:
                continue
            has_beacon = me != BASE_ID and (step // TICK_STEPS) % 2 == beacon_phase[me]
            beacon = _beacon(me, step) + mac if has_beacon else b""
            if signed and has_beacon and step % 1000 < 2 * TICK_STEPS:
                beacon += bytes(MANIFEST_BYTES)
            if has_beacon:
                radio.send(me, beacon, now_s)
            for frame in _record_frames(nodes, me, makers, now_s, len(beacon)):
                radio.send(me, senders[me].frame(*frame) + mac, now_s, aside=True)
        for me in ids:
            for frame in _split(radio.deliver(me, now_s)):
                if is_record_frame(frame):
                    nodes[me].receive(frame, now_s)
                elif me != BASE_ID:
                    sent[me, frame[5]] = int.from_bytes(frame[10:14], "little")
        if now_s > 10.0:
            known = sent[1 : n + 1, 1 : n + 1]
            ages += np.bincount(step - known[known >= 0], minlength=ages.size)
    share = np.cumsum(ages) / ages.sum()
    return float(np.searchsorted(share, 0.99)) * STEP_S


def _exchange(me: int, members: int, draw: Callable[[], int], *, signed: bool) -> RecordExchange:
    ring = keyring(OPERATOR if me == BASE_ID else me, members)
    keys = record_keys(open_session(ring, me, MISSION, me), 0) if signed else None
    store = RecordStore(MEMORY, me, draw, keys=keys)
    common = (store, DirectWriter(store), me, members, RATE_KBPS)
    return RecordExchange(*common, epoch=1) if keys is None else SignedExchange(*common, keys=keys, epoch=1)


def _record_frames(
    nodes: dict[int, RecordExchange], me: int, makers: Any, now_s: float, beacon_bytes: int
) -> list[tuple[int, bytes]]:
    if me not in nodes:
        return []
    if me in makers:
        nodes[me].append(RecordKind.STEM, bytes([me]) * BODY_BYTES, now_s)
    return nodes[me].frames(now_s, beacon_bytes)


def _beacon(me: int, step: int) -> bytes:
    """A frame as long as a beacon, with the time in it."""
    body = step.to_bytes(4, "little").ljust(BEACON_BYTES - 12, b"\1")
    return bytes((0xFD, len(body), 0, 0, 0, me, COMPONENT, 1, 0, 0)) + body + b"\0\0"


def _split(data: bytes) -> list[bytes]:
    return [data[start:end] for start, end, _ in frames(data)]
