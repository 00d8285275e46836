"""Takes out each defence that docs/hazards.toml names, and runs its tests: `python -m tests.mutants taken-out`.

In a copy, one at a time. A row whose tests all pass without its defence is a defence that no test holds.
"""

from __future__ import annotations

import argparse
import re
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path

from tests.mutants.copy_of_tree import ROOT, Copy

SLOW = ("interop/", "programs/")  # start programs: tried last
LIMIT_S = 150.0  # of the tests of one row


def main(argv: Sequence[str]) -> int:
    """Prints a line for each; exit code 1 when one is not noticed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants taken-out", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="WORD", help="only hazards with this in their name")
    args = parser.parse_args(argv)
    rows = tomllib.loads((ROOT / "docs" / "hazards.toml").read_text(encoding="utf-8"))["hazard"]
    tried = [row for row in rows if "taken_out" in row]
    chosen = [row for row in tried if not args.names or any(word in row["hazard"] for word in args.names)]
    unnoticed = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder) / "tree")
        for row in chosen:
            tests = [f"tests/{name}" for name in sorted(row["tests"], key=lambda name: name.startswith(SLOW))]
            with copy.changed(**row["taken_out"]):
                failed = copy.fails(tests, LIMIT_S)
            named = re.search(r"tests/[^\s\[]+::[^\s\[]+", failed)
            if named is not None and copy.fails([named[0]], LIMIT_S):
                failed = ""  # it fails with the defence, too: that says nothing
            unnoticed += not failed
            print(f"{row['hazard']}: {failed or 'NOT NOTICED'}", flush=True)
    print(
        f"{len(chosen) - unnoticed} of {len(chosen)} noticed; {len(rows) - len(tried)} rows without a piece to take out"
    )
    return 1 if unnoticed else 0
