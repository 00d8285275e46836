"""The mission's fence as autopilots take it: one polygon of vertices that no vehicle leaves. Pure.

MAVLink's fence is a list of items (MAV_MISSION_TYPE_FENCE). The ceiling is a parameter on both autopilots.
"""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import BaseModel, ConfigDict

from mission.common.frames import LocalFrame, enu_to_ned
from mission.document.model import Mission

INCLUSION = 5001  # MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
KINDS = {
    5000: "return point",
    INCLUSION: "inclusion vertex",
    5002: "exclusion vertex",
    5003: "inclusion circle",
    5004: "exclusion circle",
}
ROUNDING_E7 = 1  # 1e-7 degrees, about 1 cm: an autopilot may keep a vertex in another form


class Vertex(BaseModel):
    """One item of a fence. Degrees times 1e7, WGS84. `count`: of its polygon's vertices; of a circle its radius, m."""

    model_config = ConfigDict(frozen=True)

    command: int
    count: float
    lat_e7: int
    lon_e7: int

    def __str__(self) -> str:
        kind = KINDS.get(self.command, f"item {self.command}")
        return f"{kind} {self.lat_e7 / 1e7:.7f}, {self.lon_e7 / 1e7:.7f}"


def fence_of(mission: Mission) -> tuple[Vertex, ...]:
    """The mission's polygon; none: no items. The mission must have an origin."""
    assert mission.origin is not None
    frame = LocalFrame(mission.origin.wgs84)
    polygon = mission.fence.polygon_enu_m or ()
    vertices = []
    for east_m, north_m in polygon:
        point = frame.to_wgs84(enu_to_ned((east_m, north_m, 0.0)))
        lon_deg = (point.lon_deg + 180.0) % 360.0 - 180.0  # a mission may lie across the date line
        vertices.append(
            Vertex(
                command=INCLUSION, count=len(polygon), lat_e7=round(point.lat_deg * 1e7), lon_e7=round(lon_deg * 1e7)
            )
        )
    return tuple(vertices)


def difference(found: Sequence[Vertex], wanted: Sequence[Vertex]) -> str:
    """First item of the autopilot's fence that is not the mission's, in words; empty: none."""
    if len(found) != len(wanted):
        return f"{len(found)} items instead of {len(wanted)}"
    for number, (there, here) in enumerate(zip(found, wanted, strict=True), start=1):
        same = there.command == here.command and there.count == here.count
        near = max(abs(there.lat_e7 - here.lat_e7), abs(there.lon_e7 - here.lon_e7)) <= ROUNDING_E7
        if not (same and near):
            return f"item {number} is {there} instead of {here}"
    return ""
