"""The clock of the hosts that the sensors' drivers run on: simulated time -> the wall time at which it was."""

from __future__ import annotations

from collections import deque
from typing import Final

REMEMBERED_S: Final = 4.0  # simulated: scans come 2 s late at most (sim.lidar.delay_s, and a fault's)


class DriversClock:
    """Drivers stamp by their own host's clock, which goes on when the world falls behind it.

    Stamps in simulated time would stay behind a companion's clock by all that was given up, and a scan that comes
    later by its stamps counts as old. The clock begins at the simulated time of the first step.
    """

    def __init__(self, step_s: float) -> None:
        """`step_s`: simulated, between two steps."""
        self._step_s = step_s
        self._sim_s = 0.0  # of the last step
        self._wall_s: deque[float] = deque(maxlen=round(REMEMBERED_S / step_s) + 1)  # of the last steps
        self._ahead_s = 0.0  # simulated less wall time, of the first step

    def note_step(self, sim_s: float, wall_s: float) -> None:
        """The world is at `sim_s` now, a step later than at the call before."""
        if not self._wall_s:
            self._ahead_s = sim_s - wall_s
        self._sim_s = sim_s
        self._wall_s.append(wall_s + self._ahead_s)

    def stamp_s(self, sim_s: float) -> float:
        """The drivers' time at which the world was at `sim_s`, which is not after the last step. It never goes back."""
        ago = max(0.0, (self._sim_s - sim_s) / self._step_s)
        steps = int(ago)
        last = len(self._wall_s) - 1
        if steps >= last:  # before what is remembered the world was in time
            return self._wall_s[0] - (ago - last) * self._step_s
        after_s, before_s = self._wall_s[last - steps], self._wall_s[last - steps - 1]
        return after_s - (ago - steps) * (after_s - before_s)
