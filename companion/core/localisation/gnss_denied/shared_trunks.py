"""Trunks shared between vehicles: the own ones remembered and told, and what those that neighbours tell align to.

Remembered are solitary trunks of the ground flown lately, in the frame of the own scan odometry. What neighbours tell
is a measurement of where they are, no more: it is dropped where the own radio measures them nearer, or not at all, and
weighed against the relative filter's own uncertainty. How near a neighbour may be follows from own ranges as before.

Without radios nobody is measured, and trunks are all that tells where others are. Then a liar moves itself by them, as
it can by its odometer, at most as far at once as the filter's gate is wide; and one that is lost, or has its start
position alone, believes the first that it aligns with where the leader is. Vehicles that it sees it keeps clear of.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.localisation.gnss_denied.error_state import Level
from companion.core.localisation.gnss_denied.ranging import RangingLocaliser
from companion.core.localisation.gnss_denied.wide_search import align_wide
from companion.core.model.beacon import ToldTrunk, TrunkReport
from companion.core.perception.landmarks.constellation import LEAST, Alignment, align, turned
from companion.core.perception.landmarks.solitary_trunks import SolitaryTrunks

TELLS_S: Final = 1.0  # between two messages
NOTES_S: Final = 0.5  # between two looks at the own trunks
TELLS_MAX: Final = 12  # trunks in a message
REMEMBERED_MAX: Final = 128
SAME_M: Final = 0.6  # two sightings of one trunk, the later with the drift since; solitary ones stand farther apart
FORGOTTEN_M: Final = 60.0  # own way since a trunk was seen: by then the odometry has drifted by 0.3 m
NOTED_S: Final = 2.0  # ago at most: by then the odometer, which nothing corrects, has the own place 0.1 to 0.2 m off
UNNOTED_MPS: Final = 6.0  # of way that counts as flown while nothing was noted for longer: that drifts by 0.3 m in 10 s
WIDE_M: Final = 1.0  # a neighbour's place that is more uncertain wants more trunks
UNCERTAIN_MAX_M: Final = 1.5  # and beyond, what is searched does not hold it
AGREES_M: Final = 0.4  # two in a row that are one
AGREES_RAD: Final = math.radians(1.5)
AGREES_S: Final = 3.5  # between them: two messages may be lost
MOVED_MAX_M: Final = 10.0  # a message that was on its way for longer, or an odometer that began anew
ALIGNS_S: Final = 0.5  # between two of one sender
PLACE_FLOOR_M: Final = 0.08
TURN_FLOOR_RAD: Final = math.radians(0.25)
REACH_SDS: Final = 3.0  # without radios: so far about where odometers have a neighbour it is searched for
START_REACH_M: Final = 30.0  # and about its start position, before it is known whether the own one is right
BEYOND_RANGE_M: Final = 0.6  # a neighbour may be told so much farther off than the own radio measures
RANGE_S: Final = 0.5  # lately


@final
class _Remembered:
    """A trunk in the frame of the own odometry, and what way had been flown when it was seen last."""

    __slots__ = ("diameter_m", "east_m", "north_m", "way_m")

    def __init__(self, north_m: float, east_m: float, diameter_m: float, way_m: float) -> None:
        self.north_m, self.east_m, self.diameter_m, self.way_m = north_m, east_m, diameter_m, way_m


@final
class SharedTrunks:
    """One vehicle's. Neighbours' ids are the mission's; times are the local clock's, s."""

    __slots__ = (
        "_aligned_s",
        "_frame",
        "_known",
        "_nearest",
        "_noted_s",
        "_odo",
        "_place",
        "_reports",
        "_told_farther",
        "_told_s",
        "_way_m",
        "aligned",
    )

    def __init__(self) -> None:
        self._known: list[_Remembered] = []
        self._nearest: list[ToldTrunk] = []  # of them, about this vehicle when it looked last
        self._place: Level | None = None  # own, in the frame of these; None: it has not looked yet
        self._odo: Level = (0.0, 0.0)  # the own odometer there
        self._frame = (0.0, 0.0, 0.0)
        self._way_m = 0.0
        self._told_farther = True  # the last time, so the nearest are next
        self._reports: dict[int, TrunkReport] = {}  # the last of each sender
        self._noted_s = self._told_s = -math.inf
        self._aligned_s: dict[int, float] = {}  # by sender
        self.aligned: dict[int, tuple[Alignment, float]] = {}  # by sender: the last, and when

    # --- own ---

    def is_due(self, now_s: float) -> bool:
        """Own trunks are to be noted."""
        return now_s - self._noted_s >= NOTES_S - 1e-6

    def note_trunks(self, seen: SolitaryTrunks, odo_ne_m: Level, now_s: float) -> None:
        """The own trunks in sight, and where this vehicle is among them. `odo_ne_m`: the own odometer there."""
        unnoted_s, self._noted_s, self._odo = now_s - self._noted_s, now_s, odo_ne_m
        if seen.frame != self._frame:
            self._turn_frame(seen.frame)
        before, self._place = self._place, seen.place_ne_m
        if before is not None:
            self._way_m += math.dist(before, seen.place_ne_m)
            if unnoted_s > NOTED_S:
                self._way_m += UNNOTED_MPS * unnoted_s
        n, e = seen.place_ne_m
        for trunk in seen.trunks:
            self._remember(trunk)
        self._known = [one for one in self._known if self._way_m - one.way_m <= FORGOTTEN_M]
        del self._known[:-REMEMBERED_MAX]
        about = [(one.north_m - n, one.east_m - e, one.diameter_m) for one in self._known]
        self._nearest = sorted(about, key=_distance_of)[: 2 * TELLS_MAX]

    def _remember(self, trunk: ToldTrunk) -> None:
        """Stores or replaces one, as the last."""
        north_m, east_m, diameter_m = trunk
        for k in range(len(self._known)):
            one = self._known[k]
            if math.hypot(one.north_m - north_m, one.east_m - east_m) <= SAME_M:
                del self._known[k]
                break
        self._known.append(_Remembered(north_m, east_m, diameter_m, self._way_m))

    def _turn_frame(self, frame: tuple[float, float, float]) -> None:
        """All places are turned as the trunks' frame has been since (see `ScanOdometry.frame`)."""
        before, self._frame = self._frame, frame
        for one in self._known:
            n, e = turned(frame[0] - before[0], one.north_m - before[1], one.east_m - before[2])
            one.north_m, one.east_m = frame[1] + n, frame[2] + e

    def make_report(self, me: int, time_ms: int, now_s: float) -> TrunkReport | None:
        """The message behind a beacon: in turn the nearest and the next; None: not now, or there is too little."""
        if now_s - self._told_s < TELLS_S - 1e-6 or now_s - self._noted_s > NOTES_S or len(self._nearest) < LEAST:
            return None
        self._told_s = now_s
        first = 0 if self._told_farther or len(self._nearest) < TELLS_MAX + LEAST else len(self._nearest) - TELLS_MAX
        self._told_farther = first > 0
        return TrunkReport(me, time_ms, self._odo, tuple(self._nearest[first : first + TELLS_MAX]))

    # --- neighbours' ---

    def receive_report(self, report: TrunkReport, ranging: RangingLocaliser, now_s: float) -> Alignment | None:
        """A neighbour's trunks: measures where it is, once two in a row agree; returns what was measured.

        Nothing is where the own trunks were noted longer than NOTED_S ago.
        """
        sender, here = report.sender, self._place
        is_early = now_s - self._aligned_s.get(sender, -math.inf) < ALIGNS_S
        if here is None or now_s - self._noted_s > NOTED_S or is_early or (ranging.is_lost and ranging.has_radio):
            return None
        prior = _locate_sender(report, ranging, now_s)
        if prior is None:
            return None
        self._aligned_s[sender] = now_s
        own = ranging.odo_ne_m
        n, e = here[0] + own[0] - self._odo[0], here[1] + own[1] - self._odo[1]
        known = [(one.north_m - n, one.east_m - e, one.diameter_m) for one in self._known]
        told = self._join(report)
        found: Alignment | None = None
        if prior.sd_m <= UNCERTAIN_MAX_M:
            found = align(told, known, prior.place, prior.turn_rad, is_wide=prior.sd_m > WIDE_M)
        if found is None and prior.reach_m > 0.0:
            found = align_wide(told, known, prior.place, prior.turn_rad, prior.reach_m)
        if found is None:
            return None
        # What others say makes no neighbour farther than the own radio measures it (ranges come late, never early), and
        # places none that it does not measure: where the sender is among its trunks is its word alone
        measured_m = ranging.measured_m(sender, now_s, RANGE_S)
        is_unmeasured = measured_m == math.inf and ranging.has_radio
        if is_unmeasured or math.hypot(*found.place(prior.moved)) > measured_m + BEYOND_RANGE_M:
            return None
        odo = report.odo_ne_m
        placed = Alignment(
            (odo[0] + found.there[0], odo[1] + found.there[1]),
            (own[0] + found.here[0], own[1] + found.here[1]),
            found.turn_rad,
            position_sd_m=math.hypot(PLACE_FLOOR_M, found.position_sd_m),
            turn_sd_rad=math.hypot(TURN_FLOOR_RAD, found.turn_sd_rad),
            matched=found.matched,
        )
        before = self.aligned.get(sender)
        self.aligned[sender] = (placed, now_s)
        if before is None or now_s - before[1] > AGREES_S or not _agree(before[0], placed):
            return None
        n, e = placed.place(odo)
        there = turned(ranging.filter.compass[0], n - own[0], e - own[1])
        if ranging.has_radio or not ranging.find_by(sender, there, now_s):
            ranging.filter.add_alignment(sender, placed)
        return placed

    def _join(self, report: TrunkReport) -> list[ToldTrunk]:
        """A neighbour's trunks with those of its message before, the nearest first."""
        before, self._reports[report.sender] = self._reports.get(report.sender), report
        told = list(report.trunks)
        if before is not None:
            n, e = before.odo_ne_m[0] - report.odo_ne_m[0], before.odo_ne_m[1] - report.odo_ne_m[1]
            if math.hypot(n, e) <= MOVED_MAX_M:
                earlier = [(one[0] + n, one[1] + e, one[2]) for one in before.trunks]
                told += [one for one in earlier if not _has_near(told, one)]
        return sorted(told, key=_distance_of)


