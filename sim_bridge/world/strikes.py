"""Effects of simulated faults on vehicles and their sensors, a row for each kind."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Final

from companion.mavlink import dialect
from companion.mavlink.framing import wire
from mission.schema.kinds import FaultKind, Personality
from sim_bridge.world.autopilot import Link
from sim_bridge.world.sensors.simulated import SimulatedSensor
from sim_bridge.world.world import World

PILOT_SYSTEM: Final = 255  # as ground stations have it
PILOT_COMPONENT: Final = 190
PILOT_MODE: Final = {Personality.PX4: 3.0, Personality.ARDUPILOT: 5.0}  # as DO_SET_MODE has POSCTL and LOITER
Struck = Mapping[int, tuple[float, ...]]  # by id: the numbers of the fault in force, in the order of its row


def _wind(world: World, struck: Struck) -> None:
    world.set_winds({k: (east_mps, north_mps, 0.0) for k, (east_mps, north_mps) in struck.items()})


def _gnss_outage(world: World, struck: Struck) -> None:
    for k, vehicle in world.vehicles.items():
        if vehicle.receiver is not None:
            vehicle.receiver.is_covered = k in struck
        elif vehicle.gnss is not None:
            vehicle.gnss.set_fix(k not in struck)


def _gnss_drift(world: World, struck: Struck) -> None:
    for k, vehicle in world.vehicles.items():
        drift_ne_mps = (struck[k][1], struck[k][0]) if k in struck else None
        if vehicle.receiver is not None:
            vehicle.receiver.set_drift(drift_ne_mps)
        elif vehicle.gnss is not None:
            vehicle.gnss.set_drift(drift_ne_mps)


def _position_jump(world: World, struck: Struck) -> None:
    for k, vehicle in world.vehicles.items():
        if vehicle.position is not None:
            vehicle.position.set_jump((struck[k][1], struck[k][0]) if k in struck else (0.0, 0.0))


def _position_freeze(world: World, struck: Struck) -> None:
    for k, vehicle in world.vehicles.items():
        if vehicle.position is not None:
            vehicle.position.freeze(k in struck)


def _position_drift(world: World, struck: Struck) -> None:
    for k, vehicle in world.vehicles.items():
        if vehicle.position is not None:
            vehicle.position.set_drift((struck[k][1], struck[k][0]) if k in struck else None)


def _height_error(world: World, struck: Struck) -> None:
    for k, vehicle in world.vehicles.items():
        if vehicle.position is not None:
            vehicle.position.set_height_error(struck[k][0] if k in struck else 0.0)


def _motor(world: World, struck: Struck) -> None:
    for k in struck:
        world.fail_motor(k)


def _pilot(world: World, struck: Struck) -> None:
    """By the mode of sticks that holds a position, as a ground station sets it."""
    for k in struck:
        mode = PILOT_MODE[world.mission.sim.personality_of(k)]
        order = dialect.MAVLink_command_long_message(k, 1, dialect.MAV_CMD_DO_SET_MODE, 0, 1.0, mode, *[0.0] * 5)
        data = wire.pack(order, seq=0, system=PILOT_SYSTEM, component=PILOT_COMPONENT)
        world.vehicles[k].autopilot.receive(Link.GROUND, data, world.now_s)


OF_VEHICLES: Final[Mapping[FaultKind, Callable[[World, Struck], None]]] = {
    FaultKind.WIND: _wind,
    FaultKind.GNSS_OUTAGE: _gnss_outage,
    FaultKind.GNSS_DRIFT: _gnss_drift,
    FaultKind.POSITION_JUMP: _position_jump,
    FaultKind.POSITION_FREEZE: _position_freeze,
    FaultKind.POSITION_DRIFT: _position_drift,
    FaultKind.HEIGHT_ERROR: _height_error,
    FaultKind.MOTOR: _motor,
    FaultKind.PILOT: _pilot,
}
OF_SENSORS: Final = {
    FaultKind.SCAN_ERRORS: ("obstacles", "lidar"),
    FaultKind.RANGE_ERRORS: ("ranges",),
}  # by their names


def strike(world: World, kind: FaultKind, struck: Struck) -> None:
    """Sets which vehicles a kind of fault strikes now; of no kind but these anything comes."""
    if kind in OF_VEHICLES:
        OF_VEHICLES[kind](world, struck)
    strike_sensors(world.sensors, kind, struck)


def strike_sensors(sensors: Iterable[SimulatedSensor], kind: FaultKind, struck: Struck) -> None:
    """The same of sensors alone."""
    for sensor in sensors:
        if sensor.name in OF_SENSORS.get(kind, ()):
            sensor.set_errors(struck)
