"""Orders of the operator's key, forged, replayed, in floods; how fast one spreads: `python -m tests.bench orders`.

Nothing is flown: books of orders hear frames, or one another over a radio that loses them.
"""

from __future__ import annotations

import argparse
import math
import random
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from companion.core.model.states import Order
from companion.keys.crypto import Verifier, public_key
from companion.mavlink.orders.order import OrderKind, order_holds
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from tests.unit.mavlink.orders_kit import BOOTS, DIGEST, FLIGHT, OPERATOR_SEED, TICK_S, VEHICLE_SEED, Vehicle, frame
from tests.unit.mavlink.orders_kit import order as make

START, HOLD, LAND, ABORT = OrderKind
PERIOD_S = 0.1
FLOOD_HZ = 10_000
TOPOLOGIES = ("chain", "ring", "drawn")
N = 12


def changed(payload: bytes, rng: random.Random) -> bytes:
    """A bit of it flipped."""
    at = rng.randrange(len(payload))
    return payload[:at] + bytes([payload[at] ^ 1 << rng.randrange(8)]) + payload[at + 1 :]


def attack(kind: str, rng: random.Random) -> tuple[Vehicle, Callable[[], bytes]]:
    """A vehicle, and what draws one more payload that it must not obey."""
    one = Vehicle()
    genuine = [make(START, 10), make(HOLD, 11), make(START, 12), make(LAND, 13)]
    one.disk.loses = kind == "replayed after a reboot, the write lost"
    if kind in ("replayed", "forged", "a bit changed", "largest counter", "a vehicle's key", "other mission"):
        one.hear(genuine[0])
        one.airborne = rng.random() < 0.5
        one.hear(genuine[1], genuine[2])
    if kind == "replayed":
        return one, lambda: rng.choice(genuine[:3])
    if kind.startswith("replayed after"):
        one.hear(*genuine)
        one.restart()
        return one, lambda: rng.choice(genuine)
    kinds, template = list(OrderKind), make(ABORT, 1 << 40)
    if kind == "other mission":
        pool = [make(one_kind, 1 << 40, digest=bytes([k]) * 32) for one_kind in kinds for k in range(16)]
        return one, lambda: rng.choice(pool)
    if kind == "a bit changed":
        return one, lambda: changed(template, rng)
    if kind == "a vehicle's key":
        pool = [make(one_kind, (1 << 40) + k, seed=VEHICLE_SEED) for one_kind in kinds for k in range(250)]
        return one, lambda: rng.choice(pool)
    highest = kind == "largest counter"

    def forge() -> bytes:
        counter = (1 << 64) - 1 if highest else rng.randrange(14, 1 << 63)
        head = counter.to_bytes(8, "little") + FLIGHT + DIGEST[:8] + bytes([1, rng.randrange(1, 5), 0])
        return head + rng.randbytes(64) + template[91:]

    return one, forge


ATTACKS = (
    "forged",
    "a bit changed",
    "a vehicle's key",
    "largest counter",
    "other mission",
    "replayed",
    "replayed after a reboot",
    "replayed after a reboot, the write lost",
)


