"""Estimates what the autopilot does not hold against: flown velocity less what a model makes of the setpoints, level.

Where wind pushes for a second or so, that is known to the next setpoints: they lean against it, and roll-outs reckon
with it. What is not known is how it changes until a setpoint acts: so much more room is kept.

How long a setpoint takes to act differs (a point mass: at once; PX4's and ArduPilot's flight in JSBSim with their
telemetry: 0.25 s, after which the lag of 0.3 s fits PX4 to 0.03 m/s rms, and limited jerk ArduPilot). Of some models,
one of them by the shaping that the autopilot's make has, the one that explains the flight best counts.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.model.events import Position
from companion.core.model.states import VelocityShaping
from companion.core.safety.response_model import (
    CALM,
    DEAD_S,
    STEP_S,
    Disturbance,
    follow_lagged,
    follow_shaped,
)
from mission.common.frames import Vec3
from mission.document.model import Mission

DEAD_TICKS = (0, 1, 3, 5)  # of 50 ms, until a setpoint begins to act: one model each
FOLLOW: Final = 0.4  # of a new residual in each tick: noise is smoothed, a gust of a second is not
LIMIT_MPS: Final = 2.5  # of what is leant against
AHEAD_TICKS: Final = 6  # a setpoint has acted after so long
MEMORY_S: Final = 6.0
# Slower changes of what a model leaves are wind; those from tick to tick are noise, and would choose any model: by
# velocities told 0.2 m/s wrong a vehicle knew its dead time half of the time (docs/explanation/trees.md)
WIND_S: Final = 3.0
FOLLOWS_S: Final = 20.0  # memory of how it follows, which changes less than the wind
CALM_MPS: Final = 0.15  # change in calm air: noise, and the models' error


@final
class _Model:
    """The vehicle as one dead time, and one way to follow, make it."""

    __slots__ = (
        "commanded",
        "east_mps",
        "east_mps2",
        "mean_east_mps",
        "mean_north_mps",
        "misses2",
        "north_mps",
        "north_mps2",
        "off_east_mps",
        "off_north_mps",
        "shaping",
    )

    def __init__(self, dead_ticks: int, shaping: VelocityShaping | None = None) -> None:
        self.commanded: list[tuple[float, float]] = [(0.0, 0.0)] * dead_ticks  # under way
        self.shaping: Final = shaping
        self.north_mps = self.east_mps = self.north_mps2 = self.east_mps2 = 0.0
        self.off_north_mps = self.off_east_mps = 0.0  # of the flown velocity from it
        self.mean_north_mps = self.mean_east_mps = 0.0  # of that, over WIND_S
        self.misses2 = 0.0  # how far it is from its mean, squared, lately

    def begin(self, vel: tuple[float, float]) -> None:
        """From that velocity, commanded to brake."""
        self.commanded = [(0.0, 0.0)] * len(self.commanded)
        self.north_mps, self.east_mps = vel
        self.north_mps2 = self.east_mps2 = 0.0
        self.off_north_mps = self.off_east_mps = 0.0
        self.mean_north_mps = self.mean_east_mps = 0.0


@final
class DisturbanceEstimator:
    """Feed it each tick with what was flown and what was commanded; all (north, east), m/s, over ground."""

    __slots__ = ("_begins", "_best", "_models", "_past", "_shaping", "_square", "level_mps")

    def __init__(self) -> None:
        self.level_mps: tuple[float, float] = (0.0, 0.0)  # what the wind adds now
        self._square = 0.0
        self._past: list[tuple[float, float]] = []
        self._models = [_Model(dead_ticks) for dead_ticks in DEAD_TICKS]
        self._shaping: VelocityShaping | None = None
        self._best = self._models[0]
        self._begins = True  # with what is felt next

    @property
    def change_mps(self) -> float:
        """By how much it changes until a setpoint acts, rms, beyond what it seems to in calm air."""
        return max(0.0, math.sqrt(self._square) - CALM_MPS)

    def adopt_shaping(self, shaping: VelocityShaping | None) -> None:
        """The autopilot's make shapes velocities so; None: not at all, or the make is not known yet."""
        if shaping is self._shaping:
            return
        self._shaping = shaping
        self._models = [model for model in self._models if model.shaping is None]
        if shaping is not None:
            shaped = _Model(round(shaping.dead_s / STEP_S), shaping)
            shaped.misses2 = min(model.misses2 for model in self._models)  # it has shown nothing yet
            self._models.append(shaped)
        self._best = self._models[0]
        self._begins = True

    @property
    def dead_s(self) -> float:
        """Until a setpoint acts."""
        shaping = self._best.shaping
        return DEAD_S if shaping is None else shaping.dead_s + DEAD_S

    def reset(self) -> None:
        """Not steered: what was commanded does not count. How the vehicle follows is kept."""
        self.level_mps = (0.0, 0.0)
        self._past.clear()
        self._begins = True

    def estimate_disturbance(
        self, vel: tuple[float, float], commanded: tuple[float, float], dt_s: float, most_mps2: float
    ) -> None:
        """`commanded`: the setpoint that went out last."""
        if vel[0] - vel[0] != 0.0 or vel[1] - vel[1] != 0.0:  # no number
            return
        if self._begins:  # it may fly already: that is no wind
            self._begins = False
            for model in self._models:
                model.begin(vel)
            return
        best = self._models[0]
        for model in self._models:
            self._run(model, vel, commanded, dt_s, most_mps2)
            if model.misses2 < best.misses2:
                best = model
        self._best = best
        r_n, r_e = best.off_north_mps, best.off_east_mps
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

    def _run(
        self, model: _Model, vel: tuple[float, float], commanded: tuple[float, float], dt_s: float, most_mps2: float
    ) -> None:
        model.commanded.append(commanded)
        _predict_response(model, model.commanded.pop(0), dt_s, most_mps2)
        r_n, r_e = vel[0] - model.north_mps, vel[1] - model.east_mps
        model.off_north_mps, model.off_east_mps = r_n, r_e
        share = min(1.0, dt_s / WIND_S)
        model.mean_north_mps += share * (r_n - model.mean_north_mps)
        model.mean_east_mps += share * (r_e - model.mean_east_mps)
        d_n, d_e = r_n - model.mean_north_mps, r_e - model.mean_east_mps
        model.misses2 += min(1.0, dt_s / FOLLOWS_S) * (d_n * d_n + d_e * d_e - model.misses2)

    def under_way(self, dt_s: float, most_mps2: float) -> tuple[float, float, float, float] | None:
        """Predicts where the vehicle will be, and how much faster, when no more than DEAD_S is left to a setpoint.

        North and east from here (m), and of the change of velocity (m/s). None: no setpoint takes longer. One that
        shapes velocities is late by DEAD_S more: its model is the worse one.
        """
        best = self._best
        sent = best.commanded
        late = sent if best.shaping is not None else sent[: max(0, len(sent) - round(DEAD_S / STEP_S))]
        if not late:
            return None
        ahead = _Model(0, best.shaping)
        ahead.north_mps, ahead.east_mps = best.north_mps, best.east_mps
        ahead.north_mps2, ahead.east_mps2 = best.north_mps2, best.east_mps2
        off_n, off_e = best.off_north_mps, best.off_east_mps
        n = e = 0.0
        for acts in late:
            _predict_response(ahead, acts, dt_s, most_mps2)
            n, e = n + (ahead.north_mps + off_n) * dt_s, e + (ahead.east_mps + off_e) * dt_s
        return n, e, ahead.north_mps - best.north_mps, ahead.east_mps - best.east_mps


