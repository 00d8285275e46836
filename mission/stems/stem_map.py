"""Stem maps: measured trees from CSV, GeoJSON or GeoPackage, in the mission's frame, with what was filled in said."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from statistics import median
from typing import NamedTuple

from mission.common.files import MAX_PLACE_CHARS, decoded, read_bytes, refused
from mission.common.frames import LocalFrame, Wgs84, ned_to_enu
from mission.common.problems import MAX_PROBLEMS, MissionError, Problem, printable, shown
from mission.schema.trees import UNDERGROWTH, Species, StandTree, crown_radius_of_m, height_of_m
from mission.stems import utm
from mission.stems.columns import (
    BOUNDS,
    NOTHING_MAPPED,
    PLACES,
    POSITIONS,
    SWAPPED,
    Column,
    hint_of,
    is_imperial,
    is_missing,
)
from mission.stems.geopackage import gpkg_rows
from mission.stems.headings import Meaning, folded, species_of
from mission.stems.numbers import Signs, is_ambiguous, number, signs_of
from mission.stems.stem_files import MAX_STEM_BYTES, Row, Rows, csv_rows, geojson_rows
from mission.stems.text import read_text

CROWN_BASE_SHARE = 0.6  # of the height, where a map does not say: as `[forest.stand]` has it by default
FURTHEST_M = 20_000.0  # from the origin
TEXTS = (".csv", ".txt", ".tsv")
TEXT = (Meaning.SPECIES, Meaning.ID)
MAX_ID_CHARS = 40
AMBIGUOUS = "with thousands or decimals? `mission forest import --decimal comma` or `point` says which"
DEGREES_SPREAD_M = 0.1  # no map is as small: that many degrees are 11 km


class Stem(NamedTuple):
    """A tree of a map, and where it stands in the file."""

    tree: StandTree
    line: int | None
    id: str = ""  # as the file has it


@dataclass(frozen=True, slots=True)
class StemMap:
    """A stem map in ENU metres from `origin`, or from its own where it has none."""

    place: str
    stems: tuple[Stem, ...]
    origin: Wgs84 | None
    notes: tuple[str, ...]  # what was understood, filled in and dropped

    @property
    def trees(self) -> tuple[StandTree, ...]:
        """Without undergrowth."""
        return tuple(stem.tree for stem in self.stems if stem.tree.species != UNDERGROWTH)

    @property
    def bushes(self) -> tuple[StandTree, ...]:
        """Undergrowth."""
        return tuple(stem.tree for stem in self.stems if stem.tree.species == UNDERGROWTH)


def read_stems(
    path: str | os.PathLike[str],
    *,
    origin: Wgs84 | None = None,
    zone: utm.Zone | None = None,
    lenient: bool = False,
    columns: Mapping[str, Column] = NOTHING_MAPPED,
    signs: Signs | None = None,
) -> StemMap:
    """The stem map in `path`. MissionError names each file, line, column and value that is wrong.

    origin: of the mission; a map on Earth without one has its own, the median of its places. zone: of UTM places.
    lenient: trees without a diameter, and trees that stand there twice, are dropped and said, not refused.
    columns: what columns of the file are, by their headings. signs: of its numbers; None: as they show by themselves.
    """
    place = printable(os.fsdecode(path), MAX_PLACE_CHARS)
    suffix = PurePath(path).suffix.lower()
    if suffix not in (*TEXTS, ".geojson", ".json", ".gpkg"):
        raise refused(place, None, "must be a stem map: .csv, .geojson or .gpkg")
    if suffix not in TEXTS and any(column.meaning in PLACES for column in columns.values()):
        raise refused(place, None, "says by its geometry where trees stand: no column does")
    data = read_bytes(path, place, MAX_STEM_BYTES)
    notes: tuple[str, ...] = ()
    if suffix == ".gpkg":
        rows, its_zone = gpkg_rows(data, place, columns)
        if its_zone is not None and zone not in (None, its_zone):
            raise refused(place, None, f"is in {its_zone}, as it says itself: not {zone}")
        zone = its_zone or zone
    elif suffix in TEXTS:
        text, encoding = read_text(data, place)
        notes = (f"taken for {encoding} text: it is not UTF-8",) if encoding else ()
        rows = csv_rows(text, place, columns)
    else:
        rows = geojson_rows(decoded(data, place), place, columns)
    return _Reader(rows, place, origin, zone, lenient, signs, notes).read_map()


class _Reader:
    """From rows to trees."""

    def __init__(
        self,
        rows: Rows,
        place: str,
        origin: Wgs84 | None,
        zone: utm.Zone | None,
        lenient: bool,
        signs: Signs | None,
        notes: tuple[str, ...],
    ) -> None:
        self._rows, self._place, self._origin, self._zone, self._lenient = rows, place, origin, zone, lenient
        self._heard = notes
        self._known = rows.columns.known
        measured = [meaning for meaning in self._known if meaning not in TEXT]
        values = (row.values[meaning] for row in rows.rows for meaning in measured)
        self._signs = signs_of(values, rows.decimal) if signs is None else signs
        self._where = next(pair for pair in POSITIONS if all(meaning in self._known for meaning in pair))
        self._problems: list[Problem] = []
        self._count = 0
        self._filled = {Meaning.HEIGHT: 0, Meaning.CROWN_BASE: 0, Meaning.CROWN_RADIUS: 0}
        self._strange: dict[str, None] = {}  # species
        self._undiametered: list[int | None] = []
        self._taken: dict[tuple[float, float], int | None] = {}  # east, north m: the first line there
        self._twice: list[int | None] = []

    def read_map(self) -> StemMap:
        """The map, or MissionError with up to MAX_PROBLEMS problems and a count of the others."""
        self._check_frame()
        told = [(row, self._measured(row)) for row in self._rows.rows]
        self._check_unit([values[Meaning.DBH] for _, values in told if Meaning.DBH in values])
        self._refuse()
        self._check_metres([values for _, values in told])
        positions = self._local([(values[self._where[0]], values[self._where[1]]) for _, values in told])
        stems = []
        for (row, values), (east_m, north_m) in zip(told, positions, strict=True):
            if max(abs(east_m), abs(north_m)) > FURTHEST_M:
                self._problem(row, self._where[0], self._far(values, math.hypot(east_m, north_m)))
            elif Meaning.DBH not in values:
                self._undiametered.append(row.line)
                if not self._lenient:
                    message = "missing; `mission forest import` drops trees without a diameter"
                    self._problem(row, Meaning.DBH, message)
            elif self._is_single(row, at := (round(east_m, 2), round(north_m, 2))):
                stems.append(Stem(self._tree(row, values, *at), row.line, self._id(row)))
        self._refuse()
        trees = sum(stem.tree.species != UNDERGROWTH for stem in stems)
        return StemMap(self._place, tuple(stems), self._origin, tuple(self._notes(trees)))

    def _check_frame(self) -> None:
        eastings = Meaning.EASTING in self._where
        if eastings and self._zone is None:
            columns = " and ".join(shown(self._known[meaning].name) for meaning in self._where)
            message = f"has {columns}: which zone? `mission forest import --utm 32N` converts it"
            raise refused(self._place, None, message)
        if self._zone is not None and not eastings:
            raise refused(self._place, None, f"has no easting and northing, which {self._zone} is the zone of")

    def _measured(self, row: Row) -> dict[Meaning, float]:
        """The numbers of a row, in metres and degrees, those that are missing left out; problems are noted."""
        values: dict[Meaning, float] = {}
        for meaning, column in self._known.items():
            raw = row.values[meaning]
            if meaning in TEXT:
                continue
            if is_missing(raw):
                if meaning in self._where:
                    self._problem(row, meaning, "missing: where does it stand?")
                    values[meaning] = 0.0
                continue
            found = number(raw, self._signs)
            low, high, unit = BOUNDS[meaning]
            value = math.nan if found is None else found * column.factor
            if not low <= value <= high:
                if found is None and is_ambiguous(raw, self._signs):
                    self._problem(row, meaning, AMBIGUOUS, raw)
                else:
                    ranged = f"must be a number {_range(low, high, unit, column)}"
                    self._problem(row, meaning, ranged + hint_of(meaning, value, column), raw)
                value = low
            values[meaning] = value
        return values

    def _check_metres(self, told: Sequence[dict[Meaning, float]]) -> None:
        """Refuse degrees that are called x and y, as programs write those of a layer on Earth too."""
        if self._where[0] is not Meaning.EAST or not self._known[Meaning.EAST].assumed_unit or len(told) < 3:
            return
        names = [shown(self._known[meaning].name) for meaning in self._where]
        if all(max(axis) - min(axis) < DEGREES_SPREAD_M for axis in ([v[m] for v in told] for m in self._where)):
            message = (
                f"{' and '.join(names)} of all trees are within {DEGREES_SPREAD_M:g}: metres, or degrees? Name them "
            )
            raise refused(self._place, None, message + "east_m and north_m, or lon and lat")

    def _check_unit(self, diameters_m: Sequence[float]) -> None:
        """True if the unit can be centimetres: of a stem map's trees some are over 3 cm thick, and half under 1 m."""
        column = self._known[Meaning.DBH]
        if column.assumed_unit and diameters_m and median(diameters_m) > 1.0:
            message = f"{shown(column.name)} has no unit, and most values are above 100: name it dbh_m, dbh_cm, dbh_mm"
            raise refused(self._place, None, message)
        if column.assumed_unit and diameters_m and max(diameters_m) < 0.03:
            message = f"{shown(column.name)} has no unit and no value above 3: name it dbh_m, dbh_cm or dbh_mm"
            raise refused(self._place, None, message)

    def _local(self, positions: Sequence[tuple[float, float]]) -> Iterator[tuple[float, float]]:
        """To east, north of the origin."""
        match self._where[0]:
            case Meaning.EAST:
                yield from positions
                return
            case Meaning.LAT:
                on_earth = [*positions]
            case _:
                assert self._zone is not None
                on_earth = [utm.to_wgs84(east_m, north_m, self._zone) for east_m, north_m in positions]
        if self._origin is None:
            self._origin = _middle(on_earth)
        frame = LocalFrame(self._origin)
        for lat_deg, lon_deg in on_earth:
            enu_m = ned_to_enu(frame.to_ned(Wgs84(lat_deg, lon_deg, self._origin.alt_m)))
            yield enu_m[0], enu_m[1]

    def _far(self, values: dict[Meaning, float], off_m: float) -> str:
        """Note about a tree that stands `off_m` from the origin."""
        assert self._origin is not None  # metres east and north have bounds of their own
        origin = f"{self._origin.lat_deg:.7f}, {self._origin.lon_deg:.7f}"
        message = f"stands {off_m / 1e3:.0f} km from the origin, {origin}: must be within {FURTHEST_M / 1e3:g} km"
        if self._where[0] is Meaning.LAT and abs(values[Meaning.LON]) <= BOUNDS[Meaning.LAT][1]:
            turned = Wgs84(values[Meaning.LON], values[Meaning.LAT], self._origin.alt_m)
            if math.hypot(*LocalFrame(self._origin).to_ned(turned)[:2]) <= FURTHEST_M:
                message += SWAPPED
        return message

    def _tree(self, row: Row, values: dict[Meaning, float], east_m: float, north_m: float) -> StandTree:
        dbh_m = round(values[Meaning.DBH], 4)
        named = self._species(row)
        if named == UNDERGROWTH:
            height_m = values.get(Meaning.HEIGHT, dbh_m)
            return StandTree(east_m, north_m, dbh_m / 2.0, height_m, height_m, dbh_m / 2.0, named)
        kind = self._kind(named)
        height_m = self._filled_in(Meaning.HEIGHT, values, height_of_m(dbh_m, kind))
        base_m = self._filled_in(Meaning.CROWN_BASE, values, round(CROWN_BASE_SHARE * height_m, 1))
        if base_m > height_m:
            self._problem(row, Meaning.CROWN_BASE, f"must be at most the tree's height, {height_m:g} m")
        reach_m = self._filled_in(Meaning.CROWN_RADIUS, values, crown_radius_of_m(dbh_m, kind))
        return StandTree(east_m, north_m, dbh_m / 2.0, height_m, base_m, max(reach_m, dbh_m / 2.0), named)

    def _filled_in(self, meaning: Meaning, values: dict[Meaning, float], rule: float) -> float:
        if meaning in values:
            return values[meaning]
        self._filled[meaning] += 1
        return rule

    def _species(self, row: Row) -> str:
        raw = row.values.get(Meaning.SPECIES)
        if is_missing(raw):
            return ""
        if not isinstance(raw, str):
            self._problem(row, Meaning.SPECIES, "must be text")
            return ""
        return printable(raw.strip(), 40)

    def _id(self, row: Row) -> str:
        raw = row.values.get(Meaning.ID)
        if is_missing(raw):
            return ""
        is_whole = isinstance(raw, float) and raw.is_integer() and abs(raw) < 1e15  # as JSON and SQLite may have one
        return printable(f"{raw:.0f}" if is_whole else str(raw).strip(), MAX_ID_CHARS)

    def _kind(self, named: str) -> Species:
        """The species whose curves it is given: by the words of its name."""
        for word in folded(named).split("_"):
            kind = species_of(word)
            if kind is not None:
                return kind
        self._strange[named] = None
        return Species.BROADLEAF

    def _is_single(self, row: Row, at: tuple[float, float]) -> bool:
        """True if it stands east, north m `at` a place of its own. Bushes may stand in each other."""
        if at in self._taken and self._species(row) != UNDERGROWTH:
            self._twice.append(row.line)
            if not self._lenient:
                line = self._taken[at]
                first = "" if line is None else f" as in line {line}"
                message = (
                    f"a tree stands at {at[0]:.2f} east, {at[1]:.2f} north{first}; `mission forest import` drops it"
                )
                self._add(Problem(self._place, row.line, "", "", message))
            return False
        self._taken.setdefault(at, row.line)
        return True

    def _problem(self, row: Row, meaning: Meaning, message: str, raw: object = None) -> None:
        raw = row.values[meaning] if raw is None else raw
        value = "" if is_missing(raw) else shown(raw)
        self._add(Problem(self._place, row.line, printable(_key(row, self._known[meaning])), value, message))

    def _add(self, problem: Problem) -> None:
        self._count += 1
        if len(self._problems) < MAX_PROBLEMS:
            self._problems.append(problem)

    def _refuse(self) -> None:
        if self._count > len(self._problems):
            self._problems.append(Problem(self._place, None, "", "", f"and {self._count - MAX_PROBLEMS} more problems"))
        if self._problems:
            raise MissionError(self._problems)

    def _notes(self, n: int) -> Iterator[str]:
        """Result of reading a file."""
        read = [f"{printable(column.name, 30)} as {_said(column)}" for column in self._known.values()]
        yield from self._heard
        yield f"read {', '.join(read)}"
        unknown = [printable(name, 30) for name in self._rows.columns.unknown]
        if unknown:
            yield f"not read: {', '.join(unknown)}"
        imperial = [printable(name, 30) for name in self._rows.columns.unknown if is_imperial(name)]
        if imperial:
            yield f"convert {', '.join(imperial)} to metres to have it read: inches and feet are not"
        if self._zone is not None:
            yield f"converted from {self._zone}"
        if self._origin is not None and self._where[0] is not Meaning.EAST:
            yield f"placed about the origin {self._origin.lat_deg:.7f}, {self._origin.lon_deg:.7f}"
        for meaning, rule in (
            (Meaning.HEIGHT, "by the curve of its diameter and species"),
            (Meaning.CROWN_BASE, f"at {CROWN_BASE_SHARE:g} of its height"),
            (Meaning.CROWN_RADIUS, "by its diameter and species"),
        ):
            if self._filled[meaning]:
                yield f"filled in the {meaning} of {self._filled[meaning]} of {counted(n)}, {rule}"
        strange = [shown(name) for name in self._strange if name][:8]
        if strange:
            yield f"took {', '.join(strange)} for broadleaves: a species that is not known"
        if "" in self._strange:
            yield "took trees without a species for broadleaves"
        if self._undiametered:
            yield f"dropped {counted(len(self._undiametered))} without a diameter{_lines(self._undiametered)}"
        if self._twice:
            yield f"dropped {counted(len(self._twice))} in the place of another{_lines(self._twice)}"


