"""The vehicles that took off, are in this part of the swarm, have done what the phase asks. Bit k-1: vehicle k.

A swarm can fall into parts that do not hear one another, and no part can tell a lost vehicle from one that flies on
elsewhere. So only a part that holds the majority of those that took off, its leader's *quorum*, goes on with the
mission: two parts never come to the same tree. The others hold, and join when they hear it again.

Who is here comes up the routes, each vehicle by one branch. So that no branch makes a majority by itself, its word does
not count for long for those that were heard here and fell silent, where without them there is none. And who is heard
here has done what it says itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from companion.core.model.beacon import Beacon
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause

NO_MAJORITY: Final = failsafe_engine.row(Cause.NO_MAJORITY)
# A leader decides for the swarm only so long after it has counted a majority. By then one that led before has noticed
# that it has none any more, also by one-way links and a bad radio: by 1.5 s of silence at each hop and the delay of
# NO_MAJORITY, less the 1.4 s that others take to come to lead
DECIDES_AFTER_S: Final = 5.0
# Among trunks half of a swarm is out of sight for a second. And before another may decide this one has noticed
DOUBTED_S: Final = 3.0
NAMED_MAX: Final = 4  # vehicles in a message of 50 characters


class Roster:
    """One vehicle's knowledge. `flown` only grows, and travels with every beacon; the other sets come up the routes."""

    __slots__ = (
        "_behind",
        "_counted_s",
        "_doubted",
        "_doubted_s",
        "_everyone",
        "_excluded",
        "_flies",
        "_me",
        "_quorum_s",
        "_untold",
        "done",
        "flown",
        "present",
    )

    def __init__(self, me: int, size: int) -> None:
        self._me = 1 << (me - 1)
        self._everyone = (1 << size) - 1
        self.done = 0
        self.present = self._me
        self._behind: list[int] = []  # by branch: those that it brings, and that fell silent here
        self._doubted = 0  # those that do not count as here, whatever their branch says
        self._doubted_s: float | None = None  # since when it takes one branch's word for the majority
        self.flown = 0
        self._flies = False
        self._untold = 0  # started in the air: those that may have taken off before
        self._excluded = 0  # of whose words none count: nobody waits for them, and they are no part of the majority
        self._quorum_s: float | None = None  # when this part had the majority last
        self._counted_s: float | None = None  # since when it has had it, as counted, but for moments

    def update_flown(self, beacon: Beacon) -> None:
        """Adds those that took off, by a beacon: all know of them soon, whatever the routes are."""
        self.flown |= beacon.flown & self._everyone

    def exclude(self, vehicles: int) -> None:
        """Leave out vehicles whose words do not count now; bit k-1 for vehicle k."""
        self._excluded = vehicles

    def mark_airborne(self, *, takes_off: bool) -> None:
        """This vehicle takes off, or is in the air; one that was started there does not know who else is."""
        if takes_off:
            self._untold = 0
        elif not self._flies:
            self._untold = self._everyone
        self._flies = True
        self.flown |= self._me

    def mark_launched(self, ready: int) -> None:
        """The swarm takes off: those that were ready may be in the air from now on, heard or not."""
        self.flown |= ready & self._everyone

    def collect_branches(
        self,
        branches: Iterable[Beacon],
        *,
        done: bool,
        phase: int,
        stop: int = 0,
        silent: int = 0,
        heard: Iterable[Beacon] = (),
    ) -> None:
        """This vehicle and the branches behind it; a branch in another phase has not done anything in this one.

        `silent`: those that fell silent here, in the air (bit k-1: vehicle k); `heard`: of all that are heard.
        """
        self.present, self.done, self._behind = self._me, self._me if done else 0, []
        for beacon in branches:
            self.present |= beacon.present | 1 << (beacon.sender - 1)
            if beacon.present & silent:
                self._behind.append(beacon.present & silent)
            if beacon.phase == phase and beacon.stop == stop:
                self.done |= beacon.done
        for beacon in heard:
            its = 1 << (beacon.sender - 1) & ~self._excluded
            if beacon.phase != phase or beacon.stop != stop or not beacon.done & its:
                self.done &= ~its
        self.present &= self._everyone
        self.done &= self._everyone

    def missing_peers(self, grounded: int = 0) -> int:
        """The vehicles that took off and are not in this part. `grounded`: last heard on the ground; not counted."""
        return self._took_off & ~self.find_linked() & ~grounded & ~self._excluded

    @property
    def _took_off(self) -> int:
        """Vehicles that took off, or may have, as one that was started in the air cannot know. Bit k-1: vehicle k."""
        return self.flown | self._untold

    def find_linked(self) -> int:
        """The vehicles that count as in this part; bit k-1 for vehicle k."""
        return self.present & ~self._doubted

    def _find_doubted(self, grounded: int) -> int:
        """The vehicles that fell silent here, by the one branch without which this part is no majority; else 0."""
        awaited = self._took_off & ~grounded & ~self._excluded
        missing = awaited & ~self.present
        if self._is_majority(self.present, missing):
            for doubted in self._behind:
                if not self._is_majority(self.present & ~doubted, missing | awaited & doubted):
                    return doubted
        return 0

    def _is_majority(self, here: int, missing: int) -> bool:
        return (self.flown & here).bit_count() > missing.bit_count()

    def with_excluded(self, done: int) -> int:
        """`done`, or all, where nobody but those excluded is waited for."""
        return self._everyone if done | self._excluded == self._everyone else done

    def has_quorum(self, now_s: float, *, grounded: int = 0) -> bool:
        """A leader's: its part is the majority of those that took off, or was a moment ago, by the table of failsafes.

        A new leader has none until it has counted one, but what it has been handed (see `note_following`).
        """
        doubted = self._find_doubted(grounded)
        if not doubted:
            self._doubted_s = None
        elif self._doubted_s is None:
            self._doubted_s = now_s
        self._doubted = doubted if self._doubted_s is not None and now_s - self._doubted_s >= DOUBTED_S else 0
        here = (self.flown & self.find_linked()).bit_count()
        missing = self.missing_peers(grounded).bit_count()
        is_counted = here > missing or not self.flown
        if is_counted:
            self._quorum_s = now_s
        has = self._quorum_s is not None and now_s - self._quorum_s <= NO_MAJORITY.delay_s
        if not has:
            self._counted_s = None
        elif is_counted and self._counted_s is None:
            self._counted_s = now_s
        return has

    def may_decide(self, now_s: float) -> bool:
        """A leader's: its part has had the majority for so long that no other one still goes by an older count."""
        if self._counted_s is None:
            return False
        return not self.flown or now_s - self._counted_s >= DECIDES_AFTER_S

    def note_following(self, quorum_s: float | None, *, majority: bool) -> None:
        """While it does not lead: which are there comes up the routes only when it does.

        `quorum_s`: when the leader that hands over to it had the majority last; None: nobody hands over to it.
        `majority`: the leader that it follows says that it has one. Who took off is among what it has been told then.
        """
        self._quorum_s, self._counted_s = quorum_s, None
        self._doubted, self._doubted_s = 0, None
        if majority:
            self._untold = 0


def list_vehicles(vehicles: Sequence[int]) -> str:
    """Words for a message: the ids, or of many the first few and how many more."""
    named = vehicles if len(vehicles) <= NAMED_MAX else vehicles[: NAMED_MAX - 1]
    more = f", {len(vehicles) - len(named)} more" if len(named) < len(vehicles) else ""
    return ", ".join(map(str, named)) + more


def ids(bits: int) -> list[int]:
    """The vehicles of a set, ascending."""
    return [k for k in range(1, bits.bit_length() + 1) if bits >> (k - 1) & 1]
