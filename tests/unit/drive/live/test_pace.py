"""How fast a flight goes that may be watched."""

from __future__ import annotations

import math

import pytest

from sim_bridge.drive.live.pace import LAG_MAX_S, LOOK_EVERY_S, WATCHED, Pace


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def watched(asked: float | None = None) -> tuple[Pace, Clock]:
    clock = Clock()
    pace = Pace(asked, clock)
    pace.watched = True
    return pace, clock


def test_a_flight_that_nobody_looks_at_goes_as_fast_as_it_can() -> None:
    pace = Pace(None, Clock())
    assert [pace.wait_s(0.05 * tick) for tick in range(100)] == [0.0] * 100


def test_with_a_viewer_it_keeps_to_five_times_real_time() -> None:
    pace, clock = watched()
    assert pace.wait_s(7.0) == 0.0
    assert pace.wait_s(7.05) == pytest.approx(0.05 / WATCHED)
    clock.now_s += 0.05 / WATCHED
    assert pace.wait_s(7.05) == pytest.approx(0.0, abs=1e-9)


def test_what_was_asked_for_on_the_command_line_holds_whether_somebody_looks_or_not() -> None:
    pace, _ = watched(2.0)
    assert pace.factor == 2.0
    pace.watched = False
    assert pace.factor == 2.0


def test_a_wish_holds_from_its_moment_and_is_not_made_up_for_from_the_start() -> None:
    pace, clock = watched(1.0)
    pace.wait_s(0.0)
    clock.now_s += 10.0
    pace.wait_s(10.0)
    pace.want(0.5)
    assert pace.wait_s(10.0) == 0.0
    assert pace.wait_s(10.01) == pytest.approx(0.02)


def test_what_a_slow_machine_misses_is_given_up() -> None:
    pace, clock = watched(1.0)
    pace.wait_s(0.0)
    clock.now_s += LAG_MAX_S + 5.0
    assert pace.wait_s(0.0) == 0.0
    assert pace.wait_s(0.04) == pytest.approx(0.04)  # not at once, as five seconds late would be


def test_a_paused_flight_stands_still_but_for_the_steps_asked_for() -> None:
    pace, _ = watched()
    pace.pause(True)
    assert pace.wait_s(3.0) == LOOK_EVERY_S
    pace.step()
    pace.step()
    assert [pace.wait_s(3.0 + 0.05 * k) for k in range(3)] == [0.0, 0.0, LOOK_EVERY_S]
    pace.pause(False)
    assert pace.wait_s(3.1) == 0.0


def test_the_first_step_of_a_flight_that_goes_stops_it() -> None:
    pace, _ = watched()
    pace.step()
    assert pace.paused
    assert pace.wait_s(1.0) == LOOK_EVERY_S


def test_a_flight_that_was_paused_goes_on_when_its_last_viewer_is_gone() -> None:
    pace, _ = watched()
    pace.pause(True)
    pace.watched = False
    assert pace.wait_s(3.0) == 0.0


@pytest.mark.parametrize("factor", [0.0, -1.0, 0.01, 1e9, math.nan, math.inf])
def test_a_wish_that_is_no_pace_is_refused_by_its_value(factor: float) -> None:
    pace, _ = watched()
    with pytest.raises(ValueError, match=r"^speed .*: must be 0.05 to 1000$"):
        pace.want(factor)
    assert pace.factor == WATCHED
