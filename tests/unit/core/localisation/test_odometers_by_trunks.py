"""Odometers count as sure as they are: that of a vehicle that sees no trunk has the errors of its autopilot."""

from __future__ import annotations

import math
from random import Random

import pytest

from companion.core.localisation.gnss_denied.error_state import AMONG_TRUNKS, BY_TRUNKS, Errors, Level
from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.localisation.gnss_denied.relative_filter import TRUNKS_S, RelativeFilter
from companion.core.model.beacon import TrunkReport
from companion.core.perception.landmarks.solitary_trunks import SolitaryTrunks
from tests.unit.core.ranging_kit import ranging_mission

DT_S, SECONDS = 0.05, 30.0
CIRCLE_M, PERIOD_S = 0.5, 9.0
STARTS: dict[int, Level] = {0: (0.0, 0.0), 1: (8.0, 0.0), 2: (0.0, 8.0), 3: (-8.0, 0.0), 4: (-8.0, 8.0)}
RAW = {"sensor": "scan-1deg", "range_m": 12.0}
RNG_M = 0.1


class Odometer:
    """Of a vehicle that circles about its start; it errs as `errors` say, its compass does not."""

    def __init__(self, vehicle: int, errors: Errors, rng: Random) -> None:
        self._vehicle, self._errors, self._rng = vehicle, errors, rng
        self.true: Level = STARTS[vehicle]
        self._bias = [rng.gauss(0.0, errors.bias_mps) for _ in range(2)]
        self.odo, self.vel = [0.0, 0.0], [0.0, 0.0]

    def fly(self, now_s: float) -> None:
        turn = math.tau * now_s / (PERIOD_S + 0.7 * self._vehicle) + 2.0 * self._vehicle
        speed_mps = CIRCLE_M * math.tau / PERIOD_S
        true_mps = (speed_mps * math.cos(turn), speed_mps * math.sin(turn))
        keep = math.exp(-DT_S / self._errors.bias_s)
        for axis in range(2):
            fresh = self._errors.bias_mps * math.sqrt(1.0 - keep * keep)
            self._bias[axis] = keep * self._bias[axis] + self._rng.gauss(0.0, fresh)
            white = self._rng.gauss(0.0, self._errors.velocity_mps * math.sqrt(self._errors.velocity_s / DT_S))
            self.vel[axis] = true_mps[axis] + self._bias[axis]
            self.odo[axis] += (self.vel[axis] + white) * DT_S
        self.true = (self.true[0] + true_mps[0] * DT_S, self.true[1] + true_mps[1] * DT_S)


def squares_of_compasses(seed: int, *, noted: bool) -> float:
    """The mean of the squared errors of all compasses over what the filter of vehicle 0 says of them.

    Odometers err as without trunks. `noted`: they are said to be corrected by some.
    """
    rng = Random(seed)
    flown = {k: Odometer(k, Errors(), rng) for k in STARTS}
    found = RelativeFilter(AMONG_TRUNKS)
    found.initialise({k: STARTS[k] for k in STARTS if k}, 0.3)
    for tick in range(round(SECONDS / DT_S)):
        now_s = tick * DT_S
        for k, one in flown.items():
            one.fly(now_s)
            (odo_n, odo_e), (vel_n, vel_e) = one.odo, one.vel
            if k == 0:
                found.update_odometry((odo_n, odo_e), (vel_n, vel_e), now_s)
            else:
                found.update_peer_odometry(k, (odo_n, odo_e), (vel_n, vel_e), 0.0, now_s)
            if noted and tick % 20 == 0:
                found.note_trunks(k or None, now_s)
        if tick % 2 == 0:
            for a in STARTS:
                for b in range(a + 1, len(STARTS)):
                    metres = math.dist(flown[a].true, flown[b].true) + rng.gauss(0.0, RNG_M)
                    found.update_range(a or None, b, metres, 0.0, now_s)
        found.advance(now_s)
    yaws = [found._covariance.cov[found._covariance.yaw(slot)][found._covariance.yaw(slot)] for slot in range(-1, 4)]
    errors = [found.compass[0], *[found.compass_of(k) for k in found.ids]]
    return sum([error * error / var for error, var in zip(errors, yaws, strict=True)]) / len(errors)


