"""A mission file in, a checked Mission or every problem with its line out; and back.

A file comes from a person, a radio or an attacker: whatever it holds, the only exception is MissionError.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import tomllib
from collections.abc import Mapping
from typing import Any, NamedTuple

from mission.common.files import MAX_PLACE_CHARS, decoded, read_bytes, refused
from mission.common.problems import MissionError, Path, Problem, printable
from mission.document.locate import MAX_DEPTH, TooMuchError, locate
from mission.document.model import Mission
from mission.document.renamed import rename_keys
from mission.document.tree_points import place_trees
from mission.schema.check import LineOf, validated

__all__ = [
    "MAX_FILE_BYTES",
    "MAX_PLACE_CHARS",
    "Document",
    "MissionError",
    "Problem",
    "dump_mission",
    "load_mission",
    "load_with_source",
    "mission_sha256",
    "parse_mission",
]

MAX_FILE_BYTES = 64 * 1024
# A line of a key file (`companion key`), also of one that was cut off
_SECRET = re.compile(r"""^[ \t]*(seed|[0-9]+)[ \t]*=[ \t]*["'][0-9A-Fa-f]{16}""", re.MULTILINE)
OF_STUDIES = ("missions", "localise")  # keys that each study has one of
STEM_SUFFIXES = (".csv", ".geojson", ".json", ".gpkg")
MANY = 50  # tables of an array: more are written on a line each, or 700 trees would not fit into a file
_TOML_PLACE = re.compile(r"(?s)(.*) \(at (?:line (\d+), column (\d+)|end of document)\)")
_ENDLESS_NUMBER = re.compile(r"[0-9][0-9_]{4000}")  # Python refuses to read an integer of more than 4300 digits


class Document(NamedTuple):
    """A file's values, its name, and where each key stands: what `validated` takes."""

    values: dict[str, Any]
    place: str
    line_of: LineOf


def load_mission(path: str | os.PathLike[str]) -> Mission:
    """The mission in the TOML file `path`, or MissionError with every problem of the file."""
    return load_with_source(path)[0]


def load_with_source(path: str | os.PathLike[str]) -> tuple[Mission, bytes]:
    """The mission as `load_mission` has it, and the file's bytes that it was read from."""
    place = printable(os.fsdecode(path), MAX_PLACE_CHARS)
    _check_name(path, place)
    data = read_bytes(path, place, MAX_FILE_BYTES)
    document = _decode(data, place, path)
    check_kind(document)
    return validated(Mission, *document), data


def check_kind(document: Document) -> None:
    """MissionError: it is a study, rather than that each of its keys is unknown."""
    if "route" not in document.values and not document.values.keys().isdisjoint(OF_STUDIES):
        raise refused(document.place, None, "is a study, and no mission: `sim-bridge study` flies it")


def load_document(path: str | os.PathLike[str]) -> Document:
    """Of any TOML file of ours. MissionError."""
    place = printable(os.fsdecode(path), MAX_PLACE_CHARS)
    _check_name(path, place)
    return _decode(read_bytes(path, place, MAX_FILE_BYTES), place, path)


def parse_document(text: str, path: str | os.PathLike[str]) -> Document:
    """Of what is to stand in the file `path`, beside which its stem map is. MissionError."""
    return _parse(text, printable(os.fsdecode(path), MAX_PLACE_CHARS), os.path.dirname(os.fsdecode(path)))


def _check_name(path: str | os.PathLike[str], place: str) -> None:
    """A stem map in the place of a mission is told so, and not what of it is no TOML."""
    if os.fsdecode(path).lower().endswith(STEM_SUFFIXES):
        begin = f"`mission edit new.toml --stems {place}` begins one that flies in it"
        raise refused(place, None, f"is a stem map by its name, and a mission is a .toml: {begin}")


def _decode(data: bytes, place: str, path: str | os.PathLike[str]) -> Document:
    return _parse(decoded(data, place), place, os.path.dirname(os.fsdecode(path)))


def mission_sha256(path: str | os.PathLike[str]) -> str:
    """SHA-256 of the file `path`, in hexadecimal, as sha256sum prints it; MissionError when it cannot be read."""
    place = printable(os.fsdecode(path), MAX_PLACE_CHARS)
    return hashlib.sha256(read_bytes(path, place, MAX_FILE_BYTES)).hexdigest()


