"""One row of the table: what was compared, and what is not as recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing that is not as recorded."""

    what: str
    recorded: str
    ours: str


@dataclass(frozen=True, slots=True)
class Check:
    """One row of the table."""

    name: str
    summary: str
    differences: tuple[Difference, ...] = ()


def moved(recorded: Sequence[str], ours: Sequence[str]) -> list[Difference]:
    """Lists what is missing, extra, or in another place."""
    missing: list[str] = []
    extra: list[str] = []
    for tag, a, b, c, d in SequenceMatcher(None, recorded, ours, autojunk=False).get_opcodes():
        if tag != "equal":
            missing += recorded[a:b]
            extra += ours[c:d]
    found = []
    for what in missing:
        if what in extra:
            extra.remove(what)
            found.append(Difference(f"{what}: order", "as sent", "in another place"))
        else:
            found.append(Difference(what, "yes", "no"))
    return found + [Difference(what, "no", "yes") for what in extra]
