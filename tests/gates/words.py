"""Holds names, docstrings, messages and headings to the field's words: `python -m tests.gates.words`."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = ("mission", "companion", "sim_bridge")
GENERATED = ("companion/mavlink/dialect.py", "companion/mavlink/own_messages.py")

# A function says what it does to what: `update_peers`. `step` is the simulator's.
BARE_VERB = re.compile(r"ask|feel|find|follow|hear|keep|lay|look|own|read|say|see|step|take|tell")
STEP_FOLDERS = ("sim_bridge/world/", "sim_bridge/drive/")

RIDDLE = re.compile(r"(What|Whether|Which|One that|Those|Who|How|Where|That|Why|When)\b")

# Word in a name -> the field's word.
NAMES = {
    "faith": "lease freshness",
    "weave": "excitation",
    "wish": "desired velocity",
    "place_sd": "position_sd",
    "place_ned": "pos_ned_m",
    "place_lost": "position_uncertain",
    "place_unsure": "peer_uncertain",
    "kept_per_trunk": "trunk_attenuation_factor",
}
# Words in a message or a heading -> the field's words.
TEXTS = {
    "place lost": "position uncertain",
    "start place": "start position",
    "unsure where": "position uncertain",
    "no way on": "leader stuck",
    "looking for the others": "searching for lost peers",
    "not the majority behind": "no quorum",
    "That it does not happen": "Prevention",
    "Parts that lose one another": "Partition recovery",
    "Where it goes": "CPU profile",
    "What sounds": "Alarms",
    "After the rebuild": "what was measured",
    "hears satellites": "has a GNSS fix",
    "hears no satellite": "no GNSS fix",
    "satellites are heard": "satellites are received",
    "hear satellites": "receive satellites",
    "nobody here knows": "unknown",
    "contents refused": "messages with invalid values",
    "What is looked for": "Failure criteria",
    "Make a failure smaller": "Shrink a failure",
    "What is in the folder": "Results folder",
    "What is not shown": "Limitations",
    "What the autopilots said": "Messages",
    "What they flew": "Flights",
    "What the columns say": "Columns",
    "What is stable": "Stable interfaces",
    "Where next": "Documentation",
}

# FILE-OR-FOLDER:NAME, with the reason.
EXCEPTIONS = {
    "companion/mavlink/schema/tables/measurements.py:place_sd": "name on the wire: another is another CRC extra",
    "mission/document/renamed.py:place_lost": "old key, read for one version more",
    "sim_bridge/judge/page/replay.py:kept_per_trunk": "old key of a replay, written for one version more",
    "sim_bridge/lab/study/localise/:weave": "key of study files",
}


def problems(root: Path = ROOT) -> Iterator[str]:
    """Every name, text and heading that has another word in the field, and every docstring that opens with a riddle."""
    for package in SOURCES:
        for file in sorted((root / package).rglob("*.py")):
            name = file.relative_to(root).as_posix()
            if name not in GENERATED and "node_modules" not in file.parts:
                tree = ast.parse(file.read_text(encoding="utf-8"))
                yield from (problem for problem, word in _words(name, tree) if not _is_excepted(name, word))
                yield from _riddles(name, tree)
    for file in sorted([*root.glob("*.md"), *(root / "docs").rglob("*.md")]):
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1):
            for old, new in TEXTS.items():
                if line.startswith("#") and old in line:
                    yield f"{file.relative_to(root).as_posix()}:{number}: heading {old!r}; say {new!r}"


def _words(file: str, tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Each problem, and the word that it is about."""
    for node in ast.walk(tree):
        line = getattr(node, "lineno", 1)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            bare = node.name.strip("_")
            if BARE_VERB.fullmatch(bare) and not (bare == "step" and file.startswith(STEP_FOLDERS)):
                yield f"{file}:{line}: {node.name}(): a bare verb; say what it does to what", bare
        for text in _identifiers(node):
            for old, new in NAMES.items():
                if re.search(rf"(^|_){old}(_|$)", text.lower()):
                    yield f"{file}:{line}: name {text}; say {new}", old
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            for old, new in TEXTS.items():
                if old in node.value:
                    yield f"{file}:{line}: text {old!r}; say {new!r}", old
            if node.value in NAMES:
                yield f"{file}:{line}: name {node.value!r}; say {NAMES[node.value]}", node.value


def _identifiers(node: ast.AST) -> Iterator[str]:
    for attribute in ("name", "id", "attr", "arg"):
        text = getattr(node, attribute, None)
        if isinstance(text, str) and not isinstance(node, ast.Name | ast.Attribute):
            yield text  # where it is defined
        elif isinstance(text, str) and isinstance(getattr(node, "ctx", None), ast.Store):
            yield text


def _riddles(file: str, tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Module):
            text = ast.get_docstring(node)
            if text and RIDDLE.match(text):
                yield f"{file}:{getattr(node, 'lineno', 1)}: docstring {text[:40]!r} is a riddle; say what it is"


def _is_excepted(file: str, word: str) -> bool:
    return any(file.startswith(where) and word == name for where, name in (key.split(":") for key in EXCEPTIONS))


def main() -> int:
    found = list(problems())
    print("\n".join(found) or "names, messages and headings are in the field's words")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
