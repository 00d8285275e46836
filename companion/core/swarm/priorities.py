"""Election priorities and scores: by the mission's list, GNSS reception and battery; and who is out for a while."""

from __future__ import annotations

from typing import Final, final

from companion.core.model.states import Reception
from companion.core.swarm.election import priority_of
from companion.core.swarm.picture import Picture
from companion.core.vehicle.failsafe import LOW_BATTERY_CLEARS_PERCENT, LOW_BATTERY_PERCENT
from mission.document.model import Mission

SCORE_STEP_PERCENT: Final = 10
BARRED_S: Final = 10.0  # longer than a lead takes to change hands, and a sensor that comes and goes is away
# Of the charge: with poor reception it counts as if half of it were left. Among those without it decides still
SCORE_DIVISOR = {Reception.GOOD: 1, Reception.POOR: 2, Reception.NONE: 4}


@final
class Priorities:
    """A mission's. In a swarm of which not all have a GNSS receiver, those that receive come before all others."""

    def __init__(self, mission: Mission) -> None:
        listed = mission.swarm.leader_priority
        self._listed = {vehicle: priority_of(vehicle, listed) for vehicle in listed}  # 0 for the others
        self._members: Final = range(1, mission.swarm.size + 1)
        self._receivers = {vehicle for vehicle in self._members if mission.has_satellites(vehicle)}
        # Above the last of the list; where all have a receiver nothing is.
        self._above = 0 if len(self._receivers) == mission.swarm.size else len(listed) + 1

    def of(self, vehicle: int, reception: Reception) -> int:
        """The priority with that reception."""
        listed = self._listed.get(vehicle, 0)
        return listed + self._above if reception is not Reception.NONE else listed

    def may_have(self, priority: int, vehicle: int) -> bool:
        """True for what the mission gives a member, with reception where it has a receiver, or without."""
        if vehicle not in self._members:
            return False
        listed = self._listed.get(vehicle, 0)
        return priority == listed or (priority == listed + self._above and vehicle in self._receivers)


def score_of(battery_percent: int | None, reception: Reception) -> int:
    """Score for the election, 0..10: the charge left, less with poor GNSS reception, and least without."""
    charge = 0 if battery_percent is None else battery_percent // SCORE_STEP_PERCENT
    return charge // SCORE_DIVISOR[reception]


@final
class Resignation:
    """One vehicle's: who had to give up the lead in flight is out for BARRED_S; by a low battery, until that is not.

    Where it comes first by the mission's list it would take the lead back in each moment in which its reason is gone,
    and while the lead changes nobody decides. One that hears nobody is not out: none else would lead.
    """

    __slots__ = ("_at_s", "_is_low")

    def __init__(self) -> None:
        self._at_s: float | None = None  # when its reason was there last; None: it is not out
        self._is_low = False

    def update(self, picture: Picture, *, leads: bool, resigns: bool) -> bool:
        """Each period; True: it is out. `resigns`: it has a reason now."""
        battery, at_s = picture.battery_percent, self._at_s
        self._is_low = self._is_low and battery is not None and battery < LOW_BATTERY_CLEARS_PERCENT
        if at_s is not None and picture.now_s - at_s > BARRED_S and not self._is_low:
            self._at_s = None
        if resigns and picture.is_steered and (leads or self._at_s is not None):
            self._at_s = picture.now_s
            self._is_low = battery is not None and battery < LOW_BATTERY_PERCENT
        return self._at_s is not None and bool(picture.neighbours)
