"""Keys of before, which are read under their new names for one version, with a warning on stderr."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterator
from typing import Any

from mission.common.problems import Path, dotted

# table, old key -> new key, until 0.3; wherever the table stands: studies set keys of missions
RENAMED = {
    ("swarm", "place_budget_m"): "position_error_max_m",
    ("swarm", "place_lost"): "position_uncertain",
    ("sensors", "place_m"): "start_m",
}


def rename_keys(values: dict[str, Any], lines: dict[Path, int], place: str) -> None:
    """Renames old keys in `values`, and in `lines`, where each stands. One beside its new name stays, to be refused."""
    for table, path in _tables(values, ()):
        for old in list(table):
            new = RENAMED.get((str(path[-1]), old)) if path else None
            if new is not None and new not in table:
                table[new] = table.pop(old)
                line = lines.pop((*path, old), None)
                if line is not None:
                    lines[*path, new] = line
                _warn(f"{place}:{line or 1}: {dotted((*path, old))} is deprecated: write {new}")


def _tables(value: Any, path: Path) -> Iterator[tuple[dict[str, Any], Path]]:
    if isinstance(value, dict):
        yield value, path
        for key, inner in list(value.items()):
            yield from _tables(inner, (*path, key))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _tables(inner, (*path, index))


@functools.cache
def _warn(text: str) -> None:
    """Prints once in a process: programs read their mission more than once."""
    print(text, file=sys.stderr)
