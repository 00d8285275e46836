"""All that differs between makes of autopilot, as data: one `Make` each in `px4` and `ardupilot`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from companion.core.model.states import AutopilotTraits, FlightMode, Request
from companion.mavlink import dialect
from mission.document.height_layers import list_layers
from mission.document.model import Mission

Command = tuple[int, tuple[float, ...]]  # MAV_CMD and its parameters, as many as matter
FLOAT_TOLERANCE = 1e-6  # of REAL32

# Every make is asked by these commands, so that an answer tells its request.
REQUESTS = {
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: Request.ARM,
    dialect.MAV_CMD_DO_SET_MODE: Request.OFFBOARD,
    dialect.MAV_CMD_NAV_TAKEOFF: Request.TAKEOFF,
    dialect.MAV_CMD_NAV_LAND: Request.LAND,
}


@dataclass(frozen=True, slots=True)
class Altitude:
    """Altitude at which a takeoff ends."""

    amsl_m: float
    above_home_m: float


@dataclass(frozen=True, slots=True)
class Rule:
    """One parameter as it must be under a canopy. An int is an integer parameter, a float a REAL32."""

    name: str
    good: Mapping[int | float, str]  # value -> what it does; the first of them is what preflight's `--apply` sets
    why: str
    older_names: tuple[str, ...] = ()  # of the same parameter in earlier firmwares
    optional: bool = False  # older firmwares have none: only a warning

    @property
    def names(self) -> tuple[str, ...]:
        """To be tried in this order."""
        return (self.name, *self.older_names)

    @property
    def wanted(self) -> int | float:
        """Value that `--apply` sets."""
        return next(iter(self.good))

    def fits(self, value: float) -> bool:
        """`value`, as read, is a good one."""
        return any(math.isclose(value, good, rel_tol=FLOAT_TOLERANCE, abs_tol=FLOAT_TOLERANCE) for good in self.good)

    @property
    def text(self) -> str:
        """The good values in words."""
        return " or ".join(f"{value:g} ({meaning})" for value, meaning in self.good.items())


@dataclass(frozen=True, slots=True)
class Aid:
    """One way by which an estimator without GNSS knows how it moves, or any its height, by what switches it on.

    It is for its owner to say which sensor a vehicle carries: preflight reads them, and sets none.
    """

    text: str  # what they must be, in words
    bits: Mapping[str, int]  # each has one of these bits
    equals: Mapping[str, int]

    @property
    def names(self) -> tuple[str, ...]:
        """Of its parameters."""
        return (*self.equals, *self.bits)

    def is_on(self, values: Mapping[str, float | None]) -> bool:
        """By values as read; None: there is none."""
        told = {name: int(value) for name, value in values.items() if value is not None and math.isfinite(value)}
        has_bits = all(told.get(name, 0) & wanted for name, wanted in self.bits.items())
        return has_bits and all(told.get(name) == wanted for name, wanted in self.equals.items())


@dataclass(frozen=True, slots=True, eq=False)
class Make:
    """One make of autopilot: how it is known, flown, and made fit to fly under trees."""

    key: str  # in reports and `--json`: px4
    name: str  # as people know it: PX4
    autopilot: int  # HEARTBEAT.autopilot (MAV_AUTOPILOT)

    # In flight.
    traits: AutopilotTraits
    modes: Mapping[int, FlightMode]  # by HEARTBEAT.custom_mode; others are the pilot's
    mode_names: Mapping[int, str]  # by the same, as an operator knows them
    command: Callable[[Request, Altitude], Command]  # one of REQUESTS
    streams_hz: Mapping[int, float]  # by message id, beside those that every autopilot is asked for
    reception_hz: Mapping[int, float]  # those that say whether its position goes by GNSS
    ready_ekf_flags: int  # EKF_STATUS_REPORT flags that readiness needs beside SYS_STATUS' prearm bit; 0: none

    # Before it.
    ready_state: int | None  # HEARTBEAT.system_status (MAV_STATE) that preflight waits for; None: any
    ready_about: str  # what readiness takes, in words
    id_parameter: str  # what the vehicle's system id is set by
    serial_parameters: str  # what a serial port is set to MAVLink and its baud rate by
    canopy_rules: tuple[Rule, ...]  # nothing may end in a return flight, which first climbs into the branches
    fence_rules: Callable[[Mission], tuple[Rule, ...]]  # the mission's ceiling, and what makes the fence work

    satellite_rules: tuple[Rule, ...]  # of one with GNSS, in a swarm of which not all have it
    odometry_rules: Callable[[Mission], tuple[Rule, ...]]  # of a vehicle without GNSS
    aids: tuple[Aid, ...] = ()  # of which it needs one
    height_aids: tuple[Aid, ...] = ()  # of which one that changes between layers of height needs one
    odometry_aids: tuple[Aid, ...] = ()  # of which one that its companion tells its velocity needs one, to use it
    takes_odometry: bool = True  # a velocity in NED by ODOMETRY; False: by VISION_SPEED_ESTIMATE
    ground_hold: Command | None = None  # out of its offboard mode, where that alone keeps it from arming; None: it arms

    def rules(self, mission: Mission, vehicle_id: int | None = None) -> tuple[Rule, ...]:
        """Every parameter that must be right for this vehicle of `mission`; None: for one with GNSS."""
        own: tuple[Rule, ...] = ()
        if vehicle_id is not None and mission.flies_by_ranges:
            own = self.satellite_rules if mission.has_satellites(vehicle_id) else self.odometry_rules(mission)
        return self.canopy_rules + own + self.fence_rules(mission)

    def aids_of(self, mission: Mission, vehicle_id: int) -> tuple[Aid, ...]:
        """Aids of which this vehicle of `mission` needs one; none: it has GNSS."""
        return () if mission.has_satellites(vehicle_id) else self.aids

    def height_aids_of(self, mission: Mission) -> tuple[Aid, ...]:
        """Aids of which a vehicle of `mission` needs one; none: the mission flies at one height."""
        return self.height_aids if len(list_layers(mission)) > 1 else ()

    def odometry_aids_of(self, mission: Mission, vehicle_id: int) -> tuple[Aid, ...]:
        """Aids of which this vehicle needs one to use the velocity that its companion sends; none: it is sent none."""
        sensing = mission.sensing
        sends = sensing is not None and sensing.sends_odometry and mission.has_satellites(vehicle_id)
        return self.odometry_aids if sends else ()
