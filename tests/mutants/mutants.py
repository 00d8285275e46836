"""Tries mutants of the modules that people stand under: `make mutants`.

mutmut makes them in a copy of the tree, and tries a drawn sample of each group by its quick tests; what survives, or
was reached by none of them, is tried again by the slow ones. What survives both stands in docs/mutants.toml, with a
reason that somebody has written; reasons are kept as long as the mutant is the same.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import fnmatch
import json
import os
import random
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from tests.mutants.copy_of_tree import ROOT, Copy
from tests.mutants.groups import GROUPS, Group

TABLE: Final = ROOT / "docs" / "mutants.toml"
KILLED: Final = (1, 3, 37)  # exit codes as mutmut keeps them: a test failed
TIMED_OUT: Final = (24, 36, 152, 255, -24, -9)
SLOW_LIMIT_S: Final = 400.0
CONTEXT: Final = 40


@dataclass(frozen=True, slots=True)
class Survivor:
    """A change that no test notices."""

    file: str
    function: str
    old: str
    new: str

    def table(self, reason: str) -> str:
        """As in docs/mutants.toml."""
        pairs = {"file": self.file, "function": self.function, "old": self.old, "new": self.new, "reason": reason}
        return "\n[[survivor]]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in pairs.items())


@dataclass(frozen=True, slots=True)
class Tally:
    """A group's sample."""

    group: Group
    made: int
    tried: int
    quick: int  # killed by the quick tests
    slow: int
    survivors: tuple[Survivor, ...]

    def table(self) -> str:
        """As in docs/mutants.toml."""
        counts = {"made": self.made, "tried": self.tried, "killed_quick": self.quick, "killed_slow": self.slow}
        lines = "".join(f"{key} = {value}\n" for key, value in counts.items())
        return f"\n[[group]]\nname = {json.dumps(self.group.name)}\nfiles = {json.dumps(self.group.files)}\n{lines}"