@final
class _Prior:
    """A sender's pose when it told its trunks, as far as it is known; in the own axes, from here."""

    __slots__ = ("moved", "place", "reach_m", "sd_m", "turn_rad")

    def __init__(self, place: Level, turn_rad: float, sd_m: float, moved: Level, reach_m: float) -> None:
        """`moved`: its way since, in its own axes; `reach_m`: where it may be found besides, 0: nowhere else."""
        self.place: Final = place
        self.turn_rad: Final = turn_rad
        self.sd_m: Final = sd_m
        self.moved: Final = moved
        self.reach_m: Final = reach_m


def _locate_sender(report: TrunkReport, ranging: RangingLocaliser, now_s: float) -> _Prior | None:
    """None: it is not known well enough to be searched for."""
    sender, joint = report.sender, ranging.filter
    if ranging.is_lost:
        place, sd_m = ranging.dead_reckon(sender, report.odo_ne_m)
        return _Prior(place, 0.0, math.inf, (0.0, 0.0), REACH_SDS * sd_m)
    found, odo = joint.relative(sender), joint.odometer_of(sender)
    if found is None or odo is None or (ranging.has_radio and found.sd_m > UNCERTAIN_MAX_M):
        return None
    moved = (odo[0] - report.odo_ne_m[0], odo[1] - report.odo_ne_m[1])
    if math.hypot(moved[0], moved[1]) > MOVED_MAX_M:
        return None
    reach_m = 0.0
    if found.sd_m > UNCERTAIN_MAX_M:
        reach_m = REACH_SDS * found.sd_m
    elif not ranging.has_radio and ranging.is_doubtful and ranging.relocaliser.knows_leader(sender, now_s):
        reach_m = START_REACH_M
    own_rad = joint.compass[0]
    turn_rad = joint.compass_of(sender) - own_rad
    there, way = turned(-own_rad, found.ne_m[0], found.ne_m[1]), turned(turn_rad, moved[0], moved[1])
    return _Prior((there[0] - way[0], there[1] - way[1]), turn_rad, found.sd_m, moved, reach_m)


def _has_near(trunks: list[ToldTrunk], one: ToldTrunk) -> bool:
    return any([math.hypot(other[0] - one[0], other[1] - one[1]) <= SAME_M for other in trunks])


def _distance_of(trunk: ToldTrunk) -> float:
    return math.hypot(trunk[0], trunk[1])


def _agree(before: Alignment, after: Alignment) -> bool:
    n, e = before.place(after.there)
    turned_rad = abs(math.remainder(after.turn_rad - before.turn_rad, math.tau))
    return math.hypot(after.here[0] - n, after.here[1] - e) <= AGREES_M and turned_rad <= AGREES_RAD
