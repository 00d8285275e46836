"""The survey of a mission's vehicle, where it has one: numpy is loaded only then."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mission.document.model import Mission

if TYPE_CHECKING:
    from companion.survey.surveyor import Surveyor


def survey_of(mission: Mission, vehicle_id: int, *, keeps_returns: bool = False) -> Surveyor | None:
    """One vehicle's; None: the mission has no [survey]. `keeps_returns`: as `Surveyor` has it."""
    if mission.survey is None:
        return None
    from companion.survey.surveyor import Surveyor

    return Surveyor(mission, vehicle_id, keeps_returns=keeps_returns)
