"""An entrant in an agent's tick: a foreign law as its guidance, a safety filter that only limits speed.

Only the simulator builds these: what flies on a board has no such choice (`companion.core.stages`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from companion.core.guidance.guidance_input import Desired, GuidanceInput
from companion.core.guidance.movement import GATHER_MPS, YAW_SPEED_MPS, Guidance
from companion.core.localisation.peer_table import PeerTable
from companion.core.localisation.predicted_corridors import PredictedCorridor
from companion.core.model.beacon import PeerReport
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, is_finite, limit, sub
from companion.core.safety.setpoint import Setpoint
from companion.core.safety.surroundings import Surroundings
from companion.core.stages import FLIGHT_STAGES, FilterStage, StageFactory
from mission.common.frames import Vec3
from mission.document.model import Mission
from sim_bridge.drive.entrant.law import OPTIONAL, Law, LawFile, load_law
from sim_bridge.drive.entrant.view import Peer, Trunk, View

TRANSIT: Final = "transit"
FUNCTIONS: Final = {
    FlightState.GATHERING: TRANSIT,
    FlightState.TRANSIT: TRANSIT,
    FlightState.RETURNING: TRANSIT,
    FlightState.COVERAGE: OPTIONAL,
}
OURS: Final = "ours"
SHA_SHOWN: Final = 12  # digits


@dataclass(frozen=True, slots=True)
class Entrant:
    """Choice of stages: a law, None ours, with the safety filter or without."""

    law: LawFile | None = None
    safety_filter: bool = True

    def stages(self) -> StageFactory:
        """For the agents of one flight. LawError."""
        return StageFactory(
            FLIGHT_STAGES.build_guidance if self.law is None else partial(LawGuidance, load_law(self.law)),
            FLIGHT_STAGES.build_safety_filter if self.safety_filter else SpeedLimits.of,
        )

    @property
    def name(self) -> str:
        """The law's."""
        return OURS if self.law is None else self.law.name

    @property
    def is_ours(self) -> bool:
        """True if these are the stages that a board flies."""
        return self.law is None and self.safety_filter

    def note(self) -> str:
        """Words for a verdict: what is not ours; empty: all is."""
        said = [] if self.law is None else [f"law {self.law.name}, sha256 {self.law.sha256[:SHA_SHOWN]}"]
        if not self.safety_filter:
            said.append("WITHOUT SAFETY FILTER")
        return "; ".join(said)

    def figures(self) -> dict[str, Any]:
        """The keys that metrics.json has of it; none where all is ours."""
        if self.is_ours:
            return {}
        sha256 = None if self.law is None else self.law.sha256
        return {"flown_by": self.note(), "law": self.name, "law_sha256": sha256, "safety_filter": self.safety_filter}


BY_OURS: Final = Entrant()


