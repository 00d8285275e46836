"""Values of other sensors: rows of one table, its layer and file, and a summary of each quantity.

docs/reference/stand-files.md lists the columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean, stdev
from typing import Final, NamedTuple

from companion.stand.products.table import Cell, csv_text
from companion.stand.records import KeyedSample, Session
from mission.schema.payload import heading_of
from mission.stems.geopackage_write import PointLayer

LAYER: Final = "payload"
DIGITS: Final = 6  # of a value: single precision has seven


class Quantity(NamedTuple):
    """A quantity, and its recorded values in figures."""

    name: str
    unit: str
    n: int
    mean: float
    sd: float | None  # between values, not of the mean; None: there is one alone
    min: float
    max: float


class PayloadTable(NamedTuple):
    """A row for each time at which a vehicle recorded something: quantities that it had none of then are empty."""

    headings: tuple[str, ...]  # of the quantities, with their units
    places_m: list[tuple[float, float]]  # east, north
    rows: list[list[Cell]]  # vehicle, flight, time, height, error of the place; the values


OWN: Final = {
    "vehicle_id": "INTEGER",
    "flight": "INTEGER",
    "made_s": "DOUBLE",
    "up_m": "DOUBLE",
    "position_sd_m": "DOUBLE",
}


def quantities_of(samples: Sequence[KeyedSample]) -> list[Quantity]:
    """By name."""
    found = []
    for name, unit in _kinds(samples):
        values = [s.sample.value for s in samples if (s.sample.name, s.sample.unit) == (name, unit)]
        mean, least, most = map(_rounded, (fmean(values), min(values), max(values)))
        sd = _rounded(stdev(values)) if len(values) > 1 else None
        found.append(Quantity(name, unit, len(values), mean, sd, least, most))
    return found


def table_of(samples: Sequence[KeyedSample]) -> PayloadTable:
    """`samples` as they are sorted: values of one tick of one vehicle are one row."""
    headings = _headings(samples)
    flights = _flights(samples)
    at: dict[tuple[Session, float], int] = {}
    places: list[tuple[float, float]] = []
    rows: list[list[Cell]] = []
    for one in samples:
        sample, when = one.sample, (one.session, one.made_s)
        if when not in at:
            at[when] = len(rows)
            places.append((sample.east_m, sample.north_m))
            own: list[Cell] = [sample.vehicle_id, flights[one.session], round(one.made_s, 3)]
            rows.append([*own, round(sample.up_m, 2) + 0.0, round(sample.position_sd_m, 3), *[None] * len(headings)])
        rows[at[when]][len(OWN) + headings[sample.name, sample.unit][0]] = _rounded(sample.value)
    return PayloadTable(tuple(heading for _, heading in headings.values()), places, rows)


def layer_of(table: PayloadTable) -> PointLayer:
    """Of a GeoPackage."""
    return PointLayer(LAYER, OWN | dict.fromkeys(table.headings, "DOUBLE"), table.places_m, table.rows)


def to_csv(table: PayloadTable) -> str:
    """In metres east and north of the mission's origin."""
    places = [[f"{east_m:.3f}", f"{north_m:.3f}"] for east_m, north_m in table.places_m]
    rows = [[*place, *row] for place, row in zip(places, table.rows, strict=True)]
    return csv_text([["east_m", "north_m", *OWN, *table.headings], *rows])


def _kinds(samples: Sequence[KeyedSample]) -> list[tuple[str, str]]:
    return sorted({(s.sample.name, s.sample.unit) for s in samples})


def _headings(samples: Sequence[KeyedSample]) -> dict[tuple[str, str], tuple[int, str]]:
    """Index and heading of each quantity; records come by radio, and of missions of before: no two are alike."""
    taken = {"fid", "geom", "east_m", "north_m", *OWN}
    found: dict[tuple[str, str], tuple[int, str]] = {}
    for k, (name, unit) in enumerate(_kinds(samples)):
        heading = first = _word(heading_of(name, unit))
        count = 1
        while heading in taken:
            count += 1
            heading = f"{first}_{count}"
        taken.add(heading)
        found[name, unit] = k, heading
    return found


def _word(heading: str) -> str:
    """A name for SQL."""
    kept = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in heading.lower())
    return kept if kept[:1].isalpha() else f"value_{kept}"


def _flights(samples: Sequence[KeyedSample]) -> dict[Session, int]:
    """Of each session, which flight of its vehicle it is, from 1 on, as far as logs and clocks tell."""
    found: dict[Session, int] = {}
    count: dict[int, int] = {}
    for session in sorted({s.session for s in samples}):
        count[session[0]] = found[session] = count.get(session[0], 0) + 1
    return found


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
