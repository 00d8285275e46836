"""A signed radio: what is forged or sent again, by the million; what it costs a companion, and the air.

Frames are those of two guards that have met. One that speaks as another has all of a member's keys but that one's own:
how long until it is found, from drawn moments on. The cost is CPU time of one companion's exact traffic, replayed with
keys and without in one run; who is listened to, and from when on, is drawn.
"""

from __future__ import annotations

import argparse
import gc
import math
import random
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.own_messages import decode_beacon
from companion.mavlink.peers.frame_mac import TIMESTAMP_MAX, UNITS_PER_S, seal, timestamp_of
from companion.mavlink.peers.session import open_session
from mission.document.load import load_mission
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.options.search import as_count, as_seed
from sim_bridge.options.study import positive
from sim_bridge.world.world import DEFAULT_ORIGIN, World
from tests.bench.flights import EXAMPLES
from tests.bench.live import answers_of, point_masses
from tests.unit.core.core_kit import lease
from tests.unit.mavlink.signing_kit import MISSION, PERIOD_S, Node, beacon_frame, exchange, keyring, met

BEFORE_TICKS, TICKS = 900, 300  # as tests.bench.tick: on the ground, assembling, departing
ROUNDS = 7
RECORDED = 200  # frames that are sent again
EPOCH = 0
RING_M = 0.95  # of the ring's radius a vehicle: there is room for all
RING_MAX = 25  # vehicles on it inside the example's fence; more fly without coverage and polygon
LOSSES = (0.0, 0.3, 0.5)  # of datagrams, the impostor's too
IMPOSTORS = {  # whether it goes on with each beacon period, how far ahead of its time its frames are stamped
    "one frame": (False, 0.0),
    "with each beacon": (True, 0.0),
    "the same, 2.9 s ahead": (True, 2.9),  # 3 s are taken
}
GIVEN_UP_S = 20.0  # a manifest names the frames of 2 s

Frames = Callable[[random.Random], bytes]


def kinds(one: Node, two: Node, now_s: float) -> dict[str, Frames]:
    """Frames in vehicle 1's name that vehicle 2 must not take."""
    genuine = [one.send(round(now_s + k * PERIOD_S, 6))[0] for k in range(RECORDED)]
    for k, frame in enumerate(genuine):
        two.receive([frame], now_s + k * PERIOD_S)
    earlier = Node(1, boot=99)
    exchange([earlier, Node(2, boot=98)], now_s, 20)
    old = [earlier.send(round(now_s + k * PERIOD_S, 6))[0] for k in range(RECORDED)]
    own_key = open_session(keyring(1), 1, MISSION, 1001).stream_key(EPOCH, 1, 1001) or b""
    other_key = open_session(keyring(1), 1, b"n" * 32, 1001).stream_key(EPOCH, 1, 1001) or b""
    ahead = timestamp_of(genuine[-1]) + 1_000_000
    unheard = [one.guard.seal(beacon_frame(1), now_s) for _ in range(RECORDED)]

    def changed(rng: random.Random) -> bytes:
        frame = bytearray(rng.choice(unheard))  # new, but for one bit
        frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
        return bytes(frame)

    return {
        "forged, without a key": lambda rng: seal(beacon_frame(1), rng.randbytes(32), EPOCH, ahead),
        "a bit changed": changed,
        "sent again": lambda rng: rng.choice(genuine),
        "of an earlier boot": lambda rng: rng.choice(old),
        "of another mission": lambda _: seal(beacon_frame(1), other_key, EPOCH, ahead),
        "by a member, far ahead": lambda rng: seal(
            beacon_frame(1), own_key, EPOCH, rng.choice((TIMESTAMP_MAX, ahead * 2, ahead + 100_000_000))
        ),
    }


def attack(count: int, seed: int) -> int:
    """A row a kind; the number of frames that were taken."""
    taken_in_all = 0
    print("| frames in another's name | sent | taken | the next genuine one |\n|---|---|---|---|")
    for name in kinds(*_two()):
        (one, two), now_s = met(1, 2)
        make, rng = kinds(one, two, now_s)[name], random.Random(f"{seed} {name}")
        at_s = now_s + RECORDED * PERIOD_S
        taken = sum(_takes(two, make(rng), at_s) for _ in range(count))
        genuine = one.send(at_s + 0.01)[0]
        print(f"| {name} | {count:,} | {taken} | {'taken' if _takes(two, genuine, at_s + 0.01) else 'LOST'} |")
        taken_in_all += taken
    return taken_in_all


