"""The Tick of a simulated world."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from sim_bridge.drive.links.transmitter import Transmitter
from sim_bridge.judge.tick import Tick
from sim_bridge.world.world import Vehicle, World


def world_tick(
    world: World,
    transmitter: Transmitter,
    *,
    alive: Iterable[int],
    answered: Iterable[int],
    frames: Mapping[int, tuple[bytes, ...]] = MappingProxyType({}),
) -> Tick:
    """`world` as it stands now; `frames`: as in Tick.

    `alive`, `answered`: as in Tick, of all vehicles: those that have fallen are left out here.
    """
    touched = world.touched
    states = [vehicle.airframe.state for vehicle in world.vehicles.values()]
    autopilots = [vehicle.autopilot for vehicle in world.vehicles.values()]
    return Tick(
        time_s=world.now_s,
        pos_ned_m=tuple([state.pos_ned_m for state in states]),
        vel_ned_mps=tuple([state.vel_ned_mps for state in states]),
        on_ground=tuple([state.on_ground for state in states]),
        armed=tuple([autopilot.armed for autopilot in autopilots]),
        mode=tuple([autopilot.mode for autopilot in autopilots]),
        range_m=tuple([world.radio.range_m(vehicle_id) for vehicle_id in world.vehicles]),
        touched=tuple([str(touched.get(vehicle_id, "")) for vehicle_id in world.vehicles]),
        alive=tuple([vehicle_id for vehicle_id in alive if vehicle_id not in touched]),
        answered=tuple([vehicle_id for vehicle_id in answered if vehicle_id not in touched]),
        said=dict(transmitter.said),
        said_s=dict(transmitter.said_s),
        frames=frames,
        words=dict(transmitter.words),
        north_off_rad=tuple([_north_off_rad(vehicle) for vehicle in world.vehicles.values()]),
        asked_ned_mps=tuple([autopilot.asked_ned_mps for autopilot in autopilots]),
    )


def _north_off_rad(vehicle: Vehicle) -> float:
    return 0.0 if vehicle.odometry is None else vehicle.odometry.north_off_rad
