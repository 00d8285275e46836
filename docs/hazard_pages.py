"""Reference page of the hazards and their defences, of docs/hazards.toml. For `generate.py`."""

from __future__ import annotations

import ast
import functools
import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from flight_pages import NOTE

from companion.core.model.states import FlightState
from companion.core.safety.setpoint import CutReason
from companion.core.vehicle.failsafe import Cause
from mission.schema.kinds import FaultKind

ROOT = Path(__file__).parents[1]
HAZARDS = ROOT / "docs" / "hazards.toml"
FLOWN = ROOT / "docs" / "hazards_flown.json"
KEYS = {"hazard", "group", "otherwise", "defence", "code", "tests", "events", "measured", "lacks", "taken_out"}
COMPONENT_KEYS = {"name", "what", "ours", "code", "tests"}

ABOUT = """\
What can go wrong, or be done to a swarm; what would come of it; what stands against it, and where in the code; the
tests that hold it; and how often it came up where nobody had planned it, in flights that
[the search](../how-to/search-for-failures.md) drew. `make check` finds each name here in the tree, or fails.
*Taken out*: that piece of the defence was taken out, and one of the tests named failed (`make taken-out` does it
again). *Lacks*: what there is not, or not yet."""

FLOWN_ABOUT = """\
*In flight*: `{command}`, {flights} flights (seeds {first} to {last}, missions as drawn by version {version} of the
search; {grades}). `kill 9/8`: nine times, in eight of the flights. First what the search did to them, then what
companions did: a failsafe that decided, a limit that cut the setpoint, a state, a text; each counts when it begins, for
each vehicle. A frame that the radio's guard refused counts by itself. A 0 says that it did not come up there, so of
that defence these flights say nothing. Half of them have keys, half an attacker; what is measured elsewhere besides,
says where."""

F3269 = """\
## Run-time assurance: ASTM F3269

The practice ASTM F3269-21 (*Methods to Safely Bound Behavior of Aircraft Systems Containing Complex Functions Using
Run-Time Assurance*) describes a system whose complex function needs no assurance of its own, because assured components
bound it. By its public scope and by what has been published about it (the text itself was not at hand) these are its
components, in our words, beside ours:"""

NO_MATCH = """\
What does not correspond:

- **No assurance level.** The practice has components built to a level that a safety assessment gives. None was made
  here: tests, properties and the search are what there is. No conformity is claimed.
- **No switch in the filter.** It projects a velocity into what is allowed, so complex function and recovery blend; a
  switch, in the sense of the practice, is the table of failsafes alone.
- **One computer.** Complex function, monitor and recovery are one process, one loop: what ends it ends all three. That
  is wanted, as setpoints then stop, and the autopilot, a computer of its own, holds by its own failsafe: the outermost
  recovery is not ours, and its parameters are checked before each flight.
- **The boundary is partly others' word.** Where neighbours are is what they say, within what is seen. So a word can
  only restrict ([trust](#trust-strangers)).
- **No person** is counted on as a recovery function, as the practice allows: a pilot is above all of it.
- **Coverage of the boundary** is shown by properties over drawn inputs and by flights, not by proof."""


class HazardsError(Exception):
    """docs/hazards.toml names what there is not."""


def hazards_page() -> Iterator[str]:
    """Hazards by group, then the components of run-time assurance. HazardsError names all that does not resolve."""
    table = tomllib.loads(HAZARDS.read_text(encoding="utf-8"))
    flown = json.loads(FLOWN.read_text(encoding="utf-8"))
    problems = list(find_problems(table, flown))
    if problems:
        raise HazardsError("\n".join(f"docs/hazards.toml: {problem}" for problem in problems))
    yield from ("# Hazards and defences", "", NOTE, "", ABOUT, "")
    grades = ", ".join(f"{count} {grade}" for grade, count in flown["grades"].items())
    last = flown["first_seed"] + flown["flights"] - 1
    yield FLOWN_ABOUT.format(
        command=flown["command"],
        flights=flown["flights"],
        first=flown["first_seed"],
        last=last,
        version=flown["search_version"],
        grades=grades,
    )
    for group in dict.fromkeys(row["group"] for row in table["hazard"]):
        yield from ("", f"## {group}", "", "| hazard | without a defence | defence | held by | in flight |")
        yield "|---|---|---|---|---|"
        for row in table["hazard"]:
            if row["group"] == group:
                yield _hazard(row, flown["events"])
    yield from ("", F3269, "", "| component | | here | code | held by |", "|---|---|---|---|---|")
    for row in table["component"]:
        yield _cells(row["name"], row["what"], row["ours"], _code(row["code"]), _tests(row["tests"]))
    yield from ("", NO_MATCH)


