"""KML 2.2 with Google's tracks: Google Earth, QGIS, and what else shows places."""

from __future__ import annotations

from collections.abc import Iterator
from xml.sax.saxutils import escape

from mission.common.frames import Wgs84
from sim_bridge.judge.export.flown import Flown

RATE_HZ = 2.0
# Dark enough on a satellite picture; KML writes aabbggrr
COLOURS = ("332288", "cc6677", "117733", "88ccee", "aa4499", "999933", "44aa99", "882255", "ddcc77")


def document(flight: Flown) -> Iterator[str]:
    """The lines of a KML file. Altitudes above sea level; times are UTC."""
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">'
    yield f"<Document><name>{escape(flight.title)}</name>"
    for k, colour in enumerate(COLOURS):
        line = f"<color>ff{colour[4:]}{colour[2:4]}{colour[:2]}</color><width>3</width>"
        yield f'<Style id="c{k}"><LineStyle>{line}</LineStyle></Style>'
    yield '<Style id="trunk"><LineStyle><color>ff2a4b6b</color><width>4</width></LineStyle></Style>'
    yield "<Folder><name>Vehicles</name>"
    rows = flight.rows(RATE_HZ).tolist()
    for vehicle_id in flight.ids:
        style = (vehicle_id - 1) % len(COLOURS)
        yield f"<Placemark><name>vehicle {vehicle_id}</name><styleUrl>#c{style}</styleUrl>"
        yield "<gx:Track><altitudeMode>absolute</altitudeMode>"
        for row in rows:
            yield f"<when>{flight.at(row).isoformat(timespec='milliseconds').replace('+00:00', 'Z')}</when>"
        for row in rows:
            yield f"<gx:coord>{_tuple(flight.position(row, vehicle_id), ' ')}</gx:coord>"
        yield "</gx:Track></Placemark>"
    yield "</Folder><Folder><name>Mission</name>"
    for name, position in flight.route_points():
        point = f"<Point><altitudeMode>absolute</altitudeMode><coordinates>{_tuple(position)}</coordinates></Point>"
        yield f"<Placemark><name>{name}</name>{point}</Placemark>"
    fence = flight.fence()
    if fence:
        ring = " ".join([_tuple(vertex) for vertex in [*fence, fence[0]]])
        yield "<Placemark><name>fence</name><LineString><tessellate>1</tessellate>"
        yield f"<coordinates>{ring}</coordinates></LineString></Placemark>"
    yield "</Folder><Folder><name>Trunks</name>"
    for tree in flight.stand.trees:
        foot, top = (flight.on_ground(tree.east_m, tree.north_m, up_m) for up_m in (0.0, tree.height_m))
        yield f"<Placemark><name>{2.0 * tree.radius_m:.2f} m</name><styleUrl>#trunk</styleUrl>"
        yield "<LineString><altitudeMode>absolute</altitudeMode>"
        yield f"<coordinates>{_tuple(foot)} {_tuple(top)}</coordinates></LineString></Placemark>"
    yield "</Folder></Document></kml>"


def _tuple(position: Wgs84, between: str = ",") -> str:
    return f"{position.lon_deg:.7f}{between}{position.lat_deg:.7f}{between}{position.alt_m:.2f}"
