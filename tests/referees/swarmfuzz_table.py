"""The section of docs/reference/referees.md that SwarmFuzz's attack has."""

from __future__ import annotations

from collections.abc import Sequence

from scipy.stats import binomtest

from tests.referees.referee import Row, words_of
from tests.referees.swarmfuzz import RADIOS, UNATTACKED

TITLE = "SwarmFuzz's attack"
THEIRS = "48.8 % (mean of all its settings)"


def section(flights: Sequence[Row], commit: str) -> str:
    """Its markdown: a row for each distance and size, those with range radios behind the others."""
    lines = [
        f"## {TITLE}",
        "",
        f"`python -m tests.referees swarmfuzz`, flight software of commit {commit}, missions "
        f"{words_of(flights, 'seed')}, the whole stack on point masses, estimates `{words_of(flights, 'estimates')}`. "
        "*Missions hit*: another vehicle than the attacked one collided under one of their attacks at least, with its "
        "interval at 95 %.",
        "",
        "| spoofed by | n | missions hit | attacks: others collided | the attacked alone collided | nobody collided | "
        "separation, m, worst |",
        "|---|---|---|---|---|---|---|",
        f"| 5 m, 10 m: theirs | 5, 10, 15 | {THEIRS} | | | | |",
    ]
    alike: dict[tuple[str, int], list[Row]] = {}
    for row in flights:
        alike.setdefault((_spoofed(row), row["n"]), []).append(row)
    for radios in ("", RADIOS):
        found = [key for key in alike if key[0].endswith(RADIOS) == bool(radios)]
        for spoofed, n in sorted(found, key=lambda key: (not key[0].startswith(UNATTACKED), len(key[0]), key)):
            lines.append(_line(spoofed, str(n), alike[spoofed, n]))
        attacked = [row for key in found if not key[0].startswith(UNATTACKED) for row in alike[key]]
        if attacked:
            lines.append(_line(f"all attacks{radios}", words_of(attacked, "n"), attacked))
    return "\n".join(lines) + "\n"


def _spoofed(row: Row) -> str:
    """`5 m`, `5 m, range radios`, `no attack`."""
    name = str(row["name"])
    return name.split(",")[0] + (RADIOS if name.endswith(RADIOS) else "")


def _line(spoofed: str, n: str, rows: Sequence[Row]) -> str:
    missions: dict[tuple[str, int, int], bool] = {}
    for row in rows:
        mission = (_spoofed(row), row["n"], row["seed"])
        missions[mission] = missions.get(mission, False) or row["grade"] == "others"
    hit = sum(missions.values())
    interval = binomtest(hit, len(missions)).proportion_ci(method="wilson")
    nearest = [row["min_separation_m"] for row in rows if row["min_separation_m"] is not None]
    cells = [
        spoofed,
        n,
        f"{hit} of {len(missions)} ({interval.low:.0%} to {interval.high:.0%})",
        *(str(sum(row["grade"] == grade for row in rows)) for grade in ("others", "own", "clear")),
        f"{min(nearest):.2f}" if nearest else "",
    ]
    return f"| {' | '.join(cells)} |"
