"""The end of `fly --autopilots`: companions are ended once they have said that they are down, or have had time to."""

from __future__ import annotations

import io
from typing import Any, cast

from sim_bridge.drive.external import program
from sim_bridge.judge.progress import Progress


class Landed:
    """A flight whose vehicles are down; their companions hear so at `heard_s`."""

    def __init__(self, heard_s: float) -> None:
        self.now_s, self.over, self._heard_s = 0.0, False, heard_s

    def order_land(self) -> list[int]:
        return []

    def landings_unsaid(self) -> list[int]:
        return [1] if self.now_s < self._heard_s else []

    def step(self) -> bool:
        self.now_s += 0.05
        return False

    def show(self, progress: Progress) -> None:
        pass


def end(flight: Landed) -> float:
    program._land(cast(Any, flight), Progress(io.StringIO()))
    return flight.now_s


def test_a_flight_goes_on_until_each_companion_has_said_that_its_vehicle_is_down() -> None:
    assert 0.4 <= end(Landed(0.4)) < 0.5


def test_one_that_never_says_so_is_not_waited_for_long() -> None:
    assert program.SAID_LIMIT_S <= end(Landed(1e9)) < program.SAID_LIMIT_S + 0.2
