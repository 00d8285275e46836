"""Judges whether a flight did what its mission asks: the last line of `sim-bridge fly`, and its exit code.

ARRIVED asserts all of these:

- The swarm arrived: a leader came to d2, and then or later all were gathered there (`arrived`).
- The flight came to its own end: the time in coverage is over, or all have landed where the mission lands.
- No contact, and `min_separation_m` never more than 0.1 m below separation.hard_m.
- Coverage was formed when its time was over, unless coverage.duration_s = 0: over the last 5 s of the phase no vehicle
  was further off the ring or sphere than a covering vehicle is (`coverage_radius_error_m`), and the gap was at most 1.5
  times the ideal: one that is missing makes it 2 on a ring.
- Where the mission lands, every vehicle is on the ground in the right place and disarmed; and nowhere has one landed
  before the phase LAND, as those do that are left without a majority.
- No vehicle was lost: at the end every companion answers (and every external autopilot), and no vehicle has run
  into a trunk, a crown or the ground. One that a fault of the
  mission killed on purpose, or stopped to the end, is the exception: if everything else holds for the others, the
  flight is ARRIVED without it, by name, and succeeded.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

from mission.document.model import AtEnd, Mission
from sim_bridge.judge.metrics import Metrics, tolerance_m

SEPARATION_TOLERANCE_M = 0.1  # the safety filter commands velocities: an airframe follows them to centimetres
FORMED_RATIO = 1.5  # of gap to ideal: no vehicle is missing on a ring, and none half a place off
COVERED, LANDED = "coverage complete", "all landed"  # how a flight ends by itself


@dataclass(frozen=True, slots=True)
class Verdict:
    """Of one flight."""

    succeeded: bool
    text: str  # one line


def judge(metrics: Metrics, mission: Mission, ended: str, *, silenced: Collection[int] = ()) -> Verdict:
    """`ended`: why the flight was over; `silenced`: vehicles whose companions were killed or stopped on purpose."""
    excused = set(metrics.lost) & set(silenced)
    problems = [*_way(metrics, mission, ended), *_distances(metrics, mission)]
    if metrics.arrived:
        problems += _coverage(metrics, mission)
    problems += _landing(metrics, mission, excused)
    unwanted = set(metrics.lost) - excused
    if unwanted:
        problems.append(f"lost {_vehicles(unwanted)}")
    without = f" without {_names(metrics.lost)}" if metrics.lost else ""
    if problems:
        return Verdict(False, f"FAILED{without}: {'; '.join(problems)}")
    left = set(metrics.lost) & (set(metrics.aloft) | set(metrics.armed)) if _lands(mission) else set()
    return Verdict(True, f"ARRIVED{without}{f' ({_still(metrics, left)})' if left else ''}")


def _way(metrics: Metrics, mission: Mission, ended: str) -> Iterator[str]:
    if not metrics.arrived:
        absent = set(metrics.absent) - set(metrics.lost)
        who = f": {_vehicles(absent)} never came to d2" if absent else ""
        yield f"not all arrived{who} ({ended})"
    elif not _lands(mission) and ended.startswith(LANDED):
        yield f"{ended}, where the mission holds"
        return
    elif not ended.startswith(LANDED if _lands(mission) else COVERED):
        yield ended
    if metrics.visited < len(mission.visits) and mission.route.stops:
        yield f"covered {metrics.visited} of {len(mission.visits)} trees"
    if metrics.landed_early:
        yield f"{_vehicles(metrics.landed_early)} landed before the mission's end"


def _distances(metrics: Metrics, mission: Mission) -> Iterator[str]:
    if metrics.contacts:
        with_what = (("trunks", metrics.contacts_trunks), ("crowns", metrics.contacts_crowns))
        parts = [f"{n} with {what}" for what, n in (*with_what, ("the ground", metrics.contacts_ground)) if n]
        count = f"{metrics.contacts} contact{'s' * (metrics.contacts > 1)}"
        yield f"{count} ({', '.join(parts)})" if parts else count
    hard_m = mission.separation.hard_m
    if metrics.min_separation_m is not None and metrics.min_separation_m < hard_m - SEPARATION_TOLERANCE_M:
        yield f"separation {metrics.min_separation_m:.2f} m: must be at least separation.hard_m = {hard_m:g}"


def _coverage(metrics: Metrics, mission: Mission) -> Iterator[str]:
    if mission.coverage.duration_s == 0.0:
        return
    gap_deg, ideal_deg = metrics.coverage_gap_deg, metrics.coverage_gap_ideal_deg
    if gap_deg is None or ideal_deg is None:
        yield "no coverage"
        return
    shape, within_m = mission.coverage.shape.value, tolerance_m(mission)
    error_m = metrics.coverage_radius_error_m
    if error_m is None:
        yield "coverage not formed: no vehicle in the air at its end"
    elif error_m > within_m:
        yield f"coverage not formed: up to {error_m:.1f} m off the {shape}: must be within {within_m:g} m"
    elif gap_deg > FORMED_RATIO * ideal_deg:
        yield f"coverage not formed: gap {gap_deg:.0f} deg: must be at most {FORMED_RATIO:g} x {ideal_deg:.0f}"


def _landing(metrics: Metrics, mission: Mission, excused: set[int]) -> Iterator[str]:
    if not _lands(mission) or not metrics.arrived:
        return
    left = (set(metrics.aloft) | set(metrics.armed)) - excused
    if left:
        yield _still(metrics, left)
    strayed = set(metrics.strayed) - excused - set(metrics.landed_early)
    if strayed:
        where = "d1" if mission.route.at_end is AtEnd.RETURN else "the coverage at d2"
        yield f"{_vehicles(strayed)} landed away from {where}"


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
