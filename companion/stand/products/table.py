"""Stems as rows, and the text files made of them: CSV, GeoJSON, raw records.

docs/reference/stand-files.md lists the columns.
"""

from __future__ import annotations

import base64
import csv
import io
import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from typing import Any, Final, NamedTuple

from companion.payload.sample import PAYLOAD_KIND
from companion.stand.fusion.fuse import FusedStem
from companion.stand.records import Harvest
from companion.survey.observation import STEM_KIND
from companion.survey.track import TRACK_KIND
from mission.common.frames import LocalFrame, Wgs84, enu_to_ned
from mission.common.problems import printable
from mission.stems import utm

Cell = float | int | str | None


class Column(NamedTuple):
    """A column of the stems' table: its type in a GeoPackage, and a stem's value."""

    name: str
    kind: str
    value: Callable[[FusedStem], Cell]


COLUMNS: Final = (
    Column("stem_id", "TEXT", lambda s: s.stem_id),
    Column("dbh_cm", "DOUBLE", lambda s: round(100.0 * s.dbh_m, 2)),
    Column("dbh_sd_cm", "DOUBLE", lambda s: round(100.0 * s.dbh_sd_m, 2)),
    Column("dbh_from", "TEXT", lambda s: s.dbh_from),
    Column("cut_up_m", "DOUBLE", lambda s: round(s.cut_up_m, 2)),
    Column("cut_diameter_cm", "DOUBLE", lambda s: round(100.0 * s.diameter_m, 2)),
    Column("cut_diameter_sd_cm", "DOUBLE", lambda s: round(100.0 * s.diameter_sd_m, 2)),
    Column("position_sd_m", "DOUBLE", lambda s: round(s.position_sd_m, 3)),
    Column("lean_deg", "DOUBLE", lambda s: None if s.lean_rad is None else round(math.degrees(s.lean_rad), 1)),
    Column("grade", "TEXT", lambda s: s.grade.name.lower()),
    Column("reason", "TEXT", lambda s: _safe(s.reason)),
    Column("counted", "INTEGER", lambda s: int(s.is_counted)),
    Column("observations", "INTEGER", lambda s: len(s.observed)),
    Column("vehicles", "TEXT", lambda s: " ".join(map(str, s.vehicles))),
    Column("rays", "INTEGER", lambda s: s.rays),
)


def rows_of(stems: Iterable[FusedStem]) -> list[list[Cell]]:
    """Values of COLUMNS."""
    return [[column.value(stem) for column in COLUMNS] for stem in stems]


def to_csv(stems: Sequence[FusedStem]) -> str:
    """In metres east and north of the mission's origin; `mission forest import` reads it."""
    heading = ["east_m", "north_m", *(column.name for column in COLUMNS)]
    places = [[f"{stem.east_m:.3f}", f"{stem.north_m:.3f}"] for stem in stems]
    return csv_text([heading, *([*place, *row] for place, row in zip(places, rows_of(stems), strict=True))])


def to_3dfin_csv(stems: Sequence[FusedStem], origin: Wgs84 | None) -> tuple[str, str]:
    """Headings as 3DFin and r-lidar's packages have them, all in metres; and X and Y's reference system, in words."""
    frame = None if origin is None else LocalFrame(origin)
    zone = None if origin is None else utm.zone_at(origin.lat_deg, origin.lon_deg)
    rows: list[list[Cell]] = [["treeID", "TH", "DBH", "X", "Y", "stem_id"]]
    for k, stem in enumerate(stems, start=1):
        x, y = stem.east_m, stem.north_m
        if frame is not None and zone is not None:
            at = frame.to_wgs84(enu_to_ned((x, y, 0.0)))
            x, y = utm.from_wgs84(at.lat_deg, at.lon_deg, zone)
        rows.append([k, "", f"{stem.dbh_m:.4f}", f"{x:.3f}", f"{y:.3f}", stem.stem_id])
    return csv_text(rows), "metres of the mission's frame" if zone is None else f"{zone} (EPSG:{zone.epsg})"


def to_geojson(stems: Sequence[FusedStem], origin: Wgs84) -> str:
    """On Earth, to 1 mm; a line for each stem (RFC 7946)."""
    frame = LocalFrame(origin)
    features = []
    for stem, row in zip(stems, rows_of(stems), strict=True):
        at = frame.to_wgs84(enu_to_ned((stem.east_m, stem.north_m, 0.0)))
        coordinates = [round(math.remainder(at.lon_deg, 360.0), 8), round(at.lat_deg, 8)]
        properties = dict(zip((column.name for column in COLUMNS), row, strict=True))
        geometry = {"type": "Point", "coordinates": coordinates}
        features.append(json.dumps({"type": "Feature", "geometry": geometry, "properties": properties}))
    return '{"type": "FeatureCollection", "features": [\n' + ",\n".join(features) + "\n]}\n"


def to_json_lines(harvest: Harvest) -> str:
    """Every record, as it was received (body: base64) and as it was understood."""
    told: dict[tuple[int, int, int], dict[str, Any]] = {o.key: asdict(o.observation) for o in harvest.observations}
    told |= {p.key: asdict(p.point) for p in harvest.track} | {s.key: asdict(s.sample) for s in harvest.payload}
    lines = []
    for record in harvest.records:
        line = {
            "vehicle_id": record.vehicle_id,
            "log_id": record.log_id,
            "number": record.number,
            "kind": {STEM_KIND: "stem", TRACK_KIND: "track", PAYLOAD_KIND: "payload"}.get(
                record.kind, int(record.kind)
            ),
            "made_s": record.made_s,
            "proven": record.proven,
            "body": base64.b64encode(record.body).decode(),
            "values": told.get((record.vehicle_id, record.log_id, record.number)),
        }
        lines.append(json.dumps(line) + "\n")
    return "".join(lines)


def csv_text(rows: Iterable[Sequence[Cell]]) -> str:
    """Comma-separated values, a line for each row."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _safe(text: str) -> str:
    """Text from a radio: one line, and no formula where a spreadsheet opens it."""
    shown = printable(text)
    return f"'{shown}" if shown[:1] in ("=", "+", "-", "@") else shown