def parse_mission(text: str, place: str = "mission") -> Mission:
    """The mission in the TOML document `text`. MissionError names `place` as the file."""
    return validated(Mission, *_parse(text, place))


def _parse(text: str, place: str, folder: str | None = None) -> Document:
    if _SECRET.search(text) is not None:  # before anything of it may be shown
        raise refused(place, None, "is a key file, and no mission: nothing of it is shown")
    try:
        lines = locate(text)
    except TooMuchError as error:
        raise refused(place, error.line, str(error)) from None
    values = parse_toml(text, place)
    rename_keys(values, lines, place)
    place_trees(values, lines, place, folder)

    def line_of(path: Path) -> int:
        while path and path not in lines:
            path = path[:-1]
        return lines.get(path, 1)

    return Document(values, place, line_of)


def dump_mission(mission: Mission, *, all_keys: bool = True) -> str:
    """`mission` as a TOML document with every value written out; loads back equal.

    all_keys: False leaves out those that the mission was made without.
    MissionError when that is more than a mission file may hold.
    """
    values = mission.model_dump(mode="json", by_alias=True, exclude_none=True, exclude_unset=not all_keys)
    payload = values.pop("payload", [])  # tables, of which there may be none
    tables = {key: value for key, value in values.items() if isinstance(value, Mapping)}
    blocks = [_pairs({key: value for key, value in values.items() if key not in tables})]
    blocks += [f"[[payload]]\n{_pairs(item)}" for item in payload]
    for name, table in tables.items():
        arrays = {key: value for key, value in table.items() if _is_tables(value)}
        inner = {key: value for key, value in table.items() if isinstance(value, Mapping)}
        pairs = _pairs({key: value for key, value in table.items() if key not in arrays and key not in inner})
        long = {key: items for key, items in arrays.items() if len(items) > MANY}
        pairs += "".join(f"{key} = [\n{''.join(map(_row, items))}]\n" for key, items in long.items())
        blocks += [f"[{name}]\n{pairs}"] if pairs or not table else []  # that it is there may be all that it says
        blocks += [f"[{name}.{key}]\n{_pairs(value)}" for key, value in inner.items() if value]
        blocks += [
            f"[[{name}.{key}]]\n{_pairs(item)}" for key, items in arrays.items() if key not in long for item in items
        ]
    text = "\n".join(blocks)
    size = len(text.encode())
    if size > MAX_FILE_BYTES:
        kib = f"{size / 1024:.1f} KiB written out: must be at most {MAX_FILE_BYTES // 1024} KiB"
        raise refused(mission.name or "mission", None, f"takes {kib}; a stem map (forest.file) holds more trees")
    return text


def _row(table: Mapping[str, Any]) -> str:
    """An inline table on a line of its own, without a character too many."""
    pairs = (f"{key}={json.dumps(value, separators=(',', ':'))}" for key, value in table.items())
    return f"{{{','.join(pairs)}}},\n"


def _is_tables(value: object) -> bool:
    return isinstance(value, list) and any(isinstance(item, Mapping) for item in value)


def _pairs(table: Mapping[str, Any]) -> str:
    # JSON's strings, numbers, booleans and arrays are TOML's too, as long as the numbers are finite
    return "".join(
        f"{key} = {json.dumps(value, ensure_ascii=False, allow_nan=False)}\n" for key, value in table.items()
    )


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """Values of any TOML document. MissionError names the line, and `place` as the file."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = _TOML_PLACE.fullmatch(str(error))
        if match is None:
            raise refused(place, None, f"not TOML: {printable(str(error))}") from None
        line = int(match[2]) if match[2] else text.count("\n") + 1
        column = f" (column {match[3]})" if match[3] else " (end of file)"
        raise refused(place, line, f"not TOML: {printable(match[1])}{column}") from None
    except RecursionError:
        raise refused(place, None, f"nested too deep: at most {MAX_DEPTH} levels") from None
    except ValueError:
        number = _ENDLESS_NUMBER.search(text)
        line = text.count("\n", 0, number.start()) + 1 if number else 1
        raise refused(place, line, "holds a number with too many digits") from None
