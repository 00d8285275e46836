"""Check of a lidar's mounting: a person stands before, beside and behind the vehicle, and is to be seen there.

Pure: scans in, lines for people out. Bearings are degrees clockwise from the nose, as those of the scans.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Sequence
from typing import Final

from companion.lidar.mounting import SECTOR_DEG, SECTORS

PLACES: Final = (("in front of", 0.0), ("to the right of", 90.0), ("behind", 180.0), ("to the left of", 270.0))
BASELINE_SCANS: Final = 20  # of what stands there anyway: some 2 s
STEADY_SCANS: Final = 15
STEADY_DEG: Final = 15.0
MOVED_DEG: Final = 45.0  # from the place before, to be at another one
NEARER_CM: Final = 30  # than what stands there anyway
REACH_CM: Final = 500
BODY_CM: Final = 50  # a person's depth
ALLOWED_DEG: Final = 30.0  # nobody stands to the degree


class WalkAround:
    """Feed it scans with `update` until `passed` is not None."""

    def __init__(self, max_cm: int, *, yaw_deg: float, upside_down: bool) -> None:
        """`max_cm`: more of a sector is `nothing there`. The mounting is the one that the scans were made with."""
        self.passed: bool | None = None
        self._max_cm = max_cm
        self._yaw_deg, self._upside_down = yaw_deg, upside_down
        self._baseline_cm = [math.inf] * SECTORS
        self._to_learn = BASELINE_SCANS
        self._run_deg: list[float] = []
        self._found_deg: list[float] = []

    def begin(self) -> list[str]:
        """Lines before the first scan."""
        return ["Stand clear of the vehicle, 6 m away or behind a tree: what stands about it is learned."]

    def update(self, scan_cm: Sequence[int]) -> list[str]:
        """Lines that follow from one more scan."""
        measured_cm = [cm if cm <= self._max_cm else math.inf for cm in scan_cm]
        if self._to_learn:
            self._baseline_cm = [min(pair) for pair in zip(self._baseline_cm, measured_cm, strict=True)]
            self._to_learn -= 1
            return [] if self._to_learn else [self._ask_for_place()]
        if self.passed is not None:
            return []
        person = self._find_person(measured_cm)
        if person is None:
            self._run_deg.clear()
            return []
        bearing_deg, range_cm = person
        if self._found_deg and _apart_deg(bearing_deg, self._found_deg[-1]) < MOVED_DEG:
            self._run_deg.clear()  # still on the way
            return []
        if self._run_deg and _apart_deg(bearing_deg, self._run_deg[0]) > STEADY_DEG:
            self._run_deg.clear()
        self._run_deg.append(bearing_deg)
        return self._take_place(range_cm / 100.0) if len(self._run_deg) >= STEADY_SCANS else []

    def _find_person(self, measured_cm: Sequence[float]) -> tuple[float, float] | None:
        """Bearing and range, cm, of the nearest that was not there before."""
        new_cm = [
            cm if cm < min(was_cm - NEARER_CM, REACH_CM) else math.inf
            for cm, was_cm in zip(measured_cm, self._baseline_cm, strict=True)
        ]
        range_cm = min(new_cm)
        if math.isinf(range_cm):
            return None
        return mean_deg(k * SECTOR_DEG for k, cm in enumerate(new_cm) if cm < range_cm + BODY_CM), range_cm

    def _take_place(self, range_m: float) -> list[str]:
        where, asked_deg = PLACES[len(self._found_deg)]
        bearing_deg = mean_deg(self._run_deg)
        self._run_deg.clear()
        self._found_deg.append(bearing_deg)
        is_right = _apart_deg(bearing_deg, asked_deg) <= ALLOWED_DEG
        judged = f"{where} the vehicle is right" if is_right else f"WRONG, {where} it is {asked_deg:.0f} deg"
        line = f"seen at {range_m:.1f} m, bearing {round(bearing_deg) % 360} deg: {judged}"
        if len(self._found_deg) < len(PLACES):
            return [line, self._ask_for_place()]
        verdict = self._judge()
        self.passed = verdict.startswith("PASS")
        return [line, verdict]

    def _ask_for_place(self) -> str:
        return f"Walk round, and stand still {PLACES[len(self._found_deg)][0]} the vehicle, about 2 m from it."

    def _judge(self) -> str:
        """PASS, or the mounting that would have been right."""
        asked_deg = [asked for _, asked in PLACES]
        if all(_apart_deg(*pair) <= ALLOWED_DEG for pair in zip(self._found_deg, asked_deg, strict=True)):
            return "PASS: ahead, right, behind and left are where the vehicle has them"
        turns_deg = [found - asked for found, asked in zip(self._found_deg, asked_deg, strict=True)]
        if _agree(turns_deg):
            yaw_deg = self._yaw_deg - mean_deg(turns_deg)
            return f"FAIL: it is turned; try --yaw-deg {_option_deg(yaw_deg)}{' --upside-down' * self._upside_down}"
        sums_deg = [found + asked for found, asked in zip(self._found_deg, asked_deg, strict=True)]
        if _agree(sums_deg):
            yaw_deg = mean_deg(sums_deg) - self._yaw_deg
            flag = "without --upside-down" if self._upside_down else "--upside-down"
            return f"FAIL: left and right are swapped; try {flag}, --yaw-deg {_option_deg(yaw_deg)}"
        return "FAIL: these bearings fit no mounting. Did anything else move? Check again, with nobody else about"


def mean_deg(bearings_deg: Iterable[float]) -> float:
    """Of directions, 0 to 360."""
    return math.degrees(cmath.phase(sum(cmath.rect(1.0, math.radians(deg)) for deg in bearings_deg))) % 360.0


def _apart_deg(a_deg: float, b_deg: float) -> float:
    return abs(math.remainder(a_deg - b_deg, 360.0))


def _agree(angles_deg: Sequence[float]) -> bool:
    """True for angles that are the same, as people stand."""
    mean = mean_deg(angles_deg)
    return all(_apart_deg(angle, mean) <= ALLOWED_DEG for angle in angles_deg)


def _option_deg(deg: float) -> int:
    return round(deg / 5.0) * 5 % 360
