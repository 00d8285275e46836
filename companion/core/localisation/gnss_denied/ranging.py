"""Positions of the neighbours in a GNSS-denied swarm: `relative_filter`, fed by beacons, odometer and radio.

What comes out is along the north of this vehicle's own compass, by which it steers. Vectors that others tell are along
theirs, and are turned here. Of a neighbour's position two things are told apart: where it is thought to be, and how
near it may be, which is what is kept clear of.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.localisation.gnss_denied.error_state import AMONG_TRUNKS, Errors, Level
from companion.core.localisation.gnss_denied.relative_filter import RelativeFilter
from companion.core.localisation.gnss_denied.relative_state import drift_of, drifted_m
from companion.core.localisation.gnss_denied.relocalisation import Relocaliser
from companion.core.localisation.gnss_denied.start_placement import StartPlacementCheck
from companion.core.localisation.integrity.own_ranges import OwnRanges
from companion.core.model.beacon import RangeTo, RelativeReport
from companion.core.model.events import Position
from companion.core.model.states import LandedState
from companion.core.model.vectors import ZERO, turned_level
from companion.core.vehicle.failsafe import UNSURE_FROM, UNSURE_UNTIL
from mission.common.frames import Vec3, enu_to_ned
from mission.document.model import Mission

START_SD_M: Final = 0.5  # of the mission's positions, on each axis
GAP_S: Final = 1.0  # after a longer one the own bias is reckoned with from now on
STEEP: Final = 0.7  # a range is of use where so much of it is level
WIDENS_SDS: Final = 2.0  # a neighbour is kept clear of as if nearer by so many standard deviations
AWAY_M: Final = 3.0  # an odometer that has come farther was not begun here: standing still it does not drift
AGREES_M: Final = 4.0  # positions of the mission, and found ones: farther off they are others
UNKNOWN_AGE_S: Final = 3600.0  # of an odometer that does not tell it
OFF_M: Final = 2.0  # nearer than its reach by as much the radio measures: both positions of a pair may be off
NO_RANGES: Final = "no ranges from range radio"
FOUND: Final = "relative localisation initialised"
MISPLACED: Final = "start positions wrong: vehicle %d found elsewhere"


@final
class RangingLocaliser:
    """One vehicle's. `advance` it once a tick, after what has come in; ids are the mission's."""

    __slots__ = (
        "_age_s",
        "_agreed",
        "_begun",
        "_doubts",
        "_down_m",
        "_found",
        "_me",
        "_measures",
        "_met",
        "_mission",
        "_near_m",
        "_others_away",
        "_own_ranges",
        "_position_sd_m",
        "_read_s",
        "_standing",
        "_start_check",
        "_starts",
        "_told_s",
        "filter",
        "has_radio",
        "is_lost",
        "odo_ne_m",
        "relocaliser",
        "strayed_ned_m",
        "uncertain_peers",
    )

    def __init__(self, mission: Mission, me: int) -> None:
        assert mission.ranging is not None
        starts = [enu_to_ned(position) for position in mission.ranging.start_enu_m[: mission.swarm.size]]
        self._me = me
        self._starts = starts
        here = starts[me - 1]
        others = {k: _level(there, here) for k, there in enumerate(starts, start=1) if k != me}
        self._mission = mission
        nearest_m = min([math.hypot(*there) for there in others.values()], default=math.inf)
        self.has_radio: Final = mission.ranging.radio  # without one trunks alone tell where others are
        reach_m = mission.ranging.reach_m if self.has_radio else 0.0
        self._measures = nearest_m <= reach_m - OFF_M  # at its start, if its radio works
        self.relocaliser: Final = Relocaliser()
        self.is_lost = False  # it does not know where it is among the others
        self._doubts = True  # the mission's start positions: no motion has shown yet that they are no mirror image
        self._agreed: set[int] = set()  # neighbours that have told where they have the leader, as this one has it
        self._start_check = StartPlacementCheck([(position[0], position[1]) for position in starts])
        self._standing: set[int] = set()  # on the ground, this vehicle too
        self._met: set[int] = set()  # those that were heard
        self._told_s: dict[int, float] = {}  # of which time each told last, by the own clock
        self._others_away = False  # one of them had left its start by then
        self._found = ""  # by trunks, in words that are not said yet
        self._begun = False  # it is known whether it is at its start
        self._age_s = UNKNOWN_AGE_S  # of the own odometer
        self.filter = self._filter_of(others, START_SD_M)
        self._down_m = {k: starts[k - 1][2] for k in others}  # as they told last, about the mission's origin
        self.odo_ne_m: Level = (0.0, 0.0)
        self._read_s: float | None = None
        self.strayed_ned_m: Vec3 = ZERO  # how far the own odometer has gone wrong by its bias, since the start
        self._position_sd_m: dict[int, float] = {}  # as they told last
        self._own_ranges = OwnRanges(me)
        self._near_m = mission.separation.soft_m
        # Those near by whose positions are too uncertain to fly beside them, of those asked for by `locate_peer`.
        self.uncertain_peers: set[int] = set()

    # --- what comes in ---

    def update_odometry(self, position: Position, now_s: float) -> None:
        """The own odometer: the own told position, of which differences count."""
        pos, vel, start = position.pos_ned_m, position.vel_ned_mps, self._starts[self._me - 1]
        self._down_m[self._me] = pos[2]
        self.odo_ne_m = _level(pos, start)
        if position.boot_s is not None:
            self._age_s = position.boot_s
        self.relocaliser.update_odometry((pos[0], pos[1]))
        if self.is_lost:
            return
        if self._read_s is not None and 0.0 < now_s - self._read_s <= GAP_S:
            (bias_n, bias_e), since_s = self.filter.bias_ne_mps, now_s - self._read_s
            strayed = self.strayed_ned_m
            self.strayed_ned_m = (strayed[0] + bias_n * since_s, strayed[1] + bias_e * since_s, 0.0)
        self._read_s = now_s
        self.filter.update_odometry(self.odo_ne_m, (vel[0], vel[1]), now_s)

    def receive_ranges(self, ranges: tuple[RangeTo, ...], now_s: float) -> None:
        """The ranges that the own radio has measured."""
        for vehicle, metres, age_s in ranges:
            if vehicle not in self._down_m or vehicle == self._me:
                continue
            self._own_ranges.add(vehicle, metres, now_s - age_s)
            self._add_range(None, vehicle, metres, age_s, now_s)

    def receive_report(
        self,
        word: RelativeReport,
        vel_ned_mps: Vec3,
        down_m: float,
        now_s: float,
        *,
        age_s: float = 0.0,
        leader: int = 0,
        flies: bool = True,
    ) -> None:
        """A neighbour's word, with what its beacon says: velocity, height, leader (0: none), in the air or not.

        Of one that another has overtaken only the ranges count. `age_s`: for how long it has been on its way.
        """
        sender, vel, told_s = word.sender, (vel_ned_mps[0], vel_ned_mps[1]), now_s - age_s
        if sender == self._me or not 1 <= sender <= len(self._starts):
            return
        if told_s < self._told_s.get(sender, -math.inf):
            self._add_told_ranges(word, age_s, now_s)
            return
        self._told_s[sender] = told_s
        self._down_m[sender] = down_m
        (self._standing.discard if flies else self._standing.add)(sender)
        if word.position_sd_m is None:
            self._position_sd_m.pop(sender, None)
        else:
            self._position_sd_m[sender] = word.position_sd_m
        if sender not in self._met:
            self._meet_peer(word)
        start = self._starts[sender - 1]
        odo = (start[0] + word.odo_ne_m[0], start[1] + word.odo_ne_m[1])
        self.relocaliser.store_report(sender, leader, word.to_leader_ne_m, word.leader_sd_m, odo, vel, told_s)
        if self.is_lost:
            return
        if word.to_leader_ne_m is None:
            self._agreed.discard(sender)
        elif sender not in self._agreed or sender not in self.filter.ids:
            self._compare_leader(word, leader)
        self.filter.update_peer_odometry(sender, word.odo_ne_m, vel, age_s, now_s)
        self._add_told_ranges(word, age_s, now_s)

    def _add_told_ranges(self, word: RelativeReport, age_s: float, now_s: float) -> None:
        for vehicle, metres, since_s in word.ranges:
            if vehicle not in (self._me, word.sender) and not self.is_lost:  # its own it has from its own radio
                self._add_range(word.sender, vehicle, metres, since_s + age_s, now_s)

    def advance(self, now_s: float) -> str:
        """Bring all up to now. What it has just found out about where it is, in words; empty: nothing."""
        finder = self.relocaliser
        if self.is_lost and self.has_radio:
            if not finder.search(self._drifted_m, now_s):
                return ""
            self._begin_at(*finder.locate_vehicles(self._down_m, now_s))
            return FOUND
        if not self.is_lost:
            self.filter.advance(now_s)
        if not self.has_radio:
            found, self._found = self._found, ""
            return found
        if not self.is_doubtful or not finder.search(math.inf, now_s):
            return ""
        leader, there, _ = finder.leader
        if leader == self._me:
            return ""
        known = self.filter.relative(leader)
        self._doubts = False
        if known is not None and math.dist(known.ne_m, there) <= AGREES_M:
            return ""
        self._begin_at(*finder.locate_vehicles(self._down_m, now_s))
        return MISPLACED % leader

    def find_by(self, sender: int, there: Level, now_s: float) -> bool:
        """Trunks tell where a neighbour is from here. False: its place may be corrected by them, no more.

        Else this vehicle is lost, or it was elsewhere than at its start and begins anew by one that knows the leader.
        """
        finder = self.relocaliser
        if not (self.is_lost or self.is_doubtful) or not finder.place_by(sender, there, now_s):
            return self.is_lost
        leader, at, _ = finder.leader
        known = self.filter.relative(leader)
        if not self.is_lost and (leader == self._me or (known is not None and math.dist(known.ne_m, at) <= AGREES_M)):
            self._doubts = leader == self._me
            return False
        self._found = FOUND if self.is_lost else MISPLACED % leader
        self._begin_at(*finder.locate_vehicles(self._down_m, now_s))
        return True

    def dead_reckon(self, vehicle: int, odo: Level) -> tuple[Level, float]:
        """A neighbour's position from here by odometers alone, its own being at `odo`; sd on an axis."""
        here, there, own = self._starts[self._me - 1], self._starts[vehicle - 1], self.odo_ne_m
        return (there[0] + odo[0] - here[0] - own[0], there[1] + odo[1] - here[1] - own[1]), self._drifted_m

    def _begin_at(self, positions: dict[int, Level], sd_m: float) -> None:
        """Starts anew from found positions; neighbours that are not among them will tell where they are."""
        self.is_lost = self._doubts = False
        self._agreed = set(positions)
        self.filter = self._filter_of(positions, sd_m)

    def update_landed_state(self, landed: LandedState, *, waits: bool) -> None:
        """Once it is known whether this vehicle flies: one that does, or is elsewhere, is not at the mission's start.

        Nor does one on the ground know where those are that have flown already. `waits`: it is not to fly yet.
        """
        (self._standing.add if landed is LandedState.ON_GROUND else self._standing.discard)(self._me)
        begins = not self._begun and landed is not LandedState.UNDEFINED
        self._begun |= begins
        lost = begins and (landed is not LandedState.ON_GROUND or math.hypot(*self.odo_ne_m) > AWAY_M)
        self.is_lost |= lost or (self._others_away and waits and self._begun)
        self._others_away = False

    def _meet_peer(self, word: RelativeReport) -> None:
        """The first word of a neighbour: it may have left its start by then."""
        sender, odo = word.sender, word.odo_ne_m
        self._met.add(sender)
        if math.hypot(*odo) <= AWAY_M:
            return
        self._others_away = True
        self.filter.add_peer(sender, *self.dead_reckon(sender, odo))

    def _compare_leader(self, word: RelativeReport, leader: int) -> None:
        """A neighbour begins to tell where it has the leader: where it is thought to be elsewhere, its word counts."""
        to_leader, sd_m = word.to_leader_ne_m, word.leader_sd_m
        assert to_leader is not None
        at: Level = (0.0, 0.0)
        if leader != self._me:
            found = self.filter.relative(leader)
            if found is None or self._doubts or self.filter.has_lost(leader):
                return
            at, sd_m = found.ne_m, math.hypot(sd_m, found.sd_m)
        self._agreed.add(word.sender)
        there = (at[0] - to_leader[0], at[1] - to_leader[1])
        known = self.filter.relative(word.sender)
        if known is None or math.dist(known.ne_m, there) > AGREES_M + WIDENS_SDS * sd_m:
            self.filter.add_peer(word.sender, there, max(START_SD_M, sd_m))

    def _filter_of(self, positions: dict[int, Level], sd_m: float) -> RelativeFilter:
        """With the others there, each off by at least what positions of missions are."""
        made = RelativeFilter(AMONG_TRUNKS if self._mission.shares_trunks and self.has_radio else Errors())
        sure = [k for k in positions if self._mission.has_satellites(k)]
        made.initialise(positions, max(START_SD_M, sd_m), sure=sure, is_sure=self._mission.has_satellites(self._me))
        return made

    @property
    def _drifted_m(self) -> float:
        return drifted_m(Errors(), START_SD_M, self._age_s, math.hypot(*self.odo_ne_m))

    def _add_range(self, one: int | None, other: int, metres: float, age_s: float, now_s: float) -> None:
        a, b = self._down_m.get(one or self._me), self._down_m.get(other)
        if a is None or b is None:
            return
        square = metres * metres - (a - b) * (a - b)
        if square <= STEEP * STEEP * metres * metres:
            return
        if (one or self._me) in self._standing and other in self._standing:
            self._start_check.add_range(one or self._me, other, math.sqrt(square))
        if one is None and (self.is_lost or self.is_doubtful):
            self.relocaliser.add_range(other, math.sqrt(square), now_s)
        if not self.is_lost:
            self.filter.update_range(one, other, math.sqrt(square), age_s, now_s)

    # --- what comes out ---

    def locate_peer(self, vehicle: int, own_down_m: float, now_s: float) -> tuple[Vec3, Vec3] | None:
        """The position where a neighbour is thought to be, and the same as near as it may be; NED m from here.

        None: not known, or it has not told its odometer for a while.
        """
        found = None if self.is_lost else self.filter.relative(vehicle)
        if vehicle not in self._down_m or self.has_lost(vehicle):
            return None
        down_m = self._down_m[vehicle] - own_down_m
        if found is None:
            return self._dead_reckon_peer(vehicle, down_m, now_s)
        north, east = found.ne_m
        away_m = max(1e-6, math.hypot(north, east))
        u_n, u_e = north / away_m, east / away_m
        var = u_n * u_n * found.var_nn_m2 + 2.0 * u_n * u_e * found.var_ne_m2 + u_e * u_e * found.var_ee_m2
        near_m = min(away_m, self._own_ranges.level_m(vehicle, down_m, now_s))
        self._update_uncertain(vehicle, away_m, WIDENS_SDS * found.sd_m)
        near_m -= min(WIDENS_SDS * math.sqrt(max(0.0, var)), UNSURE_FROM * near_m)
        rel = turned_level((north, east, down_m), -self.filter.compass[0])
        return rel, (near_m / away_m * rel[0], near_m / away_m * rel[1], down_m)

    def scale_to_range(self, vehicle: int, rel_ned_m: Vec3, now_s: float) -> Vec3:
        """A silent vehicle's position by odometry, as near as the own radio measures: a range makes none farther."""
        return self._own_ranges.bring_near(vehicle, rel_ned_m, now_s)

    def measured_m(self, vehicle: int, now_s: float, within_s: float) -> float:
        """The level distance that the own radio measured lately; infinite: it has not."""
        down_m = self._down_m.get(vehicle, 0.0) - self._down_m.get(self._me, 0.0)
        return self._own_ranges.level_m(vehicle, down_m, now_s, within_s)

    def _dead_reckon_peer(self, vehicle: int, down_m: float, now_s: float) -> tuple[Vec3, Vec3] | None:
        """As `locate_peer`, of one that is not in the filter: as far as its range says, to where odometers have it."""
        guess = self.relocaliser.dead_reckon(vehicle)
        if guess is None:
            return None
        away_m = max(1e-6, math.hypot(*guess))
        measured_m = self._own_ranges.level_m(vehicle, down_m, now_s)
        share = min(measured_m, away_m) / away_m
        near = (1.0 - UNSURE_FROM) * share
        there = (share * guess[0], share * guess[1], down_m)
        return there, (near * guess[0], near * guess[1], down_m)

    def _update_uncertain(self, vehicle: int, away_m: float, unsure_m: float) -> None:
        share = UNSURE_UNTIL if vehicle in self.uncertain_peers else UNSURE_FROM
        if unsure_m > share * away_m and away_m - unsure_m < self._near_m:
            self.uncertain_peers.add(vehicle)
        else:
            self.uncertain_peers.discard(vehicle)

    def has_lost(self, vehicle: int) -> bool:
        """A neighbour whose odometer was not heard for a while: nobody knows here where it has gone."""
        return not self.is_lost and self.filter.has_lost(vehicle)

    def position_sd_m(self, vehicles: Sequence[int]) -> float | None:
        """Of these, as they told last, how far the way to d2 may be off where it is surest; None: none has told."""
        return min([self._position_sd_m[k] for k in vehicles if k in self._position_sd_m], default=None)

    def make_report(self, leader: int, time_ms: int, now_s: float, own_sd_m: float | None = None) -> RelativeReport:
        """For the next beacon. `leader`: the acting one; 0: none. `own_sd_m`: RelativeReport.position_sd_m."""
        knows = self._begun and not self.is_lost and not self._doubts and not self.filter.has_lost(leader)
        found = self.filter.relative(leader) if knows else None
        ranges = self._own_ranges.take_unsent(now_s)
        to_leader = None if found is None else found.ne_m
        sd_m = 0.0 if found is None else found.sd_m
        return RelativeReport(self._me, time_ms, self.odo_ne_m, to_leader, sd_m, ranges, own_sd_m)

    @property
    def start_mismatch(self) -> str:
        """While this vehicle stands: what does not stand where the mission says, in words; empty: nothing is seen."""
        if self._me not in self._standing:
            return ""
        off_m = math.hypot(*self.odo_ne_m)
        return f"{off_m:.0f} m from its start position" if off_m > AWAY_M else self._start_check.find_mismatch()

    def unmeasured(self, now_s: float) -> str:
        """While this vehicle stands, with a start position in its radio's reach: it measures nobody; empty: it does."""
        if not self._measures or self._me not in self._standing:
            return ""
        return "" if self._own_ranges.has_measured(now_s) else NO_RANGES

    @property
    def is_doubtful(self) -> bool:
        """In the air, with the mission's positions alone: it must see by a motion that they are no mirror image."""
        return self._doubts and self._begun and self._me not in self._standing

    def has_led(self) -> None:
        """This vehicle leads, and all have found their positions about it that could."""
        self._doubts = False

    def agrees(self, vehicle: int) -> bool:
        """A neighbour has told where it has the leader."""
        return vehicle in self._agreed

    @property
    def drift_ned_mps(self) -> Vec3:
        """The own velocity's error by its bias: the true one less the told one."""
        return ZERO if self.is_lost or self._doubts else drift_of(self.filter.bias_ne_mps)


def _level(a: Vec3, b: Vec3) -> Level:
    return (a[0] - b[0], a[1] - b[1])
