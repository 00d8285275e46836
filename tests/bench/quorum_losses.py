"""How often a leader counts no majority, or loses its lead, though nothing but single beacons is lost.

`python -m tests.bench quorum-losses`: agents on airframes that move at once, in transit; each receiver misses a share
of beacons, drawn anew for each. Full: all hear all. Chain: each hears the next ones in the order of ids alone.
"""

from __future__ import annotations

import argparse
import random
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

from companion.core.agent import TICK_S
from companion.core.model.states import FlightState, Order
from sim_bridge.options.study import positive
from tests.bench.options import as_loss
from tests.unit.core.core_fleet import Fleet
from tests.unit.core.core_kit import mission

SETTLES_S = 8.0  # until links are measured
KEPT_S = 60.0


@dataclass(frozen=True, slots=True)
class Counted:
    """Of one flight."""

    without: int  # times at which an acting leader has no majority any more
    without_s: float
    holding_s: float  # of all vehicles: they hold
    leaders: int  # changes of which vehicle acts
    way_m: float  # of the leader, along the way to d2


def fly_one(seed: int, *, size: int, loss: float, is_chain: bool) -> Counted:
    """One flight, a minute of it in transit by such a radio."""
    swarm = Fleet(mission(route={"d2_enu_m": (600.0, 0.0, 8.0), "at_end": "hold"}, swarm={"size": size}), range_m=55.0)
    swarm.rng = random.Random(seed)
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=90.0)
    swarm.loss = loss
    if is_chain:
        swarm.links = {frozenset((k, k + 1)) for k in range(1, size)}
    swarm.run(SETTLES_S)
    without = without_ticks = holding = changes = 0
    was_whole, led_by = True, swarm.acting()
    began_m = swarm.aircraft[led_by[0]].pos_ned_m[1] if led_by else 0.0
    for _ in range(round(KEPT_S / TICK_S)):
        swarm.tick()
        acting = swarm.acting()
        leases = [swarm.aircraft[k].agent.swarm.election.lease for k in acting]
        is_whole = any(lease is not None and lease.quorum for lease in leases)
        without += was_whole and not is_whole
        without_ticks += not is_whole
        changes += acting != led_by
        was_whole, led_by = is_whole, acting
        holding += sum(one.state is FlightState.HOLD for one in swarm.aircraft.values())
    end_m = swarm.aircraft[led_by[0]].pos_ned_m[1] if led_by else began_m
    return Counted(without, without_ticks * TICK_S, holding * TICK_S / size, changes, end_m - began_m)


def main(argv: Sequence[str]) -> int:
    """A row for each kind of swarm and share."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench quorum-losses", description=__doc__)
    parser.add_argument("--flights", type=positive, default=20, metavar="N", help="of each row (20)")
    parser.add_argument("--losses", type=as_loss, nargs="+", default=[0.3, 0.4, 0.5, 0.6], metavar="SHARE")
    parser.add_argument("--sizes", type=positive, nargs="+", default=[3, 4, 8], metavar="N")
    parser.add_argument("--chain", action="store_true", help="each hears the next ones alone")
    parser.add_argument("--jobs", type=positive, default=1, metavar="N", help="flights at once (1)")
    args = parser.parse_args(argv)
    print(
        "| n | lost | flights | without majority, times a minute | s of 60 | holding, s of 60 | leader changes | m/s |"
    )
    print("|---|---|---|---|---|---|---|---|", flush=True)
    with ProcessPoolExecutor(args.jobs) as pool:
        for size in args.sizes:
            for loss in args.losses:
                one = partial(fly_one, size=size, loss=loss, is_chain=args.chain)
                flown = list(pool.map(one, range(args.flights)))
                means = [
                    sum(getattr(row, name) for row in flown) / len(flown)
                    for name in ("without", "without_s", "holding_s", "leaders", "way_m")
                ]
                struck = sum(row.without > 0 for row in flown)
                print(
                    f"| {size} | {loss:.0%} | {len(flown)} | {means[0]:.2f} (in {struck}) | {means[1]:.2f} "
                    f"| {means[2]:.2f} | {means[3]:.2f} | {means[4] / KEPT_S:.2f} |",
                    flush=True,
                )
    return 0
