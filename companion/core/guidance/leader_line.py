"""The straight line on which a leader has set out, and the way back to it: a velocity that lies would carry it away."""

from __future__ import annotations

from typing import Final, final

from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.model.states import FlightState, SwarmPhase
from companion.core.model.vectors import ZERO, add, dot, limit, norm, scale, sub
from mission.common.frames import Vec3

LINE_GAIN_PER_S: Final = 0.8  # back to the line: a velocity 0.4 m/s wrong is held within half a metre
LINE_LIMIT_MPS: Final = 1.0  # of that
LINE_ENDS_M: Final = 3.0  # a goal that is elsewhere by so much is another line's


@final
class LeaderLine:
    """One vehicle's, while it leads."""

    def __init__(self) -> None:
        # Since when, and from where, this vehicle leads, and where to
        self._line: tuple[SwarmPhase, Vec3, Vec3] | None = None

    def reset(self) -> None:
        """Not leading."""
        self._line = None

    def lead_back(self, now: GuidanceInput, to_goal_ned_m: Vec3) -> Vec3:
        """Towards the line, NED m/s."""
        return limit(scale(self._off_ned_m(now, to_goal_ned_m), -LINE_GAIN_PER_S), LINE_LIMIT_MPS)

    def lead_to_height(self, now: GuidanceInput, to_goal_ned_m: Vec3) -> Vec3:
        """To the line's height there alone, NED m/s: of a leader that dodges trunks on its way."""
        down_mps = -LINE_GAIN_PER_S * self._off_ned_m(now, to_goal_ned_m)[2]
        return (0.0, 0.0, max(-LINE_LIMIT_MPS, min(LINE_LIMIT_MPS, down_mps)))

    def _off_ned_m(self, now: GuidanceInput, to_goal_ned_m: Vec3) -> Vec3:
        """The way from the line, square to it; ZERO where it keeps none."""
        here = now.around.own.pos_ned_m
        goal = add(here, to_goal_ned_m)
        if self._line is None or self._line[0] is not now.phase or _is_elsewhere(now, goal, self._line[2]):
            self._line = (now.phase, here, goal)
        start = self._line[1]
        way = sub(add(here, to_goal_ned_m), start)
        if now.phase is SwarmPhase.GATHER or now.state is FlightState.SEEKING or norm(way) < 1.0:
            return ZERO
        unit = scale(way, 1.0 / norm(way))
        off = sub(here, start)
        return sub(off, scale(unit, dot(off, unit)))


def _is_elsewhere(now: GuidanceInput, goal: Vec3, before: Vec3) -> bool:
    """A leader that goes back along its own way, or flies lanes or to several trees, has one goal after the other."""
    return now.goal_moves and norm(sub(goal, before)) > LINE_ENDS_M
