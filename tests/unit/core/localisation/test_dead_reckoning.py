"""How far a vehicle that has lost its GNSS fix may be off, as it tells the others."""

from __future__ import annotations

import pytest

from companion.core.localisation.dead_reckoning import (
    AHEAD_S,
    BACK_S,
    DRIFT_MPS2,
    ERROR_MAX_M,
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
