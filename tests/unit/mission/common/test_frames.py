"""Frames, against the ellipsoid's own geometry (earth-centred coordinates), not against themselves."""

from __future__ import annotations

import math

import pytest

from mission.common.frames import (
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_AXIS_M,
    LocalFrame,
    Vec3,
    Wgs84,
    enu_to_ned,
    ned_to_enu,
)

ORIGINS = [
    Wgs84(49.5, 6.36, 310.0),
    Wgs84(-3.1, -60.0, 90.0),
    Wgs84(0.0, 179.99, 0.0),
    Wgs84(68.0, 20.0, 500.0),
]


def ecef_m(point: Wgs84) -> Vec3:
    lat, lon = math.radians(point.lat_deg), math.radians(point.lon_deg)
    n = SEMI_MAJOR_AXIS_M / math.sqrt(1.0 - ECCENTRICITY_SQUARED * math.sin(lat) ** 2)
    return (
        (n + point.alt_m) * math.cos(lat) * math.cos(lon),
        (n + point.alt_m) * math.cos(lat) * math.sin(lon),
        (n * (1.0 - ECCENTRICITY_SQUARED) + point.alt_m) * math.sin(lat),
    )


def tangent_ned_m(origin: Wgs84, point: Wgs84) -> Vec3:
    lat, lon = math.radians(origin.lat_deg), math.radians(origin.lon_deg)
    x, y, z = (b - a for a, b in zip(ecef_m(origin), ecef_m(point), strict=True))
    level = math.cos(lon) * x + math.sin(lon) * y
    return (
        -math.sin(lat) * level + math.cos(lat) * z,
        -math.sin(lon) * x + math.cos(lon) * y,
        -(math.cos(lat) * level + math.sin(lat) * z),
    )


def test_enu_and_ned_swap_the_level_axes_and_turn_the_vertical_over() -> None:
    assert enu_to_ned((1.0, 2.0, 3.0)) == (2.0, 1.0, -3.0)
    assert ned_to_enu(enu_to_ned((1.0, 2.0, 3.0))) == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("origin", ORIGINS)
def test_the_origin_is_zero(origin: Wgs84) -> None:
    assert LocalFrame(origin).to_ned(origin) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("pos_ned_m", [(212.0, 0.0, -8.0), (0.0, -212.0, 0.0), (200.0, 200.0, -30.0)])
def test_within_300_m_it_departs_from_the_true_tangent_frame_by_less_than_2_cm(origin: Wgs84, pos_ned_m: Vec3) -> None:
    point = LocalFrame(origin).to_wgs84(pos_ned_m)

    assert math.dist(tangent_ned_m(origin, point), pos_ned_m) < 0.02


@pytest.mark.parametrize(("origin_deg", "there_deg"), [(179.9999, -179.9999), (-179.9999, 179.9999)])
def test_antimeridian_is_no_step(origin_deg: float, there_deg: float) -> None:
    origin, there = Wgs84(-17.0, origin_deg, 0.0), Wgs84(-17.0, there_deg, 0.0)
    found = LocalFrame(origin).to_ned(there)
    assert found == pytest.approx(tangent_ned_m(origin, there), abs=0.02)
    assert math.hypot(*found) < 25.0


@pytest.mark.parametrize("origin", ORIGINS)
def test_there_and_back_is_exact_to_a_micrometre_at_20_km(origin: Wgs84) -> None:
    frame = LocalFrame(origin)
    pos_ned_m = (-14_000.0, 13_000.0, -130.0)

    assert math.dist(frame.to_ned(frame.to_wgs84(pos_ned_m)), pos_ned_m) < 1e-6
