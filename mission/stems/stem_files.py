"""Stem maps as files: CSV and GeoJSON to rows, each with its place in the file.

The files are foreign, and may be hostile: MissionError is all that comes of it.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from mission.common.files import parsed_json, refused
from mission.common.problems import MissionError, Problem, first_of, printable, shown
from mission.schema.forest import MAX_STAND_TREES
from mission.stems.columns import NOTHING_MAPPED, Column, Columns, columns_of, is_position
from mission.stems.headings import Meaning

MAX_STEM_BYTES = 8 * 1024 * 1024
MAX_COLUMNS = 200
MAX_LINE_CHARS = 10_000
MAX_LINES = 2 * MAX_STAND_TREES  # with comments and empty ones
DELIMITERS = ",;\t"
_DELIMITER = re.compile(r'"?sep=([,;\t])"?\r?')  # first line that tells Excel
_BLANK = DELIMITERS + " \r"
WGS84_NAMES = ("CRS84", "EPSG::4326", "EPSG:4326", "4326", "WGS84")  # at the end of a `crs` that says what holds anyway

Values = Mapping[Meaning, object]


class Row(NamedTuple):
    """One tree as the file has it."""

    line: int | None
    key: str  # what its columns' names are appended to: "" or "features[3].properties."
    values: Values


class Rows(NamedTuple):
    """All of them."""

    columns: Columns
    rows: list[Row]
    decimal: str  # sign that the format has for certain; "": as the numbers themselves show


# --- CSV --------------------------------------------------------------------------------------------------------------


def csv_rows(text: str, place: str, mapped: Mapping[str, Column] = NOTHING_MAPPED) -> Rows:
    """The rows of a CSV file with a header: comma, semicolon or tab between them; a line that begins with # is none.

    mapped: as `columns_of` takes it. A row of nothing but delimiters, which spreadsheets write, is none.
    """
    _check_text(text, place)
    lines = [(k, line) for k, line in enumerate(text.split("\n"), start=1) if line.strip() and line[0] != "#"]
    told = _DELIMITER.fullmatch(lines[0][1]) if lines else None
    lines = [(k, line) for k, line in lines[told is not None :] if line.strip(_BLANK)]
    if not lines:
        raise refused(place, None, "holds nothing: must have a header and a line for each tree")
    _limit(len(lines) - 1, place)
    delimiter = told[1] if told else max(DELIMITERS, key=lines[0][1].count)
    (header_line, names), *body = _records(lines, delimiter, place)
    if len(names) > MAX_COLUMNS:
        raise refused(place, header_line, f"has {len(names)} columns: must have at most {MAX_COLUMNS}")
    columns = columns_of([name.strip() for name in names], mapped)
    if columns.fault:
        raise refused(place, header_line, columns.fault)
    if not body:
        raise refused(place, None, "holds no tree")
    at = {name.strip(): k for k, name in enumerate(names)}
    rows = []
    for line, fields in body:
        if len(fields) != len(names):
            raise refused(place, line, f"has {len(fields)} fields: must have {len(names)}, as the header")
        rows.append(Row(line, "", {m: fields[at[column.name]] for m, column in columns.known.items()}))
    return Rows(columns, rows, decimal="." if delimiter == "," else "")


def _check_text(text: str, place: str) -> None:
    count = text.count("\n")
    if count > MAX_LINES:
        raise refused(place, None, f"has {count} lines: must have at most {MAX_LINES}")
    for k, line in enumerate(text.split("\n"), start=1):
        if "\0" in line:
            raise refused(place, k, "is not text: a NUL byte")
        if len(line) > MAX_LINE_CHARS:
            raise refused(place, k, f"is longer than {MAX_LINE_CHARS} characters")


def _records(lines: list[tuple[int, str]], delimiter: str, place: str) -> Iterator[tuple[int, list[str]]]:
    """A line is a record: no field of a stem map needs a newline."""
    for line, text in lines:
        try:
            yield line, next(csv.reader([text.rstrip("\r")], delimiter=delimiter, strict=True))
        except csv.Error as error:
            raise refused(place, line, f"is not CSV: {printable(str(error))}") from None


def _limit(trees: int, place: str) -> None:
    if trees > MAX_STAND_TREES:
        raise refused(place, None, f"holds {trees} trees: must be at most {MAX_STAND_TREES}")


# --- GeoJSON ----------------------------------------------------------------------------------------------------------


def geojson_rows(text: str, place: str, mapped: Mapping[str, Column] = NOTHING_MAPPED) -> Rows:
    """The features of a GeoJSON FeatureCollection of points (RFC 7946: WGS84, longitude first)."""
    document = parsed_json(text, place)
    if not isinstance(document, dict) or document.get("type") != "FeatureCollection":
        raise refused(place, None, 'must be a GeoJSON object with "type": "FeatureCollection"')
    _check_crs(document, place)
    features = document.get("features")
    if not isinstance(features, list):
        raise MissionError([Problem(place, None, "features", _shown(features), "must be an array of Features")])
    if not features:
        raise refused(place, None, "holds no tree")
    _limit(len(features), place)
    lines = _feature_lines(text, len(features))
    names: dict[str, None] = {}
    for feature in features:
        properties = feature.get("properties") if isinstance(feature, dict) else None
        if isinstance(properties, dict):
            names.update(dict.fromkeys(list(properties)[:MAX_COLUMNS]))
        if len(names) > MAX_COLUMNS:
            raise refused(place, None, f"has more than {MAX_COLUMNS} different properties")
    columns = _placed(
        columns_of(["lon", "lat", *(name for name in names if name in mapped or not is_position(name))], mapped)
    )
    if columns.fault:
        raise refused(place, None, columns.fault)
    rows = []
    problems = []
    for k, feature in enumerate(features):
        key = f"features[{k}]"
        values = _feature(feature, columns)
        if isinstance(values, str):
            problems.append(Problem(place, lines[k], key, "", values))
        else:
            rows.append(Row(lines[k], f"{key}.properties.", values))
    if problems:
        raise MissionError(first_of(problems, place))
    return Rows(columns, rows, decimal=".")


def _placed(columns: Columns) -> Columns:
    """With the geometry's columns by names that messages can use."""
    known = dict(columns.known)
    for meaning, name in ((Meaning.LON, "geometry.coordinates[0]"), (Meaning.LAT, "geometry.coordinates[1]")):
        known[meaning] = Column(name, meaning, 1.0, False)
    return columns._replace(known=known)


