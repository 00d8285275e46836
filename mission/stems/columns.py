"""Meaning of the columns of a stem map, by their names, and in which units: `DBH [cm]`, `bhd_mm`, `X_m`, `lat` ...

A name is compared folded, its unit taken off. Nothing is guessed from values, but for one thing: a diameter
without a unit is taken for centimetres, as foresters write it, and refused where that cannot be.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

from mission.common.problems import printable, shown
from mission.stems.headings import GIRTHS, MEANINGS, Meaning, folded

_UNITS_M = {"mm": 0.001, "cm": 0.01, "dm": 0.1, "m": 1.0, "metres": 1.0, "meters": 1.0}
_IMPERIAL = ("in", "inch", "inches", "ft", "foot", "feet")
_DEGREES = ("deg", "degrees", "grad", "degres", "grados", "graus", "stopnie")
_WORDS_BEFORE_UNITS = ("_in", "_en", "_em", "_w", "_i")  # "Höhe in m", "altura en m", "wysokość w m"
_WITHOUT_UNIT = (Meaning.SPECIES, Meaning.ID)
DEGREES = (Meaning.LAT, Meaning.LON)
POSITIONS = ((Meaning.EAST, Meaning.NORTH), (Meaning.LAT, Meaning.LON), (Meaning.EASTING, Meaning.NORTHING))
PLACES = frozenset(meaning for pair in POSITIONS for meaning in pair)
MISSING = ("", "na", "n/a", "#n/a", "#nv", "null", "(null)", "none", "-", ".")  # #NV: Excel's #N/A in German

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

SWAPPED: Final = "; are latitude and longitude swapped?"
ZONE_M: Final = 1e6  # a zone's number stands before the easting's six digits, in some exports
ZONES: Final = 60


class Column(NamedTuple):
    """A column that is understood."""

    name: str  # as in the file
    meaning: Meaning
    factor: float  # to metres
    assumed_unit: bool  # it has none in its name


def column_of(name: str) -> Column | None:
    """Quantity that a column of this name holds; None: not known."""
    plain = folded(name)
    if plain in MEANINGS:
        return Column(name, MEANINGS[plain], 0.01 if MEANINGS[plain] is Meaning.DBH else 1.0, True)
    meaning, unit = _split(plain)
    if meaning is None or meaning in _WITHOUT_UNIT:
        return None
    if meaning in DEGREES:
        return Column(name, meaning, 1.0, False) if unit in _DEGREES else None
    return Column(name, meaning, _UNITS_M[unit], False) if unit in _UNITS_M else None


def is_imperial(name: str) -> bool:
    """True if a column of this name would be understood in metres: it is in inches or feet."""
    meaning, unit = _split(folded(name))
    return meaning is not None and unit in _IMPERIAL


def is_girth(name: str) -> bool:
    """True if it is the way round the trunk."""
    plain = folded(name)
    return plain in GIRTHS or plain.rpartition("_")[0] in GIRTHS


def _split(plain: str) -> tuple[Meaning | None, str]:
    """Quantity and unit of a folded name."""
    stem, _, unit = plain.rpartition("_")
    for word in _WORDS_BEFORE_UNITS:
        if stem not in MEANINGS:
            stem = stem.removesuffix(word)
    return MEANINGS.get(stem), unit


def is_position(name: str) -> bool:
    """True if it says where a tree stands. Where a geometry does, properties that do so once more are not heeded."""
    column = column_of(name)
    return column is not None and column.meaning in PLACES


class Columns(NamedTuple):
    """The columns of a file."""

    known: dict[Meaning, Column]
    unknown: tuple[str, ...]
    fault: str  # why the file cannot be read; "" if it can


_OWN: Final = "dbh_cm, height_m, crown_base_m, crown_radius_m, species, id"
NOTHING_MAPPED: Final[Mapping[str, Column]] = MappingProxyType({})


def mapping_of(options: Sequence[str]) -> dict[str, Column]:
    """Columns by their headings in a file, from `dbh_m=HEADING`. ValueError says what is wrong with one."""
    mapped: dict[str, Column] = {}
    for option in options:
        name, equals, heading = option.partition("=")
        column = column_of(name)
        if not equals or column is None:
            known = f"east_m, north_m, lat, lon, easting, northing, {_OWN}"
            raise ValueError(f"{printable(option)}: must be NAME=HEADING, with a name as {known}")
        if heading in mapped or any(column.meaning is other.meaning for other in mapped.values()):
            raise ValueError(f"{printable(option)}: the heading, or the {column.meaning}, is given twice")
        mapped[heading] = column._replace(name=heading)
    return mapped


def columns_of(names: Iterable[str], mapped: Mapping[str, Column] = NOTHING_MAPPED) -> Columns:
    """Finds what the columns `names` of a file hold, and whether that is enough: a place and a diameter.

    mapped: what some of them are, which wins over what their names, and those of others, say.
    """
    headings = [*names]
    known: dict[Meaning, Column] = {}
    unknown: list[str] = []
    given = {column.meaning for column in mapped.values()}
    if any(given.issuperset(pair) for pair in POSITIONS):
        given |= PLACES
    for k, name in enumerate(headings, start=1):
        column = mapped.get(name) or column_of(name)
        if column is None or (name not in mapped and column.meaning in given):
            unknown.append(name or f"column {k} (it has no heading)")
        elif column.meaning not in known:
            known[column.meaning] = column
        elif column.meaning is Meaning.ID and name not in mapped:
            unknown.append(name)
        else:
            first = known[column.meaning].name
            fault = f"{shown(first)} and {shown(name)} are both the {column.meaning}: {_SAYS_WHICH}"
            return Columns(known, tuple(unknown), fault)
    lost = [shown(heading) for heading in mapped if heading not in headings]
    if lost:
        return Columns(known, tuple(unknown), f"has no column {', '.join(lost)} (found: {_found(headings)})")
    return Columns(known, tuple(unknown), _lacks(known, unknown, headings))


_SAYS_WHICH: Final = "`mission forest import --column NAME=HEADING` says which is"


def _found(headings: Sequence[str]) -> str:
    return ", ".join(printable(name, 20) or '""' for name in headings[:12]) or "none"


def _lacks(known: dict[Meaning, Column], unknown: list[str], headings: Sequence[str]) -> str:
    positions = [pair for pair in POSITIONS if all(meaning in known for meaning in pair)]
    found = f"(found: {_found(headings)})"
    if not positions:
        ways = "lat and lon, east_m and north_m, or easting and northing"
        return f"must say where trees stand: {ways} {found}; {_SAYS_WHICH}"
    if len(positions) > 1:
        ways = " and ".join(shown(known[pair[0]].name) for pair in positions)
        return f"has the place in more than one way: keep one of {ways}"
    if Meaning.DBH not in known:
        imperial = ", ".join(shown(name) for name in unknown if is_imperial(name))
        hint = f"; convert {imperial}: inches and feet are not read" if imperial else ""
        girths = ", ".join(shown(name) for name in unknown if is_girth(name))
        hint += f"; divide {girths} by 3.1416: girths are not read" if girths else ""
        hint = hint or f"; {_SAYS_WHICH}"
        return f"must have a column dbh_cm, dbh_mm or dbh_m, the diameter at breast height {found}{hint}"
    return ""


def is_missing(value: object) -> bool:
    """Nothing was measured."""
    return value is None or (isinstance(value, str) and value.strip().lower() in MISSING)


def hint_of(meaning: Meaning, value: float, column: Column) -> str:
    """Likely reason why a place is out of bounds."""
    if meaning is Meaning.LAT and BOUNDS[meaning][1] < abs(value) <= BOUNDS[Meaning.LON][1]:
        return SWAPPED
    if meaning is Meaning.EASTING and value > ZONE_M:
        zone, rest_m = divmod(value, ZONE_M)
        if zone <= ZONES and BOUNDS[meaning][0] <= rest_m <= BOUNDS[meaning][1]:
            taken_off = "take that off if it is UTM; Gauss-Krüger is not read, a GIS converts it to UTM"
            return f"; it begins with a zone's number, {zone:.0f}: {taken_off}"
    wide = {Meaning.EAST: Meaning.EASTING, Meaning.NORTH: Meaning.NORTHING}.get(meaning)
    if wide is not None and BOUNDS[wide][0] <= value <= BOUNDS[wide][1]:
        return f"; `mission forest import --utm ZONE --column {wide}={printable(column.name, 30)}` if it is in a zone"
    return ""
