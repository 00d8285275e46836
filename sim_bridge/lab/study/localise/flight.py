"""One flight's measurements through the estimators of some of its vehicles, and how far off they are."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from companion.core.agent import TICK_S
from companion.core.localisation.gnss_denied.error_state import Errors, Level
from companion.core.localisation.gnss_denied.relative_filter import RelativeFilter
from sim_bridge.lab.study.law import Floats
from sim_bridge.lab.study.localise.paths import Paths
from sim_bridge.lab.study.localise.sensors import BEACON_TICKS, FLIGHT_TICKS, Measured, Range, Sensors

LOOK_TICKS = 20


@dataclass(slots=True)
class Seen:
    """Estimates of one vehicle against the truth, every LOOK_TICKS. K neighbours."""

    off_ne_m: Floats  # (L, K, 2) estimated less true
    cov_m2: Floats  # (L, 2K, 2K)
    off_own_m: Floats  # (L, K, 2) the same along the north of its own compass
    turned_rad: Floats  # (L,) by how much the formation is turned about the vehicle
    rotation_sd_rad: Floats  # (L,) what the estimator says of that
    nis: float
    dropped: float  # share of measurements
    cpu_share: float  # of a core


def believed(sensors: Sensors) -> Errors:
    """Error model that an estimator gets of its sensors: all but that ranges may come late."""
    return Errors(
        velocity_mps=sensors.velocity_mps,
        velocity_s=BEACON_TICKS * TICK_S,
        bias_mps=sensors.bias_mps,
        bias_s=sensors.bias_s,
        yaw_rad=math.radians(sensors.yaw_deg),
        yaw_s=sensors.yaw_s,
        range_m=sensors.range_m,
        bearing_rad=math.radians(sensors.bearing_deg),
    )


def fly(paths: Paths, measured: Measured, errors: Errors, observer: int, start_m: float) -> Seen:
    """The estimator of the vehicle in row `observer`; ids are rows + 1. `start_m`: how far off each starts."""
    ticks, n, _ = paths.pos_ne_m.shape
    me = RelativeFilter(errors)
    others = [row for row in range(n) if row != observer]
    positions = measured.starts_ne_m - measured.starts_ne_m[observer]
    me.initialise({row + 1: (float(positions[row][0]), float(positions[row][1])) for row in others}, start_m)
    odo, vel = measured.odo_ne_m.tolist(), measured.vel_ne_mps.tolist()
    off: list[Floats] = []
    cov: list[Floats] = []
    own: list[Floats] = []
    turned: list[float] = []
    sd: list[float] = []
    cpu_s = 0.0
    for tick in range(ticks):
        now_s = tick * TICK_S
        began = time.process_time()
        me.update_odometry(_level(odo[tick][observer]), _level(vel[tick][observer]), now_s)
        if tick >= FLIGHT_TICKS:
            sent = tick - FLIGHT_TICKS
            for beacon in measured.broadcasts[sent]:
                if beacon.sender != observer and beacon.heard[observer]:
                    there, fast = _level(odo[sent][beacon.sender]), _level(vel[sent][beacon.sender])
                    me.update_peer_odometry(beacon.sender + 1, there, fast, FLIGHT_TICKS * TICK_S, now_s)
                    for one in beacon.ranges:
                        if observer not in (one.a, one.b):
                            _range(me, one, observer, tick)
        for one in measured.ranges[tick]:
            if observer in (one.a, one.b):
                _range(me, one, observer, tick)
        for seer, seen, north_rad in measured.bearings[tick]:
            if seer == observer:
                me.update_bearing(seen + 1, north_rad, now_s)
        me.advance(now_s)
        cpu_s += time.process_time() - began
        if tick % LOOK_TICKS == 0 and tick:
            true = paths.pos_ne_m[tick][others] - paths.pos_ne_m[tick][observer]
            told_ne = np.array([found.ne_m for row in others if (found := me.relative(row + 1)) is not None])
            off.append(told_ne - true)
            cov.append(np.array(me.covariance_m2))
            own.append(_turned(told_ne, me.compass[0]) - _turned(true, float(measured.yaw_rad[tick, observer])))
            across = np.column_stack([-told_ne[:, 1], told_ne[:, 0]])
            turned.append(float((across * off[-1]).sum() / (across * across).sum()))
            sd.append(me.rotation_sd_rad)
    share = cpu_s / (ticks * TICK_S)
    gate = me.gate
    dropped = gate.dropped / max(1, gate.used + gate.dropped)
    return Seen(np.array(off), np.array(cov), np.array(own), np.array(turned), np.array(sd), gate.nis, dropped, share)


def _level(pair: list[float]) -> Level:
    north, east = pair
    return north, east


def _range(me: RelativeFilter, one: Range, observer: int, tick: int) -> None:
    a, b = (one.b, one.a) if one.b == observer else (one.a, one.b)
    me.update_range(None if a == observer else a + 1, b + 1, one.metres, (tick - one.tick) * TICK_S, tick * TICK_S)


def _turned(ne: Floats, yaw_rad: float) -> Floats:
    """As a compass has it that is wrong by `yaw_rad`."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.asarray(ne @ np.array([[c, -s], [s, c]]))
