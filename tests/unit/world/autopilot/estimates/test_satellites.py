"""Receivers under crowns: what they hear, what fix that gives, and what an autopilot makes and tells of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from companion.mavlink import dialect as mav
from mission.document.load import load_mission
from mission.document.model import Mission, OdometryErrors, Personality
from mission.schema.trees import StandTree
from mission.stand.stand import Stand, stand_of
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.autopilot.estimates.aiding import START_S, STOP_S, Aided, is_good
from sim_bridge.world.sensors.satellites import LEAST, SATELLITES, Crowns, Receiver, sky
from sim_bridge.world.world import DEFAULT_ORIGIN, World
from tests.unit.core.ranging_kit import ranging_mission

DT_S = 0.05
OPEN = Crowns(Stand())


def crown(east_m: float, north_m: float, *, base_m: float, top_m: float, radius_m: float) -> StandTree:
    return StandTree(east_m, north_m, 0.15, top_m, base_m, radius_m)


def roof(loss_m: float) -> Crowns:
    """One crown so wide that every way up goes through it: `loss_m` thick, 10 m above the ground."""
    return Crowns(Stand([crown(0.0, 0.0, base_m=10.0, top_m=10.0 + loss_m, radius_m=500.0)]))


def receiver(crowns: Crowns, *, seed: int = 1, db_per_m: float = 1.0) -> Receiver:
    made = Receiver(crowns, db_per_m, seed=seed, vehicle_id=1)
    made.step((0.0, 0.0, -4.0), 0.0)
    return made


def test_the_way_through_a_crown_is_its_chord() -> None:
    crowns = Crowns(Stand([crown(20.0, 0.0, base_m=8.0, top_m=18.0, radius_m=3.0)]))
    below = (0.0, 20.0, -4.0)
    up, low = np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 1.0, 0.01]])
    assert crowns.metres(below, up)[0] == pytest.approx(10.0, rel=1e-3)
    assert crowns.metres((0.0, 20.0, -12.0), up)[0] == pytest.approx(6.0, rel=1e-3)  # from within it
    assert crowns.metres((0.0, 20.0, -20.0), up)[0] == 0.0  # from above
    assert crowns.metres((0.0, 0.0, -10.0), low)[0] == pytest.approx(6.0, rel=1e-3)  # nearly level, through its axis
    assert crowns.metres((0.0, 0.0, -4.0), low)[0] == 0.0  # below its base
    slant = np.array([[0.0, math.sqrt(0.5), math.sqrt(0.5)]])
    # From 8 m before the axis and 4 m up: into the circle at 5 m, 9 m up, within the heights until it leaves at 11 m.
    assert crowns.metres((0.0, 12.0, -4.0), slant)[0] == pytest.approx(6.0 * math.sqrt(2.0))
    assert crowns.metres((0.0, 30.0, -4.0), up)[0] == 0.0


def test_on_a_slope_crowns_stand_on_the_ground() -> None:
    tree = crown(100.0, 0.0, base_m=8.0, top_m=18.0, radius_m=3.0)
    crowns = Crowns(Stand([tree], grade=(0.2, 0.0)))  # 20 m higher there
    assert crowns.metres((0.0, 100.0, -30.0), np.array([[0.0, 0.0, 1.0]]))[0] == pytest.approx(8.0, rel=1e-3)


def test_in_the_open_all_are_heard_and_a_fix_is_wrong_by_a_metre() -> None:
    for seed in range(20):
        fix = receiver(OPEN, seed=seed).fix
        assert fix.is_3d
        assert fix.satellites == SATELLITES
        assert 0.6 <= fix.hdop <= 0.9
        assert 0.8 <= fix.sd_m <= 1.2


def test_the_sky_is_above_the_mask() -> None:
    assert np.allclose(np.linalg.norm(sky(3), axis=1), 1.0)
    assert sky(3)[:, 2].min() >= math.sin(math.radians(10.0))


def test_crowns_make_fewer_satellites_worse_geometry_and_larger_errors_until_there_is_no_fix() -> None:
    fixes = [receiver(roof(thick_m)).fix for thick_m in (1.0, 4.0, 8.0, 12.0)]
    counts, hdops, sds = ([getattr(fix, key) for fix in fixes] for key in ("satellites", "hdop", "sd_m"))
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[1] > counts[3]
    assert hdops == sorted(hdops)
    assert sds == sorted(sds)
    assert 3.0 <= fixes[2].sd_m <= 10.0  # as under closed crowns
    none = receiver(roof(16.0)).fix
    assert not none.is_3d
    assert none.satellites < LEAST


def test_a_fix_is_wrong_by_what_it_says() -> None:
    offs = []
    for seed in range(300):
        fix = receiver(roof(4.0), seed=seed).fix
        offs.append(math.hypot(*fix.off_ne_m) / fix.sd_m)
    assert math.sqrt(np.mean(np.square(offs))) == pytest.approx(1.0, abs=0.1)


def test_errors_wander_slowly() -> None:
    made = receiver(OPEN)
    before = made.fix.off_ne_m
    for k in range(1, 6):
        made.step((0.0, 0.0, -4.0), k * 0.2)
        assert math.dist(before, made.fix.off_ne_m) < 0.7  # no white noise
    for k in range(6, 5000):
        made.step((0.0, 0.0, -4.0), k * 0.2)
    assert before != made.fix.off_ne_m


def test_what_is_drawn_does_not_depend_on_where_it_is() -> None:
    here, there = receiver(OPEN), receiver(OPEN)
    for k in range(1, 50):
        here.step((0.0, 0.0, -4.0), k * 0.2)
        there.step((9.0 * k, 0.0, -4.0), k * 0.2)
    assert here.fix == there.fix


def aided(
    crowns: Crowns = OPEN, errors: OdometryErrors | None = None, *, seed: int = 1
) -> tuple[PointMass, Receiver, Aided]:
    body = PointMass((0.0, 0.0, -4.0), 0.0)
    made = Receiver(crowns, 1.0, seed=seed, vehicle_id=1)
    knows = Aided(body, made, errors or OdometryErrors(), seed=seed, vehicle_id=1)
    knows.set_armed(True)
    return body, made, knows


def off_m(body: PointMass, knows: Aided) -> float:
    return math.dist(body.state.pos_ned_m, knows.state.pos_ned_m)


def fly(knows: Aided, seconds: float, vel: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
    for _ in range(round(seconds / DT_S)):
        knows.command(vel, 0.0)
        knows.step(DT_S)


def test_with_satellites_a_position_stays_with_the_fixes() -> None:
    offs = []
    for seed in range(10):
        body, _, knows = aided(seed=seed)
        fly(knows, 120.0, (1.0, 0.0, 0.0))
        offs.append(off_m(body, knows))
        assert knows.uses
    assert math.sqrt(np.mean(np.square(offs))) < 1.5


def test_bad_fixes_are_used_for_five_seconds_more_and_good_ones_again_after_five_at_once() -> None:
    body, made, knows = aided()
    fly(knows, 10.0)
    made.is_covered = True
    fly(knows, STOP_S - 0.5)
    assert knows.uses
    fly(knows, 1.0)
    assert not knows.uses
    assert not knows.fix.is_3d
    fly(knows, 120.0, (1.0, 0.0, 0.0))
    far_m = off_m(body, knows)
    assert far_m > 2.0  # odometry drifts
    made.is_covered = False
    fly(knows, START_S - 0.5)
    assert not knows.uses
    before = knows.state.pos_ned_m
    for _ in range(40):
        knows.step(DT_S)
        if knows.uses:
            break
    assert math.dist(before, knows.state.pos_ned_m) > 1.0  # a reset
    assert off_m(body, knows) < 2.5


def test_without_satellites_a_position_drifts_as_what_is_told_of_the_velocity_says() -> None:
    body, made, knows = aided(seed=4)
    made.is_covered = True
    fly(knows, 10.0)
    start, told = knows.state.pos_ned_m, [0.0, 0.0]
    for _ in range(1200):
        knows.command((1.0, 0.5, 0.0), 0.0)
        knows.step(DT_S)
        told = [told[0] + knows.state.vel_ned_mps[0] * DT_S, told[1] + knows.state.vel_ned_mps[1] * DT_S]
    way = [knows.state.pos_ned_m[k] - start[k] for k in (0, 1)]
    assert math.dist(told, way) < 0.3
    assert off_m(body, knows) > 0.5


LINKS = {Link.ONBOARD: StreamProfile.ONBOARD, Link.GROUND: StreamProfile.GROUND}


def shaded(**tables: dict[str, Any]) -> Mission:
    sim = {"satellites": {"crowns": "shade"}} | tables.pop("sim", {})
    return ranging_mission(sim=sim, **tables)


@pytest.mark.parametrize("personality", list(Personality))
def test_both_makes_tell_of_it(personality: Personality) -> None:
    mission = shaded(sim={"satellites": {"crowns": "shade"}, "personality": personality})
    world = World(mission, lambda _f, place, _s: PointMass(place, 0.0, ground_down_m=place[2]), links=LINKS)
    one = world.vehicles[1]
    assert one.receiver is not None
    assert world.vehicles[2].receiver is None
    for message_id in (24, 230, 193, 32):  # GPS_RAW_INT, ESTIMATOR_STATUS, EKF_STATUS_REPORT, LOCAL_POSITION_NED
        ask = mav.MAVLink_command_long_message(1, 1, mav.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message_id, 5e5, *[0.0] * 5)
        packer = mav.MAVLink(None, srcSystem=1, srcComponent=191)
        one.autopilot.receive(Link.ONBOARD, ask.pack(packer), 0.0)
    told: dict[str, Any] = {}

    def run(seconds: float) -> None:
        for _ in range(round(seconds / DT_S)):
            for datagram in one.autopilot.transmit(Link.ONBOARD, world.now_s):
                for message in mav.MAVLink(None).parse_buffer(bytearray(datagram)) or []:
                    told[message.get_type()] = message
            world.step(DT_S)

    run(50.0)
    assert told["GPS_RAW_INT"].fix_type >= 3
    assert told["GPS_RAW_INT"].satellites_visible == SATELLITES
    assert 60 <= told["GPS_RAW_INT"].eph <= 90
    assert 800 <= told["GPS_RAW_INT"].h_acc <= 1200
    absolute = mav.EKF_POS_HORIZ_ABS
    flags = told["ESTIMATOR_STATUS" if personality is Personality.PX4 else "EKF_STATUS_REPORT"].flags
    assert flags & absolute
    one.receiver.is_covered = True
    run(8.0)
    assert told["GPS_RAW_INT"].fix_type < 2
    assert told["GPS_RAW_INT"].satellites_visible == 0
    assert told["GPS_RAW_INT"].eph == 65535
    flags = told["ESTIMATOR_STATUS" if personality is Personality.PX4 else "EKF_STATUS_REPORT"].flags
    assert not flags & absolute
    assert flags & mav.EKF_POS_HORIZ_REL
    assert told["LOCAL_POSITION_NED"].time_boot_ms > 57000  # it goes on


def test_a_mission_that_does_not_ask_hears_all_as_ever() -> None:
    world = World(ranging_mission(), lambda _f, place, _s: PointMass(place, 0.0, ground_down_m=place[2]), links=LINKS)
    assert all(vehicle.receiver is None for vehicle in world.vehicles.values())
    assert world.vehicles[1].believed is world.vehicles[1].airframe


@pytest.mark.parametrize(
    ("density_per_ha", "satellites", "used"),
    [(100.0, (12, 15), (0.9, 1.0)), (200.0, (7, 11), (0.05, 0.5)), (400.0, (1, 5), (0, 0))],
)
def test_a_managed_stand_leaves_so_many_satellites_by_its_density(
    density_per_ha: float, satellites: tuple[int, int], used: tuple[float, float]
) -> None:
    """Figures of docs/how-to/fly-gnss-denied.md."""
    values = load_mission("mission/examples/managed_stand.toml").with_origin(DEFAULT_ORIGIN).model_dump(by_alias=True)
    values["forest"]["stand"] |= {"density_per_ha": density_per_ha, "spacing_min_m": 2.0}
    mission = Mission.model_validate(values)
    crowns, heard, good = Crowns(stand_of(mission)), [], 0
    for seed in range(4):
        made = Receiver(crowns, 1.0, seed=seed, vehicle_id=1)
        for k in range(50):
            made.step((10.0 * (k % 3 - 1), 20.0 + 2.0 * k, -8.0), 0.2 * k)
            heard.append(made.fix.satellites)
            good += is_good(made.fix)
    assert satellites[0] <= np.mean(heard) <= satellites[1]
    assert used[0] <= good / len(heard) <= used[1]


def test_a_stand_with_trunks_alone_shades_nothing() -> None:
    trunk = crown(0.0, 0.0, base_m=18.0, top_m=18.0, radius_m=3.0)
    assert Crowns(Stand([trunk])).metres((0.0, 0.0, -4.0), sky(1)).max() == 0.0
