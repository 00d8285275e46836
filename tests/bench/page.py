"""docs/reference/figures.md: a section for each benchmark, with the day, the commit and the machine it is of."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from collections.abc import Sequence
from datetime import UTC, datetime

from tests.bench.table import Row

TABLE_HEAD = ("| what | wanted | seen | reached |", "|---|---|---|---|")
HEAD = """# Figures

`make bench` measures all of these and writes them here, `python -m tests.bench NAME --write FILE` one of them. Flights:
JSBSim, calm air, no radio loss; "worst" is over all the seeds named. What each figure of a flight means:
[metrics](metrics.md). Speed depends on the machine and on what else it does: only ratios of one run compare. Flights do
not depend on it.
"""


def section(name: str, rows: Sequence[Row]) -> str:
    """Of one benchmark, measured just now."""
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False)
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    when = f"{datetime.now(UTC):%Y-%m-%d}, commit {commit.stdout.strip() or 'unknown'}, {machine}"
    told = f"`python -m tests.bench {name}`: {when}, load average {os.getloadavg()[0]:.1f} at the end."
    return "\n".join([f"## {name}", "", told, "", *TABLE_HEAD, *map(str, rows), ""])


def with_section(page: str, name: str, new: str, order: Sequence[str]) -> str:
    """`page` with the section of `name` put in place of the old one. Sections that no benchmark makes come last."""
    sections = {text.partition("\n")[0]: f"## {text}" for text in re.split(r"^## ", page, flags=re.MULTILINE)[1:]}
    sections[name] = new
    ranks = {known: rank for rank, known in enumerate(order)}
    titles = sorted(sections, key=lambda title: ranks.get(title, len(ranks)))
    return "\n".join([HEAD, *(sections[title].rstrip() + "\n" for title in titles)])
