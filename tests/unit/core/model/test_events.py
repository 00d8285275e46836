"""Events: what they tell by themselves."""

from __future__ import annotations

import pytest

from companion.core.model.events import Position


def test_time_between_readings_is_the_autopilots_where_both_tell_one_that_may_be() -> None:
    def at(boot_s: float | None) -> Position:
        return Position((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), boot_s)

    assert at(10.4).since_s(at(10.1), 0.0) == pytest.approx(0.3)
    assert at(10.4).since_s(at(None), 0.2) == 0.2
    assert at(None).since_s(at(10.1), 0.2) == 0.2
    assert at(5.0).since_s(at(900.0), 0.2) == 0.2  # it began anew, or its time went round
    assert at(900.0).since_s(at(5.0), 0.2) == 0.2
    assert at(None).since_s(at(None), -1.0) == 0.0
