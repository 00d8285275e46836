"""Values in, a checked model or every problem at once out: between pydantic's errors and people."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from mission.common.problems import (
    MAX_KEY_CHARS,
    MAX_PROBLEMS,
    MissionError,
    Path,
    Problem,
    dotted,
    lookup,
    printable,
    shown,
)
from mission.schema.conflict import TREES, Conflict, ConflictError, path_of
from mission.schema.json_schema import Node, allowed, json_schema, node_at, resolved

Model = TypeVar("Model", bound=BaseModel)
CLOSE = 0.55  # a key of the same table is meant that is as like: range_m and reach_m are to 0.57
LineOf = Callable[[Path], int | None]
Finding = tuple[int | None, Path, ErrorDetails | Conflict]


def no_line(_path: Path) -> None:
    """For values that come from no file."""


def validated(model: type[Model], values: Mapping[str, Any], place: str, line_of: LineOf = no_line) -> Model:
    """`values` as a `model`, or MissionError with every problem, in the order of their lines.

    The conflicts between fields are found even while other fields are refused, except where those take part.
    `line_of` gives the line of a path, and for what is not there the line of the table that lacks it.
    """
    tame = {key: _tame(value) for key, value in values.items()}
    for key, field in model.model_fields.items():  # rather than "route is missing": which keys it needs
        if field.is_required() and isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            tame.setdefault(field.alias or key, {})
    try:
        return model.model_validate(tame)
    except ValidationError as error:
        details = error.errors(include_url=False, include_input=False)
    schema = json_schema(model)  # only now: it takes as long as all the rest
    conflicts = _conflicts(details)
    faults = {
        _blamed(detail): detail
        for detail in reversed(details)
        if not _is_conflict(detail) and not _is_echo(detail, values, details)
    }
    if faults:
        conflicts = _conflicts_beside(model, schema, tame, list(faults))

    found: list[Finding] = [(line_of(path), path, detail) for path, detail in reversed(faults.items())]
    found += [(line_of(_anchor(c, values)), c.paths[0], c) for c in conflicts]
    found.sort(key=lambda finding: finding[0] or 0)
    raise MissionError(_worded(found, schema, values, place))


def problem_of(found: Conflict, values: Mapping[str, Any], place: str, line_of: LineOf) -> Problem:
    """A conflict of a mission that is valid, in words; `values` and `line_of` as for `validated`."""
    return Problem(place, line_of(_anchor(found, values)), dotted(found.paths[0]), found.value, found.message)


def _worded(found: list[Finding], schema: Node, values: Mapping[str, Any], place: str) -> Iterator[Problem]:
    """The first MAX_PROBLEMS in words: a hostile file has ten thousand, and texts take time."""
    for line, path, fault in found[:MAX_PROBLEMS]:
        if isinstance(fault, Conflict):
            yield Problem(place, line, dotted(path), fault.value, fault.message)
        else:
            requirement = _requirement(schema, path, fault)
            yield Problem(place, line, dotted(path), _written(values, path), requirement)
    if len(found) > MAX_PROBLEMS:
        yield Problem(place, None, "", "", f"and {len(found) - MAX_PROBLEMS} more problems")


def _written(values: Mapping[str, Any], path: Path) -> str:
    try:
        return shown(lookup(values, path))
    except KeyError:
        return ""


def _tame(value: Any) -> Any:
    """Integers that TOML does not promise become inf: pydantic raises ValueError beyond 4300 digits."""
    match value:
        case bool():
            return value
        case int() if value.bit_length() > 64:
            return math.inf
        case Mapping():
            return {key: _tame(item) for key, item in value.items()}
        case list() | tuple():
            return [_tame(item) for item in value]
        case _:
            return value


def _is_conflict(detail: ErrorDetails) -> bool:
    return isinstance(detail.get("ctx", {}).get("error"), ConflictError)


def _is_echo(detail: ErrorDetails, values: Mapping[str, Any], details: list[ErrorDetails]) -> bool:
    """True if another fault is what is wrong.

    An array is too short only as pydantic counts it: without the items refused by themselves. A point of the route is
    missing only as its tree, or the stem map, is refused.
    """
    tree = TREES.get(".".join(map(str, detail["loc"])))
    if detail["type"] == "missing" and tree is not None:
        return any(tuple(other["loc"][:2]) in (path_of(tree), ("forest", "file")) for other in details)
    if detail["type"] != "too_short":
        return False
    array = lookup(values, tuple(detail["loc"]))
    return isinstance(array, list | tuple) and len(array) >= detail["ctx"]["min_length"]


def _conflicts(details: list[ErrorDetails]) -> tuple[Conflict, ...]:
    for detail in details:
        error = detail.get("ctx", {}).get("error")
        if isinstance(error, ConflictError):
            return error.conflicts
    return ()


def _blamed(detail: ErrorDetails) -> Path:
    """The path that a fault is reported at: an array that is too short, not the item that it lacks.

    Of a key that may not be one, what stands there: pydantic puts "[key]" behind it.
    """
    path: Path = tuple(detail["loc"])
    if detail["type"] == "value_error" and path[-1:] == ("[key]",):
        return path[:-1]
    return path[:-1] if detail["type"] == "missing" and isinstance(path[-1], int) else path


def _requirement(schema: Node, path: Path, detail: ErrorDetails) -> str:
    error = detail.get("ctx", {}).get("error")
    if isinstance(error, ValueError):  # from a validator of ours
        return str(error)
    if detail["type"] == "extra_forbidden":
        return f"unknown key; {_meant(schema, path)}"
    node = node_at(schema, path)
    requirement = f"must be {allowed(schema, node)}" if node is not None else str(detail["msg"])
    absent = detail["type"] == "missing" and path == detail["loc"]
    return f"missing; {requirement}" if absent else requirement


def _meant(schema: Node, path: Path) -> str:
    """Suggests what to write instead of the unknown key at `path`."""
    name = printable(str(path[-1]), MAX_KEY_CHARS)
    parent = node_at(schema, path[:-1])
    here = list(parent.get("properties", ())) if parent else []
    close = difflib.get_close_matches(name, here, n=1, cutoff=CLOSE)
    if close:
        return f"did you mean {close[0]}?"
    for table, node in schema["properties"].items():
        if name in resolved(schema, node).get("properties", ()):
            return f"did you mean {table}.{name}?"
    return f"allowed here: {', '.join(here)}"


def _anchor(conflict: Conflict, values: Mapping[str, Any]) -> Path:
    """The first of the conflict's paths that is written down: the others are defaults and have no line."""
    for path in conflict.paths:
        try:
            lookup(values, path)
        except KeyError:
            continue
        return path
    return conflict.paths[0]


