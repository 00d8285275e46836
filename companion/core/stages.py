"""The stages of a tick that a simulation may build otherwise: guidance, and the safety filter.

They are chosen once, when an agent is built. A board always has `FLIGHT_STAGES`: no option of the companion changes it.
Protocols, and no base classes: what a simulation brings is not compiled, and could not inherit from what is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, Protocol, final

from companion.core.guidance.guidance_input import Desired, GuidanceInput
from companion.core.guidance.movement import Guidance
from companion.core.localisation.peer_table import PeerTable
from companion.core.localisation.predicted_corridors import PredictedCorridor
from companion.core.model.beacon import PeerReport
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.setpoint import Setpoint
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from mission.document.model import Mission


class GuidanceStage(Protocol):
    """One vehicle's `guide` stage, as `movement.Guidance` is: see there."""

    ref_ned_mps: Vec3
    yaw_rad: float

    def reset(self) -> None:
        """Not steered: forget what was desired."""

    def predict_corridors(
        self, peers: PeerTable, pos_ned_m: Vec3, now_s: float, *, range_m: float
    ) -> Sequence[PredictedCorridor]:
        """As `LocalPlanner.predict_corridors`."""

    def guide(self, now: GuidanceInput, *, dt_s: float) -> Desired:
        """Desired velocity, reference and heading."""

    def to_goal_m(self, pos_ned_m: Vec3, goal: tuple[Vec3, float], standing: Mapping[int, PeerReport]) -> float:
        """Distance that a leader has to go."""


class FilterStage(Protocol):
    """One vehicle's `filter` stage, as `safety_filter.SafetyFilter` is: see there."""

    def apply(self, desired_ned_mps: Vec3, around: Surroundings, *, dt_s: float) -> Setpoint:
        """The setpoint of a desired velocity."""


@final
class StageFactory:
    """Builds these stages for a vehicle."""

    __slots__ = ("build_guidance", "build_safety_filter")

    def __init__(
        self,
        build_guidance: Callable[[Mission, int], GuidanceStage],
        build_safety_filter: Callable[[Mission], FilterStage],
    ) -> None:
        """`build_guidance`: of a mission and a vehicle's id."""
        self.build_guidance: Final = build_guidance
        self.build_safety_filter: Final = build_safety_filter


FLIGHT_STAGES: Final = StageFactory(Guidance, SafetyFilter.of)
