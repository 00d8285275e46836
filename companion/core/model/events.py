"""Events that an agent receives: from its autopilot, its sensors, its neighbours and the operator."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from companion.core.model.beacon import Beacon, RangeTo, RelativeReport, TrunkReport
from companion.core.model.stand import RecordsWaiting, StandMeasured
from companion.core.model.states import AutopilotTraits, FlightMode, LandedState, Order, Request, Result
from mission.common.frames import Vec3

CLOCKS_PART_S: Final = 1.0  # a time that went on by more, against what was heard, is another clock's
# Of rays that a lidar on a vehicle may tell
REACH_MAX_M: Final = 1_000.0
AGE_MAX_S: Final = 60.0
RAY_TIME_MAX_S: Final = 0.1
ANGLE_MAX_RAD: Final = 1_000.0  # of a yaw that turned on and on
STEP_MIN_RAD: Final = math.radians(0.009)  # no lidar is finer
STEP_MAX_RAD: Final = math.radians(31.0)
SLACK: Final = 1e-6


@dataclass(slots=True, init=False, unsafe_hash=True)
class HeardBeacon:
    """A neighbour's beacon as it arrives: what was said, and where the sender is, which the codec makes relative."""

    said: Final[Beacon]
    rel_ned_m: Final[Vec3]  # from the receiver's position when it was decoded to the sender
    is_vouched: Final[bool]  # False: its sender does not vouch for what it sends, so it frees nothing

    def __init__(self, said: Beacon, rel_ned_m: Vec3, *, is_vouched: bool = True) -> None:
        self.said = said
        self.rel_ned_m = rel_ned_m
        self.is_vouched = is_vouched


@dataclass(slots=True, init=False, unsafe_hash=True)
class Ranges:
    """SWARM_RANGES: distances that the own range radio has measured, slant."""

    ranges: Final[tuple[RangeTo, ...]]

    def __init__(self, ranges: tuple[RangeTo, ...]) -> None:
        self.ranges = ranges


@dataclass(slots=True, init=False, unsafe_hash=True)
class Satellites:
    """GPS_RAW_INT, with what the estimator says: the own receiver."""

    used: Final[bool]  # the autopilot's position goes by them
    sd_m: Final[float]  # how wrong a fix is, level
    has_fix: Final[bool]  # the receiver has one now, whatever the estimator still goes by

    def __init__(self, used: bool, sd_m: float, has_fix: bool = True) -> None:
        self.used = used
        self.sd_m = sd_m
        self.has_fix = has_fix


@dataclass(slots=True, init=False, unsafe_hash=True)
class Position:
    """Own position and velocity (LOCAL_POSITION_NED, tied to the mission's frame by the codec)."""

    pos_ned_m: Final[Vec3]
    vel_ned_mps: Final[Vec3]
    boot_s: Final[float | None]  # the autopilot's time since boot, wrapping at 2^32 ms

    def __init__(self, pos_ned_m: Vec3, vel_ned_mps: Vec3, boot_s: float | None = None) -> None:
        self.pos_ned_m = pos_ned_m
        self.vel_ned_mps = vel_ned_mps
        self.boot_s = boot_s

    @property
    def is_finite(self) -> bool:
        """All of its numbers are."""
        numbers = 0.0
        for three in (self.pos_ned_m, self.vel_ned_mps):
            numbers += three[0] + three[1] + three[2]
        return numbers - numbers == 0.0

    def since_s(self, before: Position, heard_s: float) -> float:
        """Time since the reading before, which was heard `heard_s` earlier; >= 0.

        By the autopilot's own time where both tell it: a burst was not measured at once.
        """
        if self.boot_s is not None and before.boot_s is not None:
            since_s = self.boot_s - before.boot_s
            if 0.0 <= since_s <= heard_s + CLOCKS_PART_S:
                return since_s
        return max(0.0, heard_s)


class Scan:
    """Base of what an obstacle sensor has measured: sectors, or rays."""

    __slots__ = ()


@dataclass(slots=True, init=False, unsafe_hash=True)
class ObstacleScan(Scan):
    """OBSTACLE_DISTANCE: one sweep of an obstacle sensor, and how the vehicle stood when it came (ATTITUDE).

    Sector k looks at `start_rad + k * step_rad` in the vehicle's own level plane, clockwise from ahead, which stands
    tilted by roll and pitch (body axes: front, right, down) and turned by yaw.
    """

    sensor: Final[int]  # its MAVLink component; a vehicle may carry some
    ranges_m: Final[tuple[float, ...]]  # min_m..max_m; inf: nothing within max_m; nan: not measured
    start_rad: Final[float]
    step_rad: Final[float]  # > 0; all sectors within one turn
    min_m: Final[float]  # what is nearer counts as being there
    max_m: Final[float]
    roll_rad: Final[float]
    pitch_rad: Final[float]
    yaw_rad: Final[float]
    age_s: Final[float]  # since it was measured, as far as it can be known

    def __init__(
        self,
        sensor: int,
        ranges_m: tuple[float, ...],
        start_rad: float,
        step_rad: float,
        min_m: float,
        max_m: float,
        roll_rad: float = 0.0,
        pitch_rad: float = 0.0,
        yaw_rad: float = 0.0,
        age_s: float = 0.0,
    ) -> None:
        self.sensor = sensor
        self.ranges_m = ranges_m
        self.start_rad = start_rad
        self.step_rad = step_rad
        self.min_m = min_m
        self.max_m = max_m
        self.roll_rad = roll_rad
        self.pitch_rad = pitch_rad
        self.yaw_rad = yaw_rad
        self.age_s = age_s


