"""A piece of a map, to be put into a page that opens without the map's file: pictures as data URLs."""

from __future__ import annotations

import base64
import math
from itertools import product
from typing import Any, Final, NamedTuple

from mission.basemap.chart import Chart

TILES_MOST: Final = 150  # of all zooms together
BYTES_MOST: Final = 8 << 20  # of the pictures: a page that is sent by mail
LAT_MOST_DEG: Final = 85.05  # of web Mercator


class Area(NamedTuple):
    """West, south, east and north, degrees."""

    west: float
    south: float
    east: float
    north: float


def cut_piece(chart: Chart, area: Area) -> dict[str, Any] | None:
    """The tiles of `chart` about `area`, from the finest zoom that there is room for on; None: there are none.

    As `About`, with `tiles`: data URLs by "zoom/x/y", or `image`: that of a map that is one.
    """
    about = chart.about.as_dict()
    whole = chart.image()
    if whole is not None:
        return {**about, "image": _data_url(chart.about.mime, whole)}
    tiles: dict[str, bytes] = {}
    zooms: list[int] = []
    size = 0
    for zoom in range(chart.about.max_zoom, chart.about.min_zoom - 1, -1):
        columns, rows = _tiles_of(area, zoom)
        if len(columns) * len(rows) + len(tiles) > TILES_MOST:
            continue
        found = {f"{zoom}/{x}/{y}": data for x, y in product(columns, rows) if (data := chart.tile(zoom, x, y))}
        size_there = sum(map(len, found.values()))
        if found and size + size_there <= BYTES_MOST:
            zooms.append(zoom)
            tiles |= found
            size += size_there
        if len(columns) == len(rows) == 1:
            break  # coarser ones would show the same, smaller
    if not tiles:
        return None
    pictures = {place: _data_url(chart.about.mime, data) for place, data in tiles.items()}
    return {**about, "min_zoom": min(zooms), "max_zoom": max(zooms), "tiles": pictures}


def _tiles_of(area: Area, zoom: int) -> tuple[range, range]:
    """Columns and rows, these from the north, of tiles that hold a part of `area`."""
    west, north = _tile_at(area.west, area.north, zoom)
    east, south = _tile_at(area.east, area.south, zoom)
    return range(west, east + 1), range(north, south + 1)


def _tile_at(lon_deg: float, lat_deg: float, zoom: int) -> tuple[int, int]:
    """Of web Mercator."""
    side = 1 << zoom
    lat = math.radians(max(-LAT_MOST_DEG, min(LAT_MOST_DEG, lat_deg)))
    x = (lon_deg + 180.0) / 360.0 * side
    y = (1.0 - math.asinh(math.tan(lat)) / math.pi) / 2.0 * side
    return min(side - 1, max(0, int(x))), min(side - 1, max(0, int(y)))


def _data_url(mime: str, data: bytes) -> str:
    return f"data:{mime};base64,{base64.b64encode(data).decode('ascii')}"
