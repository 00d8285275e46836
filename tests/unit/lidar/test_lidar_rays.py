"""Raw scans of a lidar: every ray in its cell with its time, free and unknown apart, turned and masked as mounted."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from companion.lidar.command import RayCount
from companion.lidar.driver import Return
from companion.lidar.ldrobot import LdLidar
from companion.lidar.livox import Mid360
from companion.lidar.models import MODELS
from companion.lidar.mounting import Mounting
from companion.lidar.options import RAW_NAMES, parse_mask
from companion.lidar.rays import RayScan
from companion.lidar.rplidar import RpLidar
from companion.lidar.sectors import Limits
from companion.mavlink.framing import wire
from companion.mavlink.lidar_scan import LIDAR_SCAN_ID, LidarPiece, decode_lidar_scan
from mission.schema.kinds import RAW_LIDARS, SensorClass
from tests.unit.lidar.lidar_kit import (
    RPLIDAR_SCANNING,
    everywhere,
    ld_revolution,
    mid360_points,
    post,
    rplidar_revolution,
)

LIMITS = Limits(0.2, 12.0)
PERIOD_S = 0.1


def read(payloads: list[bytes]) -> list[LidarPiece]:
    found = []
    for payload in payloads:
        frame = wire.frame(LIDAR_SCAN_ID, payload, seq=0, system=3, component=196)
        piece = decode_lidar_scan(wire.fields(frame))
        assert piece is not None
        found.append(piece)
    return found


def revolution(ranges_m: dict[int, float], elsewhere_m: float = 0.0, samples: int = 360) -> list[Return]:
    """One return in the middle of each cell of a lidar that turns."""
    step_cdeg = 36000 // samples
    return [(step_cdeg * k + step_cdeg // 2, ranges_m.get(k, elsewhere_m), 0.0, k == 0) for k in range(samples)]


def turned(
    returns: list[Return],
    mounting: Mounting | None = None,
    sensor: SensorClass = SensorClass.SCAN_1DEG,
    limits: Limits = LIMITS,
) -> list[LidarPiece]:
    """The pieces of the second of two turns, at PERIOD_S each, its returns one after the other."""
    rays = RayScan(limits, mounting or Mounting(), RAW_LIDARS[sensor])
    found: list[bytes] = []
    for turn in range(3):
        for k, one in enumerate(returns):
            found += rays.update([one], 10.0 + PERIOD_S * (turn + k / len(returns)))
    pieces = read(found)
    return [piece for piece in pieces if piece.turn == 2]


def seen(pieces: list[LidarPiece]) -> dict[float, float]:
    """Range by the bearing, 0 to 360, of what is not free."""
    return {
        round((piece.first_bearing_deg + k * piece.bearing_step_deg) % 360.0, 2): range_m
        for piece in pieces
        for k, range_m in enumerate(piece.ranges_m)
        if range_m != math.inf
    }


def test_each_cell_has_its_nearest_and_one_where_nothing_came_back_is_free() -> None:
    returns = revolution({0: 3.0, 90: 2.0})
    returns.insert(1, (80, 2.5, 0.0, False))
    pieces = turned(returns)
    assert [len(piece.ranges_m) for piece in pieces] == [90] * 4
    assert seen(pieces) == {0.5: 2.5, 90.5: 2.0}
    assert {piece.elevation_deg for piece in pieces} == {0.0}


def test_a_piece_is_sent_when_the_next_arc_begins_and_tells_when_its_rays_were_measured() -> None:
    rays = RayScan(LIMITS, Mounting(), RAW_LIDARS[SensorClass.SCAN_1DEG])
    sent_s: list[float] = []
    pieces: list[LidarPiece] = []
    for turn in range(4):
        for k, one in enumerate(revolution({}, 5.0)):
            now_s = 10.0 + PERIOD_S * (turn + k / 360)
            told = read(rays.update([one], now_s))
            sent_s += [now_s] * len(told)
            pieces += told
    assert sent_s == pytest.approx([10.1 + 0.025 * k for k in range(1, 4 * 3)], abs=1e-3)
    for piece, now_s in zip(pieces, sent_s, strict=True):
        assert piece.ray_time_s == pytest.approx(PERIOD_S / 360, rel=1e-3)
        assert piece.time_us / 1e6 + 89 * piece.ray_time_s == pytest.approx(now_s, abs=1e-3)
    assert [piece.turn for piece in pieces] == [2] * 4 + [3] * 4 + [4] * 3


def test_too_far_is_free_too_near_and_no_pulse_are_not_measured() -> None:
    returns = [one for one in revolution({10: 12.5, 20: 0.05, 30: 12.0}) if one[0] // 100 != 40]
    returns.insert(32, (3040, 0.05, 0.0, False))
    found = seen(turned(returns))
    assert {bearing for bearing, range_m in found.items() if math.isnan(range_m)} == {20.5, 40.5}
    assert found[30.5] == 12.0
    assert 10.5 not in found


@pytest.mark.parametrize(
    ("mounting", "bearing_deg"),
    [
        (Mounting(), 90.5),
        (Mounting(yaw_deg=90.0), 180.5),
        (Mounting(upside_down=True), 269.5),
        (Mounting(yaw_deg=180.0, upside_down=True), 89.5),
    ],
)
def test_a_return_at_the_lidars_right_is_where_the_mounting_puts_it(mounting: Mounting, bearing_deg: float) -> None:
    assert seen(turned(revolution({90: 2.0}), mounting)) == {bearing_deg: 2.0}


def test_masked_bearings_are_not_measured() -> None:
    found = seen(turned(revolution({}, 5.0), Mounting(mask=parse_mask("88..91"))))
    measured = {bearing for bearing, range_m in found.items() if range_m == 5.0}
    assert {k + 0.5 for k in range(360)} - measured == {87.5 + k for k in range(5)}


def test_a_finer_class_has_twice_the_cells() -> None:
    pieces = turned(revolution({181: 2.0}, samples=720), sensor=SensorClass.SCAN_HALF_DEG)
    assert len(pieces) == 8
    assert seen(pieces) == {90.75: 2.0}


@pytest.mark.parametrize(("samples", "sampled"), [(360, 360), (400, 400), (720, 720), (800, 720), (1600, 720)])
def test_rays_that_an_rplidar_samples_in_a_turn_are_counted(samples: int, sampled: int) -> None:
    rays, driver = RayScan(LIMITS, Mounting(), RAW_LIDARS[SensorClass.SCAN_HALF_DEG]), RpLidar()
    count = RayCount(rays, "scan-0.5deg")
    assert rays.take_rays_a_turn() is None
    data = RPLIDAR_SCANNING + 4 * rplidar_revolution(everywhere(0.0), samples)
    size = math.ceil(len(data) / 40)
    for k in range(40):
        rays.update(driver.decode(data[k * size : (k + 1) * size]), 10.0 + PERIOD_S * k / 10)
    told = count.update()
    if sampled < 0.67 * 720:
        assert told.startswith(f"{sampled} of 720 rays a turn are sampled: ERROR, too few for --raw scan-0.5deg")
    else:
        assert told == ""
    assert count.update() == ""  # no turn since


def test_too_few_rays_are_told_once_and_that_there_are_enough_again() -> None:
    rays = RayScan(LIMITS, Mounting(), RAW_LIDARS[SensorClass.SCAN_1DEG])
    count = RayCount(rays, "scan-1deg")
    told = []
    for turn in range(12):
        gap = 2 if turn < 6 else 1
        rays.update(revolution({}, 5.0)[::gap], 10.0 + PERIOD_S * turn)
        if turn % 3 == 2:
            told.append(count.update())
    assert told == [
        "180 of 360 rays a turn are sampled: ERROR, too few for --raw scan-1deg, no preflight passes; more samples, or "
        "a coarser class",
        "",
        "300 of 360 rays a turn are sampled: enough for --raw scan-1deg",
        "",
    ]


def test_a_turn_that_takes_too_long_is_not_told() -> None:
    rays = RayScan(LIMITS, Mounting(), RAW_LIDARS[SensorClass.SCAN_1DEG])
    told = [rays.update(revolution({}, 5.0), 10.0 + 0.6 * turn) for turn in range(3)]
    assert told == [[], [], []]


def test_bytes_of_an_ld19_are_rays() -> None:
    rays, driver = RayScan(MODELS["ld19"].limits, Mounting(), RAW_LIDARS[SensorClass.SCAN_1DEG]), LdLidar()
    found: list[bytes] = []
    for turn in range(4):
        data = ld_revolution(post(90.0, 2.1, 6.0))
        for k in range(10):
            part = data[k * len(data) // 10 : (k + 1) * len(data) // 10]
            found += rays.update(driver.decode(part), 10.0 + PERIOD_S * (turn + k / 10))
    pieces = [piece for piece in read(found) if piece.turn == 3]
    hit = [bearing for bearing, range_m in seen(pieces).items() if range_m == 2.1]
    assert 86.5 <= min(hit) <= 87.5
    assert 92.5 <= max(hit) <= 93.5
    assert set(seen(pieces).values()) == {2.1, 6.0}


def framed(points_m: list[tuple[float, float, float]], mounting: Mounting) -> list[LidarPiece]:
    """The pieces of a frame of a Mid-360, of points at x ahead, y left, z up of the lidar."""
    rays, driver = RayScan(MODELS["mid360"].limits, mounting, RAW_LIDARS[SensorClass.MULTI_LAYER]), Mid360()
    assert rays.update(driver.decode(mid360_points(3, points_m)), 10.0) == []
    return read(rays.update(driver.decode(mid360_points(3, [(1.0, 0.0, 0.0)])), 10.125))


def test_points_of_a_mid360_are_in_the_layer_that_is_nearest_to_them() -> None:
    up = [(5.0, -0.05, 5.0 * math.tan(math.radians(deg))) for deg in (-7.0, 1.0, 52.0)]
    pieces = framed([*up, (6.0, -0.06, 0.1)], Mounting())
    found = {round(piece.elevation_deg, 1): piece.ranges_m[0] for piece in pieces}
    assert found[-7.0] == pytest.approx(5.0 / math.cos(math.radians(7.0)), abs=0.01)
    assert found[1.4] == pytest.approx(5.0, abs=0.02)  # the nearer of two
    assert found[52.0] == pytest.approx(5.0 / math.cos(math.radians(52.0)), abs=0.01)
    assert {piece.time_us for piece in pieces} == {10_000_000}
    assert all(90 * piece.ray_time_s == pytest.approx(0.125) for piece in pieces)


def test_a_frame_that_takes_too_long_is_not_told() -> None:
    rays = RayScan(MODELS["mid360"].limits, Mounting(), RAW_LIDARS[SensorClass.MULTI_LAYER])
    assert rays.update([(0, 5.0, 0.0, False)], 10.0) == []
    assert rays.update([(0, 5.0, 0.0, False)], 10.6) == []
    assert len(rays.update([], 10.75)) == 1


def test_a_mid360_that_hangs_has_its_layers_below_and_turns_the_other_way_round() -> None:
    pieces = framed([(0.0, -3.0, 3.0 * math.tan(math.radians(52.0)))], Mounting(upside_down=True))
    (piece,) = pieces
    assert piece.elevation_deg == pytest.approx(-52.0)
    assert seen(pieces)[269.5] == pytest.approx(3.0 / math.cos(math.radians(52.0)), abs=0.01)


def test_the_guide_names_lidars_for_each_class_that_reach_as_far_as_it_says() -> None:
    guide = (Path(__file__).parents[3] / "docs" / "how-to" / "connect-a-lidar.md").read_text(encoding="utf-8")
    for sensor, lidar in RAW_LIDARS.items():
        row = re.search(rf"^\| `{sensor}` \| (.*?up to (\d+) m: .*?) \|", guide, re.MULTILINE)
        assert row is not None
        reach_m = [MODELS[name].limits.max_m for name in re.findall(r"`([\w-]+)`", row[1]) if name in MODELS]
        assert reach_m
        assert float(row[2]) == min(lidar.range_max_m, *reach_m)


def test_every_class_but_sectors_can_be_sent() -> None:
    assert set(RAW_NAMES) == {sensor.value for sensor in SensorClass} - {"sectors"}
