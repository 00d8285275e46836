"""MAVSDK reads a plan of QGroundControl with its own reader. A program, as MAVSDK may abort its process.

python mavsdk_plan.py udpout://127.0.0.1:PORT FILE.plan -> one JSON object on stdout, exit code 0
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync

LIMIT_S = 120.0


async def plan(url: str, file: str) -> dict[str, Any]:
    """What MAVSDK's own reader makes of the plan."""
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(LIMIT_S)
        assert system is not None, "no autopilot found"
        read = await MissionRawAsync(system).import_qgroundcontrol_mission(file)
    return {
        "mission": [[item.command, item.frame, item.param1, item.x, item.y, item.z] for item in read.mission_items],
        "fence": [[item.command, item.param1, item.x, item.y] for item in read.geofence_items],
    }


if __name__ == "__main__":
    print(json.dumps(asyncio.run(plan(sys.argv[1], sys.argv[2]))))
