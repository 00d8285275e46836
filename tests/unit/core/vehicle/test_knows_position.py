"""Which causes say that the own position is old."""

from __future__ import annotations

import pytest

from companion.core.vehicle.failsafe import Cause, Finding
from companion.core.vehicle.failsafe_engine import knows_position

NOT_KNOWN = {Cause.NO_POSITION, Cause.POSITION_FROZEN, Cause.TELEMETRY_LATE}


@pytest.mark.parametrize("cause", list(Cause))
def test_the_position_is_known_but_for_late_telemetry_or_none(cause: Cause) -> None:
    assert knows_position([Finding(cause)]) == (cause not in NOT_KNOWN)
    assert not knows_position([Finding(cause), *map(Finding, NOT_KNOWN)])


def test_without_a_finding_the_position_is_known() -> None:
    assert knows_position([])