def _two() -> tuple[Node, Node, float]:
    (one, two), now_s = met(1, 2)
    return one, two, now_s


def _takes(node: Node, frame: bytes, now_s: float) -> bool:
    fields = swarm_beacon.unpack(frame)
    return fields is not None and node.guard.admits(frame, now_s, decode_beacon(frame[5], fields))


# --- a member that speaks as another ---


def impersonate(draws: int, seed: int) -> int:
    """A row for each way and loss; how often a word that was not its sender's counted."""
    counted = 0
    print("\n| as another | loss | drawn | found after, s: median | most | never | words not its own that counted |")
    print("|---|---|---|---|---|---|---|")
    for name, (goes_on, ahead_s) in IMPOSTORS.items():
        for loss in LOSSES:
            rng = random.Random(f"{seed} {name} {loss}")
            drawn = [_found_after_s(rng, loss, goes_on=goes_on, ahead_s=ahead_s) for _ in range(draws)]
            found_s = [after_s for after_s, _ in drawn if math.isfinite(after_s)]
            words = sum(count for _, count in drawn)
            seen = f"{statistics.median(found_s):.2f} | {max(found_s):.2f}" if found_s else "- | -"
            print(f"| {name} | {loss:.0%} | {draws} | {seen} | {draws - len(found_s)} | {words} |", flush=True)
            counted += words
    return counted


def _found_after_s(rng: random.Random, loss: float, *, goes_on: bool, ahead_s: float) -> tuple[float, int]:
    """From the first frame as vehicle 1 that vehicle 2 takes until it says so, infinite: not; and words that counted.

    Each time a frame with vehicle 1's own word, and one with another.
    """
    (one, two), now_s = met(1, 2)
    key = open_session(keyring(3), 3, MISSION, 1003).stream_key(EPOCH, 1, 1001) or b""
    from_s, first_s, words = now_s + rng.uniform(1.0, 5.0), math.inf, 0
    late_s = rng.uniform(0.001, PERIOD_S - 0.001)  # after vehicle 1's beacon
    while now_s < min(first_s, from_s + GIVEN_UP_S) + GIVEN_UP_S:
        frames = one.send(now_s)
        if rng.random() >= loss:
            two.receive(frames, now_s)
        if two.guard.refused["disowned"]:
            return now_s - first_s, words
        if now_s >= from_s and (goes_on or first_s == math.inf) and rng.random() >= loss:
            at_s = now_s + late_s
            stamp = int((at_s + ahead_s) * UNITS_PER_S)
            false = [(stamp, beacon_frame(1)), (stamp + 1, beacon_frame(1, lease=lease(3, 9)))]
            taken = two.receive([seal(frame, key, EPOCH, at) for at, frame in false], at_s)
            first_s = min(first_s, at_s) if taken else first_s
            words += sum(believed for _, believed in taken[1:])
        now_s = round(now_s + PERIOD_S, 6)
    return math.inf, words


# --- what it costs ---


class _Noting:
    """A companion in this process whose traffic is kept."""

    def __init__(self, mission: Mission, vehicle_id: int, keys: FleetKeys | None) -> None:
        guard = None if keys is None else keys.guard(vehicle_id)
        self._companion = InProcess(
            mission, vehicle_id, guard=guard, orders=None if keys is None else keys.orders(vehicle_id)
        )
        self.id = vehicle_id
        self.receive, self.kill, self.close = self._companion.receive, self._companion.kill, self._companion.close
        self.traffic: list[tuple[float, bytes, bytes]] = []
        self.sent_bytes = 0

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes = b"") -> None:
        self.traffic.append((now_s, from_peers, from_autopilot))
        self._companion.send(from_peers, from_autopilot, now_s, from_sensor)
        self.sent_bytes += len(self.receive()[0]) if len(self.traffic) > BEFORE_TICKS else 0


