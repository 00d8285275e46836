"""The collector's settings during a flight, and after it."""

from __future__ import annotations

import gc

from sim_bridge.drive.garbage import TRACKED_NEW, collect_less


def test_collector_looks_less_often_until_the_flight_is_over() -> None:
    before = gc.get_threshold()
    as_before = collect_less()
    try:
        assert gc.get_threshold() == (TRACKED_NEW, *before[1:])
        assert gc.get_freeze_count() > 0
    finally:
        as_before()
    assert gc.get_threshold() == before
    assert gc.get_freeze_count() == 0
