"""Ranges that all of an epoch agree are late, where trunks tell the distance: they pull no neighbour away."""

from __future__ import annotations

import math
from dataclasses import replace
from random import Random

import pytest

from companion.core.localisation.gnss_denied.epoch_ranges import EpochRanges
from companion.core.localisation.gnss_denied.error_state import BY_TRUNKS, Errors, ErrorStateCovariance, Level
from companion.core.localisation.gnss_denied.relative_filter import RelativeFilter
from companion.core.perception.landmarks.constellation import Alignment

AT: dict[int, Level] = {2: (12.0, 1.0), 3: (2.0, -11.0), 4: (-9.0, 6.0)}
ALONE = replace(BY_TRUNKS, mean_range_m=None)  # each range is weighed by itself
DT_S = 0.05


class Hover:
    """Vehicle 1's filter, of four that hover and see the same trunks."""

    def __init__(self, errors: Errors) -> None:
        self.joint, self.now_s, self.rng = RelativeFilter(errors), 0.0, Random(3)
        self.joint.initialise(AT, 0.3)
        self.run(10.0)

    def run(self, seconds: float, *, late_m: float = 0.0, slips_m: float = 0.0, aligns: bool = True) -> list[float]:
        """How far off vehicle 2 is, at each second.

        The range to it is late, or it has gone farther off than its odometer tells.
        """
        joint, off_m = self.joint, []
        share = 1.0 + slips_m / math.hypot(*AT[2])
        true = AT | {1: (0.0, 0.0), 2: (share * AT[2][0], share * AT[2][1])}
        for tick in range(round(seconds / DT_S)):
            self.now_s += DT_S
            joint.update_odometry((0.0, 0.0), (0.0, 0.0), self.now_s)
            for k, odo in AT.items():
                joint.update_peer_odometry(k, odo, (0.0, 0.0), 0.0, self.now_s)
            for a, b in ((1, 2), (1, 3), (1, 4), (2, 3), (2, 4), (3, 4)) if tick % 2 == 0 else ():
                wrong_m = self.rng.gauss(0.0, 0.1) + (late_m if (a, b) == (1, 2) else 0.0)
                joint.update_range(None if a == 1 else a, b, math.dist(true[a], true[b]) + wrong_m, 0.0, self.now_s)
            if tick % 20 == 0:
                for k, there in AT.items() if aligns else ():
                    joint.add_alignment(
                        k, Alignment(there, true[k], 0.0, position_sd_m=0.08, turn_sd_rad=0.005, matched=9)
                    )
                found = joint.relative(2)
                assert found is not None
                off_m.append(math.dist(found.ne_m, true[2]))
            joint.advance(self.now_s)
        return off_m


@pytest.mark.parametrize("late_m", [0.4, 0.7, 1.2])
def test_a_range_that_comes_late_round_a_trunk_pulls_no_neighbour_away(late_m: float) -> None:
    assert max(Hover(BY_TRUNKS).run(20.0, late_m=late_m)) < 0.1


def test_weighed_one_by_one_such_ranges_do() -> None:
    assert Hover(ALONE).run(20.0, late_m=0.4)[-1] > 0.2


def test_early_ranges_and_those_that_agree_keep_their_weight() -> None:
    for off_m in (-0.5, 0.05):
        given, kept = (ErrorStateCovariance(BY_TRUNKS) for _ in range(2))
        ranges = EpochRanges(BY_TRUNKS)
        for joint in (given, kept):
            joint.initialise(3, 0.05)
        for _ in range(5):
            given.add_range(-1, 0, 1.0, 0.0, off_m, 100.0)
            ranges.add((-1, 0), (1.0, 0.0, off_m, 100.0), kept)
        assert not kept.fresh
        ranges.reckon_in(kept)
        assert given.correct() == kept.correct()


def test_without_trunks_a_range_counts_at_once_and_by_itself() -> None:
    given, taken = (ErrorStateCovariance(Errors()) for _ in range(2))
    for joint in (given, taken):
        joint.initialise(3, 0.05)
    given.add_range(-1, 0, 1.0, 0.0, 0.9, 100.0)
    ranges = EpochRanges(Errors())
    ranges.add((-1, 0), (1.0, 0.0, 0.9, 100.0), taken)
    assert taken.fresh
    ranges.reckon_in(taken)
    assert given.correct() == taken.correct()


@pytest.mark.parametrize("slips_m", [0.3, 0.5, 1.0, 2.0])
def test_one_that_has_gone_farther_off_than_its_odometer_tells_is_found_again(slips_m: float) -> None:
    assert max(Hover(BY_TRUNKS).run(20.0, slips_m=slips_m, aligns=False)[12:]) < 0.2
