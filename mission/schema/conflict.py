"""Fields of a mission that do not go together, and how to say so."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from mission.common.problems import Path, dotted, shown
from mission.schema.fields import Table

TREES: Final = {"route.d1_enu_m": "route.d1_tree", "route.d2_enu_m": "route.d2_tree"}
"""Key of a point: that of the tree of a stem map which may be written instead."""


@dataclass(frozen=True, slots=True)
class Conflict:
    """Fields that do not go together.

    The first path is the one to blame, `value` what it holds, as shown, empty where it is missing; the message gives
    the others' values.
    """

    paths: tuple[Path, ...]
    value: str
    message: str

    def __str__(self) -> str:
        subject = dotted(self.paths[0])
        return f"{subject} = {self.value}: {self.message}" if self.value else f"{subject}: {self.message}"


class ConflictError(ValueError):
    """Raised inside validation; carries the conflicts to where the lines are known."""

    def __init__(self, conflicts: tuple[Conflict, ...]) -> None:
        self.conflicts = conflicts
        super().__init__(conflicts)  # what it is made of: so it comes out of another process as it went in

    def __str__(self) -> str:
        return "; ".join(map(str, self.conflicts))


def path_of(key: str) -> Path:
    """`radio.full_range_m`, or `route.stops.0.pos_enu_m`, as a path."""
    return tuple(int(part) if part.isdecimal() else part for part in key.split("."))


def value_of(mission: Table, key: str) -> Any:
    """The value at `key`."""
    found: Any = mission
    for part in path_of(key):
        found = found[part] if isinstance(part, int) else getattr(found, part)
    return found


def _written_key(mission: Table, key: str) -> str:
    """The key that says it: where a mission names the tree at a point, the tree's."""
    tree = TREES.get(key)
    return key if tree is None or value_of(mission, tree) is None else tree


def show_key(mission: Table, key: str) -> str:
    """`radio.full_range_m = 55.0`; `route.d2_tree = "A-17" at [60.0, 4.5, 8.0]`"""
    written = _written_key(mission, key)
    where = "" if written == key else f" at {shown(value_of(mission, key))}"
    return f"{dotted(path_of(written))} = {shown(value_of(mission, written))}{where}"


def conflict(mission: Table, keys: Sequence[str], requirement: str) -> Conflict:
    """`requirement`, then the other keys and their values."""
    blamed = _written_key(mission, keys[0])
    where = [] if blamed == keys[0] else [f"the tree is at {shown(value_of(mission, keys[0]))}"]
    others = ", ".join([*where, *(show_key(mission, key) for key in keys[1:])])
    message = f"{requirement} ({others})" if others else requirement
    paths = [blamed, *(key for key in keys if key != blamed)]
    return Conflict(tuple(map(path_of, paths)), shown(value_of(mission, blamed)), message)


def order(mission: Table, low: str, high: str, *, equal: bool = False) -> Iterator[Conflict]:
    """A conflict unless the value at `low` is less than that at `high`, or `equal` to it."""
    low_value, high_value = value_of(mission, low), value_of(mission, high)
    if low_value > high_value or (low_value == high_value and not equal):
        requirement = "must be at most" if equal else "must be less than"
        yield Conflict((path_of(low), path_of(high)), shown(low_value), f"{requirement} {show_key(mission, high)}")
