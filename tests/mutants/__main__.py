"""`python -m tests.mutants taken-out`, or `mutants`."""

from __future__ import annotations

import sys

from tests.mutants import mutants, taken_out

PROGRAMS = {"mutants": mutants.main, "taken-out": taken_out.main}

if __name__ == "__main__":
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in PROGRAMS:
        sys.exit(f"usage: python -m tests.mutants {{{','.join(PROGRAMS)}}} ...")
    sys.exit(PROGRAMS[name](sys.argv[2:]))