def _check_crs(document: Mapping[str, Any], place: str) -> None:
    """GeoJSON of before RFC 7946 could name another reference system. Only the names of WGS84 are let pass."""
    if "crs" not in document:
        return
    crs = document["crs"]
    named = crs.get("properties", {}) if isinstance(crs, dict) else None
    name = named.get("name") if isinstance(named, dict) else None
    if not isinstance(name, str) or not name.upper().endswith(WGS84_NAMES):
        said = _shown(name if isinstance(name, str) else crs)
        message = "GeoJSON is WGS84, longitude and latitude (RFC 7946): convert it, or import a CSV with its UTM zone"
        raise MissionError([Problem(place, None, "crs", said, message)])


def _shown(value: object) -> str:
    return "null" if value is None else shown(value)


def _feature(feature: object, columns: Columns) -> Values | str:
    """The values given of one tree, or why nothing is."""
    if not isinstance(feature, dict) or feature.get("type") != "Feature":
        return 'must be an object with "type": "Feature"'
    geometry, properties = feature.get("geometry"), feature.get("properties")
    if not isinstance(geometry, dict) or geometry.get("type") != "Point":
        kind = geometry.get("type") if isinstance(geometry, dict) else geometry
        return f"geometry is {_shown(kind)}: must be a Point, the trunk's axis"
    at = geometry.get("coordinates")
    if not isinstance(at, list) or len(at) not in (2, 3):
        return f"geometry.coordinates = {_shown(at)}: must be longitude and latitude"
    if not isinstance(properties, dict):
        return "properties: must be an object with the tree's diameter"
    told = {meaning: properties.get(column.name) for meaning, column in columns.known.items()}
    return {**told, Meaning.LON: at[0], Meaning.LAT: at[1]}


_FEATURES = re.compile(r'"features"\s*:\s*\[\s*')
_BETWEEN = re.compile(r"\s*,\s*")


def _feature_lines(text: str, count: int) -> list[int | None]:
    """The line that each feature begins on; None where that cannot be told."""
    start = _FEATURES.search(text)
    lines: list[int | None] = []
    if start is not None:
        decoder, at, line, seen = json.JSONDecoder(), start.end(), 1, 0
        try:
            while len(lines) < count:
                line += text.count("\n", seen, at)
                seen = at
                lines.append(line)
                _, at = decoder.raw_decode(text, at)
                comma = _BETWEEN.match(text, at)
                if comma is None:
                    break
                at = comma.end()
        except ValueError:
            lines = []
    return lines if len(lines) == count else [None] * count
