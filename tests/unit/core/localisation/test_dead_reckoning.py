"""How far a vehicle that has lost its GNSS fix may be off, as it tells the others."""

from __future__ import annotations

import pytest

from companion.core.localisation.dead_reckoning import (
    AHEAD_S,
    BACK_S,
    DRIFT_MPS2,
    ERROR_MAX_M,
    FLIES_ON_M,
    ODOMETRY_AGREES_MPS,
    ODOMETRY_FRESH_S,
    RECKONS_S,
    RESETS_S,
    SILENT_S,
    DeadReckoning,
)
from companion.core.model.events import Position


def lost_at(lost_s: float) -> DeadReckoning:
    reckoning = DeadReckoning()
    reckoning.receive_fix(lost_s, has_fix=True)
    reckoning.receive_fix(lost_s + 0.2, has_fix=False)
    return reckoning


def test_with_a_fix_nothing_is_off() -> None:
    reckoning = DeadReckoning()
    assert (reckoning.lasts_s(5.0), reckoning.error_m(5.0)) == (0.0, 0.0)
    reckoning.receive_fix(5.0, has_fix=True)
    assert (reckoning.lasts_s(9.0), reckoning.error_m(9.0)) == (0.0, 0.0)


def test_a_receiver_that_never_had_a_fix_has_not_lost_one() -> None:
    """By motion capture, or any position that is no receiver's."""
    reckoning = DeadReckoning()
    reckoning.receive_fix(1.0, has_fix=False)
    assert (reckoning.lasts_s(9.0), reckoning.error_m(9.0)) == (0.0, 0.0)


def test_the_error_counts_from_the_last_fix_and_grows_ahead_of_now() -> None:
    reckoning = lost_at(10.0)
    assert reckoning.lasts_s(10.3) == pytest.approx(0.3)
    assert reckoning.lasts_s(12.0) == pytest.approx(2.0)
    assert reckoning.error_m(12.0) == pytest.approx(0.5 * DRIFT_MPS2 * (2.0 + AHEAD_S) ** 2)


def test_once_the_position_is_given_up_the_drift_goes_on_as_fast_up_to_a_bound() -> None:
    reckoning = lost_at(10.0)
    at_s = 10.0 + RECKONS_S - AHEAD_S
    assert reckoning.error_m(at_s) == pytest.approx(0.5 * DRIFT_MPS2 * RECKONS_S**2)
    assert reckoning.error_m(at_s + 2.0) - reckoning.error_m(at_s) == pytest.approx(2.0 * DRIFT_MPS2 * RECKONS_S)
    assert reckoning.error_m(at_s + 1e4) == ERROR_MAX_M


def test_fixes_must_come_for_a_while_before_it_goes_by_them() -> None:
    reckoning = lost_at(10.0)
    reckoning.receive_fix(12.0, has_fix=False)
    for k in range(5):
        reckoning.receive_fix(12.2 + 0.1 * k, has_fix=True)
        assert reckoning.error_m(12.2 + 0.1 * k) > 0.0
    reckoning.receive_fix(12.8, has_fix=False)  # flickers
    reckoning.receive_fix(13.1, has_fix=True)
    assert reckoning.lasts_s(13.1) == pytest.approx(3.1)
    reckoning.receive_fix(12.8 + BACK_S, has_fix=True)
    assert reckoning.error_m(13.9) == 0.0


def test_by_trunks_it_flies_on_and_drifts_little() -> None:
    reckoning = lost_at(10.0)
    for k in range(100):
        reckoning.note_odometry(10.2 + 0.1 * k, off_mps=0.3)
        assert reckoning.lasts_s(10.2 + 0.1 * k) == 0.0
    assert 0.3 < reckoning.error_m(20.2) < 1.0
    assert lost_at(10.0).error_m(20.2) > 5.0


def test_by_trunks_it_holds_once_it_may_have_drifted_too_far() -> None:
    reckoning = lost_at(10.0)
    for k in range(600):
        reckoning.note_odometry(10.2 + 0.1 * k, off_mps=0.3)
    assert reckoning.lasts_s(70.2) == pytest.approx(60.2)
    assert FLIES_ON_M < reckoning.error_m(70.2) < 5.0


def test_trunks_out_of_sight_carry_nothing() -> None:
    reckoning = lost_at(10.0)
    for k in range(20):
        reckoning.note_odometry(10.2 + 0.1 * k, off_mps=0.3)
    gone_s = 12.1 + ODOMETRY_FRESH_S + 0.1
    assert reckoning.lasts_s(gone_s) == pytest.approx(gone_s - 10.0)
    assert reckoning.error_m(17.1) > reckoning.error_m(12.1) + 0.5 * DRIFT_MPS2 * 4.0**2


