"""Reference page of the mutants that were tried, of docs/mutants.toml. For `generate.py`."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from flight_pages import NOTE
from hazard_pages import HazardsError

TABLE = Path(__file__).parent / "mutants.toml"
Z = 1.96  # 95 %
NOTHING = "changes nothing"  # begins the reason of a mutant that does the same

ABOUT = """\
A mutant is the code with one small thing changed: a sign, a bound, a constant, an argument. If a test fails with it, it
is killed; one that survives is a change that nobody would notice, or one that changes nothing. `make mutants` makes
those of the modules below with [mutmut](https://github.com/boxed/mutmut), draws {each} of each group (seed {seed}), and
tries each by the tests nearest to its module, then, where it survives, by slower ones: properties, transcripts of
ticks, flights (`tests/mutants/groups.py`). Functions with a decorator have no mutants, nor have constants."""


def mutants_page() -> Iterator[str]:
    """Groups with their shares, then what survived. HazardsError: a survivor without a reason."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    survivors = table.get("survivor", [])
    open_ones = [row for row in survivors if not row["reason"]]
    if open_ones:
        raise HazardsError(f"docs/mutants.toml: {len(open_ones)} survivors have no reason, as {open_ones[0]['new']!r}")
    yield from ("# Mutants", "", NOTE, "", ABOUT.format(each=table["each"], seed=table["seed"]), "")
    yield "| group | modules | made | tried | killed at once | by slower tests | survive | killed (95 % interval) |"
    yield "|---|---|---|---|---|---|---|---|"
    for group in table["group"]:
        yield _group_row(group)
    groups = [group for group in table["group"] if group["tried"]]
    made, tried = (sum(group[key] for group in groups) for key in ("made", "tried"))
    nothing = sum(row["reason"].startswith(NOTHING) for row in survivors)
    share = sum(group["made"] * _killed(group) / group["tried"] for group in groups) / made
    # of a stratified sample: each group's share counts as its mutants do
    variance = sum((group["made"] / made) ** 2 * _variance(group) for group in groups)
    yield from (
        "",
        f"Of the {made} of the groups that were tried, by their shares: **{100.0 * share:.1f} %** killed "
        f"(± {100.0 * Z * math.sqrt(variance):.1f}, 95 %). Those that change nothing count as survivors here: "
        f"{nothing} of {len(survivors)}; of the {tried - nothing} others "
        f"{100.0 * (tried - len(survivors)) / (tried - nothing):.1f} % are killed. {table['note']}".rstrip(),
        "",
        "## Survivors",
        "",
        "| module, function | from | to | why |",
        "|---|---|---|---|",
    )
    for row in survivors:
        module = row["file"].removeprefix("companion/").removesuffix(".py")
        yield _cells(f"`{module}` {row['function']}", _code(row["old"]), _code(row["new"]), row["reason"])


def _group_row(group: Mapping[str, Any]) -> str:
    tried, killed = group["tried"], _killed(group)
    files = ", ".join(f"`{file.removeprefix('companion/')}`" for file in group["files"])
    if not tried:
        return _cells(group["name"], files, str(group["made"]), "0", "", "", "", "not tried yet")
    low, high = wilson(killed, tried)
    return _cells(
        group["name"],
        files,
        str(group["made"]),
        str(tried),
        str(group["killed_quick"]),
        str(group["killed_slow"]),
        str(tried - killed),
        f"{100.0 * killed / tried:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})",
    )


def _killed(group: Mapping[str, Any]) -> int:
    return int(group["killed_quick"] + group["killed_slow"])


def _variance(group: Mapping[str, Any]) -> float:
    """Of a group's share, drawn without putting back."""
    share, tried, made = _killed(group) / group["tried"], group["tried"], group["made"]
    return share * (1.0 - share) / max(1, tried - 1) * (1.0 - tried / made)


def wilson(killed: int, tried: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson's score)."""
    share = killed / tried
    middle = (share + Z * Z / (2.0 * tried)) / (1.0 + Z * Z / tried)
    half = Z * math.sqrt(share * (1.0 - share) / tried + Z * Z / (4.0 * tried * tried)) / (1.0 + Z * Z / tried)
    return middle - half, middle + half


def _code(text: str) -> str:
    return f"`` {text} ``" if "`" in text else f"`{text}`" if text else "(nothing)"


def _cells(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
