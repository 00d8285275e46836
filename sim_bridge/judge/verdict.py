"""Judges whether a flight did what its mission asks: the last line of `sim-bridge fly`, and its exit code.

ARRIVED asserts all of these:

- The swarm arrived: a leader came to d2, and then or later all were gathered there (`arrived`).
- The flight came to its own end: the time in coverage is over, or all have landed where the mission lands.
- No contact, `min_separation_m` never more than 0.1 m below separation.hard_m (0.5 m where what autopilots report is
  off the truth: each keeps its distance by what they report), nobody more than 1 m outside of the fence, and never two
  acting leaders in one connected part for more than 2 s.
- Coverage was formed when its time was over, unless coverage.duration_s = 0: over the last 5 s of the phase no vehicle
  was further off the ring or sphere than a covering vehicle is (`coverage_radius_error_m`), the gap was at most 1.5
  times the ideal, and none whose companion answers was on the ground (`uncovering`).
- Where the mission lands, every vehicle is on the ground in the right place and disarmed; and nowhere has one come
  down for good before it announced the phase LAND, as those do that are left without a majority (`landed_early`).
- No vehicle was lost: at the end every companion answers (and every external autopilot), and no vehicle has run into
  anything. One that a fault of the mission killed on purpose, or stopped to the end, is the exception: if everything
  else holds for the others, the flight is ARRIVED without it, by name, and succeeded.

Else the flight is the worst of three, and says all that does not hold:

- UNSAFE: a contact, separation, the fence, two leaders.
- INCOMPLETE: it stayed safe, and did not do what the mission asks, though it could have.
- DEGRADED: the same, and faults explain it: only vehicles that a fault struck, or that sim.battery_mah gives less than
  2000 mAh, stayed behind, landed early, are up at the end or missing on the ring or sphere; or a fault was in force in
  the last 30 s (kill, motor, pilot and disk-full, past which the others go on: began then); or faults left no majority
  of the swarm at one time, and then all land, as the failsafe table asks; or, where not all have satellites, faults
  took for good the position of each that has, and nobody knows the way. A member's lie counts as in force for as long
  again as it lasted; what came down after one need not go up again, nor need a tree be covered that was left out. A
  radio without keys, and a base station that is not heard, explain nothing: they are to change nothing.

Where only such vehicles are missing at d2, coverage, landing and end are asked of the others as ever.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

from mission.common.forming import FORMED_RATIO
from mission.document.model import AtEnd, Mission
from mission.schema.faults import FaultKind
from sim_bridge.judge.fault_events import SILENCING, FaultEvent, silenced
from sim_bridge.judge.metrics import Metrics, tolerance_m
from sim_bridge.judge.metrics.arrival import estimates_tolerance_m

SEPARATION_TOLERANCE_M = 0.1  # the safety filter commands velocities: an airframe follows them to centimetres
FENCE_TOLERANCE_M = 1.0  # what an autopilot's estimate of its position may be wrong by
UNHEARD_S = 5.0  # after two hear each other again, until they may be asked to keep their distance, and count each other
LEADERS_TOGETHER_S = 2.0  # until two that come into reach have heard each other, over some links that lose beacons
HARMLESS = (FaultKind.OUTSIDER, FaultKind.BASE_LOST)  # no vehicle is to fly otherwise for them
# Nothing mends these, and the others go on
LOSSES = (FaultKind.KILL, FaultKind.MOTOR, FaultKind.PILOT, FaultKind.DISK_FULL)
# What takes a position of satellites away for good, or the vehicle that has it: doubted, it is given up. From an outage
# and from a jump a vehicle recovers
TAKES_POSITION = (
    FaultKind.KILL,
    FaultKind.MOTOR,
    FaultKind.PILOT,
    FaultKind.GNSS_DRIFT,
    FaultKind.POSITION_FREEZE,
    FaultKind.POSITION_DRIFT,
)
RECOVERY_S = 30.0  # after a fault is over, until the swarm may be asked for what it does
SMALL_BATTERY_MAH = 2000.0  # a vehicle that is given less than this may land by its autopilot's battery failsafe
COVERED, LANDED = "coverage complete", "all landed"  # how a flight ends by itself


class Grade(StrEnum):
    """Grade of a flight; from good to bad."""

    ARRIVED = "ARRIVED"
    DEGRADED = "DEGRADED"
    INCOMPLETE = "INCOMPLETE"
    UNSAFE = "UNSAFE"


BAD_FIRST = list(reversed(Grade))
CAUSES = {
    "contact": "a vehicle touched a trunk, a crown, a box or the ground",
    "collision": "two vehicles touched",
    "separation": "two came nearer than separation.hard_m",
    "unheard": "the two causes before, while a fault kept the two vehicles from hearing each other",
    "fence": "a vehicle left the fence",
    "leaders": "two acting leaders in one connected part",
    "not arrived": "some never came to d2",
    "unfinished": "the flight did not come to its own end, or left trees out",
    "landed early": "some landed before the mission's end",
    "coverage": "the ring or sphere did not form",
    "landing": "some did not land, or elsewhere",
    "lost": "a companion did not answer any more",
}


@dataclass(frozen=True, slots=True)
class Verdict:
    """Of one flight."""

    grade: Grade
    text: str  # one line
    causes: tuple[str, ...] = ()  # the kinds of what did not hold, worst first: `CAUSES`

    @property
    def succeeded(self) -> bool:
        """The mission was flown."""
        return self.grade is Grade.ARRIVED


@dataclass(frozen=True, slots=True)
class _Problem:
    cause: str  # of CAUSES
    text: str
    grade: Grade


def judge(
    metrics: Metrics, mission: Mission, ended: str, *, faults: Sequence[FaultEvent] = (), end_s: float | None = None
) -> Verdict:
    """`ended`: why the flight was over, at `end_s` (None: with its recording); `faults`: those that happened."""
    struck = _struck(metrics, faults, mission, ended, metrics.sim_time_s if end_s is None else end_s)
    excused = set(metrics.lost) & struck.silenced
    left = (set(metrics.aloft) | set(metrics.armed)) - excused if _lands(mission) else set()
    problems = [*_way(metrics, mission, ended, left, struck), *_dangers(metrics, mission, faults)]
    if _came(metrics, struck):
        problems += [*_coverage(metrics, mission, struck), *_landing(metrics, mission, excused, left, struck)]
    unwanted = set(metrics.lost) - excused
    if unwanted:
        problems.append(_Problem("lost", f"lost {_vehicles(unwanted)}", Grade.INCOMPLETE))
    without = f" without {_names(metrics.lost)}" if metrics.lost else ""
    if problems:
        problems.sort(key=lambda problem: BAD_FIRST.index(problem.grade))
        grade = problems[0].grade
        text = f"{grade}{without}: {'; '.join([problem.text for problem in problems])}"
        return Verdict(grade, text, tuple(dict.fromkeys([problem.cause for problem in problems])))
    hang = excused & (set(metrics.aloft) | set(metrics.armed)) if _lands(mission) else set()
    return Verdict(Grade.ARRIVED, f"ARRIVED{without}{f' ({_still(metrics, hang)})' if hang else ''}")


def with_notes(text: str, *notes: str) -> str:
    """The line of a verdict, with what a reader must know of the flight: what external autopilots believed, whose law
    flew. Empty ones are left out.
    """
    said = "; ".join([note for note in notes if note])
    return f"{text} ({said})" if said else text


@dataclass(frozen=True, slots=True)
class _Struck:
    """Excuses by the faults of a flight."""

    silenced: frozenset[int]  # their companions were killed, or are stopped at the end
    vehicles: frozenset[int]  # struck by any fault, cut off on the lesser side, or with a small battery
    lied: bool  # a member has, at any time
    all_excused: bool  # by what befell the whole swarm

    def explain(self, vehicles: Collection[int]) -> bool:
        """They alone are missing, and were struck."""
        return bool(vehicles) and self.vehicles.issuperset(vehicles)

    def excuses(self, vehicles: Collection[int] = ()) -> Grade:
        """Grade of what did not hold of these vehicles; empty: of the swarm."""
        return Grade.DEGRADED if self.all_excused or self.explain(vehicles) else Grade.INCOMPLETE


def _struck(metrics: Metrics, faults: Sequence[FaultEvent], mission: Mission, ended: str, end_s: float) -> _Struck:
    n = metrics.n
    faults = [fault for fault in faults if fault.kind not in HARMLESS]
    struck = {k for k, capacity_mah in mission.sim.battery_mah.items() if capacity_mah < SMALL_BATTERY_MAH}
    struck |= {k for fault in faults for k in fault.vehicles if fault.kind is not FaultKind.PARTITION}
    for fault in faults:
        if fault.kind is FaultKind.PARTITION:
            others = frozenset(range(1, n + 1)).difference(fault.vehicles)
            struck |= min(set(fault.vehicles), others, key=len) if 2 * len(others) != n else others | {*fault.vehicles}
    # Who has come down stays there, though the lie that brought it down is over
    lied = any(fault.kind is FaultKind.INSIDER for fault in faults)
    struck |= set(metrics.landed_early) if lied else set()
    brought_down = lied and ended.startswith(LANDED) and not (metrics.arrived and _lands(mission))
    lasting = any(_over_s(fault) > end_s - RECOVERY_S for fault in faults)
    without = mission.without_satellites.union(*[fault.vehicles for fault in faults if fault.kind in TAKES_POSITION])
    no_satellites = mission.flies_by_ranges and without.issuperset(range(1, n + 1))
    all_excused = brought_down or lasting or no_satellites or not _kept_majority(faults, n)
    return _Struck(silenced(faults, end_s), frozenset(struck), lied, all_excused)


def _kept_majority(faults: Sequence[FaultEvent], n: int) -> bool:
    """More than half of the swarm could decide at any time."""
    silencing = [fault for fault in faults if fault.kind in (*SILENCING, FaultKind.MOTOR)]
    for now_s in [fault.at_s for fault in silencing]:
        silent = {
            k
            for fault in silencing
            if fault.at_s <= now_s and (fault.until_s is None or now_s <= fault.until_s + UNHEARD_S)
            for k in fault.vehicles
        }
        if 2 * (n - len(silent)) <= n:
            return False
    return True


def _over_s(fault: FaultEvent) -> float:
    """Time from which the swarm may begin to recover: from a loss it does at once."""
    if fault.kind in LOSSES:
        return fault.at_s
    if fault.until_s is None:
        return math.inf
    if fault.kind is FaultKind.INSIDER:  # who was led astray needs as long to come back
        return 2.0 * fault.until_s - fault.at_s
    return fault.until_s


def _came(metrics: Metrics, struck: _Struck) -> bool:
    """All came to d2 but those that were struck: from the others the rest of the mission is asked."""
    return metrics.arrived or struck.explain(set(metrics.absent) - set(metrics.lost))


def _way(metrics: Metrics, mission: Mission, ended: str, left: Collection[int], struck: _Struck) -> Iterator[_Problem]:
    wrong_end = _came(metrics, struck) and not ended.startswith(LANDED if _lands(mission) else COVERED)
    if not metrics.arrived:
        absent = set(metrics.absent) - set(metrics.lost)
        who = f": {_vehicles(absent)} never came to d2" if absent else ""
        why = "" if wrong_end else f" ({ended})"
        yield _Problem("not arrived", f"not all arrived{who}{why}", struck.excuses(absent))
    if wrong_end and ended.startswith(LANDED):
        yield _Problem("landed early", f"{ended}, where the mission holds", struck.excuses(metrics.landed_early))
        return
    if wrong_end:
        yield _Problem("unfinished", ended, struck.excuses(left))
    if metrics.visited < len(mission.visits) and mission.route.stops:
        grade = Grade.DEGRADED if struck.lied else struck.excuses()  # what it was told that all have done is left out
        yield _Problem("unfinished", f"covered {metrics.visited} of {len(mission.visits)} trees", grade)
    if metrics.landed_early:
        early = f"{_vehicles(metrics.landed_early)} landed before the mission's end"
        yield _Problem("landed early", early, struck.excuses(metrics.landed_early))


def separation_tolerance_m(mission: Mission) -> float:
    """Distance below separation.hard_m that two may come to, by truth."""
    return max(SEPARATION_TOLERANCE_M, estimates_tolerance_m(mission))


def separation_limit_m(mission: Mission) -> float:
    """Distance below which two were too near, by truth."""
    return mission.separation.hard_m - separation_tolerance_m(mission)


def _dangers(metrics: Metrics, mission: Mission, faults: Sequence[FaultEvent]) -> Iterator[_Problem]:
    for cause, text in (*_closeness(metrics, mission, unheard=_unheard(metrics, faults)), *_rules(metrics)):
        yield _Problem(cause, text, Grade.UNSAFE)


def _unheard(metrics: Metrics, faults: Sequence[FaultEvent]) -> bool:
    """A fault kept the two that came closest from hearing each other, until UNHEARD_S before at most."""
    at_s = metrics.closest_at_s
    if at_s is None:
        return False
    pair = set(metrics.closest)
    for fault in faults:
        struck = len(pair.intersection(fault.vehicles))
        parts = struck == 1 if fault.kind is FaultKind.PARTITION else struck > 0 and fault.kind in SILENCING
        if parts and fault.at_s <= at_s <= (math.inf if fault.until_s is None else fault.until_s + UNHEARD_S):
            return True
    return False


def _closeness(metrics: Metrics, mission: Mission, *, unheard: bool) -> Iterator[tuple[str, str]]:
    if metrics.contacts:
        with_what = (
            ("trunks", metrics.contacts_trunks),
            ("crowns", metrics.contacts_crowns),
            ("boxes", metrics.contacts_boxes),
            ("the ground", metrics.contacts_ground),
        )
        parts = [f"{n} with {what}" for what, n in with_what if n]
        count = f"{metrics.contacts} contact{'s' * (metrics.contacts > 1)}"
        text = f"{count} ({', '.join(parts)})" if parts else count
        if metrics.contacts > metrics.contacts_vehicles:
            yield "contact", text if metrics.contacts_steered else f"{text}, with no companion to steer"
        else:
            yield "unheard" if unheard else "collision", text
    least_m, limit_m = metrics.min_separation_m, separation_limit_m(mission)
    if least_m is not None and least_m < limit_m:
        who = f" between {_vehicles(metrics.closest)} at {metrics.closest_at_s:.1f} s" if metrics.closest else ""
        why = ", kept from hearing each other" if unheard else ""
        must = f"must be at least {limit_m:g} (separation.hard_m less {separation_tolerance_m(mission):g})"
        text = f"separation {least_m:.2f} m{who}{why}: {must}"
        yield "unheard" if unheard else "separation", text


def _rules(metrics: Metrics) -> Iterator[tuple[str, str]]:
    if metrics.fence_exceeded_m > FENCE_TOLERANCE_M:
        yield "fence", f"{metrics.fence_exceeded_m:.1f} m outside of the fence"
    if metrics.leaders_together_s > LEADERS_TOGETHER_S:
        yield "leaders", f"two acting leaders in one connected part for {metrics.leaders_together_s:.1f} s"


def _coverage(metrics: Metrics, mission: Mission, struck: _Struck) -> Iterator[_Problem]:
    if mission.coverage.duration_s == 0.0:
        return
    text = _unformed(metrics, mission)
    if text:
        yield _Problem("coverage", text, struck.excuses(metrics.uncovering))


def _unformed(metrics: Metrics, mission: Mission) -> str:
    gap_deg, ideal_deg = metrics.coverage_gap_deg, metrics.coverage_gap_ideal_deg
    if gap_deg is None or ideal_deg is None:
        return "no coverage"
    shape, within_m = mission.coverage.shape.value, tolerance_m(mission)
    error_m = metrics.coverage_radius_error_m
    if error_m is None:
        return "coverage not formed: no vehicle in the air at its end"
    if error_m > within_m:
        flying = set(metrics.uncovering) - set(metrics.landed_early)
        who = f"{_vehicles(flying)} " if flying else ""
        return f"coverage not formed: {who}up to {error_m:.1f} m off the {shape}: must be within {within_m:g} m"
    if gap_deg > FORMED_RATIO * ideal_deg:
        return f"coverage not formed: gap {gap_deg:.0f} deg: must be at most {FORMED_RATIO:g} x {ideal_deg:.0f}"
    down = set(metrics.uncovering) - set(metrics.landed_early)  # the others of a large ring leave hardly a gap
    if down:
        return f"coverage not formed: {_vehicles(down)} did not cover"
    return ""


def _landing(
    metrics: Metrics, mission: Mission, excused: set[int], left: Collection[int], struck: _Struck
) -> Iterator[_Problem]:
    if not _lands(mission):
        return
    if left:
        yield _Problem("landing", _still(metrics, left), struck.excuses(left))
    strayed = set(metrics.strayed) - excused - set(metrics.landed_early)
    if strayed:
        where = "d1" if mission.route.at_end is AtEnd.RETURN else "the coverage at d2"
        yield _Problem("landing", f"{_vehicles(strayed)} landed away from {where}", struck.excuses(strayed))


def _still(metrics: Metrics, left: Collection[int]) -> str:
    """Words about vehicles that should be on the ground and disarmed."""
    up, armed = set(left) & set(metrics.aloft), set(left) & set(metrics.armed)
    parts = (
        (up & armed, "still armed in the air"),
        (armed - up, "still armed on the ground"),
        (up - armed, "in the air, disarmed"),
    )
    return ", ".join(f"{_vehicles(ids)} {how}" for ids, how in parts if ids)


def _lands(mission: Mission) -> bool:
    return mission.route.at_end is not AtEnd.HOLD


def _vehicles(ids: Collection[int]) -> str:
    return f"vehicle{'s' * (len(ids) > 1)} {_names(ids)}"


def _names(ids: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(ids)))
