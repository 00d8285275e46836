"""What the autopilot does not hold against: flown velocity less what the model makes of the setpoints, level.

Where wind pushes for a second or so, that is known to the next setpoints: they lean against it, and roll-outs reckon
with it. What is not known is how it changes until a setpoint acts: so much more room is kept.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.stopping import LAG_S

DEAD_TICKS: Final = 1  # until a setpoint begins to act
FOLLOW: Final = 0.4  # of a new residual in each tick of 50 ms: noise is smoothed, a gust of a second is not
LIMIT_MPS: Final = 2.5  # of what is leant against
AHEAD_TICKS: Final = 6  # a setpoint has acted after so long
MEMORY_S: Final = 6.0
CALM_MPS: Final = 0.15  # change in calm air: the model's error


@final
class Gusts:
    """Feed it each tick with what was flown and what was told; all (north, east), m/s, over ground."""

    __slots__ = ("_model", "_past", "_square", "_told", "level_mps")

    def __init__(self) -> None:
        self.level_mps: tuple[float, float] = (0.0, 0.0)  # what the wind adds now
        self._square = 0.0
        self.rest((0.0, 0.0))

    def rest(self, vel: tuple[float, float]) -> None:
        """Not steered: nothing was told that could be held to."""
        self._model = vel
        self._told: list[tuple[float, float]] = [vel] * DEAD_TICKS
        self._past: list[tuple[float, float]] = []
        self.level_mps = (0.0, 0.0)

    @property
    def change_mps(self) -> float:
        """By how much it changes until a setpoint acts, rms, beyond what it seems to in calm air."""
        return max(0.0, math.sqrt(self._square) - CALM_MPS)

    def feel(self, vel: tuple[float, float], told: tuple[float, float], dt_s: float, most_mps2: float) -> None:
        """`told`: the setpoint that went out last."""
        self._told.append(told)
        acts = self._told.pop(0)
        m_n, m_e = self._model
        share = 1.0 - math.exp(-dt_s / LAG_S)
        d_n, d_e = share * (acts[0] - m_n), share * (acts[1] - m_e)
        step = math.sqrt(d_n * d_n + d_e * d_e)
        if step > most_mps2 * dt_s:
            d_n, d_e = d_n * most_mps2 * dt_s / step, d_e * most_mps2 * dt_s / step
        m_n, m_e = m_n + d_n, m_e + d_e
        r_n, r_e = vel[0] - m_n, vel[1] - m_e
        if r_n - r_n != 0.0 or r_e - r_e != 0.0:
            return
        self._model = (m_n, m_e)
        g_n, g_e = self.level_mps
        g_n, g_e = g_n + FOLLOW * (r_n - g_n), g_e + FOLLOW * (r_e - g_e)
        size = math.sqrt(g_n * g_n + g_e * g_e)
        if size > LIMIT_MPS:
            g_n, g_e = g_n * LIMIT_MPS / size, g_e * LIMIT_MPS / size
        self.level_mps = (g_n, g_e)
        self._past.append((g_n, g_e))
        if len(self._past) > AHEAD_TICKS:
            p_n, p_e = self._past.pop(0)
            square = (r_n - p_n) * (r_n - p_n) + (r_e - p_e) * (r_e - p_e)
            self._square += min(1.0, dt_s / MEMORY_S) * (square - self._square)
