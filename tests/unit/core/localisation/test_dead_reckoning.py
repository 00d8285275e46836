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
    DeadReckoning,
)


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
    reckoning.receive_fix(71.2 + BACK_S, has_fix=True)
    reckoning.receive_fix(73.0, has_fix=False)
    assert reckoning.lasts_s(73.0) < 1.0
    assert reckoning.error_m(73.0) < 1.0
