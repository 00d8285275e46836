"""An airframe without flight dynamics, for studies and for tests of control laws."""

from __future__ import annotations

import math
from typing import Final

from mission.common.frames import Vec3
from mission.document.model import Drag, Mission
from sim_bridge.world.airframe.base import AirframeFactory
from sim_bridge.world.airframe.drag import SIH_DOWN_I, SIH_DOWN_P, SIH_DRAG_PER_S, SIH_LEVEL_I, SIH_LEVEL_P
from sim_bridge.world.airframe.state import AirframeState

GRAVITY_MPS2: Final = 9.80665
YAW_RATE_MAX_RADPS: Final = 1.0  # as the quad's
IDLE_THROTTLE: Final = 0.1  # as the quad's
HOVER_THROTTLE: Final = 0.41  # as the quad's
SHORTFALL_STEP_S: Final = 0.01  # of integrating it: short against 0.2 s, its fastest part
STILL: Vec3 = (0.0, 0.0, 0.0)


class PointMass:
    """An Airframe whose velocity follows the command with a first-order lag, under a limit of acceleration.

    It stays level, in still air; any positive `dt_s` is a whole number of its steps. With Drag.SIH
    the velocity falls behind that by what PX4's gains leave of the drag of its simulator.
    """

    __slots__ = (
        "_accel_max_mps2",
        "_armed",
        "_cmd_ned_mps",
        "_cmd_yaw_rad",
        "_ground_down_m",
        "_lag_s",
        "_shortfall",
        "_state",
    )

    def __init__(
        self,
        pos_ned_m: Vec3,
        yaw_rad: float,
        *,
        lag_s: float = 0.3,
        accel_max_mps2: float = 3.0,
        drag: Drag = Drag.LOW,
        ground_down_m: float = 0.0,
    ) -> None:
        """Stand or hang at `pos_ned_m`, disarmed and at rest. ValueError for a place under the ground."""
        if pos_ned_m[2] > ground_down_m:
            raise ValueError(f"pos_ned_m = {pos_ned_m}: down must be <= {ground_down_m:g}")
        if lag_s <= 0.0 or accel_max_mps2 <= 0.0:
            raise ValueError(f"lag_s = {lag_s}, accel_max_mps2 = {accel_max_mps2}: must be > 0")
        self._lag_s = lag_s
        self._accel_max_mps2 = accel_max_mps2
        self._shortfall = _Shortfall() if drag is Drag.SIH else None
        self._armed = False
        self._ground_down_m = ground_down_m
        self._cmd_ned_mps: Vec3 = (0.0, 0.0, 0.0)
        self._cmd_yaw_rad = yaw_rad
        self._state = AirframeState(
            pos_ned_m=pos_ned_m,
            vel_ned_mps=(0.0, 0.0, 0.0),
            attitude_rad=(0.0, 0.0, math.remainder(yaw_rad, math.tau)),
            rates_radps=(0.0, 0.0, 0.0),
            on_ground=pos_ned_m[2] == ground_down_m,
            throttle=0.0,
        )

    @property
    def state(self) -> AirframeState:
        """Ground truth after the last step."""
        return self._state

    def set_armed(self, armed: bool) -> None:
        """Start or stop the rotors. Stopped, the body falls freely."""
        self._armed = armed

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        """Sets what to follow: velocity (NED m/s), heading (rad). ValueError unless all are finite."""
        if not all(map(math.isfinite, (*vel_ned_mps, yaw_rad))):
            raise ValueError(f"vel_ned_mps = {vel_ned_mps}, yaw_rad = {yaw_rad}: must be finite")
        self._cmd_ned_mps = vel_ned_mps
        self._cmd_yaw_rad = yaw_rad

    def set_wind(self, mean_ned_mps: Vec3) -> None:
        """It flies in still air: `World.still_air` tells, and a fault of wind strikes none."""

    def set_ground(self, down_m: float) -> None:
        """Sets how far below the origin the ground lies."""
        self._ground_down_m = down_m

    def step(self, dt_s: float) -> None:
        """Advance by `dt_s` > 0."""
        if not dt_s > 0.0:
            raise ValueError(f"dt_s = {dt_s}: must be > 0")
        before = self._state
        standing = before.on_ground and not (self._armed and self._cmd_ned_mps[2] < 0.0)
        flying = self._armed and not standing
        if standing:
            vel_ned_mps = STILL
        elif self._shortfall and self._armed:
            dragless = self._next_velocity(_sum(before.vel_ned_mps, self._shortfall.vel_ned_mps), dt_s)
            vel_ned_mps = _sum(dragless, self._shortfall.step(dragless, dt_s), sign=-1.0)
        else:
            vel_ned_mps = self._next_velocity(before.vel_ned_mps, dt_s)
        pos_ned_m = _advance(before.pos_ned_m, before.vel_ned_mps, vel_ned_mps, dt_s)
        if landed := standing or pos_ned_m[2] >= self._ground_down_m:
            pos_ned_m = (pos_ned_m[0], pos_ned_m[1], self._ground_down_m)
            vel_ned_mps = STILL
        if self._shortfall and not (flying and not landed):
            self._shortfall = _Shortfall()
        yaw_rad = before.attitude_rad[2]
        yaw_rate_radps = self._yaw_rate(yaw_rad, dt_s) if flying else 0.0
        self._state = AirframeState(
            pos_ned_m=pos_ned_m,
            vel_ned_mps=vel_ned_mps,
            attitude_rad=(0.0, 0.0, math.remainder(yaw_rad + yaw_rate_radps * dt_s, math.tau)),
            rates_radps=(0.0, 0.0, yaw_rate_radps),
            on_ground=landed,
            throttle=HOVER_THROTTLE if flying else IDLE_THROTTLE if self._armed else 0.0,
        )

    def _next_velocity(self, vel_ned_mps: Vec3, dt_s: float) -> Vec3:
        """The lag is solved exactly, so that a long step does not overshoot."""
        north, east, down = vel_ned_mps
        if not self._armed:
            return (north, east, down + GRAVITY_MPS2 * dt_s)
        to_north = self._cmd_ned_mps[0] - north
        to_east = self._cmd_ned_mps[1] - east
        to_down = self._cmd_ned_mps[2] - down
        fraction = -math.expm1(-dt_s / self._lag_s)
        change_mps = fraction * math.hypot(to_north, to_east, to_down)
        change_max_mps = self._accel_max_mps2 * dt_s
        if change_mps > change_max_mps:
            fraction *= change_max_mps / change_mps
        return (north + fraction * to_north, east + fraction * to_east, down + fraction * to_down)

    def _yaw_rate(self, yaw_rad: float, dt_s: float) -> float:
        """The short way round, at most YAW_RATE_MAX_RADPS."""
        rate_radps = math.remainder(self._cmd_yaw_rad - yaw_rad, math.tau) / dt_s
        return max(-YAW_RATE_MAX_RADPS, min(YAW_RATE_MAX_RADPS, rate_radps))


