"""The cast of raw scans against one that knows only points on a ray: a lidar that moves, turns and leans meanwhile."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mission.common.frames import Vec3
from mission.schema.boxes import StandBox, box_of
from mission.schema.kinds import RawLidar
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.raw_scan import RayPattern, cast

Floats = NDArray[np.float64]
Moving = tuple[float, float, float, float, float, float, float]  # a cylinder, and its velocity north and east
LIDAR = RawLidar(15.0, (-30.0, 0.0, 4.0, 52.0), 12.0, 0.02, 0.0)
MAX_M = 12.0
PERIOD_S = 0.1
STEP_M = 0.004
STEPS_M = np.arange(0.0, MAX_M + 0.1, STEP_M)
GRAZES_M = 0.008  # of what a ray only grazes the steps of the cast may make either
EXACT_M = 0.01

angles = st.floats(-0.6, 0.6)
places = st.tuples(st.floats(-11.0, 11.0), st.floats(-11.0, 11.0))
speeds = st.floats(-6.0, 6.0)
states = st.builds(
    lambda pos, vel, attitude, rates: AirframeState(pos, vel, attitude, rates, False, 0.4),
    st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-4.0, -1.2)),
    st.tuples(speeds, speeds, st.floats(-2.0, 2.0)),
    st.tuples(angles, angles, st.floats(-math.pi, math.pi)),
    st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-3.0, 3.0)),
)
trunks = st.tuples(places, st.floats(0.05, 0.7), st.sampled_from([(-50.0, 30.0), (-50.0, 1.0), (2.0, 6.0), (2.0, 2.5)]))
standings = st.lists(
    st.tuples(trunks | st.tuples(places, st.floats(0.7, 3.0), st.just((3.0, 30.0))), st.tuples(speeds, speeds)).map(
        lambda drawn: (*drawn[0][0], drawn[0][1], *drawn[0][2], *drawn[1])
    ),
    max_size=5,
)
blocks = st.lists(
    st.builds(
        box_of,
        places,
        length_m=st.floats(0.2, 9.0),
        width_m=st.floats(0.2, 9.0),
        height_m=st.sampled_from((30.0, 2.0)),
        rotation_deg=st.floats(-180.0, 180.0),
    ),
    max_size=2,
)
grounds = st.tuples(st.floats(-2.0, 0.5), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))


def turned(vector: Floats, attitude_rad: Vec3) -> Floats:
    """From the body to NED by three rotations one after the other."""
    roll, pitch, yaw = attitude_rad
    x, y, z = vector
    y, z = y * math.cos(roll) - z * math.sin(roll), y * math.sin(roll) + z * math.cos(roll)
    x, z = x * math.cos(pitch) + z * math.sin(pitch), -x * math.sin(pitch) + z * math.cos(pitch)
    return np.array([x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw), z])


def earlier(vector: Floats, rates_radps: Vec3, age_s: float) -> Floats:
    """A vector of the body's axes of `age_s` ago, in those of now: by many small turns."""
    steps = 400
    small = -np.array(rates_radps) * age_s / steps
    for _ in range(steps):
        vector = vector + np.cross(small, vector)
    return vector / np.linalg.norm(vector)


def slow_m(
    eye: Floats,
    way: Floats,
    age_s: float,
    standing: Sequence[Moving],
    boxes: Sequence[StandBox],
    ground: tuple[Vec3, Floats],
    grown_m: float,
) -> float:
    """Walk along the ray until something is met, all of which is thicker by `grown_m`."""
    points = eye[:, None] + STEPS_M * way[:, None]
    inside = np.zeros(len(STEPS_M), dtype=bool)
    for north, east, radius, low, high, vel_n, vel_e in standing:
        off = np.hypot(points[0] - north + vel_n * age_s, points[1] - east + vel_e * age_s)
        inside |= (off < radius + grown_m) & (-points[2] > low - grown_m) & (-points[2] < high + grown_m)
    for box in boxes:
        x, y = box.local(points[1], points[0])  # type: ignore[arg-type] # works for arrays too
        inside |= (
            (np.abs(x) < box.along_m + grown_m)
            & (np.abs(y) < box.across_m + grown_m)
            & (-points[2] < box.height_m + grown_m)
        )
    (up_m, rise_n, rise_e), here = ground
    ground_up_m = up_m + rise_n * (points[0] - here[0]) + rise_e * (points[1] - here[1])
    if -points[2][0] > ground_up_m[0]:
        inside |= -points[2] < ground_up_m + grown_m
    met = np.flatnonzero(inside)
    return float(STEPS_M[met[0]]) if len(met) else math.inf