@dataclass(slots=True, init=False, unsafe_hash=True)
class LidarScan(Scan):
    """SWARM_LIDAR_SCAN: rays of one layer of a lidar, side by side, and how the vehicle stood meanwhile (ATTITUDE).

    Ray k was measured `age_s - k * ray_time_s` ago. In the body's frame then (front, right, down) it looks at the
    bearing `start_rad + k * step_rad`, clockwise from ahead, and `elevation_rad` above the level plane. A turn is many
    of these: of some bearings each, and of each layer.
    """

    sensor: Final[int]  # its MAVLink component; a vehicle may carry some
    turn: Final[int]  # the same in all of a turn; modulo 256
    ranges_m: Final[tuple[float, ...]]  # min_m..max_m; inf: nothing within max_m; nan: not measured
    elevation_rad: Final[float]
    start_rad: Final[float]
    step_rad: Final[float]  # negative: counter-clockwise
    min_m: Final[float]  # what is nearer counts as being there
    max_m: Final[float]
    age_s: Final[float]  # of the first ray, as far as it can be known
    ray_time_s: Final[float]
    first_attitude_rad: Final[Vec3]  # roll, pitch, yaw at the first ray
    last_attitude_rad: Final[Vec3]  # at the last

    def __init__(
        self,
        sensor: int,
        turn: int,
        ranges_m: tuple[float, ...],
        elevation_rad: float,
        start_rad: float,
        step_rad: float,
        min_m: float,
        max_m: float,
        age_s: float,
        ray_time_s: float,
        first_attitude_rad: Vec3,
        last_attitude_rad: Vec3,
    ) -> None:
        self.sensor = sensor
        self.turn = turn
        self.ranges_m = ranges_m
        self.elevation_rad = elevation_rad
        self.start_rad = start_rad
        self.step_rad = step_rad
        self.min_m = min_m
        self.max_m = max_m
        self.age_s = age_s
        self.ray_time_s = ray_time_s
        self.first_attitude_rad = first_attitude_rad
        self.last_attitude_rad = last_attitude_rad

    @property
    def can_be(self) -> bool:
        """All of its numbers are finite and within what a lidar on a vehicle may tell.

        What comes as SWARM_LIDAR_SCAN is; sensors of installed packages tell events of their own.
        """
        if not (0.0 <= self.min_m <= self.max_m <= REACH_MAX_M and self.max_m > 0.0):  # all false for NaN
            return False
        if not (abs(self.age_s) <= AGE_MAX_S and 0.0 <= self.ray_time_s <= RAY_TIME_MAX_S):
            return False
        if not (abs(self.start_rad) <= math.tau + SLACK and abs(self.elevation_rad) <= math.pi / 2.0 + SLACK):
            return False
        count, step_rad = len(self.ranges_m), abs(self.step_rad)
        if count == 0 or (count > 1 and not (step_rad >= STEP_MIN_RAD and (count - 1) * step_rad <= math.tau + SLACK)):
            return False
        if not step_rad <= max(STEP_MAX_RAD, math.tau / count + SLACK):
            return False
        for angle_rad in (*self.first_attitude_rad, *self.last_attitude_rad):
            if not abs(angle_rad) <= ANGLE_MAX_RAD:
                return False
        for range_m in self.ranges_m:  # noqa: SIM110 - a generator is slow where it is compiled
            if range_m < 0.0:
                return False
        return True


@dataclass(slots=True, init=False, unsafe_hash=True)
class BootTime:
    """The autopilot's time since boot when it answered a TIMESYNC request of ours."""

    boot_s: Final[float]
    round_trip_s: Final[float]

    def __init__(self, boot_s: float, round_trip_s: float) -> None:
        self.boot_s = boot_s
        self.round_trip_s = round_trip_s


@dataclass(frozen=True, slots=True)
class AutopilotMode:
    """HEARTBEAT of the vehicle's own autopilot."""

    mode: FlightMode
    armed: bool
    name: str  # as an operator knows it
    failsafe: bool = False  # the autopilot acts by itself, and chose this mode
    traits: AutopilotTraits | None = None  # None: an unknown autopilot, never armed; `name` says what it is


@dataclass(frozen=True, slots=True)
class AutopilotHealth:
    """SYS_STATUS: ready to arm, and the battery's charge (0..100 %, None: unknown)."""

    ready_to_arm: bool
    battery_percent: int | None


@dataclass(frozen=True, slots=True)
class Landed:
    """EXTENDED_SYS_STATE."""

    state: LandedState


@dataclass(frozen=True, slots=True)
class Answer:
    """COMMAND_ACK to a request."""

    request: Request
    result: Result


@dataclass(frozen=True, slots=True)
class AutopilotText:
    """STATUSTEXT of the vehicle's own autopilot."""

    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class OperatorOrder:
    """An operator's order to this companion.

    `hands_back`: it names this vehicle, which is steered again though a pilot has taken it over.
    """

    order: Order
    hands_back: bool = True


AutopilotEvent = Position | BootTime | AutopilotMode | AutopilotHealth | Landed | Answer | AutopilotText

AnyScan = ObstacleScan | LidarScan

RecordEvent = StandMeasured | RecordsWaiting

Event = (
    AutopilotEvent
    | OperatorOrder
    | HeardBeacon
    | AnyScan
    | Ranges
    | Satellites
    | RelativeReport
    | TrunkReport
    | RecordEvent
)