def test_an_autopilot_that_does_not_take_what_it_is_told_is_not_believed_to() -> None:
    """Its velocity goes away from what is seen: preflight was waived, or the trunks are none."""
    reckoning, alone = lost_at(10.0), lost_at(10.0)
    for k in range(40):
        reckoning.note_odometry(10.2 + 0.1 * k, off_mps=ODOMETRY_AGREES_MPS + 0.1)
    assert reckoning.lasts_s(14.2) == alone.lasts_s(14.2)
    assert reckoning.error_m(14.2) == alone.error_m(14.2)


def test_what_had_drifted_is_forgotten_with_the_next_fixes() -> None:
    reckoning = lost_at(10.0)
    for k in range(600):
        reckoning.note_odometry(10.2 + 0.1 * k, off_mps=0.3)
    reckoning.receive_fix(71.0, has_fix=False)
    reckoning.receive_fix(71.2 + RESETS_S, has_fix=True)
    reckoning.receive_fix(82.0, has_fix=False)
    assert reckoning.lasts_s(82.0) < 1.0
    assert reckoning.error_m(82.0) < 1.0


def hear_fixes(reckoning: DeadReckoning, from_s: float, until_s: float, *, is_used: bool = True) -> None:
    for k in range(round((until_s - from_s) / 0.2) + 1):
        reckoning.receive_fix(from_s + 0.2 * k, has_fix=True, is_used=is_used)


def fly_east(reckoning: DeadReckoning, from_s: float, until_s: float, off_m: float = 0.0) -> None:
    for k in range(round((until_s - from_s) / 0.05)):
        now_s = from_s + 0.05 * k
        reckoning.note_position(Position((off_m, 2.0 * now_s, -5.0), (0.0, 2.0, 0.0), now_s), now_s)


def test_after_long_it_counts_as_lost_until_the_estimator_has_reset_to_its_fixes() -> None:
    reckoning = lost_at(10.0)
    reckoning.receive_fix(18.0, has_fix=False)
    fly_east(reckoning, 17.0, 23.0)
    hear_fixes(reckoning, 18.2, 23.0)
    assert reckoning.is_lost
    assert reckoning.error_m(23.0) > 10.0
    fly_east(reckoning, 23.0, 23.1, off_m=7.0)
    hear_fixes(reckoning, 23.2, 23.2)
    assert not reckoning.is_lost
    assert reckoning.error_m(23.2) == 0.0


def test_a_jump_before_the_fix_has_come_is_no_reset_to_it() -> None:
    reckoning = lost_at(10.0)
    fly_east(reckoning, 17.0, 17.5)
    fly_east(reckoning, 17.5, 18.0, off_m=3.0)
    reckoning.receive_fix(18.0, has_fix=False)
    fly_east(reckoning, 18.0, 20.0, off_m=3.0)
    hear_fixes(reckoning, 18.2, 20.0)
    assert reckoning.is_lost


def test_without_a_jump_fixes_that_have_come_for_long_are_gone_by() -> None:
    """The estimator was pulled to them, or had not drifted."""
    reckoning = lost_at(10.0)
    reckoning.receive_fix(18.0, has_fix=False)
    hear_fixes(reckoning, 18.2, 18.0 + RESETS_S - 0.2)
    assert reckoning.is_lost
    hear_fixes(reckoning, 18.0 + RESETS_S, 18.2 + RESETS_S)
    assert not reckoning.is_lost


def test_fixes_that_the_estimator_does_not_use_are_no_return() -> None:
    reckoning = lost_at(10.0)
    hear_fixes(reckoning, 11.0, 40.0, is_used=False)
    assert reckoning.is_lost
    hear_fixes(reckoning, 40.2, 40.2 + RESETS_S)
    assert not reckoning.is_lost


def test_an_estimator_that_never_went_by_its_fixes_stays_lost_no_longer_than_they_are() -> None:
    """By flow, say: it tells the same before and after."""
    reckoning = DeadReckoning()
    reckoning.receive_fix(10.0, has_fix=True, is_used=False)
    reckoning.receive_fix(10.2, has_fix=False, is_used=False)
    hear_fixes(reckoning, 10.4, 12.0, is_used=False)
    assert not reckoning.is_lost


def test_a_receiver_that_is_not_heard_any_more_has_no_fix() -> None:
    reckoning = DeadReckoning()
    reckoning.note_silence(50.0)
    assert not reckoning.is_lost  # it never told of one
    hear_fixes(reckoning, 50.0, 51.0)
    reckoning.note_silence(51.0 + SILENT_S)
    assert not reckoning.is_lost
    reckoning.note_silence(51.1 + SILENT_S)
    assert reckoning.lasts_s(51.1 + SILENT_S) > SILENT_S
    assert reckoning.error_m(51.1 + SILENT_S) > 3.0


def test_what_is_not_heard_while_the_companion_stalls_is_no_silence() -> None:
    reckoning = DeadReckoning()
    hear_fixes(reckoning, 50.0, 51.0)
    reckoning.handle_stall(70.0)
    reckoning.note_silence(70.0)
    reckoning.note_silence(70.0 + SILENT_S)
    assert not reckoning.is_lost
