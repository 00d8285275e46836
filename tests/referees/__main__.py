"""Tests that others wrote, flown by ours, beside their figures: `make referees`, or `python -m tests.referees`."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from mission.common.exit_codes import EXIT_DONE, EXIT_ENVIRONMENT
from sim_bridge.lab.study.jobs import worker_count
from tests.referees import (
    karhunen,
    karhunen_table,
    laws,
    laws_table,
    stem_maps,
    stem_maps_table,
    swarmfuzz,
    swarmfuzz_table,
    uav_testing,
    uav_testing_table,
)
from tests.referees.referee import Case, Referee, Row, case_of, with_section, words_of

REFEREES = {
    "uav-testing": Referee(
        uav_testing_table.TITLE, uav_testing.cases, uav_testing.fly_layout, uav_testing_table.section
    ),
    "stem-maps": Referee(
        stem_maps_table.TITLE, stem_maps.cases, stem_maps.fly_line, stem_maps_table.section, stem_maps.missing
    ),
    "karhunen": Referee(karhunen_table.TITLE, karhunen.cases, karhunen.fly_through, karhunen_table.section),
    "laws": Referee(laws_table.TITLE, laws.cases, laws.fly_law, laws_table.section),
    "swarmfuzz": Referee(swarmfuzz_table.TITLE, swarmfuzz.cases, swarmfuzz.fly_attack, swarmfuzz_table.section),
}
NOT_CLEAR = 1


class _Chosen(NamedTuple):
    """What the command line asks for."""

    only: Sequence[str]  # the beginnings of names; none: all
    n: Sequence[int]
    seed: int | None
    estimates: Sequence[str]
    sensors: Sequence[str]

    def cases(self, referee: Referee) -> list[Case]:
        """Those of `referee` that are asked for."""
        found = referee.cases()
        if self.seed is not None:
            found = list(dict.fromkeys(replace(case, seed=self.seed) for case in found))
        return [
            case
            for case in found
            if (not self.only or case.name.startswith(tuple(self.only)))
            and (not self.n or case.n in self.n)
            and (not self.estimates or case.estimates in self.estimates)
            and (not self.sensors or case.sensor in self.sensors)
        ]


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 1: a flight was not clear; 2: there is no such flight; 3: what a referee needs is not installed."""
    parser = argparse.ArgumentParser(prog="python -m tests.referees", description=__doc__)
    parser.add_argument("referee", nargs="*", help=f"{', '.join(REFEREES)} (default: all)")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="what begins so: m1_test_0, waka")
    parser.add_argument("-n", type=int, action="append", default=[], help="vehicles (default: what the referee flies)")
    parser.add_argument("--seed", type=int, help="instead of the referee's")
    parser.add_argument("--estimates", action="append", default=[], help="of autopilots (default: the referee's)")
    parser.add_argument("--sensor", action="append", default=[], help="of obstacles (default: the referee's)")
    parser.add_argument("--workers", type=int, default=worker_count(), help="processes")
    parser.add_argument("--rows", type=Path, metavar="FILE", help="a line for each flight; what is there is not flown")
    parser.add_argument("--kept", action="store_true", help="fly nothing: tables of what --rows has")
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the tables into their sections of this page")
    args = parser.parse_args(argv)
    if unknown := [name for name in args.referee if name not in REFEREES]:
        parser.error(f"there is no referee {', '.join(unknown)}: {', '.join(REFEREES)}")
    chosen = _Chosen(args.only, args.n, args.seed, args.estimates, args.sensor)
    code = EXIT_DONE
    flown: list[Row] = []
    for name in args.referee or REFEREES:
        referee = REFEREES[name]
        cases = chosen.cases(referee)
        if args.kept:
            kept = {case_of(row) for row in _rows(args.rows) if row["referee"] == name}
            cases = [case for case in cases if case in kept]
        if not cases:
            continue
        if not args.kept and (missing := referee.missing()):
            print(f"{name}: left out: {missing}", file=sys.stderr)
            code = EXIT_ENVIRONMENT
            continue
        flights = _flights(name, cases, args.workers, args.rows)
        text = referee.section(flights, words_of(flights, "commit"))
        print(text)
        if args.write is not None:
            page = args.write.read_text(encoding="utf-8")
            args.write.write_text(with_section(page, referee.title, text), encoding="utf-8")
        flown += flights
    if not flown:
        if code == EXIT_DONE:
            parser.error("no referee has such flights")
        return code
    return code if all(row["grade"] == "clear" for row in flown) else NOT_CLEAR


def _flights(name: str, cases: Sequence[Case], workers: int, path: Path | None) -> list[Row]:
    """A row of each case, in their order: those that are kept in `path`, and those that are flown now."""
    found = {case_of(row): row for row in _rows(path) if row["referee"] == name}
    todo = [case for case in cases if case not in found]
    began_s, commit = time.monotonic(), _commit()
    with ProcessPoolExecutor(workers) as pool:
        futures = [pool.submit(REFEREES[name].fly, case) for case in todo]
        for count, future in enumerate(as_completed(futures), start=1):
            row = {"referee": name, "commit": commit, **future.result()}
            found[case_of(row)] = row
            left_s = (time.monotonic() - began_s) / count * (len(todo) - count)
            of_case = case_of(row)
            told = f"{of_case.name}, n = {of_case.n}, seed {of_case.seed}, {of_case.estimates}, {of_case.sensor}"
            print(f"{name} {count}/{len(todo)}, {left_s / 60.0:.0f} min left: {told}: {row['grade']}", file=sys.stderr)
            if path is not None:
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
    return [found[case] for case in cases]


def _rows(path: Path | None) -> list[Row]:
    if path is None or not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def _commit() -> str:
    told = subprocess.run(["git", "describe", "--always"], capture_output=True, text=True, check=False)
    return told.stdout.strip() or "unknown"


if __name__ == "__main__":
    sys.exit(main())
