"""MAVSDK uploads a fence, reads it back and clears it. A program, as MAVSDK may abort its process.

python mavsdk_fence.py udpout://127.0.0.1:PORT -> one JSON object on stdout, exit code 0
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.geofence import GeofenceAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.plugins.geofence import Circle, FenceType, GeofenceData, Point, Polygon

LIMIT_S = 120.0
CORNERS = [(47.398, 8.545), (47.398, 8.547), (47.397, 8.547), (47.397, 8.545)]
RADIUS_M = 3.5


async def fence(url: str) -> dict[str, Any]:
    """What came back after the upload, and after the clearing."""
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(LIMIT_S)
        assert system is not None, "no autopilot found"
        geofence, raw = GeofenceAsync(system), MissionRawAsync(system)
        polygon = Polygon(points=[Point(*corner) for corner in CORNERS], fence_type=FenceType.INCLUSION)
        circle = Circle(point=Point(*CORNERS[0]), radius=RADIUS_M, fence_type=FenceType.EXCLUSION)
        await geofence.upload_geofence(GeofenceData(polygons=[polygon], circles=[circle]))
        items = await raw.download_geofence()
        await geofence.clear_geofence()
        left = await raw.download_geofence()
    return {
        "items": [[item.command, item.param1, item.x, item.y] for item in items],
        "left": len(left),
    }


if __name__ == "__main__":
    print(json.dumps(asyncio.run(fence(sys.argv[1]))))
