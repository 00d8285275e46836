"""The simulated lidars that tell every ray: when, how wrong, how distorted, and as which messages."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from companion.mavlink.framing.frames import Framing
from companion.mavlink.lidar_scan import LidarPiece, decode_lidar_scan
from mission.document.model import Lidar as LidarErrors
from mission.document.model import Mission, Sensing
from mission.stand.stand import Stand, StandTree
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.raw_lidar import RawDriver, RawLidar, RawScan, raw_lidars_of
from sim_bridge.world.sensors.scene import Scene
from sim_bridge.world.sensors.simulated import stamp_simulated
from sim_bridge.world.sensors.table import link_name, simulated_sensors

EXACT = LidarErrors(noise_m=0.0, dropout=0.0)


def trunk(north_m: float, east_m: float, radius_m: float = 0.2, height_m: float = 20.0) -> StandTree:
    return StandTree(east_m, north_m, radius_m, height_m, height_m, radius_m)


def state(*, vel: Any = (0.0, 0.0, 0.0), rates: Any = (0.0, 0.0, 0.0), up_m: float = 3.0) -> AirframeState:
    return AirframeState((0.0, 0.0, -up_m), vel, (0.0, 0.0, 0.0), rates, False, 0.4)


def lidar(stand: Stand, *, errors: LidarErrors = EXACT, seed: int = 1, vehicle_id: int = 1, **sensing: Any) -> RawLidar:
    keys = Sensing(**{"sensor": "scan-1deg", "range_m": 12.0, **sensing})
    return RawLidar(Scene(stand, keys.range_m), keys, errors, seed=seed, vehicle_id=vehicle_id)


def seen(sensor: RawLidar, at: AirframeState | None = None, others: Any = ()) -> dict[int, float]:
    """Of the first layer: rays that met something."""
    ranges_m = sensor.measure(at or state(), others)[0]
    return {k: round(float(range_m), 3) for k, range_m in enumerate(ranges_m) if math.isfinite(range_m)}


def bearing_deg(found: dict[int, float]) -> float:
    """The middle of what was seen, -180 to 180."""
    off = [math.remainder(k, 360) for k in found]
    return sum(off) / len(off)


def test_a_still_lidar_sees_a_trunk_as_wide_as_it_is_and_half_a_beam_to_either_side() -> None:
    found = seen(lidar(Stand([trunk(4.0, 0.0, 0.2)])))
    assert set(found) == {357, 358, 359, 0, 1, 2, 3}  # 2.87 degrees to either side, and 0.15
    assert found[0] == 3.8
    fine = seen(lidar(Stand([trunk(4.0, 0.0, 0.2)]), sensor="scan-0.5deg"))
    assert set(fine) == {*range(715, 720), *range(6)}  # 0.1 to either side is less than to the next ray
    assert seen(lidar(Stand([trunk(12.3, 0.0)]))) == {}


def test_a_turn_is_distorted_by_the_motion_in_it() -> None:
    """The first ray is 0.1 s old, that behind 0.05 s, the last is of now."""
    stand = Stand([trunk(5.0, 0.0), trunk(-5.0, 0.0)])
    forward = seen(lidar(stand), state(vel=(3.0, 0.0, 0.0)))
    assert forward[0] == pytest.approx(4.8 + 0.3, abs=0.01)
    assert forward[359] == pytest.approx(4.8, abs=0.03)
    assert forward[180] == pytest.approx(4.8 - 0.15, abs=0.01)
    right = seen(lidar(Stand([trunk(-5.0, 0.0)])), state(rates=(0.0, 0.0, math.radians(90.0))))
    assert abs(bearing_deg(right)) == pytest.approx(175.5, abs=0.6)  # 4.5 degrees ago it looked there


def test_other_vehicles_are_seen_at_their_height_and_where_they_were() -> None:
    other = ((0.0, 6.0, -3.0), (0.0, -5.0))
    assert seen(lidar(Stand()), others=[other])[90] == pytest.approx(6.0 - 0.35 + 5.0 * 0.1 * 269 / 360, abs=0.01)
    assert seen(lidar(Stand()), others=[((0.0, 6.0, -5.0), (0.0, 0.0))]) == {}
    many = lidar(Stand(), sensor="multi-layer")
    assert np.isfinite(many.measure(state(), [((0.0, 6.0, -5.0), (0.0, 0.0))])[3:]).any()  # but not by many layers


def test_layers_look_up_and_hanging_down() -> None:
    stand = Stand([StandTree(0.0, 5.0, 0.2, 20.0, 5.0, 2.0)])  # its crown begins 5 m up
    up = lidar(stand, sensor="multi-layer").measure(state(), ())
    assert np.isfinite(up[1:5, 0]).all()
    assert up[8, 0] == pytest.approx(1.75 / math.sin(math.radians(-7.0 + 8 * 59 / 14)), abs=0.01)  # into the crown
    hanging = lidar(stand, sensor="multi-layer", upside_down=True)
    down = hanging.measure(state(), ())
    assert hanging.pattern.elevations_deg[-1] == pytest.approx(-52.0)
    assert down[-1, 180] == pytest.approx(3.25 / math.sin(math.radians(52.0)), abs=0.01)  # the ground
    assert hanging.pattern.bearings_deg[90] == -90.0  # it turns the other way round


def test_noise_and_dropouts_are_those_of_the_class_or_of_the_mission() -> None:
    ring = Stand([trunk(4.0 * math.cos(math.tau * k / 72), 4.0 * math.sin(math.tau * k / 72)) for k in range(72)])
    for sensor, errors, sd_m in (
        ("scan-1deg", LidarErrors(), 0.03),
        ("scan-0.5deg", LidarErrors(), 0.02),
        ("scan-1deg", LidarErrors(noise_m=0.1), 0.1),
    ):
        one = lidar(ring, errors=errors, sensor=sensor)
        exact = one.measure(state(), ())
        scans = [scan for k in range(60) if (scan := one.scan(state(), (), 0.1 * k)) is not None]
        told = np.array([scan.ranges_m for scan in scans])
        assert np.isnan(told).mean() == pytest.approx(0.02, abs=0.003)
        assert np.nanstd(told - exact) == pytest.approx(sd_m, rel=0.05)


def test_the_same_seed_tells_the_same_whatever_is_seen_and_every_vehicle_something_else() -> None:
    def flown(seed: int, vehicle_id: int, *more: StandTree) -> list[float]:
        one = lidar(Stand([trunk(3.0, 0.0), *more]), errors=LidarErrors(), seed=seed, vehicle_id=vehicle_id)
        scans = [one.scan(state(), (), 0.05 * k) for k in range(40)]
        return [float(scan.ranges_m[0, 0]) for scan in scans if scan is not None]

    assert repr(flown(1, 1)) == repr(flown(1, 1)) == repr(flown(1, 1, trunk(-3.0, 0.0)))
    assert repr(flown(1, 1)) != repr(flown(2, 1))
    assert repr(flown(1, 1)) != repr(flown(1, 2))


def test_errors_of_a_fault_come_on_top_and_outside_the_field_of_view_nothing_is_measured() -> None:
    one = lidar(Stand([trunk(3.0, 0.0)]), errors=LidarErrors(noise_m=0.0, dropout=0.0), field_of_view_deg=90.0)
    one.set_errors(0.0, 0.2)
    times_s = [(0.05 * k, scan) for k in range(40) if (scan := one.scan(state(), (), 0.05 * k)) is not None]
    assert all(at_s - scan.taken_s == pytest.approx(0.2) for at_s, scan in times_s)
    measured = ~np.isnan(times_s[0][1].ranges_m[0])
    assert np.flatnonzero(measured).tolist() == [*range(46), *range(315, 360)]


def pieces_of(driver: RawDriver, at_s: float = 0.45) -> list[LidarPiece]:
    framing, found = Framing(), []
    for k in range(round(at_s / 0.05) + 1):
        for m in framing.parse(driver.frames(state(), (), 0.05 * k, stamp_simulated)):
            piece = decode_lidar_scan(m)
            assert piece is not None
            found.append(piece)
    assert framing.bad == framing.garbage_bytes == 0
    return found


@pytest.mark.parametrize(("sensor", "count"), [("scan-1deg", 4), ("scan-0.5deg", 8), ("multi-layer", 60)])
def test_a_turn_is_sent_in_pieces_each_with_its_own_time(sensor: str, count: int) -> None:
    driver = RawDriver(lidar(Stand([trunk(3.0, 0.0)]), sensor=sensor), 7)
    pieces = pieces_of(driver)
    turns = {piece.turn for piece in pieces}
    one = [piece for piece in pieces if piece.turn == min(turns)]
    assert len(one) == count
    first_us = one[0].time_us
    assert {piece.time_us - first_us for piece in one} == {
        round(1e5 * k * 90 / len(driver.lidar.pattern.bearings_deg))
        for k in range(len(driver.lidar.pattern.bearings_deg) // 90)
    }
    last = one[-1]
    assert last.time_us + 89 * last.ray_time_s * 1e6 == pytest.approx(first_us + 1e5 - last.ray_time_s * 1e6, abs=3)
    assert (one[0].first_bearing_deg, one[0].ranges_m[0]) == (0.0, pytest.approx(2.8, abs=0.03))


def test_what_was_not_measured_is_not_sent() -> None:
    scan = RawScan(1.0, 1, np.full((1, 360), math.nan))
    scan.ranges_m[0, 100] = math.inf
    (payload,) = RawDriver(lidar(Stand()), 7).pieces(scan, stamp_simulated)
    assert len(payload) > 200


def test_a_mission_has_the_lidars_of_its_class_or_those_of_sectors() -> None:
    def mission(**sensing: Any) -> Mission:
        route = {"d1_enu_m": (0, 0, 4), "d2_enu_m": (40, 0, 4), "vel_leader_mps": 2.0}
        return Mission.model_validate({"schema": 1, "route": route, "sensing": sensing})

    assert [one.name for one in simulated_sensors(mission(), Stand(), [1])] == ["obstacles"]
    raw = mission(sensor="multi-layer")
    assert [one.name for one in simulated_sensors(raw, Stand(), [1])] == ["lidar"]
    assert link_name(raw) == "lidar"
    assert raw_lidars_of(mission(), Stand(), [1]) is None


def test_how_fast_the_others_are_is_known_by_where_they_were() -> None:
    route = {"d1_enu_m": (0, 0, 4), "d2_enu_m": (40, 0, 4), "vel_leader_mps": 2.0}
    sensing = {"sensor": "scan-1deg", "range_m": 12.0}
    errors = {"noise_m": 0.0, "dropout": 0.0}
    mission = Mission.model_validate({"schema": 1, "route": route, "sensing": sensing, "sim": {"lidar": errors}})
    lidars = raw_lidars_of(mission, Stand(), [1, 2])
    assert lidars is not None
    for k in range(10):
        places = {1: (0.0, 0.0, -3.0), 2: (0.0, 6.0 - 0.25 * k, -3.0)}
        data = lidars.frames(1, state(), places, 0.05 * k)
        if data:
            east_m = 6.0 - 0.25 * k
            pieces = [decode_lidar_scan(m) for m in Framing().parse(data)]
            assert pieces[1] is not None
            assert pieces[1].ranges_m[0] == pytest.approx(east_m - 0.35 + 5.0 * 0.1 * 269 / 360, abs=0.01)
            break
    else:
        pytest.fail("no scan")
