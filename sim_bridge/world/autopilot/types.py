"""Types that every personality shares with what flies, measures or drives it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Protocol

from companion.mavlink import dialect as mav
from mission.common.frames import Vec3
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot.battery import Battery
from sim_bridge.world.autopilot.fence import Fence
from sim_bridge.world.autopilot.protocols.links import Link, LinkCounts
from sim_bridge.world.autopilot.protocols.parameters import ParameterTable
from sim_bridge.world.sensors.satellites import Fix


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = mav.MAV_RESULT_ACCEPTED
    TEMPORARILY_REJECTED = mav.MAV_RESULT_TEMPORARILY_REJECTED
    DENIED = mav.MAV_RESULT_DENIED
    UNSUPPORTED = mav.MAV_RESULT_UNSUPPORTED
    FAILED = mav.MAV_RESULT_FAILED


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = mav.MAV_LANDED_STATE_ON_GROUND
    IN_AIR = mav.MAV_LANDED_STATE_IN_AIR
    TAKEOFF = mav.MAV_LANDED_STATE_TAKEOFF
    LANDING = mav.MAV_LANDED_STATE_LANDING


class Failsafe(Enum):
    """Cause of a failsafe."""

    OFFBOARD_LOSS = "offboard signal lost"
    BATTERY = "battery"
    GCS_LOSS = "ground station lost"
    GEOFENCE = "geofence"
    POSITION_LOSS = "position lost"
    TERMINATED = "terminated"


class BatteryLevel(IntEnum):
    """MAV_BATTERY_CHARGE_STATE."""

    OK = mav.MAV_BATTERY_CHARGE_STATE_OK
    LOW = mav.MAV_BATTERY_CHARGE_STATE_LOW
    CRITICAL = mav.MAV_BATTERY_CHARGE_STATE_CRITICAL
    EMERGENCY = mav.MAV_BATTERY_CHARGE_STATE_EMERGENCY


class StreamProfile(Enum):
    """Profile of what a link streams unasked; the personality's tables say which messages, and how often."""

    ONBOARD = "onboard"  # the default for a companion, as recorded
    GROUND = "ground"  # the default for a ground station
    MINIMAL = "minimal"  # HEARTBEAT and little more; the rest on request


@dataclass(frozen=True, slots=True)
class Notice:
    """A text for people; severity as MAV_SEVERITY."""

    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Measurements by the bridge."""

    mode: str  # the personality's own name
    armed: bool
    landed: LandedState
    failsafe: Failsafe | None
    battery_remaining: float  # 0..1
    setpoints: int  # accepted, since boot
    setpoints_rejected: int  # not finite, or of a kind that the personality does not take


class Mode(Protocol):
    """A flight mode: an enum whose value is HEARTBEAT.custom_mode."""

    @property
    def name(self) -> str:
        """As the personality calls it."""

    @property
    def value(self) -> int:
        """HEARTBEAT.custom_mode."""


class FlightLogic(Protocol):
    """One vehicle's flight logic, without MAVLink. Positions: NED metres about the mission's origin."""

    state: AirframeState
    battery: Battery
    origin_ned_m: Vec3  # of the local frame
    home_ned_m: Vec3 | None
    home_yaw_rad: float
    home_at_s: float
    notices: deque[Notice]
    armed: bool
    failsafe: Failsafe | None
    command_ned_mps: Vec3
    fence: Fence  # as uploaded

    @property
    def mode(self) -> Mode:
        """Mode and state that HEARTBEAT shows."""

    @property
    def command_yaw_rad(self) -> float:
        """The heading that the airframe is to keep."""

    @property
    def landed_state(self) -> LandedState:
        """As EXTENDED_SYS_STATE shows it."""

    @property
    def battery_level(self) -> BatteryLevel:
        """By this personality's own thresholds."""

    def hear_gcs(self, system: int, now_s: float) -> None:
        """A ground station's heartbeat has come."""

    def update(self, now_s: float) -> None:
        """Look, decide, and give the airframe its velocity and heading."""

    def disarm(self, *, force: bool) -> Result:
        """Refused in the air, unless forced: then the vehicle falls."""


class Satellites(Protocol):
    """A vehicle's, where crowns stand above them."""

    @property
    def uses(self) -> bool:
        """Its estimator goes by them."""

    @property
    def fix(self) -> Fix:
        """Last fix of its receiver."""

    @property
    def fix_ned_m(self) -> Vec3:
        """Position of that; the last one, where there is none."""


class Autopilot(Protocol):
    """A vehicle's autopilot as the bridge drives it. `now_s`: seconds since its boot, never backwards."""

    sysid: int
    parameters: ParameterTable

    def receive(self, link: Link, data: bytes, now_s: float) -> None:
        """A datagram from a client. Whatever is in it, nothing raises but an unknown link (KeyError)."""

    def update(self, now_s: float) -> None:
        """Once per step of the bridge, before `airframe.step`."""

    def transmit(self, link: Link, now_s: float) -> list[bytes]:
        """All that is due on `link`, as datagrams of whole frames; answers first, then streams."""

    def record(self, now_s: float) -> bytes:
        """Frames that a recorder on the vehicle hears besides the onboard link. To be asked at every step, or never."""

    def timesync_request(self, now_s: float) -> bytes:
        """A TIMESYNC request on the onboard link, for what drives the clock in lockstep."""

    def counts(self, link: Link) -> LinkCounts:
        """Counters of `link`."""

    @property
    def armed(self) -> bool:
        """The rotors may turn."""

    @property
    def mode(self) -> str:
        """The personality's own name of the flight mode."""

    @property
    def asked_ned_mps(self) -> Vec3 | None:
        """The velocity that it was asked to fly last, along its own north; None: none, or not on every axis."""

    @property
    def snapshot(self) -> Snapshot:
        """Measurements by the bridge."""
