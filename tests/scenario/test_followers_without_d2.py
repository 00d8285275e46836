"""Rule 5 in drawn flights: whoever does not lead never uses d2.

Each companion has a twin with another d2, which is handed the same bytes. For as long as the companion has not led,
the two answer the same setpoints, to the bit. Compared on the way: near d2 everybody keeps clear of the trunk that the
mission has there, an obstacle like any other (`trunks_of`).
"""

from __future__ import annotations

import contextlib
import math
from typing import Any

import pytest

from companion.core.guidance.movement import Guidance
from companion.core.model.states import STEERED, Role, SwarmPhase
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.setpoint import Setpoint
from companion.core.safety.surroundings import Surroundings
from companion.core.stages import FLIGHT_STAGES, StageFactory
from companion.mavlink import dialect
from companion.mavlink.framing.frames import whole
from mission.common.frames import Vec3, enu_to_ned
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.lab.search.draw import draw
from sim_bridge.lab.study.backends.agents import fly_stack
from tests.flights import short_mission

SEEDS = (1001, 1002, 1004, 1005, 1006, 1008, 1012)
UNTIL_S = 90.0  # of each flight: gathered, and on the way
AWAY_M = 1000.0
BRAKES_M = 20.0  # from d2, before the trunk there brakes anybody


class Twins:
    """A companion, and another one of the same vehicle that looks for another d2."""

    STAGES = FLIGHT_STAGES

    def __init__(self, mission: Mission, vehicle_id: int, **options: Any) -> None:
        self.one = InProcess(mission, vehicle_id, **{**options, "stages": self.STAGES})
        self.twin = InProcess(elsewhere(mission), vehicle_id, stages=self.STAGES)
        self.has_led = False
        self.compared = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.one, name)

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes = b"") -> None:
        self.one.send(from_peers, from_autopilot, now_s, from_sensor)
        self.twin.send(from_peers, from_autopilot, now_s, from_sensor)
        agent = self.one.endpoint.agent
        leads = agent.swarm.election.role in (Role.CLAIMANT, Role.LEADER) and agent.flight.state in STEERED
        self.has_led = self.has_led or leads  # on the ground each claims until it has heard of another
        if not self.has_led:
            mine, others = (setpoints(one.receive()[1]) for one in (self.one, self.twin))
            assert mine == others, f"vehicle {self.id} at {now_s:.2f} s"
            self.compared += bool(mine)


def elsewhere(mission: Mission) -> Mission:
    """The same, and d2 and the trees before it AWAY_M further east; unchecked."""
    route = mission.route
    d2 = (route.d2_enu_m[0] + AWAY_M, *route.d2_enu_m[1:])
    stops = [
        stop.model_copy(update={"pos_enu_m": (stop.pos_enu_m[0] + AWAY_M, *stop.pos_enu_m[1:])}) for stop in route.stops
    ]
    moved = route.model_copy(update={"d2_enu_m": d2, "stops": tuple(stops)})
    return mission.model_copy(update={"route": moved})


def setpoints(sent: bytes) -> list[bytes]:
    """Those that a companion sends, without their sequence numbers and checksums."""
    wanted = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
    return [sent[start + 10 : end - 2] for start, end, message_id in whole(sent) if message_id == wanted]


class Enough(Exception):  # noqa: N818 - it is no error
    """The flight has shown what is asked."""


def compared(mission: Mission, monkeypatch: pytest.MonkeyPatch) -> int:
    """How many setpoints of followers were equal; AssertionError for one that was not."""
    monkeypatch.setattr(fly, "InProcess", Twins)
    twins: dict[int, Twins] = {}
    d2_ned_m = enu_to_ned(mission.route.d2_enu_m)

    def watch(flight: Flight) -> None:
        twins.update((k, one) for k, one in flight.lockstep.companions.items() if isinstance(one, Twins))
        to_d2_m = min(math.dist(at, d2_ned_m) for at in flight.world.positions().values())
        if flight.world.now_s > UNTIL_S or flight.phase() > SwarmPhase.TRANSIT or to_d2_m < BRAKES_M:
            raise Enough

    with contextlib.suppress(Enough):
        fly_stack(mission, None, on_jsbsim=False, watch=watch)
    return sum(twin.compared for twin in twins.values())


@pytest.mark.parametrize("seed", SEEDS)
def test_followers_of_a_drawn_mission_answer_the_same_whatever_d2_is(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert compared(draw(seed, 0.0).mission, monkeypatch) > 500


class DrawnFilter:
    """A planted defect: d2 draws every vehicle a little."""

    def __init__(self, mission: Mission) -> None:
        self._filter = SafetyFilter.of(mission)
        self._d2_east_m = mission.route.d2_enu_m[0]

    def apply(self, desired_ned_mps: Vec3, around: Surroundings, *, dt_s: float) -> Setpoint:
        north, east, down = desired_ned_mps
        return self._filter.apply((north, east + 1e-4 * self._d2_east_m, down), around, dt_s=dt_s)


def test_a_follower_that_looks_at_d2_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Twins, "STAGES", StageFactory(Guidance, DrawnFilter))
    with pytest.raises(AssertionError, match=r"vehicle \d+ at"):
        compared(short_mission(), monkeypatch)
