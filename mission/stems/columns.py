"""Meaning of the columns of a stem map, by their names, and in which units: `DBH [cm]`, `bhd_mm`, `X_m`, `lat` ...

A name is compared in lower case, its unit taken off. Nothing is guessed from values, but for one thing: a diameter
without a unit is taken for centimetres, as foresters write it, and refused where that cannot be.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from enum import StrEnum
from typing import NamedTuple

from mission.common.problems import printable, shown


class Meaning(StrEnum):
    """Quantity in a column; the value is how messages call it."""

    EAST = "east"
    NORTH = "north"
    LAT = "latitude"
    LON = "longitude"
    EASTING = "easting"
    NORTHING = "northing"
    DBH = "diameter at breast height"
    HEIGHT = "height"
    CROWN_BASE = "crown base"
    CROWN_RADIUS = "crown radius"
    SPECIES = "species"


_NAMES = {
    Meaning.EAST: "east x x_local local_x dx",
    Meaning.NORTH: "north y y_local local_y dy",
    Meaning.LAT: "lat latitude lat_wgs84 breite",
    Meaning.LON: "lon lng long longitude lon_wgs84 laenge",
    Meaning.EASTING: "easting utm_e utm_east utm_x e_utm x_utm rechtswert",
    Meaning.NORTHING: "northing utm_n utm_north utm_y n_utm y_utm hochwert",
    Meaning.DBH: "dbh d d13 d130 d1_3 diameter diam dbh_ob bhd diametro dap",
    Meaning.HEIGHT: "height h ht tree_height total_height hoehe",
    Meaning.CROWN_BASE: "crown_base crown_base_height height_crown_base hcb kronenansatz",
    Meaning.CROWN_RADIUS: "crown_radius kronenradius",
    Meaning.SPECIES: "species spp sp tree_species species_name scientific_name baumart",
}
_MEANINGS = {name: meaning for meaning, names in _NAMES.items() for name in names.split()}
_UNITS_M = {"mm": 0.001, "cm": 0.01, "dm": 0.1, "m": 1.0, "metres": 1.0, "meters": 1.0}
_IMPERIAL = ("in", "inch", "inches", "ft", "foot", "feet")
_DEGREES = ("deg", "degrees")
DEGREES = (Meaning.LAT, Meaning.LON)
_PLAIN = re.compile(r"[^a-z0-9]+")
_NUMBER = re.compile(r"[+-]?(?:[0-9]{1,12}(?:\.[0-9]{0,20})?|\.[0-9]{1,20})(?:[eE][+-]?[0-9]{1,2})?")
MISSING = ("", "na", "n/a", "null", "none", "-", ".")

# What a tree may be; heights in metres
BOUNDS = {
    Meaning.EAST: (-20_000.0, 20_000.0, "m"),
    Meaning.NORTH: (-20_000.0, 20_000.0, "m"),
    Meaning.LAT: (-85.0, 85.0, "degrees"),
    Meaning.LON: (-180.0, 180.0, "degrees"),
    Meaning.EASTING: (100_000.0, 900_000.0, "m"),
    Meaning.NORTHING: (0.0, 10_000_000.0, "m"),
    Meaning.DBH: (0.005, 5.0, "m"),
    Meaning.HEIGHT: (0.1, 130.0, "m"),
    Meaning.CROWN_BASE: (0.0, 130.0, "m"),
    Meaning.CROWN_RADIUS: (0.0, 30.0, "m"),
}


class Column(NamedTuple):
    """A column that is understood."""

    name: str  # as in the file
    meaning: Meaning
    factor: float  # to metres
    assumed_unit: bool  # it has none in its name


def column_of(name: str) -> Column | None:
    """Quantity that a column of this name holds; None: not known."""
    plain = _plain(name)
    if plain in _MEANINGS:
        return Column(name, _MEANINGS[plain], 0.01 if _MEANINGS[plain] is Meaning.DBH else 1.0, True)
    stem, _, unit = plain.rpartition("_")
    meaning = _MEANINGS.get(stem)
    if meaning is None or meaning is Meaning.SPECIES:
        return None
    if meaning in DEGREES:
        return Column(name, meaning, 1.0, False) if unit in _DEGREES else None
    return Column(name, meaning, _UNITS_M[unit], False) if unit in _UNITS_M else None


def is_imperial(name: str) -> bool:
    """True if a column of this name would be understood in metres: it is in inches or feet."""
    stem, _, unit = _plain(name).rpartition("_")
    return unit in _IMPERIAL and stem in _MEANINGS


def _plain(name: str) -> str:
    return _PLAIN.sub("_", name.lower()).strip("_")


class Columns(NamedTuple):
    """The columns of a file."""

    known: dict[Meaning, Column]
    unknown: tuple[str, ...]
    fault: str  # why the file cannot be read; "" if it can


def columns_of(names: Iterable[str]) -> Columns:
    """Finds what the columns `names` of a file hold, and whether that is enough: a place and a diameter."""
    known: dict[Meaning, Column] = {}
    unknown: list[str] = []
    for name in names:
        column = column_of(name)
        if column is None:
            unknown.append(name)
        elif column.meaning in known:
            first = known[column.meaning].name
            return Columns(known, tuple(unknown), f"{shown(first)} and {shown(name)} are both the {column.meaning}")
        else:
            known[column.meaning] = column
    return Columns(known, tuple(unknown), _lacks(known, unknown))


def _lacks(known: dict[Meaning, Column], unknown: list[str]) -> str:
    positions = [pair for pair in POSITIONS if all(meaning in known for meaning in pair)]
    found = ", ".join(printable(name, 20) for name in (*(c.name for c in known.values()), *unknown)[:12]) or "none"
    if not positions:
        return f"must say where trees stand: lat and lon, east_m and north_m, or easting and northing (found: {found})"
    if len(positions) > 1:
        ways = " and ".join(shown(known[pair[0]].name) for pair in positions)
        return f"has the place in more than one way: keep one of {ways}"
    if Meaning.DBH not in known:
        imperial = ", ".join(shown(name) for name in unknown if is_imperial(name))
        hint = f"; convert {imperial}: inches and feet are not read" if imperial else ""
        return f"must have a column dbh_cm, dbh_mm or dbh_m, the diameter at breast height (found: {found}){hint}"
    return ""


POSITIONS = ((Meaning.EAST, Meaning.NORTH), (Meaning.LAT, Meaning.LON), (Meaning.EASTING, Meaning.NORTHING))


def number(value: object, *, decimal_comma: bool = False) -> float | None:
    """A number as the file has it, or as text; None: it is none. NaN and infinity are none."""
    match value:
        case bool():
            return None
        case int() | float():
            if isinstance(value, int) and value.bit_length() > 64:
                return None
            return float(value) if abs(value) < 1e15 else None
        case str():
            text = value.strip()
            if decimal_comma and "." not in text:
                text = text.replace(",", ".", 1)
            return float(text) if _NUMBER.fullmatch(text) else None
        case _:
            return None


def is_missing(value: object) -> bool:
    """Nothing was measured."""
    return value is None or (isinstance(value, str) and value.strip().lower() in MISSING)
