"""The setpoint that the safety filter makes of a desired velocity, with every cut and its reason."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from typing import Final, NamedTuple, final

from companion.core.model.vectors import ZERO, dot, is_finite, norm, sub
from companion.core.safety.bounds import Bound
from mission.common.frames import Vec3


class CutReason(Enum):
    """A limit of the safety filter, as an operator reads it."""

    NO_NUMBER = "no finite velocity or position"
    SPEED = "speed limits"
    LIMITS = "fence or mission trunk"
    SEPARATION = "separation"
    ACCELERATION = "acceleration limit"
    OBSTACLES = "scanned obstacles"


class Cut(NamedTuple):
    """A change of the velocity on its way to the setpoint."""

    reason: CutReason
    by_mps: float


@final
class Setpoint:
    """A velocity (NED m/s) that goes to the autopilot, with what it came from: `cuts` are made only where asked for."""

    __slots__ = ("_bounded", "_desired", "_limited", "_limits", "_reached", "_separations", "_turned", "vel_ned_mps")

    def __init__(
        self,
        vel_ned_mps: Vec3,
        desired: Vec3 = ZERO,
        turned: Vec3 = ZERO,
        limited: Vec3 = ZERO,
        bounded: Vec3 = ZERO,
        reached: Vec3 = ZERO,
        limits: Sequence[Bound] = (),
        separations: Sequence[Bound] = (),
    ) -> None:
        """Step by step, each less what wind adds: desired, turned back into the fence, within the speed
        limits (`limited`), within the bounds, in reach of the setpoint before.
        """
        self.vel_ned_mps: Final = vel_ned_mps
        self._desired: Final = desired
        self._turned: Final = turned
        self._limited: Final = limited
        self._bounded: Final = bounded
        self._reached: Final = reached
        self._limits: Final = limits
        self._separations: Final = separations

    @property
    def desired_ned_mps(self) -> Vec3:
        """The velocity that was desired, less what wind adds; NaN where that or the position was no number."""
        return self._desired

    def cuts(self) -> list[Cut]:
        """In the order they were made; none: flown as desired. The way back into a fence counts as a cut by it."""
        found: list[Cut] = []
        limited = self._limited
        if not is_finite(self._desired):
            return [Cut(CutReason.NO_NUMBER, math.inf)]
        if self._turned != self._desired:
            found.append(Cut(CutReason.LIMITS, norm(sub(self._desired, self._turned))))
        if limited != self._turned:
            found.append(Cut(CutReason.SPEED, norm(sub(self._turned, limited))))
        if self._bounded != limited:
            by_mps = norm(sub(limited, self._bounded))
            for reason, bounds in ((CutReason.LIMITS, self._limits), (CutReason.SEPARATION, self._separations)):
                if any([dot(limited, bound.along) > bound.most_mps for bound in bounds]):
                    found.append(Cut(reason, by_mps))
        if self._reached != self._bounded:
            found.append(Cut(CutReason.ACCELERATION, norm(sub(self._bounded, self._reached))))
        if self.vel_ned_mps != self._reached:
            found.append(Cut(CutReason.OBSTACLES, norm(sub(self._reached, self.vel_ned_mps))))
        return found


AT_REST: Final = Setpoint(ZERO)
