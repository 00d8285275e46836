"""Actions of an agent: setpoints, requests, beacons, texts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from companion.core.model.beacon import Beacon, RelativeReport, TrunkReport
from companion.core.model.states import Request, Severity
from mission.common.frames import Vec3

TEXT_MAX: Final = 50  # characters of a STATUSTEXT that is one message
CUT: Final = " ..."


@dataclass(slots=True, init=False, unsafe_hash=True)
class VelocitySetpoint:
    """SET_POSITION_TARGET_LOCAL_NED with the velocity + yaw mask."""

    vel_ned_mps: Final[Vec3]
    yaw_rad: Final[float]

    def __init__(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        self.vel_ned_mps = vel_ned_mps
        self.yaw_rad = yaw_rad


@dataclass(slots=True, init=False, unsafe_hash=True)
class SendBeacon:
    """Broadcast to the neighbours; the codec adds the vehicle's position."""

    beacon: Final[Beacon]
    word: Final[RelativeReport | None]  # where the swarm flies by ranges
    pos_ned_m: Final[Vec3 | None]  # there: where an acting leader is, about the mission's origin; others do not tell
    off_ned_m: Final[Vec3]  # the position flown by less the one that the autopilot reports
    trunks: Final[TrunkReport | None]  # now and then, where they are shared

    def __init__(
        self,
        beacon: Beacon,
        word: RelativeReport | None = None,
        pos_ned_m: Vec3 | None = None,
        off_ned_m: Vec3 = (0.0, 0.0, 0.0),
        trunks: TrunkReport | None = None,
    ) -> None:
        self.beacon = beacon
        self.word = word
        self.pos_ned_m = pos_ned_m
        self.off_ned_m = off_ned_m
        self.trunks = trunks


@dataclass(frozen=True, slots=True)
class Ask:
    """A request to the autopilot; `altitude_m` for a takeoff."""

    request: Request
    altitude_m: float = 0.0


@dataclass(frozen=True, slots=True)
class SendOdometry:
    """The own velocity by what the vehicle sees, for its autopilot's estimator: ODOMETRY, or as the make has it."""

    vel_ned_mps: Vec3


@dataclass(frozen=True, slots=True)
class Say:
    """STATUSTEXT: what an operator must know."""

    severity: Severity
    text: str


def brief(text: str) -> str:
    """`text` as one chunk of STATUSTEXT takes it: one that is longer is cut at a word."""
    if len(text) <= TEXT_MAX:
        return text
    kept = text[: TEXT_MAX - len(CUT)]
    return (kept.rpartition(" ")[0] or kept) + CUT


Action = VelocitySetpoint | SendBeacon | Ask | SendOdometry | Say
