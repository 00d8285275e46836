"""Checks as a table for people."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from companion.preflight.report import Check

FOUND_CHARS = 66
FIX_CHARS = 100


def table(checks: Sequence[Check]) -> str:
    """A row for each check, and what to do below those that are not good."""
    rows = [("check", "", "found", "wanted"), *((c.name, c.verdict, c.found, c.wanted) for c in checks)]
    name, verdict = (max(len(row[column]) for row in rows) for column in (0, 1))
    found = min(FOUND_CHARS, max(len(row[2]) for row in rows))
    lines: list[str] = []
    indent = " " * (name + 2)
    for row, fix in zip(rows, ("", *(check.fix for check in checks)), strict=True):
        lines += _lines(row, (name, verdict, found))
        if fix:
            lines += textwrap.wrap(f"-> {fix}", FIX_CHARS, initial_indent=indent, subsequent_indent=f"{indent}   ")
    return "\n".join(lines)


def _lines(row: Sequence[str], widths: tuple[int, int, int]) -> list[str]:
    found = textwrap.wrap(row[2], widths[2]) or [""]
    first = f"{row[0]:{widths[0]}}  {row[1]:{widths[1]}}  {found[0]:{widths[2]}}  {row[3]}".rstrip()
    return [first, *(" " * (widths[0] + widths[1] + 4) + more for more in found[1:])]
