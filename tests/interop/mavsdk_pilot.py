"""MAVSDK flies one vehicle, and checks what it did. A program: `Action.arm()` may abort the whole process.

python mavsdk_pilot.py px4|ardupilot udpout://127.0.0.1:PORT -> one JSON object on stdout, exit code 0
"""

from __future__ import annotations

import asyncio
import json
import math
import sys
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.action import ActionError
from mavsdk.plugins.offboard import OffboardError, VelocityNedYaw
from mavsdk.plugins.telemetry import FlightMode, LandedState

LIMIT_S = 180.0  # for each thing that should happen; ArduPilot boots for 42 s
OFFBOARD_TRIES = 20  # positions come a few times a second
RATE_HZ = 10.0
TAKEOFF_M = 3.0
NORTH_MPS, EAST_MPS = 1.0, -0.5
FLOWN_M = 4.0


async def until(stream: AsyncGenerator[Any, None], wanted: Callable[[Any], bool], what: str) -> Any:
    """The first value that is `wanted`."""
    async with asyncio.timeout(LIMIT_S), aclosing(stream) as values:
        async for value in values:
            if wanted(value):
                return value
    raise AssertionError(f"{what}: the stream ended")


async def take_off_px4(action: ActionAsync, telemetry: TelemetryAsync) -> float:
    """Its altitude is a parameter; it tells when it is ready, and holds at the top. The altitude, as it says."""
    await until(telemetry.subscribe_health_all_ok(), bool, "healthy")
    await until(telemetry.subscribe_health(), lambda health: health.is_armable, "armable")  # later, as PX4
    await action.set_takeoff_altitude(TAKEOFF_M)
    altitude_m = float(await action.get_takeoff_altitude())
    await action.arm()
    await until(telemetry.subscribe_armed(), bool, "armed")
    await action.takeoff()
    await until(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.TAKEOFF, "TAKEOFF")
    await until(telemetry.subscribe_in_air(), bool, "in the air")
    await until(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.HOLD, "HOLD")  # at the top
    return altitude_m


async def take_off_ardupilot(action: ActionAsync, telemetry: TelemetryAsync) -> float:
    """It streams nothing unasked, knows its position late, and takes off only armed, in GUIDED."""
    await telemetry.set_rate_position_velocity_ned(RATE_HZ)
    await telemetry.set_rate_landed_state(RATE_HZ)
    await until(telemetry.subscribe_position_velocity_ned(), lambda _: True, "position")
    await action.set_takeoff_altitude(TAKEOFF_M)
    try:
        await action.takeoff()  # as recorded in ap_mavsdk_A: GUIDED, and refused on the ground, disarmed
    except ActionError:
        pass
    else:
        raise AssertionError("took off disarmed")
    await action.arm()
    await until(telemetry.subscribe_armed(), bool, "armed")
    await action.takeoff()
    await until(telemetry.subscribe_landed_state(), lambda state: state == LandedState.TAKING_OFF, "taking off")
    await until(telemetry.subscribe_landed_state(), lambda state: state == LandedState.IN_AIR, "at the top")
    return float(await action.get_takeoff_altitude())


TAKE_OFF = {"px4": take_off_px4, "ardupilot": take_off_ardupilot}


async def go_offboard(offboard: Any, telemetry: Any) -> None:
    """OFFBOARD; it is denied until two or three setpoints have come, and a busy machine is slow to send them."""
    for _ in range(OFFBOARD_TRIES):
        try:
            return await offboard.start()
        except OffboardError as error:
            denied = error
            await until(telemetry.subscribe_position_velocity_ned(), lambda _: True, "position")
    raise denied


async def fly(personality: str, url: str) -> dict[str, Any]:
    """Take off, fly OFFBOARD, hold, land; what was seen."""
    seen: dict[str, Any] = {}
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(LIMIT_S)
        assert system is not None, "no autopilot found"
        telemetry, action, offboard = TelemetryAsync(system), ActionAsync(system), OffboardAsync(system)

        def mode_is(mode: FlightMode) -> Any:
            return until(telemetry.subscribe_flight_mode(), lambda value: value == mode, mode.name)

        seen["takeoff_altitude_m"] = await TAKE_OFF[personality](action, telemetry)
        start = await until(telemetry.subscribe_position_velocity_ned(), lambda _: True, "position")
        seen["height_m"] = -start.position.down_m

        await offboard.set_velocity_ned(VelocityNedYaw(NORTH_MPS, EAST_MPS, 0.0, 0.0))
        await go_offboard(offboard, telemetry)
        await mode_is(FlightMode.OFFBOARD)
        moving = await until(
            telemetry.subscribe_position_velocity_ned(),
            lambda now: (
                math.hypot(now.position.north_m - start.position.north_m, now.position.east_m - start.position.east_m)
                > FLOWN_M
            ),
            "moved",
        )
        seen["moved_ned_m"] = [
            moving.position.north_m - start.position.north_m,
            moving.position.east_m - start.position.east_m,
            moving.position.down_m - start.position.down_m,
        ]
        seen["vel_ned_mps"] = [moving.velocity.north_m_s, moving.velocity.east_m_s, moving.velocity.down_m_s]
        await offboard.stop()
        await mode_is(FlightMode.HOLD)

        await action.land()
        await mode_is(FlightMode.LAND)
        await until(telemetry.subscribe_landed_state(), lambda state: state == LandedState.ON_GROUND, "landed")
        await until(telemetry.subscribe_armed(), lambda armed: not armed, "disarmed")
    return seen


if __name__ == "__main__":
    print(json.dumps(asyncio.run(fly(sys.argv[1], sys.argv[2]))))