def point_mass_airframes(mission: Mission) -> AirframeFactory:
    """Point masses with the mission's drag, in still air."""
    drag = mission.sim.drag
    return lambda _frame, pos_ned_m, _seed: PointMass(pos_ned_m, 0.0, drag=drag, ground_down_m=pos_ned_m[2])


class _Shortfall:
    """By how much the velocity is short of what it would be without drag, NED m/s.

    The drag pulls it down, the gains pull it back: e' = -(p + drag) e - i integral(e) + drag v, for each axis.
    """

    __slots__ = ("_integral", "vel_ned_mps")

    def __init__(self) -> None:
        self.vel_ned_mps = STILL
        self._integral = STILL

    def step(self, dragless_ned_mps: Vec3, dt_s: float) -> Vec3:
        """After `dt_s` of wanting `dragless_ned_mps`."""
        steps = math.ceil(dt_s / SHORTFALL_STEP_S - 1e-9)
        level, down = (SIH_LEVEL_P, SIH_LEVEL_I), (SIH_DOWN_P, SIH_DOWN_I)
        axes = []
        for short, integral, vel, (p, i) in zip(
            self.vel_ned_mps, self._integral, dragless_ned_mps, (level, level, down), strict=True
        ):
            for _ in range(steps):
                short += (SIH_DRAG_PER_S * (vel - short) - p * short - i * integral) * dt_s / steps
                integral += short * dt_s / steps
            axes.append((short, integral))
        north, east, down_axis = axes
        self.vel_ned_mps = (north[0], east[0], down_axis[0])
        self._integral = (north[1], east[1], down_axis[1])
        return self.vel_ned_mps


def _sum(a: Vec3, b: Vec3, *, sign: float = 1.0) -> Vec3:
    return (a[0] + sign * b[0], a[1] + sign * b[1], a[2] + sign * b[2])


def _advance(pos_ned_m: Vec3, from_ned_mps: Vec3, to_ned_mps: Vec3, dt_s: float) -> Vec3:
    """Trapezoid rule."""
    return (
        pos_ned_m[0] + 0.5 * (from_ned_mps[0] + to_ned_mps[0]) * dt_s,
        pos_ned_m[1] + 0.5 * (from_ned_mps[1] + to_ned_mps[1]) * dt_s,
        pos_ned_m[2] + 0.5 * (from_ned_mps[2] + to_ned_mps[2]) * dt_s,
    )