@settings(max_examples=25)
@given(states, standings, blocks, grounds, st.booleans())
def test_each_ray_is_told_as_it_was_at_its_own_time(
    state: AirframeState, standing: list[Moving], boxes: list[StandBox], ground: Vec3, upside_down: bool
) -> None:
    pattern = RayPattern(LIDAR, PERIOD_S, upside_down=upside_down)
    told_m = cast(
        pattern.rays(state, 0.25),
        np.array(standing).reshape(-1, 7),
        [(box, box.height_m) for box in boxes],
        ground,
        max_m=MAX_M,
        beam_deg=0.0,
    )
    assert told_m.shape == (4, 24)
    side = -1.0 if upside_down else 1.0
    last_eye = np.array(state.pos_ned_m) - (0.0, 0.0, 0.25)
    for layer, elevation_deg in enumerate(LIDAR.elevations_deg):
        for k in range(0, 24, 5):
            age_s = PERIOD_S * (23 - k) / 24
            bearing, elevation = math.radians(side * 15.0 * k), math.radians(side * elevation_deg)
            body = np.array(
                [
                    math.cos(elevation) * math.cos(bearing),
                    math.cos(elevation) * math.sin(bearing),
                    -math.sin(elevation),
                ]
            )
            way = turned(earlier(body, state.rates_radps, age_s), state.attitude_rad)
            eye = last_eye - age_s * np.array(state.vel_ned_mps)
            thick, thin = (
                slow_m(eye, way, age_s, standing, boxes, (ground, last_eye), grown_m)
                for grown_m in (GRAZES_M, -GRAZES_M)
            )
            told = float(told_m[layer, k])
            assert told <= MAX_M or told == math.inf
            assert told >= min(thick, MAX_M) - EXACT_M, (layer, k, told, thick)
            assert told <= thin + EXACT_M + STEP_M or thin > MAX_M - EXACT_M - STEP_M, (layer, k, told, thin)


@settings(max_examples=25)
@given(st.floats(1.0, 11.0), st.floats(-math.pi, math.pi), st.floats(0.05, 0.5), st.floats(0.1, 1.0))
def test_a_beam_tells_the_nearest_of_what_is_in_it(
    away_m: float, bearing: float, radius_m: float, beam_deg: float
) -> None:
    """Against a fan of rays without width."""
    standing = np.array([[away_m * math.cos(bearing), away_m * math.sin(bearing), radius_m, -50.0, 50.0, 0.0, 0.0]])
    ground = (-9.0, 0.0, 0.0)
    pattern = RayPattern(RawLidar(1.0, (0.0,), 12.0, 0.02, beam_deg), PERIOD_S)

    def told_m(yaw_rad: float, beam_deg: float) -> Floats:
        state = AirframeState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, yaw_rad), (0.0, 0.0, 0.0), False, 0.4)
        return cast(pattern.rays(state, 0.0), standing, [], ground, max_m=MAX_M, beam_deg=beam_deg)[0]

    fan = np.min([told_m(math.radians(off), 0.0) for off in np.linspace(-beam_deg / 2, beam_deg / 2, 41)], axis=0)
    told = told_m(0.0, beam_deg)
    both = np.isfinite(fan) & np.isfinite(told)
    assert both.sum() >= np.isfinite(fan).sum() - 2  # the fan ends, and the beam, at an edge
    assert np.isfinite(told).sum() <= both.sum() + 2
    inner = both & np.roll(both, 1) & np.roll(both, -1)  # at an edge a fan of some rays is not its nearest
    assert np.abs(fan[inner] - told[inner]).max(initial=0.0) < 0.02 + 0.1 * radius_m
