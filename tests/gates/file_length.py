"""Holds every Python source to a length that a reader takes in: `python -m tests.gates.file_length`."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = ("mission", "companion", "sim_bridge", "docs", "tests")
LINES_MAX = 400

# Longer, with the reason.
EXCEPTIONS = {
    "companion/mavlink/dialect.py": "generated",
    "companion/mavlink/own_messages.py": "generated",
    "mission/schema/tables.py": "a table: one row for each key of a mission",
    "companion/core/vehicle/failsafe.py": "a table: one row for each cause, and what its rows read",
    "tests/programs/test_watch_browser.py": "one browser, started once for all of its tests",
}


def problems(root: Path = ROOT, exceptions: Mapping[str, str] = EXCEPTIONS) -> Iterator[str]:
    """Every file that is too long, and every exception that is none."""
    lengths = {
        file.relative_to(root).as_posix(): len(file.read_text(encoding="utf-8").splitlines())
        for folder in SOURCES
        for file in sorted((root / folder).rglob("*.py"))
        if "node_modules" not in file.parts
    }
    for name, lines in lengths.items():
        if lines > LINES_MAX and name not in exceptions:
            yield f"{name}: {lines} lines; at most {LINES_MAX}"
    for name in exceptions:
        if lengths.get(name, 0) <= LINES_MAX:
            yield f"{name}: {lengths.get(name, 'no such file')}; no exception is needed"


def main() -> int:
    found = list(problems())
    print("\n".join(found) or f"no file has more than {LINES_MAX} lines")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