def counted(trees: int) -> str:
    """`1 tree`, `2 trees`"""
    return "1 tree" if trees == 1 else f"{trees} trees"


def _key(row: Row, column: Column) -> str:
    if column.meaning in (Meaning.LAT, Meaning.LON) and row.key:
        return row.key.removesuffix("properties.") + column.name
    return row.key + column.name


def _said(column: Column) -> str:
    if column.meaning in TEXT:
        return str(column.meaning)
    if column.meaning in (Meaning.LAT, Meaning.LON):
        return f"{column.meaning} in degrees"
    unit = {0.001: "mm", 0.01: "cm", 0.1: "dm", 1.0: "m"}[column.factor]
    return f"{column.meaning} in {unit}{' (it has no unit)' if column.assumed_unit else ''}"


def _range(low: float, high: float, unit: str, column: Column) -> str:
    """`from 0.5 to 500 cm`, in the column's own unit."""
    if unit == "m" and column.factor != 1.0:
        unit = {0.001: "mm", 0.01: "cm", 0.1: "dm"}[column.factor]
    return f"from {low / column.factor:.10g} to {high / column.factor:.10g} {unit}"


def _lines(lines: Sequence[int | None]) -> str:
    known = [str(line) for line in lines if line is not None]
    if not known:
        return ""
    more = f" and {len(known) - 8} more" if len(known) > 8 else ""
    return f": line{'s' if len(known) > 1 else ''} {', '.join(known[:8])}{more}"


def _middle(positions: Sequence[tuple[float, float]]) -> Wgs84:
    """Their median, to about 1 cm, so that it can be written into a mission: few wrong places do not move it.

    Longitudes count from their mean direction, so that a stand may lie across 180 degrees.
    """
    turns = [math.radians(lon_deg) for _, lon_deg in positions]
    about_deg = math.degrees(math.atan2(math.fsum(map(math.sin, turns)), math.fsum(map(math.cos, turns))))
    lat_deg = median(lat_deg for lat_deg, _ in positions)
    lon_deg = about_deg + median(math.remainder(lon_deg - about_deg, 360.0) for _, lon_deg in positions)
    return Wgs84(round(lat_deg, 7), round(math.remainder(lon_deg, 360.0), 7), 0.0)