def _hazard(row: Mapping[str, Any], events: Mapping[str, Sequence[int]]) -> str:
    held = _tests(row["tests"]) + ("; *taken out*" if "taken_out" in row else "")
    counted = ", ".join(_counted(event, events) for event in row.get("events", ()))
    lacks = f"lacks: {row['lacks']}" if "lacks" in row else ""
    seen = "; ".join(part for part in (counted, row.get("measured", ""), lacks) if part) or "not counted"
    return _cells(row["hazard"], row["otherwise"], f"{row['defence']}: {_code(row['code'])}", held, seen)


def _counted(event: str, events: Mapping[str, Sequence[int]]) -> str:
    flights, times = events.get(event, (0, 0))
    kind, _, name = event.partition(": ")
    shown = name if kind in ("fault", "failsafe") else event
    return f"`{shown}` {times}/{flights}" if times else f"`{shown}` 0"


def _cells(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _code(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _tests(names: Sequence[str]) -> str:
    """A link to its file for each, in the words of its name."""
    links = []
    for name in names:
        file, _, function = name.partition("::")
        links.append(f"[{function.removeprefix('test_').replace('_', ' ')}](../../tests/{file})")
    return "; ".join(links)


# --- does all of it exist ---------------------------------------------------------------------------------------------


def find_problems(table: Mapping[str, Any], flown: Mapping[str, Any]) -> Iterator[str]:
    """Names that do not resolve, keys that are none, texts to be taken out that do not stand there once."""
    for rows, title, known in (("hazard", "hazard", KEYS), ("component", "name", COMPONENT_KEYS)):
        for row in table[rows]:
            at = f"{row[title]!r}"
            yield from (f"{at}: {key}: is no key" for key in row.keys() - known)
            yield from (f"{at}: {name}: is not in the code" for name in row["code"] if not _is_defined(name))
            yield from (f"{at}: {name}: is no test" for name in row["tests"] if not _is_test(name))
            yield from (f"{at}: {one}: is no event" for one in row.get("events", ()) if not _is_event(one))
            out = row.get("taken_out")
            if out is not None and (ROOT / out["file"]).read_text(encoding="utf-8").count(out["old"]) != 1:
                yield f"{at}: {out['old']!r} does not stand once in {out['file']}"
    if not flown["flights"]:
        yield "no flight was counted"


@functools.cache
def _tree(file: Path) -> ast.Module | None:
    return ast.parse(file.read_text(encoding="utf-8")) if file.is_file() else None


def _is_defined(name: str) -> bool:
    """`module:Name.name`: a class, a function, or what is assigned in a class."""
    module, _, path = name.partition(":")
    body: list[ast.stmt] = []
    tree = _tree(ROOT / f"{module.replace('.', '/')}.py")
    if tree is None or not path:
        return False
    body = tree.body
    for part in path.split("."):
        found = next((node for node in body if part in _names(node)), None)
        if found is None:
            return False
        body = found.body if isinstance(found, ast.ClassDef) else []
    return True


def _names(node: ast.stmt) -> list[str]:
    match node:
        case ast.ClassDef(name=name) | ast.FunctionDef(name=name):
            return [name]
        case ast.Assign(targets=targets):
            return [target.id for target in targets if isinstance(target, ast.Name)]
        case ast.AnnAssign(target=ast.Name(id=name)):
            return [name]
    return []


def _is_event(name: str) -> bool:
    """One that tests/bench/defences.py may count. A text: its longest part without a number is said by a companion."""
    kind, _, what = name.partition(": ")
    match kind:
        case "fault":
            return what in {fault.value for fault in FaultKind}
        case "failsafe":
            return what in {cause.name.lower() for cause in Cause}
        case "state":
            return what in {state.name.lower() for state in FlightState}
        case "cut":
            return what in {reason.value for reason in CutReason}
        case "refused":
            return f'"{what}"' in _companion_source()
        case "text":
            return max(re.split("vehicle #|[#:]", what), key=len).strip() in _companion_source()
    return kind in ("dropped", "own motion")


@functools.cache
def _companion_source() -> str:
    return "".join(file.read_text(encoding="utf-8") for file in sorted((ROOT / "companion").rglob("*.py")))


def _is_test(name: str) -> bool:
    """`file::test_function`, of pytest's kind: a function of the module, or of a class in it."""
    file, _, function = name.partition("::")
    tree = _tree(ROOT / "tests" / file)
    if tree is None or not function.startswith("test_"):
        return False
    return any(isinstance(node, ast.FunctionDef) and node.name == function for node in ast.walk(tree))
