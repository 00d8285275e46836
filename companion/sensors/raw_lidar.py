"""Lidars that tell every ray: SWARM_LIDAR_SCAN."""

from __future__ import annotations

from typing import Any, Self

from companion.core.model.events import Event
from companion.mavlink import dialect
from companion.mavlink.lidar_scan import LIDAR_SCAN_ID, RAYS_MIN_SHARE
from companion.mavlink.sensor_source import SensorSource
from companion.sensors.lidar_pieces import LidarPieces
from companion.sensors.lidar_tally import GAP_MIN_DEG, RAYS_FEW_SHARE, LidarTally
from companion.sensors.obstacle_sensor import RATE_MIN_SHARE, VIEW_MIN_SHARE
from companion.sensors.scans import ATTITUDE_HZ
from mission.document.model import Mission
from mission.schema.kinds import RAW_LIDARS


class RawLidar(SensorSource):
    """A vehicle's lidars, in a mission whose `sensing.sensor` tells raw scans."""

    NAME = "lidar"
    TITLE = "lidar"
    MESSAGES = {LIDAR_SCAN_ID: "SWARM_LIDAR_SCAN"}  # noqa: RUF012
    HELP = "SWARM_LIDAR_SCAN of a lidar, in a mission whose sensing.sensor is not sectors"
    ABOUT = (
        "In a mission whose `sensing.sensor` tells raw scans: each lidar that is heard on a sensor's link has "
        f"{RATE_MIN_SHARE * 100:.0f} % of `sensing.rate_hz` turns or more and no gap above `sensing.stale_s`, sees as "
        "far as `sensing.range_m`, and has rays as close to one another and as many layers as its class, a level one "
        f"{RAYS_MIN_SHARE * 100:.0f} % of its class's rays or more that are measured; together they see "
        f"{VIEW_MIN_SHARE * 100:.0f} % of `sensing.field_of_view_deg` or more. A warning, of level lidars: within that "
        f"nothing is ever measured for {GAP_MIN_DEG} degrees or more, as behind a mast, or fewer than "
        f"{RAYS_FEW_SHARE * 100:.0f} % of its class's rays are."
    )
    UNUSED = (
        "has no [sensing] with raw scans (sensing.sensor), so nothing would fly by this lidar. Set the key in the "
        "mission of all vehicles, or leave the option out"
    )
    STALE = "no scan that is fresh"
    NEEDS_LINK = "the mission's sensing.sensor tells raw scans"
    AUTOPILOT_HZ = {dialect.MAVLINK_MSG_ID_ATTITUDE: ATTITUDE_HZ}  # noqa: RUF012

    def __init__(self, stale_s: float) -> None:
        super().__init__(stale_s)
        self._pieces = LidarPieces()

    @classmethod
    def is_flown(cls, mission: Mission) -> bool:
        """True if the mission's sensor tells raw scans."""
        return mission.sensing is not None and mission.sensing.sensor in RAW_LIDARS

    @classmethod
    def of(cls, mission: Mission) -> Self:
        """One vehicle's."""
        assert mission.sensing is not None
        return cls(mission.sensing.stale_s)

    def decode(self, m: Any, component: int, now_s: float) -> Event | None:
        """SWARM_LIDAR_SCAN, which waits for the tick's ATTITUDE."""
        self._pieces.piece(m, component, now_s)
        return None

    def read_autopilot(self, m: Any, now_s: float) -> None:
        """ATTITUDE."""
        self._pieces.attitude(m, now_s)

    def collect(self, now_s: float) -> list[Event]:
        """Pieces of scans with how the vehicle stood."""
        found: list[Event] = []
        for scan in self._pieces.join(now_s):
            self.mark_measured(scan.sensor, now_s - scan.age_s)
            found.append(scan)
        return found

    def counters(self) -> dict[str, int]:
        """Pieces that were dropped."""
        return {"pieces refused": self._pieces.refused, "pieces without attitude": self._pieces.without_attitude}

    @classmethod
    def tally(cls, began_s: float) -> LidarTally:
        """Counts SWARM_LIDAR_SCAN."""
        return LidarTally(began_s)
