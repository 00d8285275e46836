"""Response model: how the vehicle answers to setpoints, and whether the way to a stop is clear. All use this one.

Level: a setpoint takes DEAD_S to act; from then on the velocity follows it with a lag of LAG_S, at most at the
acceleration limit; commanded to brake, the vehicle goes straight on and stops within
`LAG_S * speed + speed^2 / (2 braking)`, with `braking` BRAKING_SHARE of that limit. docs/explanation/trees.md says what
follows. One that shapes velocities, as ArduPilot does, takes longer and limits its jerk, as its make has
it (`VelocityShaping`): where it is by then is in `Disturbance.under_way`.

Towards limits and neighbours REACTION_S stands for dead time and lag, and is longer: 0.35 s of radio delay are in it. A
neighbour's position is propagated by its beacon's age, and taken for nearer by what it may have strayed meanwhile.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.model.states import VelocityShaping
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from mission.common.frames import Vec3

LAG_S: Final = 0.3
DEAD_S: Final = 0.1
BRAKING_SHARE: Final = 0.6  # of the acceleration limit; the rest is left for gusts
REACTION_S: Final = 0.8  # radio delay, a tick and the autopilot's lag in velocity
BEHIND_S: Final = 0.9  # behind one that may stop at once: its braking is received late, too
BACK_OFF_PER_S: Final = 1.2  # m/s for each metre beyond a limit; more would hunt where positions come 0.3 s late
BACK_OFF_MAX_MPS: Final = 1.0
STEP_S: Final = 0.05  # of the roll-out: a tick
CREEP_MPS: Final = 0.3  # where it sees nothing it goes no faster
ESCAPE_S: Final = 1.0  # over which ways out are compared when none is clear
GUST_SHARE: Final = 0.6  # of its change, by which the way to a stop is reckoned with
# More to be kept from a point for each m/s: velocities are known 0.1 m/s wrong an axis, and turns are flown late
SPEED_MARGIN_S: Final = 0.05


@final
class Disturbance:
    """The velocity that wind adds to the setpoints, as of one tick; see `disturbance.DisturbanceEstimator`."""

    __slots__ = ("change_mps", "dead_s", "under_way", "vel_ned_mps")

    def __init__(
        self,
        vel_ned_mps: Vec3 = ZERO,
        change_mps: float = 0.0,
        under_way: tuple[float, float, float, float] | None = None,
        dead_s: float = DEAD_S,
    ) -> None:
        """`under_way`: where the vehicle will be, and how much faster (north, east, m and m/s), before DEAD_S begins.

        In spite of what it is commanded now; None: here. `dead_s`: until a setpoint acts, in all.
        """
        self.vel_ned_mps: Final = vel_ned_mps
        self.change_mps: Final = change_mps  # until a setpoint acts, rms
        self.under_way: Final = under_way
        self.dead_s: Final = dead_s

    @property
    def gust_mps(self) -> float:
        """By how much a gust may push before a setpoint acts."""
        return GUST_SHARE * self.change_mps


CALM: Final = Disturbance()


@final
class ResponseModel:
    """The model, with a vehicle's limits (m/s^2)."""

    __slots__ = ("acceleration_mps2", "braking_mps2")

    def __init__(self, acceleration_mps2: float, braking_mps2: float) -> None:
        self.acceleration_mps2: Final = acceleration_mps2
        self.braking_mps2: Final = braking_mps2

    def way_m(self, speed_mps: float) -> float:
        """Metres that the vehicle goes on once it brakes."""
        return LAG_S * speed_mps + speed_mps * speed_mps / (2.0 * self.braking_mps2)

    def speed_mps(self, way_m: float, delay_s: float = 0.0) -> float:
        """From which it stops within `way_m`, commanded to after `delay_s`; at least 0."""
        if way_m <= 0.0:
            return 0.0
        early = (delay_s + LAG_S) * self.braking_mps2
        return math.sqrt(early * early + 2.0 * self.braking_mps2 * way_m) - early

    def closing_mps(self, room_m: float) -> float:
        """The speed towards a limit or a neighbour from which it still stops within `room_m`; negative: back off."""
        if room_m <= 0.0:
            return max(-BACK_OFF_MAX_MPS, BACK_OFF_PER_S * room_m)
        return _stops_from_mps(room_m, REACTION_S, self.braking_mps2)

    def stopping_m(self, speed_mps: float) -> float:
        """The way in which `closing_mps` brings it to rest before a limit."""
        return speed_mps * REACTION_S + speed_mps * speed_mps / (2.0 * self.braking_mps2)

    def behind_mps(self, room_m: float, its_mps: float) -> float:
        """Speed to fly at behind one at `its_mps` that may brake by all it has; towards one, as `closing_mps`."""
        if its_mps <= 0.0:
            return self.closing_mps(room_m) + its_mps
        room_m += its_mps * its_mps / (2.0 * self.acceleration_mps2)
        if room_m <= 0.0:
            return self.closing_mps(room_m)
        return _stops_from_mps(room_m, BEHIND_S, self.acceleration_mps2)

    def is_clear(
        self,
        cloud: LocalObstacleCloud,
        vel: tuple[float, float],
        last: tuple[float, float],
        commanded: tuple[float, float],
        hold_s: float,
        *,
        slews: bool,
        disturbance: Disturbance = CALM,
    ) -> bool:
        """The way from `vel` is clear, with `last` commanded before, `commanded` for `hold_s` from now, then to brake.

        `slews`: the setpoint goes from `last` to `commanded` at the acceleration limit, else at once. (North, east).
        """
        u_n, u_e = vel
        s_n, s_e = last
        c_n, c_e = commanded
        n = e = 0.0
        if disturbance.under_way is not None:  # nothing commanded now changes the way there
            n, e = disturbance.under_way[0], disturbance.under_way[1]
            u_n, u_e = u_n + disturbance.under_way[2], u_e + disturbance.under_way[3]
        start_n, start_e = n, e
        most_mps = self.acceleration_mps2 * STEP_S
        dead = round(DEAD_S / STEP_S)
        steps = dead + round(hold_s / STEP_S)
        half = dead if hold_s <= 2.0 * STEP_S else (steps + 1) // 2  # a longer way bends: two chords
        for k in range(steps):
            if k >= dead:
                d_n, d_e = c_n - s_n, c_e - s_e
                if slews:
                    step_mps = math.sqrt(d_n * d_n + d_e * d_e)
                    if step_mps > most_mps:
                        d_n, d_e = d_n * most_mps / step_mps, d_e * most_mps / step_mps
                s_n, s_e = s_n + d_n, s_e + d_e
            d_n, d_e = (s_n - u_n) * (STEP_S / LAG_S), (s_e - u_e) * (STEP_S / LAG_S)
            step_mps = math.sqrt(d_n * d_n + d_e * d_e)
            if step_mps > most_mps:
                d_n, d_e = d_n * most_mps / step_mps, d_e * most_mps / step_mps
            n, e = n + (u_n + 0.5 * d_n) * STEP_S, e + (u_e + 0.5 * d_e) * STEP_S
            u_n, u_e = u_n + d_n, u_e + d_e
            if k + 1 == half and half < steps:
                if not cloud.is_way_clear(start_n, start_e, n, e):
                    return False
                start_n, start_e = n, e
        if not cloud.is_way_clear(start_n, start_e, n, e):
            return False
        speed_mps = math.sqrt(u_n * u_n + u_e * u_e)
        if speed_mps < 1e-6:
            return True
        gust_mps = disturbance.gust_mps if speed_mps > CREEP_MPS else 0.0
        share = self.way_m(speed_mps + gust_mps) / speed_mps
        if speed_mps > CREEP_MPS and not cloud.is_seen(n + share * u_n, e + share * u_e):
            return False
        return cloud.is_way_clear(n, e, n + share * u_n, e + share * u_e)

    def find_nearest_m(
        self,
        cloud: LocalObstacleCloud,
        vel: tuple[float, float],
        last: tuple[float, float],
        commanded: tuple[float, float],
        disturbance: Disturbance = CALM,
    ) -> tuple[float, float]:
        """Distance from the nearest point within ESCAPE_S: the least on the way, and the one at its end; as `is_clear`.

        With `commanded` from now on.
        """
        u_n, u_e = vel
        s_n, s_e = last
        n = e = 0.0
        if disturbance.under_way is not None:
            n, e = disturbance.under_way[0], disturbance.under_way[1]
            u_n, u_e = u_n + disturbance.under_way[2], u_e + disturbance.under_way[3]
        least = last_m2 = math.inf
        most_mps = self.acceleration_mps2 * STEP_S
        dead = round(DEAD_S / STEP_S)
        for k in range(round(ESCAPE_S / STEP_S)):
            if k == dead:
                s_n, s_e = commanded
            d_n, d_e = (s_n - u_n) * (STEP_S / LAG_S), (s_e - u_e) * (STEP_S / LAG_S)
            step_mps = math.sqrt(d_n * d_n + d_e * d_e)
            if step_mps > most_mps:
                d_n, d_e = d_n * most_mps / step_mps, d_e * most_mps / step_mps
            n, e = n + (u_n + 0.5 * d_n) * STEP_S, e + (u_e + 0.5 * d_e) * STEP_S
            u_n, u_e = u_n + d_n, u_e + d_e
            last_m2 = cloud.nearest_m2(n, e)
            least = min(least, last_m2)
        return math.sqrt(least), math.sqrt(last_m2)


