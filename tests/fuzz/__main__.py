"""`python -m tests.fuzz`: so many executions of each target, others with each seed. `make fuzz` runs it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial

from tests.fuzz.campaign import run
from tests.fuzz.seeds import write_seeds
from tests.fuzz.targets import FLIGHTS, TARGETS, corpus_of


def main(argv: Sequence[str]) -> int:
    """1 where something was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)} (all)")
    parser.add_argument("--executions", type=int, default=100_000, metavar="N", help="of each companion (100000)")
    parser.add_argument("--files", type=int, default=5_000, metavar="N", help="of each other target (5000)")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="(1)")
    parser.add_argument("--replay", action="store_true", help="only the corpus, each input once")
    parser.add_argument("--write-seeds", action="store_true", help="write the genuine part of the corpus anew")
    args = parser.parse_args(argv)
    unknown = [name for name in args.targets if name not in TARGETS]
    if unknown:
        parser.error(f"{unknown[0]!r}: must be of {', '.join(TARGETS)}")
    if args.write_seeds:
        write_seeds()
        return 0
    found = 0
    for name in args.targets or TARGETS:
        if args.replay:
            target = TARGETS[name]()
            for file, data in corpus_of(name).items():
                target.run(data)
                print(f"{name}/{file}: read")
            continue
        executions = args.executions if name in FLIGHTS else args.files
        found += len(run(name, executions, seed=args.seed, say=partial(print, flush=True)).findings)
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
