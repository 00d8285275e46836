"""The own pose by which a survey places rays, and the trunks about it: as the own motion has them in one tick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, final

from companion.core.perception.landmarks.trunk_tracks import Trunk
from mission.common.frames import Vec3


@final
class ScanPose:
    """Pose at the time of a tick, before the tick's scans correct it further. NED metres of the own odometry."""

    __slots__ = (
        "airborne",
        "frame",
        "frame_sd_m",
        "pos_ned_m",
        "shift_ne_m",
        "standing_ne_m",
        "to_mission_ne_m",
        "trunks",
        "turn_rad",
        "vel_ned_mps",
    )

    def __init__(
        self,
        pos_ned_m: Vec3,
        vel_ned_mps: Vec3,
        *,
        shift_ne_m: tuple[float, float],
        turn_rad: float,
        to_mission_ne_m: tuple[float, float],
        frame_sd_m: float,
        airborne: bool,
        frame: tuple[float, float, float],
        trunks: Sequence[Trunk],
        standing_ne_m: Sequence[tuple[float, float]] = (),
    ) -> None:
        self.pos_ned_m: Final = pos_ned_m  # corrected by trunks
        self.vel_ned_mps: Final = vel_ned_mps
        self.shift_ne_m: Final = shift_ne_m  # the correction in it: what a later one has more, this place lacks
        self.turn_rad: Final = turn_rad  # to be added to the reported yaw
        self.to_mission_ne_m: Final = to_mission_ne_m  # to be added: the same place in the mission's frame
        self.frame_sd_m: Final = frame_sd_m  # of that
        self.airborne: Final = airborne
        self.trunks: Final = trunks
        self.standing_ne_m: Final = standing_ne_m  # where other vehicles stand in the air, level
        self.frame: Final = frame  # how the odometry's frame has been turned, see `ScanOdometry.frame`
