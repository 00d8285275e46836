"""A ring of which each measures the next one alone: ranges do not see it bend, and a small motion of all does."""

from __future__ import annotations

import math
from random import Random

import pytest

from companion.core.localisation.gnss_denied.error_state import Level
from companion.core.localisation.gnss_denied.excitation import FROM_M, SPEED_MPS, UNTIL_M, ExcitationManoeuvre
from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.model.beacon import RelativeReport
from companion.core.model.events import HeardBeacon, Position, Ranges
from companion.core.model.states import FlightState, LandedState
from companion.core.model.vectors import ZERO
from mission.common.frames import Vec3
from tests.unit.core.core_kit import beacon
from tests.unit.core.ranging_kit import ranging_mission

SIZE, RADIUS_M, DOWN_M, DT_S = 9, 16.7, -4.0, 0.05
NEXT_M, ALL_M = 20.0, 40.0  # reach of the range radios: the next ones are 11.4 m off, those behind them 21.5 m
STARTS = [
    (RADIUS_M * math.sin(math.tau * k / SIZE), RADIUS_M * math.cos(math.tau * k / SIZE), 0.0) for k in range(SIZE)
]
PLACES: dict[int, Level] = {k: (north, east) for k, (east, north, _) in enumerate(STARTS, start=1)}
DRIFTS_MPS = 0.05  # of odometers, each another way


class Ring:
    """Vehicle 1's localiser, of nine that hover on a ring, or all circle about their positions on it."""

    def __init__(self, reach_m: float, *, circles: bool = False) -> None:
        mission = ranging_mission(swarm={"size": SIZE}, ranging={"start_enu_m": STARTS, "reach_m": reach_m})
        self.reach_m, self.circles, self.rng = reach_m, circles, Random(7)
        self.localiser, self.now_s = GnssDeniedLocaliser(mission, 1), 0.0
        north, east = PLACES[1]
        self.localiser.receive_position(Position((north, east, 0.0), ZERO, 0.0), 0.0)
        self.localiser.update_landed_state(LandedState.ON_GROUND, waits=True)
        self.localiser.confirm_start(1, gathers=False)

    def way(self, vehicle: int) -> tuple[Level, Level]:
        """How far it is from its position on the ring, and its velocity."""
        if not self.circles:
            return (0.0, 0.0), (0.0, 0.0)
        period_s = ExcitationManoeuvre(vehicle)._period_s
        turn, radius_m = math.tau * self.now_s / period_s + vehicle, SPEED_MPS * period_s / math.tau
        begun = radius_m * math.sin(vehicle), -radius_m * math.cos(vehicle)
        return (
            (radius_m * math.sin(turn) - begun[0], -radius_m * math.cos(turn) - begun[1]),
            (SPEED_MPS * math.cos(turn), SPEED_MPS * math.sin(turn)),
        )

    def told(self, vehicle: int) -> tuple[Level, Level]:
        """What its odometer says of that: it drifts."""
        (north, east), (vel_n, vel_e) = self.way(vehicle)
        drift_n, drift_e = DRIFTS_MPS * math.cos(2.0 * vehicle), DRIFTS_MPS * math.sin(2.0 * vehicle)
        return (north + drift_n * self.now_s, east + drift_e * self.now_s), (vel_n + drift_n, vel_e + drift_e)

    def at(self, vehicle: int) -> Level:
        north, east = self.way(vehicle)[0]
        return PLACES[vehicle][0] + north, PLACES[vehicle][1] + east

    def run(self, seconds: float) -> Ring:
        self.localiser.update_landed_state(LandedState.IN_AIR, waits=False)
        for tick in range(round(seconds / DT_S)):
            self.now_s += DT_S
            (north, east), vel = self.told(1)
            own: Vec3 = (PLACES[1][0] + north, PLACES[1][1] + east, DOWN_M)
            for k in range(2, SIZE + 1) if tick % 2 == 0 else ():
                odo, vel_ne = self.told(k)
                ranges = tuple([(j, metres, 0.0) for j, metres in self.measure(k) if (k < j) == ((k + j) % 2 == 0)])
                time_ms = round(self.now_s * 1e3)
                self.localiser.receive_ranging(RelativeReport(k, time_ms, odo, ranges=ranges), self.now_s)
                said = beacon(k, time_ms=time_ms, airborne=True, vel_ned_mps=(*vel_ne, 0.0))
                self.localiser.receive_beacon(HeardBeacon(said, (0.0, 0.0, 0.0)), own, self.now_s)
            if tick % 2 == 0:
                mine = tuple([(j, metres, 0.0) for j, metres in self.measure(1)])
                self.localiser.receive_ranging(Ranges(mine), self.now_s)
            self.localiser.receive_position(Position(own, (*vel, 0.0), self.now_s), self.now_s)
            self.localiser.update_peers(own, self.now_s, range_m=55.0, launched=True)
        return self

    def measure(self, one: int) -> list[tuple[int, float]]:
        others = [(j, math.dist(self.at(one), self.at(j))) for j in range(1, SIZE + 1) if j != one]
        return [(j, metres + self.rng.gauss(0.0, 0.1)) for j, metres in others if metres < self.reach_m]

    @property
    def shape_sd_m(self) -> float:
        return self.localiser._shape_sd_m(self.now_s)

    @property
    def off_m(self) -> float:
        """By how much it is wrong at most about where another is."""
        found = {k: self.localiser.ranging.filter.relative(k) for k in range(2, SIZE + 1)}
        here, off_m = self.at(1), 0.0
        for k, one in found.items():
            assert one is not None
            there = self.at(k)
            off_m = max(off_m, math.dist(one.ne_m, (there[0] - here[0], there[1] - here[1])))
        return off_m

    @property
    def excites(self) -> bool:
        return self.localiser.excite(FlightState.COVERAGE, None, self.now_s) != ZERO


def test_on_a_ring_of_which_each_measures_the_next_alone_vehicles_move_to_see_its_shape() -> None:
    ring = Ring(NEXT_M).run(10.0)
    assert ring.shape_sd_m > FROM_M
    assert ring.excites


def test_a_ring_that_ranges_brace_keeps_still() -> None:
    ring = Ring(ALL_M).run(10.0)
    assert ring.shape_sd_m < UNTIL_M
    assert not ring.excites


@pytest.mark.parametrize(("circles", "within_m"), [(False, (2.0, 9.0)), (True, (0.0, 1.0))])
def test_by_that_motion_the_shape_is_seen(*, circles: bool, within_m: tuple[float, float]) -> None:
    """At rest the ring bends with the odometers' drifts, for all that its ranges say."""
    assert within_m[0] < Ring(NEXT_M, circles=circles).run(60.0).off_m < within_m[1]


def test_the_motion_lasts_until_the_shape_is_known_again() -> None:
    motion = ExcitationManoeuvre(2)
    assert motion.velocity(0.0, 1.0, shape_sd_m=0.9 * FROM_M) == ZERO
    assert motion.velocity(0.0, 2.0, shape_sd_m=1.1 * FROM_M) != ZERO
    assert motion.velocity(0.0, 3.0, shape_sd_m=0.9 * FROM_M) != ZERO
    assert motion.velocity(0.0, 4.0, shape_sd_m=0.9 * UNTIL_M) == ZERO
