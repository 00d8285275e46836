"""The lidar's closed form against a ray cast that knows nothing but points on a ray, and what a sector may say."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.common.frames import Vec3
from mission.schema.boxes import StandBox, box_of
from sim_bridge.world.sensors.box_scan import nearest_box_m
from sim_bridge.world.sensors.scan import RAYS, RAYS_PER_SECTOR, SECTORS, Cylinder, Plane, nearest_m

MAX_M = 8.0
SETTINGS = settings(max_examples=30)  # each casts 720 rays
STEPS_M = np.arange(0.0, MAX_M, 0.002)  # of the ray cast
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


def cast_m(eye: Vec3, direction: Vec3, standing: list[Cylinder], ground: Plane | None) -> float:
    """Walk along the ray until something is met: no formula of an entry."""
    hits = [math.inf]
    for axis_n, axis_e, radius_m, low_m, high_m in standing:
        to_n, to_e = axis_n - eye[0], axis_e - eye[1]
        level = math.hypot(direction[0], direction[1])
        beside = (to_n * direction[1] - to_e * direction[0]) / level
        if abs(beside) > radius_m:
            continue
        n, e, down = (eye[axis] + STEPS_M * direction[axis] for axis in range(3))
        inside = (low_m <= -down) & (-down <= high_m) & (np.hypot(n - axis_n, e - axis_e) <= radius_m)
        hits += STEPS_M[inside][:1].tolist()
    if ground is not None:
        falls = direction[2] + ground[1] * direction[0] + ground[2] * direction[1]
        height_m = -eye[2] - ground[0]
        if falls > 0.0 and height_m > 0.0:
            hits.append(height_m / falls)
    return min(hits)


def brute_m(eye: Vec3, attitude_rad: Vec3, standing: list[Cylinder], ground: Plane | None) -> list[list[float]]:
    """The ranges of each sector's rays."""
    rays = [cast_m(eye, ray_direction(ray, attitude_rad), standing, ground) for ray in range(RAYS)]
    return [rays[k * RAYS_PER_SECTOR : (k + 1) * RAYS_PER_SECTOR] for k in range(SECTORS)]


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
    for sector, rays in zip(told, brute_m(eye, attitude_rad, standing, ground), strict=True):
        shortest, second = sorted(rays)[:2]
        edge = second - shortest > EXACT_M  # one ray alone meets something: where it grazes it, either answer is right
        if shortest < MAX_M - EXACT_M and sector < MAX_M:
            assert abs(sector - shortest) <= EXACT_M or (edge and abs(sector - second) <= EXACT_M)
        else:
            assert sector >= MAX_M - EXACT_M or edge
            assert shortest >= MAX_M - EXACT_M or edge


def cast_at_boxes_m(eye: Vec3, direction: Vec3, standing: list[StandBox]) -> float:
    """As cast_m: the first step of the ray that has the same side of all four walls as the middle."""
    n, e, down = (eye[axis] + STEPS_M * direction[axis] for axis in range(3))
    inside = np.zeros(len(STEPS_M), np.bool_)
    for box in standing:
        corners = box.corners()
        within = -down < box.height_m
        for (a_e, a_n), (b_e, b_n) in zip(corners, (*corners[1:], corners[0]), strict=True):
            within &= (b_e - a_e) * (n - a_n) - (b_n - a_n) * (e - a_e) > 0.0
        inside |= within
    hits: list[float] = STEPS_M[inside][:1].tolist()
    return hits[0] if hits else math.inf


@SETTINGS
@given(attitudes, st.lists(blocks, min_size=1, max_size=3), st.floats(1.2, 4.0))
def test_each_sector_tells_the_shortest_of_its_rays_to_boxes(
    attitude_rad: Vec3, standing: list[StandBox], up_m: float
) -> None:
    eye = (0.0, 0.0, -up_m)
    told = nearest_box_m(eye, attitude_rad, [(box, box.height_m) for box in standing], MAX_M)
    rays = [cast_at_boxes_m(eye, ray_direction(ray, attitude_rad), standing) for ray in range(RAYS)]
    for k, sector in enumerate(told.tolist()):
        shortest, second = sorted(rays[k * RAYS_PER_SECTOR : (k + 1) * RAYS_PER_SECTOR])[:2]
        grazed = second - shortest > EXACT_M or sector < shortest  # across a corner, between two steps of the cast
        if shortest < MAX_M - EXACT_M and sector < MAX_M:
            assert abs(sector - shortest) <= EXACT_M or grazed
        else:
            assert sector >= MAX_M - EXACT_M or grazed
            assert shortest >= MAX_M - EXACT_M or grazed