def follow_lagged(
    vel: tuple[float, float], commanded: tuple[float, float], dt_s: float, most_mps2: float
) -> tuple[float, float]:
    """The velocity `dt_s` on, of a vehicle that follows with LAG_S; (north, east)."""
    d_n, d_e = commanded[0] - vel[0], commanded[1] - vel[1]
    share = 1.0 - math.exp(-dt_s / LAG_S)
    d_n, d_e = share * d_n, share * d_e
    step_mps = math.sqrt(d_n * d_n + d_e * d_e)
    if step_mps > most_mps2 * dt_s:
        d_n, d_e = d_n * most_mps2 * dt_s / step_mps, d_e * most_mps2 * dt_s / step_mps
    return vel[0] + d_n, vel[1] + d_e


def follow_shaped(
    vel: tuple[float, float],
    acceleration: tuple[float, float],
    commanded: tuple[float, float],
    dt_s: float,
    most_mps2: float,
    shaping: VelocityShaping,
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Velocity and acceleration `dt_s` on, of a vehicle that limits its jerk; (north, east)."""
    jerk_mps3 = shaping.jerk_mps3
    d_n, d_e = commanded[0] - vel[0], commanded[1] - vel[1]
    rest_mps = math.sqrt(d_n * d_n + d_e * d_e)
    ask_mps2 = min(most_mps2, shaping.acceleration_mps2, rest_mps / shaping.lag_s, math.sqrt(jerk_mps3 * rest_mps))
    share = ask_mps2 / rest_mps if rest_mps > 0.0 else 0.0
    j_n, j_e = share * d_n - acceleration[0], share * d_e - acceleration[1]
    change = math.sqrt(j_n * j_n + j_e * j_e)
    if change > jerk_mps3 * dt_s:
        j_n, j_e = j_n * jerk_mps3 * dt_s / change, j_e * jerk_mps3 * dt_s / change
    a_n, a_e = acceleration[0] + j_n, acceleration[1] + j_e
    return (vel[0] + a_n * dt_s, vel[1] + a_e * dt_s), (a_n, a_e)


def _stops_from_mps(room_m: float, reaction_s: float, braking_mps2: float) -> float:
    return braking_mps2 * (math.sqrt(reaction_s * reaction_s + 2.0 * room_m / braking_mps2) - reaction_s)