def test_odometers_that_no_trunk_corrects_are_not_believed_as_if() -> None:
    """Compasses are right, and were taken for 4 degrees off: what odometers drift by was laid to their turn."""
    as_they_are, as_if = (sum([squares_of_compasses(k, noted=noted) for k in range(6)]) / 6 for noted in (False, True))
    assert as_they_are < 1.0
    assert as_if > 1.5


def bias_sd_mps(found: RelativeFilter, slot: int) -> float:
    joint = found._covariance
    return math.sqrt(joint.cov[joint.bias(slot)][joint.bias(slot)])


@pytest.mark.parametrize("slot", [-1, 1])
def test_the_bias_of_an_odometer_is_another_one_when_trunks_begin_and_cease_to_correct_it(slot: int) -> None:
    found = RelativeFilter(AMONG_TRUNKS)
    found.initialise({1: (8.0, 0.0), 2: (0.0, 8.0)}, 0.3)
    found.advance(0.0)
    found.advance(0.5)
    assert bias_sd_mps(found, slot) == pytest.approx(AMONG_TRUNKS.bias_mps)
    found.note_trunks(None if slot < 0 else found.ids[slot], 0.6)
    found.advance(1.0)
    assert bias_sd_mps(found, slot) == pytest.approx(BY_TRUNKS.bias_mps)
    assert bias_sd_mps(found, 0) == pytest.approx(AMONG_TRUNKS.bias_mps)
    found.advance(0.6 + TRUNKS_S + 0.5)
    assert bias_sd_mps(found, slot) == pytest.approx(AMONG_TRUNKS.bias_mps)


def test_a_vehicle_that_joins_or_leaves_takes_the_others_word_of_trunks_along() -> None:
    found = RelativeFilter(AMONG_TRUNKS)
    found.initialise({1: (8.0, 0.0), 2: (0.0, 8.0)}, 0.3)
    found.note_trunks(2, 0.0)
    found.note_trunks(None, 0.0)
    found.advance(0.0)
    found.advance(0.5)
    found.add_peer(3, (5.0, 5.0), 1.0)
    found.advance(1.0)
    assert [bias_sd_mps(found, slot) < 0.03 for slot in (0, 1, 2, -1)] == [False, True, False, True]
    found.remove_peer(1)
    found.advance(1.5)
    assert [bias_sd_mps(found, slot) < 0.03 for slot in (0, 1, -1)] == [True, False, True]


def test_own_trunks_and_those_that_a_neighbour_tells_say_whose_odometer_is_corrected() -> None:
    localiser = GnssDeniedLocaliser(ranging_mission(sensing=RAW), 1)
    found = localiser.ranging.filter
    assert found._errors == AMONG_TRUNKS
    localiser.note_trunks(SolitaryTrunks([], (0.0, 0.0), (0.0, 0.0, 0.0)), 5.0)
    localiser.receive_ranging(TrunkReport(2, 5000, (0.0, 0.0), ((1.0, 2.0, 0.3),)), 5.0)
    assert found._me.trunks_s == found._of[2].trunks_s == 5.0
    assert found._of[3].trunks_s == -math.inf


def test_without_range_radios_no_odometer_is_believed_as_corrected() -> None:
    """No range shows how well trunks correct it (docs/decisions/trunks-alone.md)."""
    localiser = GnssDeniedLocaliser(ranging_mission(sensing=RAW, ranging={"radio": False}), 1)
    localiser.note_trunks(SolitaryTrunks([], (0.0, 0.0), (0.0, 0.0, 0.0)), 5.0)
    localiser.receive_ranging(TrunkReport(2, 5000, (0.0, 0.0), ((1.0, 2.0, 0.3),)), 5.0)
    found = localiser.ranging.filter
    assert found._errors == Errors()
    assert found._me.trunks_s == found._of[2].trunks_s == -math.inf
