"""How fast a vehicle follows a velocity, on JSBSim, held to the steps of the real autopilots.

The table is the reference's: of PX4 with low drag, and of ArduCopter. PX4's overshoot there is its noise.
"""

from __future__ import annotations

import math
import statistics
from itertools import pairwise

import pytest

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame, Vec3, Wgs84
from mission.document.model import Personality
from sim_bridge.world.airframe.jsbsim_quad import JsbsimQuad
from sim_bridge.world.autopilot import Link, StreamProfile, make_autopilot
from sim_bridge.world.autopilot.estimates.errors import EXACT, RECORDED_2026_11, Errors
from sim_bridge.world.autopilot.estimates.estimator import estimated

STEP_S = 0.05
ORIGIN = Wgs84(47.3977, 8.5456, 488.0)
REST, DIAGONAL, NORTH = (0.0, 0.0, 0.0), (0.4, 0.4, -0.4), (3.0, 0.0, 0.0)
OWN_TOLERANCE = 0.15  # of ArduCopter's own times: one flight
SPREAD_TOLERANCE = 0.10  # beyond the two autopilots' spread
TICK_S = 0.05  # setpoints come at 20 Hz: no time is known better
OVERSHOOT_MAX = 0.05
STEPS: list[tuple[Vec3, Vec3, tuple[float, float, float], tuple[float, float, float]]] = [
    (REST, DIAGONAL, (0.24, 0.56, 0.88), (0.22, 0.70, 1.34)),
    (DIAGONAL, REST, (0.28, 0.64, 0.96), (0.07, 0.46, 0.86)),
    (REST, NORTH, (0.50, 1.12, 1.70), (0.27, 0.72, 1.40)),
    (NORTH, REST, (0.50, 1.12, 1.66), (0.27, 0.70, 1.33)),
]


class Hover:
    """A vehicle under way, which follows velocities."""

    def __init__(self, personality: Personality, *, errors: Errors = EXACT, seed: int = 1) -> None:
        self.body = estimated(JsbsimQuad(LocalFrame(ORIGIN), (0.0, 0.0, 0.0), 0.0), errors, seed, 1)
        self.autopilot = make_autopilot(
            personality, 1, self.body, LocalFrame(ORIGIN), links={Link.ONBOARD: StreamProfile.MINIMAL}
        )
        self.codec = mav.MAVLink(None, srcSystem=1, srcComponent=191)
        self.steps = 0
        match personality:
            case Personality.PX4:
                self._take_off_px4()
            case Personality.ARDUPILOT:
                self._take_off_ardupilot()

    def _take_off_px4(self) -> None:
        self.fly(5.0)
        self.command(22, *[math.nan] * 6, ORIGIN.alt_m + 5.0)
        self.command(400, 1.0)
        self.fly(13.0)
        self.fly(0.5, REST)
        self.command(176, 1.0, 6.0)

    def _take_off_ardupilot(self) -> None:
        self.fly(42.0)
        self.command(176, 1.0, 4.0)
        self.command(400, 1.0)
        self.command(22, *[0.0] * 6, 5.0)
        self.fly(13.0)

    def send(self, message: mav.MAVLink_message) -> None:
        self.autopilot.receive(Link.ONBOARD, message.pack(self.codec), self.steps * STEP_S)

    def command(self, number: int, *params: float) -> None:
        self.send(mav.MAVLink_command_long_message(1, 1, number, 0, *params, *[0.0] * (7 - len(params))))

    def fly(self, seconds: float, velocity: Vec3 | None = None) -> list[Vec3]:
        """The velocity after each step."""
        seen = []
        for _ in range(round(seconds / STEP_S)):
            if velocity is not None:
                self.send(
                    mav.MAVLink_set_position_target_local_ned_message(
                        0, 1, 1, 1, 0x5C7, 0, 0, 0, *velocity, 0, 0, 0, 0, 0
                    )
                )
            self.autopilot.update(self.steps * STEP_S)
            self.body.step(STEP_S)
            self.steps += 1
            seen.append(self.body.state.vel_ned_mps)
        return seen

    def step(self, before: Vec3, after: Vec3) -> list[float]:
        """The share of the change that is made, at each step from the setpoint on."""
        self.fly(6.0, before)
        change = [b - a for a, b in zip(before, after, strict=True)]
        size2 = sum(c * c for c in change)
        return [
            sum((v - a) * c for v, a, c in zip(now, before, change, strict=True)) / size2
            for now in self.fly(6.0, after)
        ]


def time_to_s(shares: list[float], share: float) -> float:
    """When it is reached, between the samples."""
    for count, (before, now) in enumerate(pairwise([0.0, *shares])):
        if now >= share:
            return (count + (share - before) / (now - before)) * STEP_S
    return math.inf


@pytest.fixture(scope="module", params=list(Personality))
def hover(request: pytest.FixtureRequest) -> tuple[Personality, Hover]:
    return request.param, Hover(request.param)


@pytest.mark.parametrize(("before", "after", "copter_s", "px4_s"), STEPS)
def test_a_step_is_followed_as_by_the_real_autopilots(
    hover: tuple[Personality, Hover],
    before: Vec3,
    after: Vec3,
    copter_s: tuple[float, float, float],
    px4_s: tuple[float, float, float],
) -> None:
    personality, vehicle = hover
    shares = vehicle.step(before, after)
    seen = [time_to_s(shares, share) for share in (0.10, 0.632, 0.90)]
    for at_s, copter, px4 in zip(seen, copter_s, px4_s, strict=True):
        low_s, high_s = min(copter, px4), max(copter, px4)
        assert low_s - max(TICK_S, SPREAD_TOLERANCE * low_s) <= at_s <= high_s + max(TICK_S, SPREAD_TOLERANCE * high_s)
        if personality is Personality.ARDUPILOT:
            assert at_s == pytest.approx(copter, rel=OWN_TOLERANCE, abs=TICK_S)
    assert max(shares) - 1.0 <= OVERSHOOT_MAX
    assert shares[-1] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(
    ("personality", "sd_mps", "wander_max_m"),
    [(Personality.PX4, (0.03, 0.17), 0.9), (Personality.ARDUPILOT, (0.001, 0.01), 0.1)],
)
def test_a_hover_with_estimates_as_recorded_is_told_as_by_the_real_autopilots(
    personality: Personality, sd_mps: tuple[float, float], wander_max_m: float, seed: int
) -> None:
    """Standard deviation of velocities within 6 s, as between two recorded steps, and how far positions wander."""
    vehicle = Hover(personality, errors=RECORDED_2026_11[personality], seed=seed)
    match personality:
        case Personality.PX4:
            vehicle.command(176, 1.0, 4.0, 3.0)  # hold
        case Personality.ARDUPILOT:
            vehicle.command(176, 1.0, 17.0)  # brake: loiter descends without a throttle
    vehicle.fly(10.0)
    told = []
    for _ in range(round(60.0 / STEP_S)):
        vehicle.fly(STEP_S)
        told.append(vehicle.body.state)
    window = round(6.0 / STEP_S)
    sds_mps = [
        statistics.pstdev(state.vel_ned_mps[axis] for state in told[start : start + window])
        for start in range(0, len(told), window)
        for axis in (0, 1)
    ]
    middle = [statistics.fmean(state.pos_ned_m[axis] for state in told) for axis in (0, 1)]
    wander_m = max(math.dist(state.pos_ned_m[:2], middle) for state in told)
    assert sd_mps[0] <= statistics.fmean(sds_mps) <= sd_mps[1]
    assert 0.2 * wander_max_m <= wander_m <= wander_max_m
