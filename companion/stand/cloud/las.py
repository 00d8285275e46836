"""A stand's point cloud as LAS 1.4 (ASPRS, R15), compressed as LAZ, in UTM where the mission has an origin.

Point format 6. The same cloud gives the same bytes, with the same versions of laspy and lazrs.
"""

from __future__ import annotations

import io
from datetime import date
from typing import Final

import laspy
import numpy as np
from laspy.vlrs.vlr import VLR

from companion.stand.cloud.merge import Floats, StandCloud
from mission import __version__
from mission.common.frames import LocalFrame, Wgs84, enu_to_ned
from mission.stems import utm

SCALE_M: Final = 0.001
MADE: Final = date(2026, 1, 1)  # the same records give the same file
STEM: Final = 5  # of ASPRS's classes: high vegetation
OTHER: Final = 1  # unclassified
BLOCK: Final = 100_000
PROJECTION: Final = ("LASF_Projection", 2112, "OGC coordinate system WKT")
WKT: Final = (
    'PROJCS["WGS 84 / UTM zone {number}{half}",GEOGCS["WGS 84",DATUM["WGS_1984",'
    'SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],'
    'PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],'
    'UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]],'
    'PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",{meridian}],'
    'PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",{northing}],'
    'UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],AXIS["Northing",NORTH],AUTHORITY["EPSG","{epsg}"]]'
)


def to_laz(cloud: StandCloud, origin: Wgs84 | None) -> bytes:
    """Of a stand whose frame starts at `origin`; without one in metres of that frame, and of no reference system."""
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.generating_software = f"understory {__version__}"
    header.creation_date = MADE
    header.scales = np.full(3, SCALE_M)
    east_m, north_m, up_m = _placed(cloud, origin)
    header.offsets = np.array([np.floor(axis.min()) if cloud.n else 0.0 for axis in (east_m, north_m, up_m)])
    extra = {
        "ring": ("u1", "layer of the lidar"),
        "treeID": ("u4", "row of the stem map"),
        "above_ground_m": ("f4", "m"),
    }
    header.add_extra_dims([laspy.ExtraBytesParams(name, kind, about) for name, (kind, about) in extra.items()])
    if origin is not None:
        header.vlrs.append(VLR(*PROJECTION, record_data=_wkt(utm.zone_at(origin.lat_deg, origin.lon_deg))))
    header.global_encoding.wkt = True  # point format 6 has no other
    las = laspy.LasData(header)
    las.x, las.y, las.z = east_m, north_m, up_m
    las["gps_time"], las["point_source_id"] = cloud.at_s, cloud.vehicle
    las["classification"] = np.where(cloud.of_stem, STEM, OTHER).astype(np.uint8)
    las["return_number"] = las["number_of_returns"] = np.ones(cloud.n, dtype=np.uint8)
    las["ring"], las["treeID"], las["above_ground_m"] = cloud.ring, cloud.tree, cloud.above_ground_m
    out = io.BytesIO()
    las.write(out, do_compress=True, laz_backend=laspy.LazBackend.Lazrs)
    return out.getvalue()


def _placed(cloud: StandCloud, origin: Wgs84 | None) -> tuple[Floats, Floats, Floats]:
    """Easting, northing, and altitude above mean sea level; without an origin those of the frame.

    UTM is nearly a similarity within a stand: it is worked out at four corners, and is between them to a millimetre.
    """
    if origin is None or not cloud.n:
        return cloud.east_m, cloud.north_m, cloud.up_m
    frame, zone = LocalFrame(origin), utm.zone_at(origin.lat_deg, origin.lon_deg)
    corners_m = [
        (e, n) for e in (cloud.east_m.min(), cloud.east_m.max()) for n in (cloud.north_m.min(), cloud.north_m.max())
    ]
    there = []
    for east_m, north_m in corners_m:
        at = frame.to_wgs84(enu_to_ned((float(east_m), float(north_m), 0.0)))
        there.append(utm.from_wgs84(at.lat_deg, at.lon_deg, zone))
    low_e, low_n = corners_m[0]
    wide_m, high_m = max(corners_m[3][0] - low_e, 1e-3), max(corners_m[3][1] - low_n, 1e-3)
    u, v = (cloud.east_m - low_e) / wide_m, (cloud.north_m - low_n) / high_m
    weights = ((1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v)
    x, y = (sum(w * place[axis] for w, place in zip(weights, there, strict=True)) for axis in (0, 1))
    return np.asarray(x), np.asarray(y), cloud.up_m + origin.alt_m


def _wkt(zone: utm.Zone) -> bytes:
    text = WKT.format(
        number=zone.number,
        half="S" if zone.south else "N",
        meridian=6 * zone.number - 183,
        northing=10_000_000 if zone.south else 0,
        epsg=zone.epsg,
    )
    return text.encode() + b"\0"
