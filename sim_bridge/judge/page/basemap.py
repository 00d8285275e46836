"""The reader's own map under a replay: the piece of it where the flight was, in the page itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from mission.basemap.chart import ChartError
from mission.basemap.charts import open_chart
from mission.basemap.piece import Area, cut_piece
from mission.cli.main import EXIT_BAD_FILE
from mission.common.frames import LocalFrame, enu_to_ned
from mission.document.model import Mission
from mission.stems.utm import zone_of
from sim_bridge.errors import StartError
from sim_bridge.judge.recording import Recording

MARGIN: Final = 0.5  # of the longer side, around all that the page shows at first
MARGIN_LEAST_M: Final = 50.0


def piece_of(path: Path, utm: str | None, flights: Sequence[tuple[Recording, Mission]]) -> dict[str, Any]:
    """The piece of the map in `path` where `flights` were. `utm`: zone of an image's world file. StartError."""
    zone = None if utm is None else zone_of(utm)
    if utm is not None and zone is None:
        raise StartError(f"--utm {utm}: must be a zone, as 32N or EPSG:32632", EXIT_BAD_FILE)
    origin = flights[0][1].origin
    if origin is None:
        raise StartError(
            f"--map {path}: the mission has no [origin]: nobody knows where on Earth it was", EXIT_BAD_FILE
        )
    area = _area(flights, LocalFrame(origin.wgs84))
    try:
        chart = open_chart(path, zone)
    except ChartError as error:
        raise StartError(f"--map {error}", EXIT_BAD_FILE) from None
    try:
        piece = cut_piece(chart, area)
    finally:
        chart.close()
    if piece is None:
        middle = f"{(area.south + area.north) / 2.0:.5f}, {(area.west + area.east) / 2.0:.5f}"
        raise StartError(f"--map {path}: has no tile where the flight was, about {middle}", EXIT_BAD_FILE)
    return piece


def _area(flights: Sequence[tuple[Recording, Mission]], frame: LocalFrame) -> Area:
    """Of ways, places and fences, with a margin."""
    east_m, north_m = [], []
    for recording, mission in flights:
        for point in (*mission.route.points_enu_m, *(mission.fence.polygon_enu_m or ())):
            east_m.append(point[0])
            north_m.append(point[1])
        if len(recording.time_s):
            flown = recording.pos_ned_m.reshape(-1, 3)
            north_m += [float(flown[:, 0].min()), float(flown[:, 0].max())]
            east_m += [float(flown[:, 1].min()), float(flown[:, 1].max())]
    (west, east), (south, north) = ((min(values), max(values)) for values in (east_m, north_m))
    margin_m = max(MARGIN_LEAST_M, MARGIN * max(east - west, north - south))
    low = frame.to_wgs84(enu_to_ned((west - margin_m, south - margin_m, 0.0)))
    high = frame.to_wgs84(enu_to_ned((east + margin_m, north + margin_m, 0.0)))
    return Area(low.lon_deg, low.lat_deg, high.lon_deg, high.lat_deg)
