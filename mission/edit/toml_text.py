"""Changes of a mission's TOML text that leave all the rest of it, comments and order too, as it was."""

from __future__ import annotations

import contextlib
import copy
import tomllib
from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal

import tomlkit
from pydantic import BaseModel, ConfigDict, Field, JsonValue
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Array

from mission.common.problems import Path, dotted
from mission.document.locate import MAX_DEPTH
from mission.document.model import Mission
from mission.schema.json_schema import json_schema, node_at

Part = Annotated[str, Field(max_length=80)] | Annotated[int, Field(ge=0, le=10_000)]
# tomlkit's errors, and those of its insides on documents that it does not understand
_NOT_TAKEN: Final = (TOMLKitError, LookupError, TypeError, ValueError, AttributeError, AssertionError)


class Change(BaseModel):
    """Change at `path`: a key is set or removed; an item of an array is put in before what stands there, or removed.

    With the last item of an array its key goes, too.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    do: Literal["set", "insert", "remove"]
    path: Annotated[tuple[Part, ...], Field(min_length=1, max_length=MAX_DEPTH)]
    value: JsonValue = None


class ChangeError(Exception):
    """The document has no such place, or takes no such value; the message says which."""


def change_text(text: str, changes: Sequence[Change]) -> tuple[str, bool]:
    """The document with `changes`, and whether its comments are lost: where the library cannot keep them.

    ChangeError: one of `changes` does not fit, and none is made.
    """
    values = tomllib.loads(text)
    typed = [change.model_copy(update={"value": _typed(change.value, change.path)}) for change in changes]
    for change in typed:
        _change_values(values, change)
    for inline in (False, True):  # new tables under headers, or, where these would take in what follows, within a line
        with contextlib.suppress(*_NOT_TAKEN):
            document = tomlkit.parse(text if text.endswith("\n") or not text else f"{text}\n")
            for change in typed:
                _change_document(document, change, inline)
            changed = tomlkit.dumps(document)
            if tomllib.loads(changed) == values:
                return changed, False
    plain = tomlkit.dumps(values)
    if tomllib.loads(plain) != values:
        raise ChangeError("this change cannot be written into the file here: make it in a text editor")
    return plain, True


def _typed(value: Any, path: Path) -> Any:
    """JSON's numbers as TOML's: whole ones are floats, unless the schema wants an integer there."""
    if isinstance(value, list):
        return [_typed(item, (*path, index)) for index, item in enumerate(value)]
    if isinstance(value, dict):
        return {key: _typed(item, (*path, key)) for key, item in value.items()}
    if isinstance(value, bool) or not isinstance(value, int) or abs(value) >= 1 << 53:
        return value
    node = node_at(json_schema(Mission), path) or {}
    return value if node.get("type") == "integer" else float(value)


def _change_values(values: dict[str, Any], change: Change) -> None:
    """Makes `change` in plain values: what the document must hold afterwards. ChangeError."""
    at: Any = values
    above: Any = at
    *way, last = change.path
    for depth, part in enumerate(way):
        above = at
        if isinstance(at, dict) and isinstance(part, str) and part not in at:
            if change.do == "remove":
                return
            at[part] = [] if isinstance(change.path[depth + 1], int) else {}
        at = _inside(at, part, change.path)
    if isinstance(at, list) and isinstance(last, int):
        _change_list(at, last, change)
        if not at and isinstance(above, dict) and isinstance(way[-1], str):
            del above[way[-1]]
    elif isinstance(at, dict) and isinstance(last, str) and change.do != "insert":
        if change.do == "set":
            at[last] = _without_null(change)
        elif last in at:
            del at[last]
    else:
        raise ChangeError(f"{dotted(change.path)}: there is no such place")


def _change_list(items: list[Any], index: int, change: Change) -> None:
    if index > len(items) - (change.do != "insert"):
        raise ChangeError(f"{dotted(change.path)}: there is no such place")
    if change.do == "remove":
        del items[index]
    elif change.do == "insert":
        items.insert(index, _without_null(change))
    else:
        items[index] = _without_null(change)


def _without_null(change: Change) -> Any:
    def holds_null(value: Any) -> bool:
        inner = value if isinstance(value, list) else value.values() if isinstance(value, dict) else ()
        return value is None or any(map(holds_null, inner))

    if holds_null(change.value):
        raise ChangeError(f"{dotted(change.path)}: TOML has no null")
    return copy.deepcopy(change.value)


def _inside(at: Any, part: str | int, path: Path) -> Any:
    if isinstance(at, dict) and isinstance(part, str) and part in at:
        return at[part]
    if isinstance(at, list) and isinstance(part, int) and part < len(at):
        return at[part]
    raise ChangeError(f"{dotted(path)}: there is no such place")


# --- The same in tomlkit's document -----------------------------------------------------------------------------------


def _change_document(document: Any, change: Change, inline: bool) -> None:
    at = above = document
    *way, last = change.path
    for depth, part in enumerate(way):
        if isinstance(part, str) and part not in at:
            if change.do == "remove":
                return
            at[part] = _empty(isinstance(change.path[depth + 1], int), inline)
        above, at = at, at[part]
    if change.do == "remove":
        if isinstance(last, int):
            del at[last]
            if not at and way and isinstance(way[-1], str):
                del above[way[-1]]
        elif last in at:
            del at[last]
    elif change.do == "insert" and isinstance(last, int):
        at.insert(last, _table(change.value) if isinstance(at, AoT) else _within_line(change.value))
    elif isinstance(last, str) and isinstance(at.get(last), Array) and isinstance(change.value, list):
        _change_array(at[last], change.value)
    else:
        at[last] = change.value


def _empty(of_items: bool, inline: bool) -> Any:
    if of_items:
        return tomlkit.array() if inline else tomlkit.aot()
    return tomlkit.inline_table() if inline else tomlkit.table()


def _within_line(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    table = tomlkit.inline_table()
    table.update(value)
    return table


def _table(values: Any) -> Any:
    """A table of an array of tables, with an empty line after it."""
    table = tomlkit.table()
    for key, value in values.items():
        table[key] = value
    table.add(tomlkit.nl())
    return table


def _change_array(array: Any, wanted: list[Any]) -> None:
    """Only what differs: an array of several lines keeps them, and its comments."""
    first = next(
        (k for k, (a, b) in enumerate(zip(array, wanted, strict=False)) if a != b), min(len(array), len(wanted))
    )
    while len(array) > len(wanted):
        del array[first]
    while len(array) < len(wanted):
        array.insert(first, wanted[first])
        first += 1
    for index, value in enumerate(wanted):
        if array[index] != value:
            if isinstance(array[index], Array) and isinstance(value, list):
                _change_array(array[index], value)
            else:
                array[index] = value
