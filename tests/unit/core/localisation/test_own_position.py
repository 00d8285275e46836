"""The own position that is flown by, told to others and judged, when what is reported cannot be true."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest

from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.localisation.gnss_localiser import GnssLocaliser
from companion.core.localisation.integrity.own_position import OwnPosition, _Astray
from companion.core.localisation.integrity.range_check import RangeCheck
from companion.core.model.actions import SendBeacon
from companion.core.model.beacon import PeerReport
from companion.core.model.displaced import Displaced
from companion.core.model.events import AnyScan, HeardBeacon, Position, Satellites
from companion.core.model.vectors import ZERO, sub
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.perception.obstacle_perception import ObstaclePerception, SeenWay
from companion.core.perception.vehicles.vehicle_tracks import SeenVehicle
from companion.core.vehicle.failsafe import Cause
from mission.common.frames import Vec3
from tests.unit.core.core_kit import beacon, mission

pytestmark = pytest.mark.sources

DT_S = 0.05
EAST_MPS = 2.0


class Sight(ObstaclePerception):
    """Sees trunks, that tell the true way, or does not."""

    def __init__(self) -> None:
        super().__init__(mission(), 0.3)
        self.true_ne_m = (0.0, 0.0)
        self.sees = True
        self.reckons_from: tuple[float, float] | None = None
        self.by_trunks_ne_m: tuple[float, float] | None = None
        self.reckoned_anew = 0

    def read_way(self, reported: Position, now_s: float) -> SeenWay | None:  # noqa: ARG002
        return SeenWay(self.true_ne_m, (0.0, 0.0, 0.0), 0.0) if self.sees else None

    def reckon_anew(self) -> None:
        self.reckoned_anew += 1

    def correct_odometry(self, own: Position, now_s: float, *, reckons: bool = False) -> Position:  # noqa: ARG002
        """Without a fix trunks tell the way where they are to say one."""
        if not reckons or self.by_trunks_ne_m is None:
            return own
        return Position((*self.by_trunks_ne_m, own.pos_ned_m[2]), own.vel_ned_mps, own.boot_s)

    def reckon_from(self, led_ne_m: tuple[float, float], reported: Position, turned_rad: float) -> None:  # noqa: ARG002
        self.reckons_from = led_ne_m

    @property
    def sees_motion(self) -> bool:
        return self.sees

    def integrate_scan(self, scan: AnyScan, own: Position, now_s: float, neighbours: Sequence[Vec3]) -> None:
        """Of no account."""

    def observe_obstacles(
        self,
        own_ned_m: Vec3,
        placed_ned_m: Vec3,
        hovering: Mapping[int, PeerReport],
        now_s: float,
        seen: Sequence[SeenVehicle] = (),
    ) -> LocalObstacleCloud:
        raise NotImplementedError


class Flown:
    """Flies east; its fix is led north by `drift_mps`."""

    def __init__(self) -> None:
        self.sight = Sight()
        self.localiser = GnssLocaliser(mission(), 1)
        self.own = OwnPosition(mission(), self.localiser, self.sight)
        self.now_s, self.off_m, self.up_m, self.began_aloft = 100.0, 0.0, 5.0, False
        self.told = self.flown = Position(ZERO, ZERO)

    def hear_receiver(self, *, has_fix: bool) -> None:
        self.localiser.receive_satellites(Satellites(used=True, sd_m=0.9, has_fix=has_fix), self.now_s)

    def fly(self, seconds: float, drift_mps: float = 0.0) -> None:
        for _ in range(round(seconds / DT_S)):
            self.now_s += DT_S
            self.off_m += drift_mps * DT_S
            self.sight.true_ne_m = (0.0, EAST_MPS * (self.now_s - 100.0))
            place = (self.off_m, self.sight.true_ne_m[1], -self.up_m)
            self.told = Position(place, (drift_mps, EAST_MPS, 0.0), self.now_s)
            self.flown = self.own.receive(self.told, self.now_s, airborne=True, commanded_ned_mps=ZERO)

    def causes(self) -> list[Cause]:
        return [found.cause for found in self.own.findings(self.now_s, airborne=True, began_aloft=self.began_aloft)]


def test_while_all_is_well_nothing_is_changed() -> None:
    one = Flown()
    one.fly(30.0)
    sent, heard = SendBeacon(beacon(1)), HeardBeacon(beacon(2), (1.0, 2.0, 3.0))
    assert one.flown is one.told
    assert one.own.correct_broadcast(sent) is sent
    assert one.own.locate_sender(heard) is heard
    assert one.causes() == []
    assert one.own.error_m(one.now_s) == 0.0


def test_a_fix_that_is_led_astray_is_dropped_before_5_m_and_the_drift_taken_off() -> None:
    one = Flown()
    one.fly(20.0)
    while one.sight.reckons_from is None and one.off_m < 20.0:
        one.fly(DT_S, 0.3)
    assert one.off_m < 5.0
    assert one.sight.reckons_from == pytest.approx(one.sight.true_ne_m, abs=0.5)
    one.fly(10.0, 0.3)
    assert one.flown.pos_ned_m[0] == pytest.approx(0.0, abs=0.7)
    assert one.flown.vel_ned_mps[0] == pytest.approx(0.3, abs=0.4)  # trunks correct it, as far as they are asked
    assert one.causes() == [Cause.POSITION_DOUBTED]
    assert one.own.error_m(one.now_s) > 1.0


def test_what_is_sent_and_heard_goes_by_the_position_that_is_flown_by() -> None:
    one = Flown()
    one.fly(1.0)
    one.off_m = 8.0  # jumps
    one.fly(DT_S)
    off = sub(one.flown.pos_ned_m, one.told.pos_ned_m)
    assert off == pytest.approx((-8.0, 0.0, 0.0), abs=1e-6)
    assert one.own.correct_broadcast(SendBeacon(beacon(1))).off_ned_m == pytest.approx(off)
    heard = one.own.locate_sender(HeardBeacon(beacon(2), (-8.0, 5.0, 0.0)))
    assert heard.rel_ned_m == pytest.approx((0.0, 5.0, 0.0), abs=1e-6)
    assert one.causes() == [Cause.POSITION_JUMPED, Cause.POSITION_DOUBTED]
    one.fly(2.5)
    assert one.causes() == [Cause.POSITION_DOUBTED]


@pytest.mark.parametrize("sees", [True, False])
def test_a_step_is_a_jump_and_no_drift(sees: bool) -> None:
    """As a fix that is let go after 20 s of a slow drift: taken for a drift, it led 20 m away in 10 s."""
    one = Flown()
    one.sight.sees = sees
    one.fly(60.0)
    one.off_m = 2.5
    one.fly(1.5)
    assert Cause.POSITION_JUMPED in one.causes()
    one.fly(20.0)
    assert one.flown.pos_ned_m[0] == pytest.approx(0.0, abs=0.1)
    assert one.flown.vel_ned_mps == one.told.vel_ned_mps
    assert one.own.error_m(one.now_s) == pytest.approx(2.5, abs=0.1)
    assert one.causes() == [Cause.POSITION_DOUBTED]
    one.off_m = 0.0
    one.fly(5.0)
    assert one.causes() == []
    assert one.flown is one.told


def test_a_drift_that_was_found_may_end() -> None:
    """Where nothing tells the motion what it goes by errs by as much as it is taken to go on."""
    one = Flown()
    one.fly(20.0)
    while one.sight.reckons_from is None:
        one.fly(DT_S, 0.5)
    one.sight.sees = False
    one.fly(10.0)
    assert one.own.error_m(one.now_s) >= abs(one.flown.pos_ned_m[0])


def test_without_trunks_it_holds_soon_and_lands_later() -> None:
    one = Flown()
    one.fly(20.0)
    while one.sight.reckons_from is None:
        one.fly(DT_S, 0.3)
    one.sight.sees = False
    one.fly(2.0, 0.3)
    assert one.causes() == [Cause.GNSS_ASTRAY, Cause.POSITION_DOUBTED]
    one.fly(14.0, 0.3)
    assert one.causes()[0] is Cause.POSITION_DOUBTED_LONG


def test_on_the_ground_it_begins_anew() -> None:
    one = Flown()
    one.fly(20.0)
    while one.sight.reckons_from is None:
        one.fly(DT_S, 0.3)
    told = Position((3.0, 50.0, 0.0), ZERO, one.now_s + DT_S)
    assert one.own.receive(told, one.now_s + DT_S, airborne=False, commanded_ned_mps=ZERO) is told
    assert one.own.findings(one.now_s, airborne=False, began_aloft=False) == []


def ranged(one: Flown, *off_ne_m: float, error_m: float = 1.0) -> None:
    """Ranges have the vehicle elsewhere: reported less true position, of the one flown by."""
    check = RangeCheck(1, 5)
    check.displaced = Displaced((off_ne_m[0], off_ne_m[1]), (0.3, 0.0), error_m)
    one.localiser._check = check


def test_where_ranges_have_it_elsewhere_it_goes_by_that_place() -> None:
    """In the open, where nothing else tells; the drift goes on as it was found."""
    one = Flown()
    one.sight.sees = False
    one.fly(10.0, 0.3)
    ranged(one, 3.0, 0.0)
    one.fly(0.5, 0.3)
    assert one.flown.pos_ned_m[0] == pytest.approx(0.0, abs=0.05)
    assert one.flown.vel_ned_mps[0] == pytest.approx(0.0, abs=1e-6)
    assert one.causes() == [Cause.POSITION_DOUBTED]
    assert one.own.error_m(one.now_s) == pytest.approx(1.0, abs=0.2)
    one.fly(1.0, 0.3)
    assert one.causes() == [Cause.GNSS_ASTRAY, Cause.POSITION_DOUBTED]
    one.fly(15.0, 0.3)
    assert one.causes()[0] is Cause.POSITION_DOUBTED_LONG


def test_a_second_place_that_ranges_tell_is_of_the_position_flown_by() -> None:
    one = Flown()
    one.sight.sees = False
    one.fly(10.0, 0.3)
    ranged(one, 3.0, 0.0)
    one.fly(DT_S, 0.3)
    ranged(one, 0.0, 2.0)
    one.fly(2 * DT_S, 0.3)
    assert sub(one.told.pos_ned_m, one.flown.pos_ned_m) == pytest.approx((3.0, 2.0, 0.0), abs=0.1)
    one.fly(1.1, 0.3)
    assert Cause.GNSS_ASTRAY in one.causes()  # since the first


def test_where_ranges_leave_the_side_open_it_holds_where_it_is_reported() -> None:
    one = Flown()
    one.sight.sees = False
    one.fly(10.0, 0.3)
    check = RangeCheck(1, 5)
    check.displaced = Displaced((0.0, 0.0), (0.0, 0.0), 5.0)
    one.localiser._check = check
    one.fly(0.5, 0.3)
    assert one.flown.pos_ned_m == pytest.approx(one.told.pos_ned_m)
    assert Cause.POSITION_DOUBTED_LONG in one.causes()  # 5 m are more than is flown by


def test_trunks_go_on_from_the_place_that_ranges_tell() -> None:
    one = Flown()
    one.fly(2.0)
    ranged(one, 3.0, 0.0)
    one.fly(DT_S)
    assert one.sight.reckoned_anew == 1
    ranged(one, 4.0, 0.0)
    one.fly(DT_S)  # trunks tell its motion: they tell the place better
    assert sub(one.told.pos_ned_m, one.flown.pos_ned_m) == pytest.approx((3.0, 0.0, 0.0), abs=0.1)


def test_on_the_ground_ranges_move_nothing() -> None:
    one = Flown()
    one.fly(1.0)
    ranged(one, 3.0, 0.0)
    told = Position((3.0, 50.0, 0.0), ZERO, one.now_s + DT_S)
    assert one.own.receive(told, one.now_s + DT_S, airborne=False, commanded_ned_mps=ZERO) is told


def test_an_open_side_takes_no_way_back_that_velocities_tell() -> None:
    """Its position has left its velocity, by which it goes: ranges that leave the side open say only how far off."""
    one = Flown()
    one.sight.sees = False
    one.fly(1.0)
    way_m = one.own._way.ne_m
    north, east, _ = one.told.pos_ned_m
    one.own._astray = _Astray(one.now_s, (0.0, 0.0), (0.0, 0.0), ZERO, (north - way_m[0], east - way_m[1]))
    check = RangeCheck(1, 5)
    check.displaced = Displaced((0.0, 0.0), (0.0, 0.0), 5.0)
    one.localiser._check = check
    one.fly(2 * DT_S)
    one.off_m = 2.5  # the position leaves it on
    one.fly(DT_S)
    assert one.flown.pos_ned_m[0] == pytest.approx(0.0, abs=0.1)
    assert one.own.error_m(one.now_s) >= 5.0


def test_without_a_fix_it_tells_and_hears_by_where_trunks_have_it() -> None:
    one = Flown()
    one.hear_receiver(has_fix=True)
    one.fly(1.0)
    one.hear_receiver(has_fix=False)
    one.off_m = 2.0  # as inertial sensors drift
    one.sight.by_trunks_ne_m = (0.0, 2.0)
    one.fly(DT_S)
    off = sub(one.flown.pos_ned_m, one.told.pos_ned_m)
    assert off[0] == pytest.approx(-2.0)
    assert one.own.correct_broadcast(SendBeacon(beacon(1))).off_ned_m == pytest.approx(off)
    heard = one.own.locate_sender(HeardBeacon(beacon(2), sub((0.0, 9.0, -5.0), one.told.pos_ned_m)))
    assert heard.rel_ned_m == pytest.approx(sub((0.0, 9.0, -5.0), one.flown.pos_ned_m))


def test_where_ranges_place_the_others_heights_alone_are_told_otherwise() -> None:
    """There the odometer leaves the reported position, and a beacon has no level position."""
    trunks_alone = mission(swarm={"size": 3}, ranging={"start_enu_m": [[0, 0, 0], [6, 0, 0], [0, 6, 0]]})
    sight = Sight()
    own = OwnPosition(trunks_alone, GnssDeniedLocaliser(trunks_alone, 1), sight)
    heard = HeardBeacon(beacon(2), (0.0, 0.0, 3.0))
    for k in range(60):
        off_m = 9.0 if k >= 40 else 0.0
        told = Position((off_m, 0.1 * k, -5.0), (0.0, EAST_MPS, 0.0), DT_S * k)
        flown = own.receive(told, 100.0 + DT_S * k, airborne=True, commanded_ned_mps=ZERO)
    assert flown.pos_ned_m[0] == pytest.approx(0.0, abs=0.1)
    assert own.locate_sender(heard) is heard
    told = Position((9.0, 6.0, -14.0), (0.0, EAST_MPS, 0.0), DT_S * 60)
    own.receive(told, 103.0, airborne=True, commanded_ned_mps=ZERO)
    assert own.locate_sender(HeardBeacon(beacon(2), (0.0, 0.0, 3.0))).rel_ned_m == pytest.approx((0.0, 0.0, -6.0))


@pytest.mark.parametrize("lands", [True, False])
def test_a_fix_that_is_true_again_is_not_held_against_notes_from_before_it_was_lost(lands: bool) -> None:
    """The estimator comes back somewhere else, or the frame of trunks is another."""
    one = Flown()
    one.hear_receiver(has_fix=True)
    one.fly(30.0)
    if lands:
        one.own.receive(one.told, one.now_s, airborne=False, commanded_ned_mps=ZERO)
    else:
        one.hear_receiver(has_fix=False)
        one.fly(1.0)
    one.off_m += 2.5
    for _ in range(12):
        one.fly(0.2)
        one.hear_receiver(has_fix=True)
    one.fly(30.0)
    assert one.sight.reckons_from is None
    assert one.causes() == []


def test_a_gap_of_telemetry_is_bridged_by_the_velocity_and_told() -> None:
    """Its position has left its velocity, by which it goes."""
    one = Flown()
    one.sight.sees = False
    one.fly(1.0)
    way_m = one.own._way.ne_m
    north, east, _ = one.told.pos_ned_m
    one.own._astray = _Astray(one.now_s, (0.0, 0.0), (0.0, 0.0), ZERO, (north - way_m[0], east - way_m[1]))
    one.fly(1.0)
    error_m = one.own.error_m(one.now_s)
    one.now_s += 1.5
    one.fly(1.0)
    assert one.flown.pos_ned_m[:2] == pytest.approx(one.sight.true_ne_m, abs=0.01)
    assert one.own.error_m(one.now_s) >= error_m + 1.5 * EAST_MPS


FENCE = mission().fence


@pytest.mark.parametrize(
    ("up_m", "is_false"),
    [
        (FENCE.altitude_min_m - 0.9, False),
        (FENCE.altitude_min_m - 1.1, True),
        (FENCE.altitude_max_m + 0.9, False),
        (FENCE.altitude_max_m + 1.1, True),
    ],
)
def test_who_starts_anew_where_no_companion_flies_does_not_believe_its_height(up_m: float, is_false: bool) -> None:
    one = Flown()
    one.up_m, one.began_aloft = up_m, True
    one.fly(DT_S)
    assert (Cause.HEIGHT_FALSE in one.causes()) is is_false
    one.up_m = 5.0  # neither does a descent make it true, nor a gust false
    one.fly(DT_S)
    assert (Cause.HEIGHT_FALSE in one.causes()) is is_false
    one.began_aloft = False  # it has landed
    assert Cause.HEIGHT_FALSE not in one.causes()


def test_a_height_outside_is_not_false_for_one_that_has_taken_off() -> None:
    one = Flown()
    one.up_m = FENCE.altitude_max_m + 5.0
    one.fly(DT_S)
    one.began_aloft = False
    assert Cause.HEIGHT_FALSE not in one.causes()
