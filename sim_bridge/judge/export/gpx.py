"""GPX 1.1: a track for each vehicle, and the mission's places."""

from __future__ import annotations

from collections.abc import Iterator
from xml.sax.saxutils import escape

from mission.common.frames import Wgs84
from sim_bridge.judge.export.flown import Flown

RATE_HZ = 2.0


def document(flight: Flown) -> Iterator[str]:
    """The lines of a GPX file. Elevations above sea level; times are UTC."""
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield '<gpx version="1.1" creator="understory" xmlns="http://www.topografix.com/GPX/1/1">'
    yield f"<metadata><name>{escape(flight.title)}</name></metadata>"
    for name, position in flight.route_points():
        yield f"<wpt {_at(position)}><ele>{position.alt_m:.2f}</ele><name>{name}</name></wpt>"
    rows = flight.rows(RATE_HZ).tolist()
    for vehicle_id in flight.ids:
        yield f"<trk><name>vehicle {vehicle_id}</name><trkseg>"
        for row in rows:
            position = flight.position(row, vehicle_id)
            when = flight.at(row).isoformat(timespec="milliseconds").replace("+00:00", "Z")
            yield f"<trkpt {_at(position)}><ele>{position.alt_m:.2f}</ele><time>{when}</time></trkpt>"
        yield "</trkseg></trk>"
    yield "</gpx>"


def _at(position: Wgs84) -> str:
    return f'lat="{position.lat_deg:.7f}" lon="{position.lon_deg:.7f}"'
