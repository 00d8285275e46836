"""`python -m tests.exploration`: all slices, in half an hour; `--quick`: those of the tests, in a minute."""

from __future__ import annotations

import argparse
import sys

from tests.exploration.model import table
from tests.exploration.slices import ALL, QUICK, explore_all

HEAD = (
    "| explored | n | troubles | states | steps | ends | states of a vehicle | settled within | two decide for | s |",
    "|---|---|---|---|---|---|---|---|---|---|",
)


def main() -> int:
    """0: every rule holds in every state."""
    parser = argparse.ArgumentParser(prog="python -m tests.exploration", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="what the tests explore")
    parser.add_argument("--only", metavar="TEXT", default="", help="slices with this in their name")
    parser.add_argument(
        "--seconds", type=float, default=1e9, metavar="S", help="of the processor, for each slice at most"
    )
    parser.add_argument("--model", action="store_true", help="the small model instead, in half a minute")
    args = parser.parse_args()
    if args.model:
        print("\n".join(table()))
        return 0
    slices = [part for part in (QUICK if args.quick else ALL) if args.only in part.name]
    broken: list[str] = []
    print("\n".join(HEAD), flush=True)
    for part, found in explore_all(slices, seconds=args.seconds):
        rest = "" if found.complete else ", not all"
        print(
            f"| {part.name}{rest} | {part.size} | {part.begins} | {found.states:,} | {found.steps:,} | {found.ends:,} "
            f"| {found.members:,} | {found.settled_after} periods | {found.exclusive or ''} | {found.seconds:.0f} |",
            flush=True,
        )
        broken += [f"{part.name}: {what}" for what in found.violations.values()]
        if broken and args.quick:
            break
    print("\n".join(broken), file=sys.stderr)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
