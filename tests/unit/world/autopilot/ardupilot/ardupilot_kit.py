"""A simulated ArduCopter, as a client on the wire sees it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame
from mission.document.model import Personality
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import (
    BatterySpec,
    Link,
    make_autopilot,
)
from tests.unit.world.autopilot.autopilot_kit import ORIGIN, STEP_S, Wire

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
ARM, SET_MODE, TAKEOFF, LAND, RTL, REPOSITION, SET_INTERVAL, REQUEST = 400, 176, 22, 21, 20, 192, 511, 512
STABILIZE, GUIDED, LOITER, RTL_MODE, LAND_MODE, BRAKE = 0, 4, 5, 6, 9, 17
FORCE = 21196.0


class Flight(Wire):
    """An autopilot on a point mass, and a client on each link."""

    def __init__(self, parameters: Mapping[str, float] | None = None, battery: BatterySpec | None = None) -> None:
        super().__init__(onboard_system=245)
        self.body = PointMass((20.0, -10.0, 0.0), 0.0)
        self.frame = LocalFrame(ORIGIN)
        self.autopilot = make_autopilot(
            Personality.ARDUPILOT, 1, self.body, self.frame, parameters=parameters, battery=battery
        )
        self.heard: dict[Link, list[tuple[float, Any]]] = {Link.ONBOARD: [], Link.GROUND: []}

    def listen(self, link: Link = Link.ONBOARD) -> list[Any]:
        messages = super().listen(link)
        self.heard[link] += [(self.now_s, message) for message in messages]
        return messages

    def run(self, seconds: float, *repeated: Any) -> Flight:
        """Fly on, sending `repeated` before every step."""
        for _ in range(round(seconds / STEP_S)):
            self.step(*repeated)
            for link in Link:
                self.listen(link)
        return self

    def all(self, kind: str, link: Link = Link.ONBOARD) -> list[tuple[float, Any]]:
        return [(at_s, m) for at_s, m in self.heard[link] if m.get_type() == kind]

    def last(self, kind: str) -> Any:
        return self.all(kind)[-1][1]

    def texts(self, link: Link = Link.ONBOARD) -> list[str]:
        return [m.text for _, m in self.all("STATUSTEXT", link)]

    def landed_states(self) -> list[int]:
        return changes([m.landed_state for _, m in self.all("EXTENDED_SYS_STATE")])

    @property
    def armed(self) -> bool:
        return self.autopilot.snapshot.armed

    @property
    def height_m(self) -> float:
        return -self.body.state.pos_ned_m[2]

    # Flights to start from

    def ready(self) -> Flight:
        """GUIDED, with a position."""
        self.run(42.0)
        assert self.command(SET_MODE, 1.0, GUIDED) == ACCEPTED
        assert self.command(SET_INTERVAL, 245.0, 100_000.0) == ACCEPTED
        return self

    def airborne(self, height_m: float = 5.0) -> Flight:
        self.ready()
        assert self.command(ARM, 1.0) == ACCEPTED
        self.run(1.2)
        assert self.command(TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == ACCEPTED
        return self.run(8.0 + height_m / 2.0)


def velocity(north: float = 0.0, east: float = 0.0, down: float = 0.0, mask: int = 0x5C7) -> Any:
    return mav.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mav.MAV_FRAME_LOCAL_NED, mask, 0, 0, 0, north, east, down, 0, 0, 0, 0, 0
    )


def changes(values: list[Any]) -> list[Any]:
    return [value for before, value in zip([None, *values], values, strict=False) if value != before]
