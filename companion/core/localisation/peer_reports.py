"""Reports of third vehicles by the member that sends them: where one hovers silent, and who hears it after all.

What others say may only restrict, so one member's word never ends another's alarm. A place that was reported is dropped

- when its own reporter takes it back: it hears the vehicle, or those on whose word it said so took theirs back;
- when a majority of the others say that they have heard the vehicle since, within VOTE_S;
- and, in `peer_table`, when it is heard here.

Where a member says that it hears a vehicle restricts, too: who does not hear that one keeps clear of the place while
it is fresh (`heard_places`), and asks on. A question is the reporter's own word that it takes back.

An alarm travels from member to member with the number of those that passed it on. Two that know of it only by each
other count up to PASSED_ON_MAX, and let it go: otherwise nobody could take back what has gone round once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final, final

from companion.core.model.beacon import PeerReport
from companion.core.model.vectors import sub
from mission.common.frames import Vec3

VOTE_S: Final = 2.0  # how long it counts that a member has heard a vehicle: two turns of eight reports, and losses
TAKEN_BACK: Final = 7  # `PeerReport.relays` of a report that only ends what its sender said before
PASSED_ON_MAX: Final = 6  # members over which a report goes
PLACES_MAX: Final = 3  # of one vehicle by one member's word: it may tell of several others' places
UNREPEATED_MAX: Final = 20  # a member tells its places in turn: one left out for so many others is not told any more
SAME_PLACE_M: Final = 1.0  # reports of one place differ by where their senders are taken to be
LEAST_VOTES: Final = 2  # one member alone ends no alarm
RELAYED_S: Final = 1.0  # how old a place may be at which a member hears a vehicle: by then it is metres off


def majority_of(size: int) -> int:
    """Members that end another's alarm: more than half of the others in a swarm of that size, and no fewer than two."""
    return max(LEAST_VOTES, (size - 1) // 2 + 1)


@final
class _Place:
    """Position of a silent vehicle by a member's word."""

    __slots__ = ("heard_s", "own_pos_ned_m", "rel_ned_m", "relays", "unrepeated")

    def __init__(self, report: PeerReport, own_pos_ned_m: Vec3, heard_s: float) -> None:
        self.rel_ned_m: Final = report.rel_ned_m
        self.own_pos_ned_m: Final = own_pos_ned_m
        self.heard_s: Final = heard_s  # by the local clock
        self.relays: Final = report.relays
        self.unrepeated = 0  # reports of other places since, by the same member

    def seen_from(self, own_pos_ned_m: Vec3) -> Vec3:
        """Relative to a position of the same odometry."""
        return sub(self.rel_ned_m, sub(own_pos_ned_m, self.own_pos_ned_m))


@dataclass(slots=True)
class _Word:
    """Reports of one vehicle by one member."""

    places: list[_Place] = field(default_factory=list)  # the latest report last, PLACES_MAX at most
    hears_s: float = -math.inf  # when it last heard that vehicle, if it says so now
    heard: _Place | None = None  # and where


class PeerReports:
    """Bounded by the swarm's size: PLACES_MAX places of each vehicle by each member's word."""

    __slots__ = ("_alarmed_s", "_asked_s", "_majority", "_refuted", "_stale_s", "_words")

    def __init__(self, size: int, stale_s: float) -> None:
        """`size`: of the swarm. `stale_s`: how far apart several may have heard a vehicle's last beacon."""
        self._majority = majority_of(size)
        self._stale_s = stale_s
        self._words: dict[int, dict[int, _Word]] = {}  # by vehicle, then by sender
        self._refuted: dict[int, _Place] = {}  # by vehicle: heard then, by a majority's word
        self._alarmed_s: dict[int, float] = {}  # by vehicle: when a member last said that it is silent
        self._asked_s: dict[int, float] = {}  # by vehicle: when a member last asked where others hear it

    def store(self, sender: int, report: PeerReport, own_pos_ned_m: Vec3, now_s: float) -> None:
        """Take in a member's report; `report.rel_ned_m` is from this vehicle."""
        word = self._words.setdefault(report.vehicle, {}).setdefault(sender, _Word())
        place = _Place(report, own_pos_ned_m, now_s - report.age_s)
        if report.silent:
            self._alarmed_s[report.vehicle] = now_s
            word.hears_s, word.heard = -math.inf, None
            if not self.is_refuted(report.vehicle, place.heard_s):
                self._keep_place(word, place, own_pos_ned_m)
            return
        word.places.clear()
        if report.relays == TAKEN_BACK:
            self._asked_s[report.vehicle] = now_s
            word.hears_s, word.heard = -math.inf, None
        else:
            word.hears_s, word.heard = place.heard_s, place
        self._count_votes(report.vehicle, place, now_s)

    def vehicles(self) -> set[int]:
        """Vehicles that some member calls silent."""
        return {vehicle for vehicle, words in self._words.items() if any([word.places for word in words.values()])}

    def places(self, vehicle: int, own_pos_ned_m: Vec3, now_s: float, *, since_s: float) -> list[PeerReport]:
        """Places at which it hovers by others' words, heard there at `since_s` or later; reports of one place are one.

        Those of which fewest passed on the word come first; a member's second place after all members' first.
        """
        found: list[tuple[int, int, int, _Place]] = []
        for sender, word in sorted(self._words.get(vehicle, {}).items()):
            latest_first = [place for place in reversed(word.places) if place.heard_s >= since_s]
            found += [(nth, place.relays, sender, place) for nth, place in enumerate(latest_first)]
        found.sort(key=lambda one: one[:3])
        reports: list[PeerReport] = []
        for *_, place in found:
            rel, age_s = place.seen_from(own_pos_ned_m), now_s - place.heard_s
            same = [k for k, other in enumerate(reports) if math.dist(rel, other.rel_ned_m) <= SAME_PLACE_M]
            if not same:
                reports.append(PeerReport(vehicle, rel, age_s, silent=True, relays=place.relays, received=True))
            elif place.relays < reports[same[0]].relays:
                reports[same[0]] = replace(reports[same[0]], age_s=age_s, relays=place.relays)
        return reports

    def is_refuted(self, vehicle: int, heard_s: float) -> bool:
        """A majority of the others has heard it since."""
        refuted = self._refuted.get(vehicle)
        return refuted is not None and refuted.heard_s > heard_s + self._stale_s

    def refutation(self, vehicle: int, own_pos_ned_m: Vec3, now_s: float) -> PeerReport | None:
        """Report of a majority that has heard it lately, to be passed on; None: there is no such word."""
        place = self._refuted.get(vehicle)
        if place is None or now_s - place.heard_s > VOTE_S:
            return None
        rel, age_s = place.seen_from(own_pos_ned_m), now_s - place.heard_s
        return PeerReport(vehicle, rel, age_s, silent=False, relays=1, received=True)

    def alarmed(self, now_s: float, *, within_s: float) -> list[int]:
        """Vehicles that a member has called silent within that time, whoever hears them."""
        return [vehicle for vehicle, at_s in self._alarmed_s.items() if now_s - at_s <= within_s]

    def asked(self, now_s: float, *, within_s: float) -> list[int]:
        """Vehicles that a member has asked for within that time."""
        return [vehicle for vehicle, at_s in self._asked_s.items() if now_s - at_s <= within_s]

    def heard_places(self, vehicle: int, own_pos_ned_m: Vec3, now_s: float) -> list[tuple[Vec3, float]]:
        """Places at which members hear it, relative, and how old each is; of those that are the same the newest."""
        words = self._words.get(vehicle, {}).values()
        fresh = [w.heard for w in words if w.heard is not None and now_s - w.heard.heard_s <= RELAYED_S]
        found: list[tuple[Vec3, float]] = []
        for place in sorted(fresh, key=lambda one: -one.heard_s):
            rel = place.seen_from(own_pos_ned_m)
            if all([math.dist(rel, other) > SAME_PLACE_M for other, _ in found]):
                found.append((rel, now_s - place.heard_s))
        return found

    def _keep_place(self, word: _Word, place: _Place, own_pos_ned_m: Vec3) -> None:
        rel = place.seen_from(own_pos_ned_m)
        kept: list[_Place] = []
        for other in word.places:
            other.unrepeated += 1
            is_same = math.dist(other.seen_from(own_pos_ned_m), rel) <= SAME_PLACE_M
            if not is_same and other.unrepeated <= UNREPEATED_MAX:
                kept.append(other)
        word.places = [*kept, place][-PLACES_MAX:]

    def _count_votes(self, vehicle: int, place: _Place, now_s: float) -> None:
        words = self._words[vehicle]
        votes = [word.hears_s for word in words.values() if now_s - word.hears_s <= VOTE_S]
        if len(votes) < self._majority:
            return
        # So late have that many heard it, at least.
        heard_s = sorted(votes, reverse=True)[self._majority - 1]
        before = self._refuted.get(vehicle)
        if before is not None and before.heard_s >= heard_s:
            return
        report = PeerReport(vehicle, place.rel_ned_m, now_s - heard_s, silent=False)
        self._refuted[vehicle] = _Place(report, place.own_pos_ned_m, heard_s)
        for word in words.values():
            word.places = [k for k in word.places if not self.is_refuted(vehicle, k.heard_s)]
