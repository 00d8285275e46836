"""The lidar's closed form against a ray cast that knows nothing but points on a ray, and what a sector may say."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mission.common.frames import Vec3
from mission.schema.boxes import StandBox, box_of
from sim_bridge.world.sensors.box_scan import nearest_box_m
from sim_bridge.world.sensors.scan import RAYS, RAYS_PER_SECTOR, SECTORS, Cylinder, Plane, nearest_m

MAX_M = 8.0
SETTINGS = settings(max_examples=30)  # each casts 720 rays
STEP_M = 0.002
STEPS_M = np.arange(0.0, MAX_M, STEP_M)  # of the ray cast
GRAZES_M = 0.004  # of what a ray only grazes the steps of the cast, and rounding, may make either
Floats = NDArray[np.float64]
EXACT_M = 0.02  # the ray nearest to the axis is not quite the shortest where the airframe is tilted

angles = st.floats(-0.6, 0.6) | st.sampled_from((-0.5, -0.2, 0.2, 0.5))  # not level, most of them
places = st.tuples(st.floats(0.8, 8.5), st.floats(-math.pi, math.pi)).map(
    lambda polar: (polar[0] * math.cos(polar[1]), polar[0] * math.sin(polar[1]))
)
attitudes = st.tuples(angles, angles, st.floats(-math.pi, math.pi))
cylinders = st.tuples(places, st.floats(0.05, 0.7), st.just(-50.0), st.sampled_from((30.0, 0.4, 1.0)))
crowns = st.tuples(places, st.floats(0.5, 3.0), st.floats(2.0, 6.0), st.just(30.0))
standings = st.lists((cylinders | crowns).map(lambda drawn: (*drawn[0], *drawn[1:])), min_size=1, max_size=4)
blocks = st.builds(
    box_of,
    places,
    length_m=st.floats(0.2, 9.0),
    width_m=st.floats(0.2, 9.0),
    height_m=st.sampled_from((30.0, 2.0, 3.0)),
    rotation_deg=st.floats(-360.0, 360.0) | st.sampled_from((0.0, 90.0)),
)
grounds = st.tuples(st.floats(-2.0, 1.0), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))


def ray_direction(ray: int, attitude_rad: Vec3) -> Vec3:
    """NED, by three rotations one after the other: none of the formulas under test."""
    angle = math.tau * (ray - (RAYS_PER_SECTOR - 1) / 2.0) / RAYS
    roll, pitch, yaw = attitude_rad
    x, y, z = math.cos(angle), math.sin(angle), 0.0
    y, z = y * math.cos(roll) - z * math.sin(roll), y * math.sin(roll) + z * math.cos(roll)
    x, z = x * math.cos(pitch) + z * math.sin(pitch), -x * math.sin(pitch) + z * math.cos(pitch)
    x, y = x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw)
    return x, y, z


def walk(eye: Vec3, direction: Vec3, first_m: float, last_m: float) -> tuple[Floats, Floats, Floats, Floats]:
    """The steps of a ray between two distances: how far, and north, east and down there."""
    far_m = STEPS_M[max(0, int(first_m / STEP_M) - 1) : max(0, int(last_m / STEP_M) + 2)]
    return far_m, eye[0] + far_m * direction[0], eye[1] + far_m * direction[1], eye[2] + far_m * direction[2]


def cast_m(eye: Vec3, direction: Vec3, standing: list[Cylinder], ground: Plane | None, grown_m: float) -> float:
    """Walk along the ray until something is met, all of which is thicker by `grown_m`: no formula of an entry."""
    hits = [math.inf]
    level = math.hypot(direction[0], direction[1])
    for axis_n, axis_e, thin_m, low_m, high_m in standing:
        radius_m = thin_m + grown_m
        to_n, to_e = axis_n - eye[0], axis_e - eye[1]
        if abs(to_n * direction[1] - to_e * direction[0]) > radius_m * level:
            continue
        along_m = to_n * direction[0] + to_e * direction[1]  # of the level way: to where it is nearest to the axis
        far_m, n, e, down = walk(
            eye, direction, (along_m / level - radius_m) / level, (along_m / level + radius_m) / level
        )
        inside = (
            (low_m - grown_m <= -down) & (-down <= high_m + grown_m) & (np.hypot(n - axis_n, e - axis_e) <= radius_m)
        )
        hits += far_m[inside][:1].tolist()
    if ground is not None:
        falls = direction[2] + ground[1] * direction[0] + ground[2] * direction[1]
        height_m = -eye[2] - ground[0]
        if falls > 0.0 and height_m > 0.0:
            hits.append(height_m / falls)
    return min(hits)


def shortest_m(rays_m: Sequence[float]) -> list[float]:
    """Of each sector's rays."""
    return [min(rays_m[k : k + RAYS_PER_SECTOR]) for k in range(0, RAYS, RAYS_PER_SECTOR)]


