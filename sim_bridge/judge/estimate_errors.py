"""Compares where external autopilots believe to be with where their simulators say that they are."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_type_hints

from mission.common.frames import Vec3


@dataclass(frozen=True, slots=True)
class ErrorFigures:
    """Figures of one flight over external autopilots. None: no simulator told the truth."""

    positions_by_estimates: Annotated[
        str,
        "What of the flight's figures rests on the autopilots' own estimates, as the verdict has it; empty: nothing, "
        "all positions are the simulators' truth.",
    ]
    estimate_error_rms_m: Annotated[
        float | None,
        "Level distance between where autopilots believed to be and where they truly were; root of the mean square "
        "over vehicles and samples (20 Hz), from the first to the last.",
    ]
    estimate_error_max_m: Annotated[float | None, "The greatest of these distances."]
    estimate_height_error_max_m: Annotated[
        float | None, "Greatest error of a height, up or down; null: no simulator told heights."
    ]
    estimate_yaw_error_max_deg: Annotated[
        float | None, "Greatest error of a yaw; null: attitudes are heard in missions with `[sensing]` only."
    ]

    def as_dict(self) -> dict[str, Any]:
        """Name -> value in the order of declaration, ready for JSON."""
        return dataclasses.asdict(self)


def definitions() -> dict[str, str]:
    """Name -> definition of every figure in `ErrorFigures`, for the documentation."""
    hints = get_type_hints(ErrorFigures, include_extras=True)
    return {field.name: get_args(hints[field.name])[1] for field in dataclasses.fields(ErrorFigures)}


class EstimateErrors:
    """The errors of one flight so far."""

    def __init__(self) -> None:
        self._squares, self._count = 0.0, 0
        self._max_m: float | None = None
        self._height_m: float | None = None
        self._yaw_rad: float | None = None

    def add(self, off_ned_m: Vec3, *, has_height: bool, yaw_off_rad: float | None) -> None:
        """Adds one vehicle's error at one time: estimated position less true position, NED m."""
        off_m = math.hypot(off_ned_m[0], off_ned_m[1])
        self._squares += off_m * off_m
        self._count += 1
        self._max_m = max(self._max_m or 0.0, off_m)
        if has_height:
            self._height_m = max(self._height_m or 0.0, abs(off_ned_m[2]))
        if yaw_off_rad is not None:
            self._yaw_rad = max(self._yaw_rad or 0.0, abs(math.remainder(yaw_off_rad, math.tau)))

    def figures(self, told_by: str) -> ErrorFigures:
        """`told_by`: what of the flight rests on estimates; empty: nothing."""
        return ErrorFigures(
            positions_by_estimates=told_by,
            estimate_error_rms_m=math.sqrt(self._squares / self._count) if self._count else None,
            estimate_error_max_m=self._max_m,
            estimate_height_error_max_m=self._height_m,
            estimate_yaw_error_max_deg=None if self._yaw_rad is None else math.degrees(self._yaw_rad),
        )