def _conflicts_beside(
    model: type[BaseModel], schema: Node, values: Mapping[str, Any], refused: list[Path]
) -> tuple[Conflict, ...]:
    """Conflicts among the valid fields: the others are replaced, and what involves them is left out.

    So is what comes of a key's absence alone: it is not found where the key has the example in its description.
    """
    keys = {path[:2] for path in refused}
    repaired = _without(values, keys)
    _fill(schema, schema, repaired)
    found = _conflicts_of(model, repaired) or ()
    for key in keys:
        node = node_at(schema, key) or {}
        if len(key) == 2 and "examples" in node and isinstance(repaired.get(str(key[0])), dict):
            repaired[str(key[0])][str(key[1])] = node["examples"][0]
    beside = _conflicts_of(model, repaired)
    found = found if beside is None else tuple(c for c in found if c in beside)
    return tuple(c for c in found if not any(path[:1] in keys or path[:2] in keys for path in c.paths))


def _conflicts_of(model: type[BaseModel], values: Mapping[str, Any]) -> tuple[Conflict, ...] | None:
    """Conflicts of values that are valid; None: they are not."""
    try:
        model.model_validate(values)
    except ValidationError as error:
        return _conflicts(error.errors(include_url=False, include_input=False)) or None
    return ()


def _without(values: Mapping[str, Any], keys: set[Path]) -> dict[str, Any]:
    kept: dict[str, Any] = {}
    for name, value in values.items():
        if (name,) in keys:
            continue
        table = isinstance(value, Mapping)
        kept[name] = {k: v for k, v in value.items() if (name, k) not in keys} if table else value
    return kept


def _fill(schema: Node, node: Node, table: dict[str, Any]) -> None:
    """Give what is required and absent the example in its description."""
    for name, child in node["properties"].items():
        child = {**resolved(schema, child), **child}
        if name not in table and name in node.get("required", ()):
            table[name] = child["examples"][0] if "examples" in child else {}
        if "properties" in child and isinstance(table.get(name), dict):
            _fill(schema, child, table[name])
