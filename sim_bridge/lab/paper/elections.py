"""Share of elections that end with one leader, on random graphs: `python -m sim_bridge.lab.paper.elections`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from scipy import stats

from sim_bridge.lab.paper import khopca
from sim_bridge.lab.study.law import Bools
from sim_bridge.lab.study.point_mass import is_connected

RANGE_M, SIDE_M = 55.0, 200.0  # the paper's r and l
ROUNDS = 100
SIZES = (4, 8, 12, 50)
CONFIDENCE = 0.95
Rule = Callable[[khopca.Ints, Bools, int], khopca.Ints]


def main(argv: Sequence[str] | None = None) -> int:
    """Prints a Markdown table: shares, each with its exact 95 % interval and of how many graphs."""
    parser = argparse.ArgumentParser(
        prog="python -m sim_bridge.lab.paper.elections", description=__doc__, allow_abbrev=False
    )
    parser.add_argument("--graphs", type=int, default=40, metavar="N", help="for each n (default: %(default)s)")
    low = khopca.LEADER_ID + 1
    parser.add_argument(
        "--least", type=int, default=low, help="of the weights that all start with (default: %(default)s)"
    )
    parser.add_argument(
        "--limit",
        type=int,
        default=khopca.WEIGHT_LIMIT,
        help="weightLimit, which the paper leaves open (default: %(default)s)",
    )
    args = parser.parse_args(argv)
    if not low <= args.limit or not khopca.LEADER_ID <= args.least <= args.limit or args.graphs < 1:
        parser.error(f"wanted: --graphs from 1, --limit from {low}, --least from {khopca.LEADER_ID} to --limit")
    printed, unnested, meant = (
        partial(rule, limit=args.limit) for rule in (khopca.printed, khopca.unnested, khopca.clean)
    )
    print(
        "| n | printed: one leader | two adjacent leaders stay | lost leaders replaced "
        "| un-nested: one leader | lost leaders replaced | KHOPCA: settles | one leader |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for n in SIZES:
        graphs = np.array([graph(n, seed) for seed in range(1, args.graphs + 1)])
        draws = [np.random.default_rng([seed, n]) for seed in range(args.graphs)]
        weights = np.array([khopca.initial_weights(n, rng, least=args.least, limit=args.limit) for rng in draws])
        first = run_rounds(printed, weights, graphs)
        apart = run_rounds(unnested, weights, graphs)
        clean = run_rounds(meant, weights, graphs)
        settled = (run_round(meant, clean, graphs) == clean).all(axis=1)
        columns = (
            *(one_leader(first), adjacent(first, graphs), replaced(first, graphs, printed)),
            *(one_leader(apart), replaced(apart, graphs, unnested), settled, one_leader(clean)),
        )
        cells = [share(found) for found in columns]
        print(f"| {n} | {' | '.join(cells)} |")
    return 0


def share(found: Bools) -> str:
    """`30 % (17-46), of 40`: the exact interval (Clopper, Pearson); `-` of none."""
    if not found.size:
        return "-"
    interval = stats.binomtest(int(found.sum()), found.size).proportion_ci(CONFIDENCE)
    return f"{100.0 * found.mean():.0f} % ({100.0 * interval.low:.0f}-{100.0 * interval.high:.0f}), of {found.size}"


def graph(n: int, seed: int) -> Bools:
    """(n, n) a connected graph of points in the paper's cube, drawn in as large a part of it as still connects them."""
    rng = np.random.default_rng([seed, n, 0x6AF])
    side_m = SIDE_M
    while True:
        points = side_m * rng.random((n, 3))
        apart = np.linalg.norm(points[:, None] - points[None], axis=2)
        near = (apart <= RANGE_M) & ~np.eye(n, dtype=np.bool_)
        if is_connected(near[None])[0]:
            return np.asarray(near)
        side_m *= 0.99


def run_round(rule: Rule, weights: khopca.Ints, graphs: Bools) -> khopca.Ints:
    """One round: every vehicle in turn, as Algorithm 1's loop."""
    weights = weights.copy()
    for u in range(weights.shape[1]):
        weights[:, u] = rule(weights, graphs[:, u], u)
    return weights


def run_rounds(rule: Rule, weights: khopca.Ints, graphs: Bools) -> khopca.Ints:
    """ROUNDS rounds."""
    for _ in range(ROUNDS):
        weights = run_round(rule, weights, graphs)
    return weights


def one_leader(weights: khopca.Ints) -> Bools:
    """(B,) exactly one leads."""
    return np.asarray((weights == khopca.LEADER_ID).sum(axis=1) == 1)


def adjacent(weights: khopca.Ints, graphs: Bools) -> Bools:
    """(B,) two leaders in touch with each other."""
    leads = weights == khopca.LEADER_ID
    return np.asarray((graphs & leads[:, :, None] & leads[:, None, :]).any(axis=(1, 2)))


def replaced(weights: khopca.Ints, graphs: Bools, rule: Rule = khopca.printed) -> Bools:
    """(B',) of the graphs with a leader: another one leads, ROUNDS rounds after all leaders are gone at once."""
    led = weights == khopca.LEADER_ID
    having = np.flatnonzero(led.any(axis=1) & ~led.all(axis=1))
    found = []
    for b in having:
        left = np.flatnonzero(~led[b])
        after = run_rounds(rule, weights[b][None, left], graphs[b][None][:, left][:, :, left])
        found.append(bool((after == khopca.LEADER_ID).any()))
    return np.array(found, dtype=np.bool_)


if __name__ == "__main__":
    sys.exit(main())
