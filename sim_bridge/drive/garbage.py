"""Rarer garbage collection while a flight is flown."""

from __future__ import annotations

import gc
from collections.abc import Callable

TRACKED_NEW = 50_000  # objects between two searches; Python's own is 700


def collect_less() -> Callable[[], None]:
    """From now on the collector looks for cycles less often, and not in what is there already; returns the way back.

    A tick makes thousands of small values, and hardly a cycle.
    """
    before = gc.get_threshold()
    gc.freeze()
    gc.set_threshold(TRACKED_NEW, *before[1:])

    def as_before() -> None:
        gc.set_threshold(*before)
        gc.unfreeze()

    return as_before