def endure(kind: str, count: int, rng: random.Random) -> tuple[int, int, int, bool, float]:
    """Of `count` frames, 500 a tick: obeyed, checked, signatures that held, the next genuine one obeyed, us a frame."""
    one, draw = attack(kind, rng)
    operator = Verifier(public_key(OPERATOR_SEED))
    obeyed = held = 0
    spent_s = 0.0
    before = one.book.refused["forged"]
    for _ in range(count // 500):
        payloads = [draw() for _ in range(500)]
        if not kind.startswith("replayed"):
            held += sum(order_holds(payload, operator) for payload in payloads[:: max(1, count // 100_000)])
        frames = [frame(payload) for payload in payloads]
        began_s = time.perf_counter()
        for data in frames:
            one.book.receive(data, one.now_s)
        one.now_s += TICK_S
        obeyed += len(one.book.tick(one.now_s, airborne=one.airborne))
        spent_s += time.perf_counter() - began_s
    checked = one.book.refused["forged"] - before
    boots = {1: one.boot}
    genuine = [make(HOLD, (1 << 41) + k, boots=boots) for k in range(1)]
    accepted = any(one.obeys(*genuine) == [Order.HOLD] for _ in range(40))
    if kind == "other mission":
        held = 0  # genuine, of another mission: they hold
    return obeyed, checked, held, accepted, spent_s / count * 1e6


def withstand(rng: random.Random, repeats: int) -> float:
    """Seconds of a flood, each forged order so often, until a genuine ABORT that is sent with each tick is obeyed."""
    one, genuine = Vehicle(), make(ABORT, 11)
    one.hear(make(START, 10))
    one.airborne = True
    template = make(ABORT, 12, seed=VEHICLE_SEED)
    per_tick = round(FLOOD_HZ * TICK_S)
    for _ in range(round(5.0 / TICK_S)):
        one.hear(*flood(rng, template, per_tick, repeats))
    began_s = one.now_s
    while one.now_s - began_s < 30.0:
        payloads = flood(rng, template, per_tick, repeats)
        payloads.insert(rng.randrange(per_tick), genuine)
        if Order.ABORT in one.obeys(*payloads):
            return one.now_s - began_s
    return math.inf


def flood(rng: random.Random, template: bytes, count: int, repeats: int) -> list[bytes]:
    """So many forged orders of one tick, each of them `repeats` times."""
    forged = [rng.randrange(12, 1 << 62).to_bytes(8, "little") + template[8:] for _ in range(count // repeats)]
    return forged * repeats


# --- how fast one spreads ---


def links(topology: str, rng: random.Random) -> dict[int, list[int]]:
    """Who hears whom; 0 is the operator, whom vehicle 1 hears, and in a drawn one those near it."""
    if topology != "drawn":
        ring = {(N, 1)} if topology == "ring" else set()
        pairs = {(k, k + 1) for k in range(N)} | ring
    else:
        while True:
            places = [(0.0, 0.0), *((rng.uniform(0.0, 100.0), rng.uniform(-20.0, 20.0)) for _ in range(N))]
            near = range(N + 1)
            pairs = {(a, b) for a in near for b in near if a < b and math.dist(places[a], places[b]) <= 30.0}
            if len(hops({k: [b for pair in pairs if k in pair for b in pair if b != k] for k in near})) == N + 1:
                break
    return {k: [b for pair in sorted(pairs) if k in pair for b in pair if b != k] for k in range(N + 1)}


def hops(heard_by: dict[int, list[int]]) -> dict[int, int]:
    """From the operator to each vehicle."""
    found, news = {0: 0}, [0]
    while news:
        news = [b for a in news for b in heard_by[a] if b not in found and found.setdefault(b, found[a] + 1)]
    return found


@dataclass(frozen=True, slots=True)
class Spread:
    """Of one order: beacon periods a hop, from the operator's first frame to the vehicle that acts."""

    farthest: float
    each: list[float]


def spread(seed: int, topology: str, loss: float) -> Spread:
    """One ABORT. Each vehicle ticks at a time of its own, and hears in its next tick what was sent before."""
    rng = random.Random(seed)
    heard_by = links(topology, rng)
    distance = hops(heard_by)
    vehicles = {k: Vehicle(k, N, operator=public_key(OPERATOR_SEED)) for k in range(1, N + 1)}
    offsets = {k: rng.uniform(0.0, TICK_S) for k in range(N + 1)}
    start, abort = make(START, 10, size=N, boots=dict.fromkeys(range(1, N + 1), 0) | boots()), make(ABORT, 11, size=N)
    for one in vehicles.values():
        one.hear(start)
        one.airborne = True
        one.now_s = 1000.0
        one.book.payloads(one.now_s)
    acted: dict[int, float] = {}
    began_s = 1000.0 + offsets[0]
    for tick in range(2000):
        for k in sorted(offsets, key=lambda k: offsets[k]):
            now_s = 1000.0 + tick * TICK_S + offsets[k]
            if k == 0:
                out = [abort] * (2 if tick < 10 else tick % 2)
            else:
                if vehicles[k].book.tick(now_s, airborne=True):
                    acted[k] = now_s
                out = [payload for payload in vehicles[k].book.payloads(now_s) if payload == abort]
            for payload in out:
                for other in heard_by[k]:
                    if other and rng.random() >= loss:
                        vehicles[other].book.receive(frame(payload), now_s)
        if len(acted) == N:
            break
    each = [(acted.get(k, math.inf) - began_s) / PERIOD_S / distance[k] for k in vehicles]
    last = max(vehicles, key=lambda k: distance[k])
    return Spread(each[last - 1], each)


def boots() -> dict[int, int]:
    """Of the kit's vehicles."""
    return {k: BOOTS.get(k, 1000 + k) for k in range(1, N + 1)}


def main(argv: Sequence[str]) -> int:
    """Prints tables; 1 when an order was obeyed that must not be, or a genuine one was not."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench orders", description=__doc__)
    parser.add_argument(
        "--count", type=positive, default=1_000_000, metavar="N", help="frames of each kind (1,000,000)"
    )
    parser.add_argument("--floods", type=positive, default=50, metavar="N", help="of each kind (50)")
    parser.add_argument(
        "--seeds", type=positive, default=1000, metavar="N", help="spreads of each topology and loss (1000)"
    )
    parser.add_argument("--first-seed", type=as_seed, default=7000, metavar="S", help="(7000)")
    args = parser.parse_args(argv)
    failed = 0
    for line, is_bad in tables(args.count, args.floods, args.seeds, args.first_seed):
        print(line, flush=True)
        failed += is_bad
    return 1 if failed else 0


def tables(count: int, floods: int, seeds: int, first_seed: int) -> Iterator[tuple[str, bool]]:
    """Lines, and whether one tells of a failure."""
    yield (
        "| frames of this kind | n | obeyed | checked by the book | signatures that held | next genuine | us each |",
        False,
    )
    yield "|---|---|---|---|---|---|---|", False
    for kind in ATTACKS:
        obeyed, checked, held, accepted, us = endure(kind, count, random.Random(f"{kind} {first_seed}"))
        cells = (kind, f"{count:,}", obeyed, f"{checked:,}", held, "obeyed" if accepted else "**not**", f"{us:.1f}")
        yield f"| {' | '.join(map(str, cells))} |", bool(obeyed or held or not accepted)
    yield (
        f"\n| {FLOOD_HZ:,} forged a second, each so often | n | until a genuine one is obeyed: p50 | p99 | max |",
        False,
    )
    yield "|---|---|---|---|---|", False
    for repeats in (1, 2, 10, 100):
        times = sorted(withstand(random.Random(first_seed + k), repeats) for k in range(floods))
        yield f"| {repeats} | {floods} | {quantiles(times, ' s')} |", math.isinf(times[-1])
    yield (
        f"\n| ABORT, n = {N} | loss | n | farthest, periods a hop: p50 | p99 | p99.9 | max | each vehicle: p99.9 |",
        False,
    )
    yield "|---|---|---|---|---|---|---|---|", False
    for topology in TOPOLOGIES:
        for loss in (0.0, 0.3, 0.5, 0.7):
            found = [spread(first_seed + k, topology, loss) for k in range(seeds)]
            far = sorted(one.farthest for one in found)
            each = sorted(value for one in found for value in one.each)
            cells = f"{topology} | {loss:.0%} | {seeds} | {quantiles(far, '', (0.5, 0.99, 0.999))}"
            yield f"| {cells} | {pick(each, 0.999):.2f} |", math.isinf(far[-1])


def quantiles(values: Sequence[float], unit: str, shares: Sequence[float] = (0.5, 0.99)) -> str:
    """Of sorted values, and the greatest."""
    return " | ".join(f"{value:.2f}{unit}" for value in (*(pick(values, share) for share in shares), values[-1]))


def pick(values: Sequence[float], share: float) -> float:
    """A quantile of sorted values."""
    return values[min(len(values) - 1, int(share * len(values)))]