class LawGuidance:
    """One vehicle's guidance by a foreign law; ours in states that the law is not asked for: hold, seeking, landing."""

    def __init__(self, law: Law, mission: Mission, me: int) -> None:
        self.ref_ned_mps: Vec3 = ZERO
        self.yaw_rad = 0.0
        self._law, self._mission, self._me = law, mission, me
        self._ours = Guidance(mission, me)
        self._memory: Any = None
        self._steered = False  # by the law, and not interrupted since

    def reset(self) -> None:
        """Not steered: the law begins anew."""
        self.ref_ned_mps = ZERO
        self._ours.reset()
        self._steered = False

    def predict_corridors(
        self,
        peers: PeerTable,  # noqa: ARG002
        pos_ned_m: Vec3,  # noqa: ARG002
        now_s: float,  # noqa: ARG002
        *,
        range_m: float,  # noqa: ARG002
    ) -> Sequence[PredictedCorridor]:
        """None: a law hears of no vehicles that it does not hear."""
        return ()

    def to_goal_m(self, pos_ned_m: Vec3, goal: tuple[Vec3, float], standing: Mapping[int, PeerReport]) -> float:
        """As ours: the swarm decides by it, not the law."""
        return self._ours.to_goal_m(pos_ned_m, goal, standing)

    def guide(self, now: GuidanceInput, *, dt_s: float) -> Desired:
        """The law's velocity, which is handed down, too. LawError."""
        function = FUNCTIONS.get(now.state)
        if function is None or (function == OPTIONAL and not self._law.covers):
            return self._fly_ours(now, dt_s)
        if not self._steered:
            self._memory, self._steered = self._law.start(self._mission, self._me), True
        desired = self._law.velocity(function, self._memory, self._view(now, dt_s))
        self.ref_ned_mps = desired
        facing = now.dest_ned_m if now.state is FlightState.COVERAGE and now.dest_ned_m is not None else desired
        if math.hypot(facing[0], facing[1]) > YAW_SPEED_MPS:
            self.yaw_rad = math.atan2(facing[1], facing[0])
        return Desired(desired, desired, self.yaw_rad)

    def _fly_ours(self, now: GuidanceInput, dt_s: float) -> Desired:
        self._ours.yaw_rad = self.yaw_rad
        desired = self._ours.guide(now, dt_s=dt_s)
        self.ref_ned_mps, self.yaw_rad = desired.ref_ned_mps, desired.yaw_rad
        return desired

    def _view(self, now: GuidanceInput, dt_s: float) -> View:
        around = now.around
        cruise_mps = self._mission.route.vel_leader_mps
        if now.phase is SwarmPhase.GATHER:
            cruise_mps = min(cruise_mps, GATHER_MPS)
        goal = now.goal if now.role is Role.LEADER else None
        ahead = {neighbour.id for neighbour in now.route.up}
        points = np.array((around.cloud.norths, around.cloud.easts), np.float64).T
        points.setflags(write=False)
        return View(
            dt_s=dt_s,
            state=now.state.name.lower(),
            leads=now.role is Role.LEADER,
            vel_ned_mps=around.own.vel_ned_mps,
            commanded_ned_mps=around.commanded_ned_mps,
            goal_ned_m=None if goal is None else sub(goal[0], around.own.pos_ned_m),
            stop_m=0.0 if goal is None else goal[1],
            cruise_mps=cruise_mps * now.governor,
            to_d2_ned_m=now.dest_ned_m,
            peers=tuple([_peer(neighbour, ahead) for neighbour in around.neighbours]),
            silent_ned_m=tuple(around.silent_ned_m),
            points_ne_m=points,
            trunks=tuple([Trunk(trunk.rel_ned_m, trunk.keep_out_m) for trunk in around.cloud.trunks]),
            range_m=now.range_m,
            size=now.size,
        )


def _peer(neighbour: Neighbour, ahead: set[int]) -> Peer:
    beacon = neighbour.beacon
    return Peer(
        id=neighbour.id,
        rel_ned_m=neighbour.rel_ned_m,
        vel_ned_mps=neighbour.vel_ned_mps,
        ref_ned_mps=beacon.ref_ned_mps,
        distance_m=neighbour.distance_m,
        age_s=neighbour.age_s,
        leads=beacon.lease is not None and beacon.lease.leader == neighbour.id,
        ahead=neighbour.id in ahead,
        gives_way=neighbour.gives_way,
    )


class SpeedLimits:
    """In place of the safety filter: the mission's speed limits, as an autopilot has some of its own; nothing else."""

    def __init__(self, speed_max_mps: float, climb_max_mps: float) -> None:
        self._speed_max_mps, self._climb_max_mps = speed_max_mps, climb_max_mps

    @classmethod
    def of(cls, mission: Mission) -> FilterStage:
        """The speed limits of a mission."""
        return cls(mission.limits.speed_max_mps, mission.limits.climb_max_mps)

    def apply(self, desired_ned_mps: Vec3, around: Surroundings, *, dt_s: float) -> Setpoint:  # noqa: ARG002
        """The desired velocity, no faster than allowed; rest where it is no number."""
        if not is_finite(desired_ned_mps):
            return Setpoint(ZERO, (math.nan, math.nan, math.nan))
        north, east, down = limit(desired_ned_mps, self._speed_max_mps)
        limited = (north, east, max(-self._climb_max_mps, min(self._climb_max_mps, down)))
        return Setpoint(limited, desired_ned_mps, desired_ned_mps, limited, limited, limited)
