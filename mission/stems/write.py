"""Stem maps of ours: what `mission forest` writes, and reads back without loss."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from itertools import repeat
from typing import Any

from mission.common.frames import LocalFrame, Wgs84, enu_to_ned
from mission.schema.trees import StandTree

_COLUMNS = "dbh_cm,height_m,crown_base_m,crown_radius_m,species"


def to_csv(trees: Iterable[StandTree], ids: Sequence[str] = ()) -> str:
    """In metres east and north of the mission's origin. ids: of the trees, in their order."""
    rows = [f"{_short(t.east_m, 2)},{_short(t.north_m, 2)},{','.join(_measures(t))},{_text(t.species)}" for t in trees]
    if any(ids):
        rows = [f"{row},{_text(name)}" for row, name in zip(rows, ids, strict=True)]
    return "\n".join((f"east_m,north_m,{_COLUMNS}{',id' * any(ids)}", *rows)) + "\n"


def to_geojson(trees: Iterable[StandTree], origin: Wgs84, ids: Sequence[str] = ()) -> str:
    """On Earth, to 1 mm; a line for each tree. ids: as `to_csv`."""
    frame = LocalFrame(origin)
    pairs = zip(trees, ids or repeat(""), strict=False)
    features = [json.dumps(_feature(tree, frame, name), ensure_ascii=False) for tree, name in pairs]
    return '{"type": "FeatureCollection", "features": [\n' + ",\n".join(features) + "\n]}\n"


def _feature(tree: StandTree, frame: LocalFrame, name: str) -> dict[str, Any]:
    at = frame.to_wgs84(enu_to_ned((tree.east_m, tree.north_m, 0.0)))
    lon_deg = round(math.remainder(at.lon_deg, 360.0), 8)
    names = _COLUMNS.split(",")
    properties: dict[str, Any] = dict(zip(names, map(float, _measures(tree)), strict=False))
    return {
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": [lon_deg, round(at.lat_deg, 8)]},
        "properties": {**properties, names[-1]: tree.species, **({"id": name} if name else {})},
    }


def _measures(tree: StandTree) -> list[str]:
    numbers = ((200.0 * tree.radius_m, 2), (tree.height_m, 2), (tree.crown_base_m, 2), (tree.crown_radius_m, 3))
    return [_short(value, digits) for value, digits in numbers]


def _short(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".rstrip("0").rstrip(".")


def _text(value: str) -> str:
    """A field of CSV; quoted where it must be."""
    return '"' + value.replace('"', '""') + '"' if any(c in value for c in ',"#') else value
