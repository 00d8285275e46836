"""GeoJSON (RFC 7946) for GIS and web maps: a line for each vehicle, the mission's places, fence and trunks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from mission.common.frames import Wgs84
from mission.common.plane import edges
from sim_bridge.judge.export.flown import Flown

RATE_HZ = 2.0


def document(flight: Flown) -> Iterator[str]:
    """The lines of a GeoJSON file, a feature each. The third coordinate is the altitude above sea level."""
    yield '{"type": "FeatureCollection", "features": ['
    features = list(_features(flight))
    for k, feature in enumerate(features):
        yield json.dumps(feature) + ("," if k < len(features) - 1 else "")
    yield "]}"


def _features(flight: Flown) -> Iterator[dict[str, Any]]:
    rows = flight.rows(RATE_HZ).tolist()
    times_s = [round(float(flight.recording.time_s[row]), 3) for row in rows]
    for vehicle_id in flight.ids if len(rows) > 1 else ():
        line = [_position(flight.position(row, vehicle_id)) for row in rows]
        yield _feature("LineString", line, kind="vehicle", vehicle=vehicle_id, time_s=times_s)
    for name, position in flight.route_points():
        yield _feature("Point", _position(position), kind="place", name=name)
    fence, polygon = flight.fence(), flight.mission.fence.polygon_enu_m
    if polygon is not None:
        if sum(a[0] * b[1] - b[0] * a[1] for a, b in edges(polygon)) < 0.0:  # RFC 7946: it runs against the clock
            fence.reverse()
        yield _feature("Polygon", [[_position(vertex) for vertex in [*fence, fence[0]]]], kind="fence")
    for tree in flight.stand.trees:
        foot = flight.on_ground(tree.east_m, tree.north_m)
        tags = {"dbh_m": round(2.0 * tree.radius_m, 4), "height_m": tree.height_m, "species": tree.species}
        yield _feature("Point", _position(foot), kind="trunk", **tags)


def _feature(geometry: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": geometry, "coordinates": coordinates}, "properties": properties}


def _position(position: Wgs84) -> list[float]:
    return [round(position.lon_deg, 7), round(position.lat_deg, 7), round(position.alt_m, 2)]
