"""Own motion by what a vehicle sees: its position, heading and velocity corrected against trunks that stand still.

The pose comes from `scan_odometry`; how the corrected position changes tells what is wrong with the reported velocity.
While there is too little to see, all is as reported.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.events import Position
from companion.core.model.velocity_bias import BANDWIDTH_PER_S, VelocityBias
from companion.core.perception.landmarks.trunk_tracks import Sighting
from companion.core.perception.level_scan import LevelScan, ScanClass
from companion.core.perception.scan_odometry import ScanOdometry
from companion.core.perception.vehicles.vehicle_tracks import VehicleTracks
from mission.common.frames import Vec3

# Of the observer while trunks correct the position to centimetres: it follows an error that is half forgotten in 2.5 s
CORRECTED_PER_S: Final = 4.0
# Estimators are hardly ever so wrong (0.25 m/s rms an axis): what is taken for trunks moves, as a formation does
BIAS_MAX_MPS: Final = 0.9
RECKONS_BIAS_MAX_MPS: Final = 1.6  # by inertial sensors alone more comes to it, up to 1.25 m/s
OTHERS: Final = 255  # vehicles of a swarm whose size is not told
FADES_S: Final = 4.0  # after the last correction, until the observer has found back to what positions alone say


@final
class OwnMotion:
    """One vehicle's, in the order of a tick: positions, then whole turns of its sensors.

    With GNSS the flight goes by reported positions, as its neighbours' are from the same satellites, and only what is
    seen is placed by corrected ones. In a swarm where not all have it, positions are odometry, of which differences
    count, and the flight goes by corrected ones: those with satellites too, whose fixes wander by a metre in seconds.
    From the moment on at which a fix is lost it goes by the last good position, and the way since by trunks.
    """

    __slots__ = (
        "_is_odometry",
        "_observer",
        "_others",
        "_shift_then_m",
        "odometry",
        "vehicles",
        "velocity_bias_ne_mps",
    )

    def __init__(
        self,
        kind: ScanClass,
        *,
        turns_with_yaw: bool,
        is_odometry: bool = False,
        hull_m: float = 0.0,
        others: int = OTHERS,
    ) -> None:
        """`is_odometry`: the flight goes by corrected positions; `hull_m`: a vehicle's radius.

        `others`: vehicles of the swarm besides this one; `turns_with_yaw`: as `ScanOdometry` has it.
        """
        self._others: Final = others
        self._is_odometry: Final = is_odometry
        self.odometry: Final = ScanOdometry(kind, turns_with_yaw=turns_with_yaw, hull_m=hull_m)
        self.vehicles: Final = VehicleTracks()
        self._observer: Final = VelocityBias()
        # True velocity less reported, level; None: nothing has been seen to tell it by
        self.velocity_bias_ne_mps: tuple[float, float] | None = None
        # Of the odometry, when the fix was lost that positions went by; None: it is there
        self._shift_then_m: tuple[float, float] | None = None

    @property
    def turn_rad(self) -> float:
        """To be added to the reported yaw."""
        return self.odometry.turn_rad

    def correct_place(self, pos_ned_m: Vec3) -> Vec3:
        """A position that the flight goes by, as trunks have it."""
        if self._is_odometry:
            return pos_ned_m
        then_m = self._shift_then_m
        if then_m is None:
            return self.odometry.correct_place(pos_ned_m)
        return (pos_ned_m[0] + then_m[0], pos_ned_m[1] + then_m[1], pos_ned_m[2])

    def correct_position(self, own: Position) -> Position:
        """The same of a position with its velocity, which stays as it is."""
        return Position(self.correct_place(own.pos_ned_m), own.vel_ned_mps, own.boot_s)

    def reckon_from(self, led_ne_m: tuple[float, float], reported: Position, turned_rad: float) -> None:
        """The fix was led astray: trunks have the vehicle at `led_ne_m` where it is `reported`.

        From now on it `reckons`. `turned_rad`: by how much the trunks' frame has been turned by motion that was not.
        """
        self.odometry.turn_frame(-turned_rad)
        placed = self.odometry.correct_place(reported.pos_ned_m)
        self._shift_then_m = (placed[0] - led_ne_m[0], placed[1] - led_ne_m[1])

    def reckon_anew(self) -> None:
        """The next position is where the vehicle is: trunks correct the way from there on."""
        self._shift_then_m = None

    def velocity_bias(self, otherwise: Vec3) -> Vec3:
        """True velocity less the one that the flight goes by; `otherwise`: what is known of it without trunks."""
        if self.velocity_bias_ne_mps is None or self._is_odometry:
            return otherwise
        return (*self._as_far_as_seen((otherwise[0], otherwise[1])), otherwise[2])

    def setpoint_bias(self, otherwise: Vec3) -> Vec3:
        """True velocity less the one that the autopilot holds."""
        seen = self.velocity_bias_ne_mps
        if seen is None or not self._is_odometry:
            return self.velocity_bias(otherwise)
        by_sight = self._as_far_as_seen((0.0, 0.0))
        return (otherwise[0] + by_sight[0], otherwise[1] + by_sight[1], otherwise[2])

    def _as_far_as_seen(self, otherwise: tuple[float, float]) -> tuple[float, float]:
        """The bias by sight; along a wall that is all there is to see: `otherwise`."""
        seen, along = self.velocity_bias_ne_mps, self.odometry.corrected_along
        if seen is None:
            return otherwise
        if along is None:
            return seen
        more_mps = (seen[0] - otherwise[0]) * along[0] + (seen[1] - otherwise[1]) * along[1]
        return otherwise[0] + more_mps * along[0], otherwise[1] + more_mps * along[1]

    def receive_position(self, own: Position, now_s: float, *, reckons: bool = False) -> Position:
        """Takes in the autopilot's position and velocity as they come; returns what the flight goes by.

        `reckons`: the autopilot goes on without the fix that it had.
        """
        odometry = self.odometry
        odometry.reckons = reckons
        odometry.receive_position(own, now_s)
        if not reckons:
            self._shift_then_m = None
        elif self._shift_then_m is None:
            self._shift_then_m = odometry.shift_m
        placed = odometry.correct_place(own.pos_ned_m)
        if odometry.corrected_s > -math.inf:
            self._observe_velocity(placed, own, now_s, reckons=reckons)
        if not self._is_odometry:
            then_m = self._shift_then_m
            if then_m is None or then_m == odometry.shift_m:
                return own
            return Position((placed[0] - then_m[0], placed[1] - then_m[1], placed[2]), own.vel_ned_mps, own.boot_s)
        vel = own.vel_ned_mps
        if self.velocity_bias_ne_mps is not None:
            by_sight = self._as_far_as_seen((0.0, 0.0))
            vel = (vel[0] + by_sight[0], vel[1] + by_sight[1], vel[2])
        return Position(placed, vel, own.boot_s)

    def _observe_velocity(self, placed: Vec3, own: Position, now_s: float, *, reckons: bool) -> None:
        """By how the corrected position changes."""
        odometry, observer = self.odometry, self._observer
        observer.bandwidth_per_s = CORRECTED_PER_S if odometry.is_corrected(now_s) else BANDWIDTH_PER_S
        observer.update(placed, own.vel_ned_mps, now_s if own.boot_s is None else own.boot_s)
        bias = observer.ned_mps
        # More trunks than there are vehicles are no formation: then it is the estimator that is so wrong
        may_err = reckons or odometry.corrected_by > self._others
        if math.hypot(bias[0], bias[1]) > (RECKONS_BIAS_MAX_MPS if may_err else BIAS_MAX_MPS):
            odometry.disprove(now_s)
            self._forget_velocity()
        else:
            self.velocity_bias_ne_mps = (bias[0], bias[1]) if now_s - odometry.corrected_s <= FADES_S else None

    def _forget_velocity(self) -> None:
        self._observer.begin_anew()
        self.velocity_bias_ne_mps = None

    def integrate_turn(
        self,
        scan: LevelScan,
        yaw_rad: float,
        own: Position,
        peers: Sequence[Vec3],
        now_s: float,
        *,
        unheard: int = 0,
        hovering: Sequence[Vec3] = (),
    ) -> Sequence[Sighting]:
        """A whole turn, placed by the corrected pose, as is `own`; its stems. `peers`: relative, NED m: no trunks.

        `unheard`: as `ScanOdometry.integrate_scan`; `hovering`: places of hulls, in the frame of the turns: no trunks.
        """
        north, east, _ = own.pos_ned_m
        heard = [(north + rel[0], east + rel[1], rel[2]) for rel in peers]
        at = [*heard, *self.vehicles.places(), *hovering]
        stems = self.odometry.integrate_scan(scan, yaw_rad, at, now_s, unheard=unheard)
        if self.odometry.corrected_s == -math.inf:
            self._forget_velocity()
        others = [one for one in stems if one.trunk is None or not one.trunk.is_good]
        self.vehicles.integrate_sightings(others, scan, now_s, hovering, heard)
        return stems
