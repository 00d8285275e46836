"""Holds every package to as many files as a reader takes in: `python -m tests.gates.package_size`."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = ("mission", "companion", "sim_bridge")
FILES_MAX = 12

# Larger, with the reason.
EXCEPTIONS = {
    "mission/schema": "a module for each table of a mission file; the kinds of faults are the thirteenth",
}


def problems(root: Path = ROOT, exceptions: Mapping[str, str] = EXCEPTIONS) -> Iterator[str]:
    """Every package with more Python files of its own, `__init__` not counted, and every exception that is none."""
    files = Counter(
        file.parent.relative_to(root).as_posix()
        for folder in SOURCES
        for file in (root / folder).rglob("*.py")
        if file.name != "__init__.py" and "node_modules" not in file.parts
    )
    for name in sorted(files):
        if files[name] > FILES_MAX and name not in exceptions:
            yield f"{name}: {files[name]} Python files; at most {FILES_MAX}: split it into rooms"
    for name in exceptions:
        if files[name] <= FILES_MAX:
            yield f"{name}: {files[name]} Python files; no exception is needed"


def main() -> int:
    found = list(problems())
    print("\n".join(found) or f"no package has more than {FILES_MAX} files of its own, but those excepted")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
