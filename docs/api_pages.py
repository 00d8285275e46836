"""The reference page of the Python API: signatures, fields and docstrings, read from the sources. For `generate.py`."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from flight_pages import NOTE

ROOT: Final = Path(__file__).parents[1]
EVERY: Final = "*"  # all that a module's __all__ names

# Heading -> what it is for, and the names; what is here is what docs/reference/stability.md calls stable.
SECTIONS: Final[dict[str, tuple[str, tuple[str, ...]]]] = {
    "Fly": (
        "`from sim_bridge import fly`: [how-to](../how-to/fly-from-python.md).",
        ("sim_bridge.library.fly", "sim_bridge.library.Result"),
    ),
    "Mission files": (
        "Keys are attributes of the tables: [mission files](mission.md).",
        (
            "mission.document.load.*",
            "mission.common.problems.MissionError",
            "mission.common.problems.Problem",
            "mission.document.model.Mission",
        ),
    ),
    "Beacons": (
        "For a program that listens to a swarm: [SWARM_BEACON](beacon.md).",
        ("companion.mavlink.beacon.beacons",),
    ),
    "A guidance law": (
        "Entry points `understory.laws`: [how-to](../how-to/fly-your-own-law.md).",
        (
            "sim_bridge.drive.entrant.law.GuidanceLaw",
            "sim_bridge.drive.entrant.view.View",
            "sim_bridge.drive.entrant.view.Peer",
        ),
    ),
    "A sensor": (
        "Entry points `understory.sensors` and `understory.simulated_sensors`: [how-to](../how-to/add-a-sensor.md).",
        (
            "companion.sensors.installed.Sensor",
            "companion.mavlink.sensor_source.SensorSource",
            "companion.mavlink.sensor_source.SensorTally",
            "companion.mavlink.sensor_source.Finding",
            "companion.core.model.events.ObstacleScan",
            "companion.core.model.events.Ranges",
            "sim_bridge.world.sensors.installed.SensorModel",
            "sim_bridge.world.airframe.state.AirframeState",
        ),
    ),
    "A make of autopilot": (
        "Entry points `understory.makes`: [how-to](../how-to/add-an-autopilot-make.md).",
        (
            "companion.mavlink.makes.make.Make",
            "companion.mavlink.makes.make.Rule",
            "companion.mavlink.makes.make.Aid",
            "companion.mavlink.makes.make.Altitude",
            "companion.core.model.states.AutopilotTraits",
            "companion.core.model.states.VelocityShaping",
        ),
    ),
}
EXTRAS: Final = {
    "sim": "`sim-bridge`: physics, figures, pages",
    "edit": "`mission edit`",
    "survey": "a companion that flies a mission with `[survey]`",
    "stand": "`companion stand`",
    "cluster": "`sim-bridge study --scheduler`, on several computers",
    "pandas": "`Result.frame()`",
    "rerun": "`sim-bridge export --rrd`",
    "ros2": "`sim-bridge export --ros2bag`",
    "zenoh": "`sim-bridge fly --zenoh`",
    "build": "compiling what runs in every tick",
    "dev": "tests and checks",
}
HEAD: Final = """\
What a program of yours may import. [Stable interfaces](stability.md) says what holds for how long; all else is
internal. The three packages `mission`, `companion` and `sim_bridge` have type hints (`py.typed`).

The name `understory-uav` is not published: install from the checkout, with the extras that are needed, as
`pip install -e '.[sim,pandas]'` in an environment of your own. `make install` makes one in `.venv` with `sim`.

| extra | for |
|---|---|"""


@dataclass(frozen=True, slots=True)
class Source:
    """A definition in a module's source."""

    module: str
    node: ast.ClassDef | ast.FunctionDef
    lines: list[str]


def api_page() -> Iterator[str]:
    """Every name of SECTIONS."""
    yield from ("# Python API", "", NOTE, "", HEAD)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    yield from (f"| `{name}` | {EXTRAS[name]} |" for name in extras)
    for title, (about, names) in SECTIONS.items():
        yield from ("", f"## {title}", "", about)
        for name in names:
            for source in _sources(name):
                yield from _definition(source)


def _sources(name: str) -> Iterator[Source]:
    module, _, wanted = name.rpartition(".")
    text = (ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")
    tree = ast.parse(text)
    nodes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef)}
    names = [one for one in _all_of(tree) if one in nodes] if wanted == EVERY else [wanted]
    for one in names:
        yield Source(module, nodes[one], text.splitlines())


def _all_of(tree: ast.Module) -> list[str]:
    (names,) = [
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__"
    ]
    return list(names)


def _definition(source: Source) -> Iterator[str]:
    node = source.node
    if isinstance(node, ast.FunctionDef):
        yield from ("", f"### {node.name}", "", "```python", f"from {_shown(source.module)} import {node.name}", "")
        yield from (_signature(node), "```", "", *_text(node))
        return
    yield from ("", f"### {node.name}", "", "```python", f"from {_shown(source.module)} import {node.name}", "```", "")
    yield from _text(node)
    fields = list(_fields(source))
    if fields:
        yield from ("", "| attribute | type | |", "|---|---|---|", *fields)
    methods = [one for one in node.body if isinstance(one, ast.FunctionDef) and not one.name.startswith("_")]
    if methods:
        yield ""
    yield from (f"- {_method(one)}: {' '.join(' '.join(_text(one)).split())}" for one in methods)


def _shown(module: str) -> str:
    return "sim_bridge" if module == "sim_bridge.library" else module


def _text(node: ast.ClassDef | ast.FunctionDef) -> list[str]:
    return (ast.get_docstring(node) or "").splitlines()


def _signature(node: ast.FunctionDef, first: int = 0) -> str:
    """Without `self` or `cls`, where `first` is 1."""
    arguments = ast.arguments(**{name: getattr(node.args, name) for name in node.args._fields})
    arguments.args = arguments.args[first:]
    returns = f" -> {ast.unparse(node.returns)}" if node.returns is not None else ""
    return f"{node.name}({ast.unparse(arguments)}){returns}"


def _method(node: ast.FunctionDef) -> str:
    marks = {getattr(mark, "id", "") for mark in node.decorator_list}
    if "property" in marks:
        returns = "" if node.returns is None else f", {ast.unparse(node.returns)}"
        return f"`{node.name}`{returns}"
    kind = "class method " if "classmethod" in marks else ""
    return f"{kind}`{_signature(node, 0 if 'staticmethod' in marks else 1)}`"


def _fields(source: Source) -> Iterator[str]:
    """Annotated attributes, with the comment behind each, and the value that it has by default."""
    for node in source.node.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id[0] != "_":
            comment = re.search(r"  # (.+)$", source.lines[(node.end_lineno or node.lineno) - 1])
            about = comment[1].partition(" noqa")[0] if comment else ""
            default = f" (`{ast.unparse(node.value)}`)" if node.value is not None else ""
            kind = ast.unparse(node.annotation).removeprefix("ClassVar[").replace("|", "\\|")
            kind = kind.removesuffix("]") if "ClassVar[" in ast.unparse(node.annotation) else kind
            yield f"| `{node.target.id}` | `{kind}`{default} | {about.replace('|', chr(92) + '|')} |"