def assert_between(told_m: list[float], nearest: list[float], farthest: list[float]) -> None:
    """Neither shorter than the rays to what stands, were that thicker, nor longer than if it were thinner."""
    for sector, (told, least_m, most_m) in enumerate(zip(told_m, nearest, farthest, strict=True)):
        assert told >= min(least_m, MAX_M) - EXACT_M, (sector, told, least_m)
        assert told <= most_m + EXACT_M or most_m > MAX_M - EXACT_M, (sector, told, most_m)
        assert told <= MAX_M or told == math.inf


@SETTINGS
@given(
    attitudes,
    standings,
    st.one_of(st.none(), grounds),
    st.floats(1.2, 4.0),
)
def test_each_sector_tells_the_shortest_of_its_rays(
    attitude_rad: Vec3, standing: list[Cylinder], ground: Plane | None, up_m: float
) -> None:
    eye = (0.0, 0.0, -up_m)
    told = nearest_m(eye, attitude_rad, standing, ground, MAX_M)
    if told == [0.0] * SECTORS:
        assert any(math.hypot(c[0], c[1]) <= c[2] and c[3] < up_m < c[4] for c in standing)
        return
    directions = [ray_direction(ray, attitude_rad) for ray in range(RAYS)]
    nearest, farthest = (
        shortest_m([cast_m(eye, direction, standing, ground, grown_m) for direction in directions])
        for grown_m in (GRAZES_M, -GRAZES_M)
    )
    assert_between(told, nearest, farthest)


def cast_at_boxes_m(eye: Vec3, direction: Vec3, standing: list[StandBox]) -> tuple[float, float]:
    """As cast_m, of thicker and of thinner boxes: the first step of the ray that is on the inner side of all walls."""
    n, e, down = (eye[axis] + STEPS_M * direction[axis] for axis in range(3))
    deepest_m = np.full(len(STEPS_M), -np.inf)
    for box in standing:
        corners = box.corners()
        deep_m = box.height_m + down
        for (a_e, a_n), (b_e, b_n) in zip(corners, (*corners[1:], corners[0]), strict=True):
            length_m = math.hypot(b_e - a_e, b_n - a_n)
            deep_m = np.minimum(deep_m, ((b_e - a_e) * (n - a_n) - (b_n - a_n) * (e - a_e)) / length_m)
        deepest_m = np.maximum(deepest_m, deep_m)
    thicker, thinner = (min(STEPS_M[deepest_m > at_m][:1].tolist(), default=math.inf) for at_m in (-GRAZES_M, GRAZES_M))
    return thicker, thinner


@SETTINGS
@given(attitudes, st.lists(blocks, min_size=1, max_size=3), st.floats(1.2, 4.0))
def test_each_sector_tells_the_shortest_of_its_rays_to_boxes(
    attitude_rad: Vec3, standing: list[StandBox], up_m: float
) -> None:
    eye = (0.0, 0.0, -up_m)
    told = nearest_box_m(eye, attitude_rad, [(box, box.height_m) for box in standing], MAX_M)
    directions = [ray_direction(ray, attitude_rad) for ray in range(RAYS)]
    thicker, thinner = zip(*[cast_at_boxes_m(eye, direction, standing) for direction in directions], strict=True)
    assert_between(told.tolist(), shortest_m(thicker), shortest_m(thinner))