def cost(size: int, seed: int) -> None:
    """A row: a tick with keys and without, and the bytes that a vehicle sends."""
    values = load_mission(EXAMPLES / "lone_tree.toml").model_dump(by_alias=True)
    values["coverage"]["radius_m"] = max(values["coverage"]["radius_m"], RING_M * size)
    if size > RING_MAX:
        values["coverage"]["duration_s"], values["fence"]["polygon_enu_m"] = 0.0, None
    mission = Mission.model_validate(values).with_size(size).with_seed(seed).with_origin(DEFAULT_ORIGIN)
    rng = random.Random(seed)
    listened = rng.randrange(1, size + 1)
    flown = {signed: _recorded(mission, signed) for signed in (False, True)}
    spent: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(ROUNDS):
        for signed, companions in flown.items():
            spent[signed].append(_replayed_us(mission, listened, companions[listened].traffic, signed))
    plain, signed = (statistics.median(spent[key]) for key in (False, True))
    ratio = statistics.median(b / a for a, b in zip(spent[False], spent[True], strict=True))
    air = [sum(one.sent_bytes for one in flown[key].values()) / size / (TICKS / 20) for key in (False, True)]
    print(f"| {size} | {plain:.0f} us | {signed:.0f} us | {ratio:.2f} | {air[0]:.0f} | {air[1]:.0f} |")


def _recorded(mission: Mission, signed: bool) -> dict[int, _Noting]:
    keys = FleetKeys(mission) if signed else None
    world = World(mission, point_masses, links=fly.LINKS)
    companions = {k: _Noting(mission, k, keys) for k in world.vehicles}
    keyholder = None if keys is None else keys.operator(world)
    flight = fly.Flight(mission, list(companions.values()), world, None, keyholder=keyholder)
    for _ in range(BEFORE_TICKS + TICKS):
        flight.tick()
    flight.close()
    return companions


def _replayed_us(
    mission: Mission, vehicle_id: int, traffic: Sequence[tuple[float, bytes, bytes]], signed: bool
) -> float:
    keys = FleetKeys(mission)
    endpoint = Endpoint(
        mission,
        vehicle_id,
        guard=keys.guard(vehicle_id) if signed else None,
        orders=keys.orders(vehicle_id) if signed else None,
    )
    endpoint.agent.waive("all")
    gc.collect()
    gc.freeze()
    spent_ns = 0
    for at, (now_s, from_peers, from_autopilot) in enumerate(traffic):
        began_ns = time.thread_time_ns()
        endpoint.from_peers(from_peers, now_s)
        endpoint.from_autopilot(from_autopilot, now_s)
        endpoint.tick(now_s)
        spent_ns += time.thread_time_ns() - began_ns if at >= BEFORE_TICKS else 0
    gc.unfreeze()
    return spent_ns / TICKS / 1e3


def live_cost(size: int, rounds: int) -> None:
    """A row: a companion that is a process, in lockstep at real time, with keys and without by turns."""
    spent: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(rounds):
        for signed, shares in spent.items():
            with tempfile.TemporaryDirectory() as folder:
                shares.append(100.0 * answers_of(size, Path(folder), signed=signed).agent_share)
    ratios = sorted(b / a for a, b in zip(spent[False], spent[True], strict=True))
    plain, signed = (statistics.median(spent[key]) for key in (False, True))
    spread = f"{statistics.median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f})"
    print(f"| {size} | {plain:.2f} % | {signed:.2f} % | {spread} |", flush=True)


def main(argv: Sequence[str]) -> int:
    """Exit code 1 when a frame was taken, or a word of an impostor counted."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench signed-radio", description=__doc__)
    parser.add_argument("--frames", type=as_count, default=1_000_000, metavar="N", help="of each kind (default: 10^6)")
    parser.add_argument(
        "--impostors",
        type=as_count,
        default=200,
        metavar="N",
        help="drawn of each way and loss (default: 200; 0: none)",
    )
    parser.add_argument("--sizes", type=positive, nargs="*", default=[4, 12, 24], metavar="N", help="vehicles")
    parser.add_argument("--seed", type=as_seed, default=9000, metavar="S")
    parser.add_argument(
        "--live", type=positive, nargs="*", default=[4, 12], metavar="N", help="vehicles that are processes"
    )
    parser.add_argument(
        "--rounds", type=positive, default=5, metavar="K", help="of those, each of 20 s twice (default: 5)"
    )
    args = parser.parse_args(argv)
    taken = attack(args.frames, args.seed) if args.frames else 0
    taken += impersonate(args.impostors, args.seed) if args.impostors else 0
    print("\n| vehicles | a tick, unsigned | signed | ratio | bytes a second, unsigned | signed |")
    print("|---|---|---|---|---|---|")
    for at, size in enumerate(args.sizes):
        cost(size, args.seed + at)
    if args.live:
        print("\n| vehicles | a live companion's share of a core, unsigned | signed | ratio |\n|---|---|---|---|")
    for size in args.live:
        live_cost(size, args.rounds)
    return 1 if taken else 0
