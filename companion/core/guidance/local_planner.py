"""The local planner: leads what a vehicle desires clear of the local obstacle cloud.

One interface, two implementations: under the open sky (`open_sky_planner`), and with an obstacle sensor
(`sensing_planner`). Which one a vehicle has is chosen when its guidance is built.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.localisation.peer_table import PeerTable
from companion.core.localisation.predicted_corridors import PredictedCorridor
from companion.core.model.vectors import dot, scale, sub
from mission.common.frames import Vec3


class LocalPlanner(ABC):
    """One vehicle's planner. Each tick: `plan_leader` or `plan_follower`, then `plan` over its desired velocity."""

    @abstractmethod
    def reset(self) -> None:
        """Not steered: forget the course."""

    @abstractmethod
    def stop_leading(self) -> None:
        """Another leads, or none: forget the line."""

    @abstractmethod
    def predict_corridors(
        self, peers: PeerTable, pos_ned_m: Vec3, now_s: float, range_m: float
    ) -> Sequence[PredictedCorridor]:
        """The corridors in which vehicles fly on that trees may hide from this one; none where none are hidden."""

    @abstractmethod
    def must_pause(self, now: GuidanceInput) -> bool:
        """No vehicle moves on for now."""

    @abstractmethod
    def plan_leader(self, now: GuidanceInput, along: Vec3, to_goal_ned_m: Vec3, stop_m: float) -> tuple[Vec3, Vec3]:
        """A leader's course for its followers, and its own desired velocity, of the velocity `along` to its goal."""

    @abstractmethod
    def separate(self, now: GuidanceInput, course: Vec3) -> Vec3:
        """A follower's push away from the others, and from those that hover silent; `course`: where it is pulled."""

    @abstractmethod
    def plan_follower(self, now: GuidanceInput, desired: Vec3) -> Vec3:
        """A follower's desired velocity, led past what hovers still, as far as that comes before `plan`."""

    @abstractmethod
    def limit_reach(self, reach_m: float) -> None:
        """In the next `plan` nothing counts that is further ahead: the vehicle comes to rest there."""

    @abstractmethod
    def plan(self, now: GuidanceInput, desired: Vec3, dt_s: float) -> Vec3:
        """Every desired velocity, led clear of what was seen."""

    @abstractmethod
    def find_free(self, now: GuidanceInput) -> Callable[[float, float], bool] | None:
        """Test of a position to stay in, north and east of this vehicle: it is free. None: it sees no position."""

    @abstractmethod
    def heading(self) -> Vec3 | None:
        """Direction to face, so as to see where it flies; None: as the swarm goes."""


def not_against(push: Vec3, course: Vec3) -> Vec3:
    """`push` without what of it is against the course: a swarm that flies ahead of its leader must not slow it."""
    square = dot(course, course)
    back = min(0.0, dot(push, course)) / square if square > 0.0 else 0.0
    return sub(push, scale(course, back))
