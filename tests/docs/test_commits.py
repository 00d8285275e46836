"""Commits that the documentation names are in this history: a reader can look at what was flown, and what changed."""

from __future__ import annotations

import re
import subprocess
from bisect import bisect_left
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = ("*.md", "docs/**/*.md", "tests/testdata/found/*.toml")
# Traces, fingerprints and checksums look alike: a commit is what stands behind one of these words, or behind another.
NAMED = re.compile(
    r"\b(?:commits?|at|before|since|until|after)\s+\(?`?([0-9a-f]{7,40}\b(?:(?:,| and| to) [0-9a-f]{7,40}\b)*)",
    re.IGNORECASE,
)
HASH = re.compile(r"[0-9a-f]{7,40}")
OTHERS = {"b9b6e63"}  # of the UAV Testing Competition's repository


def named_in(text: str) -> list[str]:
    """Commits that a text names; a number or a word is none."""
    found = [one for many in NAMED.findall(text) for one in HASH.findall(many)]
    return [one for one in found if not one.isdecimal() and not one.isalpha() and one not in OTHERS]


def git(*words: str) -> str:
    try:
        done = subprocess.run(["git", "-C", ROOT, *words], capture_output=True, text=True, check=False, timeout=60)
    except FileNotFoundError:
        pytest.skip("no git")
    if done.returncode:
        pytest.skip("no clone")
    return done.stdout


@pytest.fixture(scope="module")
def history() -> list[str]:
    if git("rev-parse", "--is-shallow-repository").strip() != "false":
        pytest.skip("a shallow clone: git fetch --unshallow looks at the commits that the documentation names")
    return sorted(git("rev-list", "HEAD").split())


def pages() -> Iterator[Path]:
    for pattern in PAGES:
        yield from sorted(ROOT.glob(pattern))


def test_every_commit_that_is_named_is_in_this_history(history: list[str]) -> None:
    named = {(one, page) for page in pages() for one in named_in(page.read_text(encoding="utf-8"))}
    assert len(named) > 50
    unknown = [f"{page.relative_to(ROOT)}: {one}" for one, page in sorted(named) if not is_in(history, one)]
    assert unknown == []


def is_in(history: list[str], short: str) -> bool:
    at = bisect_left(history, short)
    return at < len(history) and history[at].startswith(short)


@pytest.mark.parametrize(
    ("text", "commits"),
    [
        ("flown at 4057b337, (commit `cf42559c`)", ["4057b337", "cf42559c"]),
        ("commits fac087f, d5abdd2), since\n62f8e5b", ["fac087f", "d5abdd2", "62f8e5b"]),
        ("commits 3059ba6 to f466463", ["3059ba6", "f466463"]),
        ("traces 32b7fd9e, sha256 91408411a92c, at 2000000, before deadbeef, at 0.2", []),
        ("snippets/good_tests at commit b9b6e63", []),
    ],
)
def test_a_commit_is_told_from_a_trace_and_a_number(text: str, commits: list[str]) -> None:
    assert named_in(text) == commits
