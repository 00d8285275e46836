"""The news of silent vehicles for an operator: each loss and its end once, and of a link that comes and goes ever less.

Where trunks or a bad radio hide a vehicle for seconds, again and again, a log of losses hides the one that matters. So
it is lost no sooner than SAY_AFTER_S, and heard again only when it has been for REGAINED_S; each loss that ended so
doubles how long the next is waited for, up to QUIET_MAX_S, until it was never silent for CALM_S. One that another
member hears is waited for as long: it is hidden from here, not lost.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final, final

from companion.core.localisation.peer_table import TELL_AFTER_S
from companion.core.model.actions import Say
from companion.core.model.beacon import PeerReport
from companion.core.model.states import Severity

# Of silence, until an operator is told. Others are told first: where a trunk hides it from this vehicle alone, one of
# them answers in 0.2 to 0.4 s, with lost beacons later.
SAY_AFTER_S: Final = TELL_AFTER_S + 1.0
REGAINED_S: Final = 3.0  # a link that is back for so long is no chance
QUIET_MAX_S: Final = 20.0  # of a silence that goes untold: a dead vehicle is named by then, whatever its link did
CALM_S: Final = 60.0


@final
class SilenceReports:
    """One vehicle's; bounded by the vehicles of the mission. `update` each tick."""

    def __init__(self) -> None:
        self._said: set[int] = set()  # told of, and not heard again yet
        self._heard_s: dict[int, float] = {}  # of those: since when it is
        self._after_s: dict[int, float] = {}  # of silence, until it is told of; SAY_AFTER_S where there is none
        self._silent_s: dict[int, float] = {}  # when it was silent last

    def update(
        self,
        silent: Mapping[int, PeerReport],
        now_s: float,
        *,
        may_begin: bool,
        heard_elsewhere: Collection[int] = (),
        on_ground: Collection[int] = (),
    ) -> list[Say]:
        """The news of this tick. `may_begin`: this companion has listened for long enough to call others silent.

        `heard_elsewhere`: those that a member says it hears. `on_ground`: when they were heard last; they may have
        taken off since.
        """
        if not silent and not self._said:
            return []
        news = []
        for vehicle in sorted(silent):
            if now_s - self._silent_s.get(vehicle, now_s) > CALM_S:
                self._after_s.pop(vehicle, None)
            self._silent_s[vehicle] = now_s
            self._heard_s.pop(vehicle, None)
            after_s = self._after_s.get(vehicle, SAY_AFTER_S)
            if vehicle in heard_elsewhere:
                after_s = QUIET_MAX_S
            if vehicle not in self._said and may_begin and silent[vehicle].age_s >= after_s:
                self._said.add(vehicle)
                where = "on the ground" if vehicle in on_ground else "in the air"
                news.append(Say(Severity.WARNING, f"vehicle {vehicle} link lost {where}: keeping clear"))
        for vehicle in sorted(self._said - silent.keys()):
            if now_s - self._heard_s.setdefault(vehicle, now_s) >= REGAINED_S:
                del self._heard_s[vehicle]
                self._said.remove(vehicle)
                self._after_s[vehicle] = min(QUIET_MAX_S, 2.0 * self._after_s.get(vehicle, SAY_AFTER_S))
                news.append(Say(Severity.NOTICE, f"vehicle {vehicle} link regained"))
        return news