class Mutants:
    """In a copy of the tree. `mutmut`: a Python that has it."""

    def __init__(self, copy: Copy, mutmut: str) -> None:
        self._copy, self._mutmut = copy, mutmut
        self.made = copy.folder / "mutants"
        quick = list(dict.fromkeys(test for group in GROUPS for test in group.quick))
        config = {
            "source_paths": ["companion"],
            "only_mutate": [pattern for group in GROUPS for pattern in group.files],
            "pytest_add_cli_args_test_selection": quick,
            "also_copy": ["mission", "sim_bridge", "tests", "docs", "CHANGELOG.md", "Makefile"],
        }
        with (copy.folder / "pyproject.toml").open("a", encoding="utf-8") as file:
            file.write("\n[tool.mutmut]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in config.items()))

    def run(self, names: Sequence[str], jobs: int) -> None:
        """Make all, and try these, so many at a time. CalledProcessError."""
        env = {key: value for key, value in self._copy.env.items() if key != "PYTHONPATH"}
        command = [self._mutmut, "-m", "mutmut", "run", "--max-children", str(jobs), *names]
        subprocess.run(command, cwd=self._copy.folder, env=env, check=True, stdout=sys.stderr)

    def codes(self, group: Group) -> dict[str, int | None]:
        """Exit code of each mutant of a group; None: not tried."""
        found: dict[str, int | None] = {}
        for meta in sorted(self.made.glob("companion/**/*.py.meta")):
            file = meta.relative_to(self.made).as_posix().removesuffix(".meta")
            if any(fnmatch.fnmatch(file, pattern) for pattern in group.files):
                found |= json.loads(meta.read_text(encoding="utf-8"))["exit_code_by_key"]
        return dict(sorted(found.items()))

    def is_noticed(self, name: str, tests: Sequence[str]) -> bool:
        """One of these tests fails, or does not end. `name`: empty: without a mutant."""
        env = self._copy.env | {"PYTHONPATH": str(self.made), "MUTANT_UNDER_TEST": name}
        command = [self._mutmut, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
        try:
            done = subprocess.run(
                command, cwd=self.made, env=env, capture_output=True, timeout=SLOW_LIMIT_S, check=False
            )
        except subprocess.TimeoutExpired:
            return True
        return done.returncode != 0

    def survivor(self, name: str) -> Survivor:
        """The change that a mutant is, by the two functions in the file that mutmut has made."""
        module, _, mangled = name.rpartition(".")
        file = f"{module.replace('.', '/')}.py"
        source = (self.made / file).read_text(encoding="utf-8")
        stem = mangled.rpartition("__mutmut_")[0]
        lines = {
            node.name: ast.unparse(node).replace(node.name, stem).splitlines()
            for node in ast.walk(ast.parse(source))
            if isinstance(node, ast.FunctionDef) and node.name in (mangled, f"{stem}__mutmut_orig")
        }
        changes = list(difflib.ndiff(lines[f"{stem}__mutmut_orig"], lines[mangled]))
        old, new = ([line[2:].strip() for line in changes if line.startswith(sign)] for sign in ("- ", "+ "))
        function = stem.removeprefix("x_").removeprefix("xǁ").replace("ǁ", ".")
        return Survivor(file, function, *cut_alike(" ".join(old), " ".join(new)))


def cut_alike(old: str, new: str) -> tuple[str, str]:
    """Both without what is the same before and behind, but for CONTEXT characters of it."""
    ahead = _count_alike(old, new)
    behind = _count_alike(old[ahead:][::-1], new[ahead:][::-1])
    start, end = max(0, ahead - CONTEXT), max(0, behind - CONTEXT)
    first, last = "..." if start else "", "..." if end else ""
    return f"{first}{old[start : len(old) - end]}{last}", f"{first}{new[start : len(new) - end]}{last}"


def _count_alike(one: str, other: str) -> int:
    """Characters at their beginnings."""
    pairs = zip(one, other, strict=False)
    return next((count for count, (a, b) in enumerate(pairs) if a != b), min(len(one), len(other)))


def draw_names(group: Group, made: Sequence[str], each: int, seed: int) -> list[str]:
    """The sample of a group: all of them where there are no more."""
    return sorted(random.Random(f"{seed} {group.name}").sample(sorted(made), min(each, len(made))))


def tallies(mutants: Mutants, each: int, seed: int, jobs: int) -> Iterator[Tally]:
    """Each group's, after all have been tried by the quick tests."""
    mutants.run(["companion.core.safety.clearance*"], jobs)  # makes those of all files
    drawn = {group.name: draw_names(group, list(mutants.codes(group)), each, seed) for group in GROUPS}
    mutants.run([name for names in drawn.values() for name in names], jobs)
    for group in GROUPS:
        codes = mutants.codes(group)
        names = drawn[group.name]
        # what crashed in a way that mutmut does not know is for the slow tests, too
        left = [name for name in names if codes[name] not in (*KILLED, *TIMED_OUT)]
        if left and mutants.is_noticed("", group.slow):
            raise RuntimeError(f"{group.name}: a slow test fails without a mutant, too")
        with ThreadPoolExecutor(jobs) as pool:
            noticed = list(pool.map(partial(mutants.is_noticed, tests=group.slow), left))
        survivors = [mutants.survivor(name) for name, is_noticed in zip(left, noticed, strict=True) if not is_noticed]
        print(f"{group.name}: {len(survivors)} of {len(left)} survive the slow tests", file=sys.stderr, flush=True)
        quick = len(names) - len(left)
        yield Tally(group, len(codes), len(names), quick, len(left) - len(survivors), tuple(survivors))


def known_reasons(table: Mapping[str, Any]) -> dict[Survivor, str]:
    """Reasons that were written, by survivor."""
    return {
        Survivor(row["file"], row["function"], row["old"], row["new"]): row["reason"]
        for row in table.get("survivor", ())
    }


def main(argv: Sequence[str]) -> int:
    """Writes docs/mutants.toml; exit code 1 when a survivor has no reason yet."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants mutants", description=__doc__)
    parser.add_argument("--each", type=int, default=120, metavar="N", help="mutants of each group (120)")
    parser.add_argument("--seed", type=int, default=25, metavar="S", help="of the sample (25)")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="mutants at once (2)")
    parser.add_argument("--python", default=sys.executable, metavar="PATH", help="one that has mutmut (this one)")
    args = parser.parse_args(argv)
    reasons = known_reasons(tomllib.loads(TABLE.read_text(encoding="utf-8"))) if TABLE.exists() else {}
    python = os.path.abspath(args.python)
    with tempfile.TemporaryDirectory() as folder:
        found = list(tallies(Mutants(Copy(Path(folder) / "tree"), python), args.each, args.seed, args.jobs))
    text = "# Written by `make mutants`; only reasons and note are by hand.\n\n"
    text += f'each = {args.each}\nseed = {args.seed}\nnote = ""\n'
    text += "".join(tally.table() for tally in found)
    survivors = sorted(
        {survivor for tally in found for survivor in tally.survivors},
        key=lambda one: (one.file, one.function, one.old, one.new),
    )
    text += "".join(survivor.table(reasons.get(survivor, "")) for survivor in survivors)
    TABLE.write_text(text, encoding="utf-8")
    open_ones = [survivor for survivor in survivors if not reasons.get(survivor)]
    for tally in found:
        print(f"{tally.group.name}: {tally.quick + tally.slow} of {tally.tried} killed, of {tally.made} made")
    print(f"{len(survivors)} survive, {len(open_ones)} of them without a reason in docs/mutants.toml")
    return 1 if open_ones else 0