def _predict_response(model: _Model, acts: tuple[float, float], dt_s: float, most_mps2: float) -> None:
    """One tick of following `acts`."""
    vel = (model.north_mps, model.east_mps)
    if model.shaping is not None:
        acceleration = (model.north_mps2, model.east_mps2)
        vel, acceleration = follow_shaped(vel, acceleration, acts, dt_s, most_mps2, model.shaping)
        model.north_mps2, model.east_mps2 = acceleration
    else:
        vel = follow_lagged(vel, acts, dt_s, most_mps2)
    model.north_mps, model.east_mps = vel


class DisturbanceObserver:
    """Base, and the make without an obstacle sensor: no way to a stop is verified, and none leans against the wind."""

    def observe_disturbance(
        self,
        own: Position,  # noqa: ARG002
        commanded_ned_mps: Vec3,  # noqa: ARG002
        dt_s: float,  # noqa: ARG002
        shaping: VelocityShaping | None,  # noqa: ARG002
    ) -> Disturbance:
        """As of this tick. `commanded_ned_mps`: the last setpoint, with the bias of the own velocity added.

        `shaping`: of the autopilot's make, see `DisturbanceEstimator.adopt_shaping`.
        """
        return CALM

    def reset(self) -> None:
        """Not steered."""


@final
class WindObserver(DisturbanceObserver):
    """With an obstacle sensor: by the estimator above."""

    def __init__(self, acceleration_mps2: float) -> None:
        self._estimator: Final = DisturbanceEstimator()
        self._most_mps2: Final = acceleration_mps2

    def observe_disturbance(
        self, own: Position, commanded_ned_mps: Vec3, dt_s: float, shaping: VelocityShaping | None
    ) -> Disturbance:
        """As the estimator has it."""
        self._estimator.adopt_shaping(shaping)
        estimator, vel = self._estimator, own.vel_ned_mps
        commanded = (commanded_ned_mps[0], commanded_ned_mps[1])
        estimator.estimate_disturbance((vel[0], vel[1]), commanded, dt_s, self._most_mps2)
        north_mps, east_mps = estimator.level_mps
        under_way = estimator.under_way(STEP_S, self._most_mps2)
        return Disturbance((north_mps, east_mps, 0.0), estimator.change_mps, under_way, estimator.dead_s)

    def reset(self) -> None:
        """Forgets the push, and keeps how the vehicle follows."""
        self._estimator.reset()


def build_disturbance_observer(mission: Mission) -> DisturbanceObserver:
    """The make that a mission's vehicles have."""
    return DisturbanceObserver() if mission.sensing is None else WindObserver(mission.limits.acceleration_max_mps2)
