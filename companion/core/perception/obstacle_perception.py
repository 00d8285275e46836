"""Builds the local obstacle cloud, once a tick: with an obstacle sensor from its scans too, without one of the rest.

Which of the two a vehicle has is chosen when it is built (`build_perception`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

from companion.core.model.beacon import PeerReport
from companion.core.model.events import AnyScan, ObstacleScan, Position
from companion.core.model.neighbour import Neighbour, find_hover_places
from companion.core.perception.columns.column_map import ColumnMap
from companion.core.perception.landmarks.solitary_trunks import SolitaryTrunks, find_solitary
from companion.core.perception.landmarks.stem_clusters import LEAVES_M
from companion.core.perception.level_scan import LevelScan, ScanClass, level_scan_of
from companion.core.perception.lidar_mapper import LidarMapper
from companion.core.perception.motion_margin import find_wider_m
from companion.core.perception.obstacle_cloud import LocalObstacleCloud, Obstacle, ObstacleKind, trunks_of
from companion.core.perception.obstacle_map import ObstacleMap
from companion.core.perception.obstacle_memory import ObstacleMemory
from companion.core.perception.own_motion import OwnMotion
from companion.core.perception.scan_noise import ScanNoise
from companion.core.perception.scan_odometry import EXPECTED_LEAST
from companion.core.perception.sight import SightHistory
from companion.core.perception.vehicles.ghost_tracks import GhostTracks
from companion.core.perception.vehicles.hovering_hulls import HoveringHulls
from companion.core.perception.vehicles.vehicle_tracks import SeenVehicle
from companion.core.perception.yaw_correction import turned_rays, turned_sectors
from mission.common.frames import Vec3
from mission.document.model import Mission, Sensing
from mission.rules.rise_rules import ABOVE_M

NEAR_M: Final = 3.0  # what is farther off is in nobody's way who stays
BEYOND_M: Final = 1.0  # points this far beyond the sensor's range still matter: they were seen on the way
NEIGHBOUR_NEARER_M: Final = 0.5  # than separation wants: half of its hull, and a little
# What is known of how the trunks' frame is turned, at best: by sectors, at 3 m/s among 391 trees/ha, it turned by 3.6
# degrees when its filter thought to know it to 0.7 (bench `spoofing`, seed 6003)
FRAME_RAD: Final = math.radians(1.0)
FRAME_BY_SECTORS_RAD: Final = math.radians(2.0)
IN_THE_OPEN: tuple[bool, ...] = (False,)  # one bearing, all round: nothing is blind


@dataclass(slots=True, init=False, unsafe_hash=True)
class SeenWay:
    """The own position as trunks have it, north and east, m, in their frame, and how far that may be turned."""

    ne_m: Final[tuple[float, float]]
    frame: Final[tuple[float, float, float]]  # as ScanOdometry.frame
    frame_rad2: Final[float]  # as ScanOdometry.frame_rad2, or more

    def __init__(self, ne_m: tuple[float, float], frame: tuple[float, float, float], frame_rad2: float) -> None:
        self.ne_m = ne_m
        self.frame = frame
        self.frame_rad2 = frame_rad2


class ObstaclePerception(ABC):
    """Base: trunks of the mission, and vehicles that hover, which every make has."""

    def __init__(self, mission: Mission, stale_s: float) -> None:
        """`stale_s`: how old a scan may be to be flown by; inf: it flies by none."""
        self.stale_s: Final = stale_s
        self._trunks: Final = trunks_of(mission)
        self._apart_m: Final = mission.separation.hard_m

    @abstractmethod
    def integrate_scan(
        self, scan: AnyScan, own: Position, now_s: float, neighbours: Sequence[Vec3], unheard: int = 0
    ) -> None:
        """Takes in a scan. `neighbours`: relative, NED m: no trunks; `unheard`: vehicles that may be anywhere."""

    @abstractmethod
    def observe_obstacles(
        self,
        own_ned_m: Vec3,
        placed_ned_m: Vec3,
        hovering: Mapping[int, PeerReport],
        now_s: float,
        seen: Sequence[SeenVehicle] = (),
    ) -> LocalObstacleCloud:
        """The cloud about a vehicle: own position by odometry, and in the mission's frame (`placed_ned_m`).

        `seen`: as of `find_vehicles`.
        """

    def correct_odometry(self, own: Position, now_s: float, *, reckons: bool = False) -> Position:  # noqa: ARG002
        """Takes in the autopilot's position and velocity as they come; returns what the flight goes by.

        `reckons`: the autopilot goes on without the fix that it had. Without a sensor they are all there is.
        """
        return own

    def correct_place(self, pos_ned_m: Vec3) -> Vec3:
        """A place that the flight goes by, as trunks have it; without a sensor the same."""
        return pos_ned_m

    def read_way(self, reported: Position, now_s: float) -> SeenWay | None:  # noqa: ARG002
        """The position that trunks give the vehicle that is reported there; None: nothing seen tells it now."""
        return None

    @abstractmethod
    def reckon_from(self, led_ne_m: tuple[float, float], reported: Position, turned_rad: float) -> None:
        """As `OwnMotion.reckon_from`, after `read_way` has told one."""

    def reckon_anew(self) -> None:  # noqa: B027 - without a sensor nothing is reckoned
        """As `OwnMotion.reckon_anew`."""

    def velocity_bias(self, otherwise: Vec3) -> Vec3:
        """True velocity less the one that the flight goes by, NED m/s; `otherwise`: as far as nothing seen tells it."""
        return otherwise

    def setpoint_bias(self, otherwise: Vec3) -> Vec3:
        """True velocity less the one that the autopilot holds, NED m/s; `otherwise`: as before."""
        return otherwise

    @property
    def sees_motion(self) -> bool:
        """The own motion is corrected by trunks in sight."""
        return False

    def find_solitary_trunks(self, flown: Position, now_s: float) -> SolitaryTrunks | None:  # noqa: ARG002
        """Trunks that may be told, about a vehicle that flies by this position; None: nothing seen tells its motion."""
        return None

    def take_odometry(self) -> bool:
        """True once for each turn that tells the own motion, where the mission has the autopilot told of it."""
        return False

    def find_vehicles(
        self,
        own_ned_m: Vec3,  # noqa: ARG002
        heard: Sequence[Neighbour],  # noqa: ARG002
        now_s: float,  # noqa: ARG002
    ) -> Sequence[SeenVehicle]:
        """Vehicles that are seen, and which of them are `heard`: without a sensor none."""
        return ()

    def clear_ghosts(
        self,
        silent: dict[int, PeerReport],
        own_ned_m: Vec3,  # noqa: ARG002
        now_s: float,  # noqa: ARG002
        reported: Sequence[Vec3] = (),  # noqa: ARG002
    ) -> dict[int, PeerReport]:
        """Of those that fell silent, the ones that may hover where they are reckoned to be: without a sensor all."""
        return silent

    def nearest_m(self, own: Position | None) -> float:  # noqa: ARG002
        """Level distance of what was seen nearest: without a sensor inf."""
        return math.inf

    def sees_several(self, own: Position | None) -> bool:  # noqa: ARG002
        """Several things stand within the sensor's range: without a sensor nothing is seen."""
        return False

    def _trunks_from(self, placed_ned_m: Vec3) -> list[Obstacle]:
        return [trunk.seen_from(placed_ned_m) for trunk in self._trunks]

    def _hovering(self, hovering: Mapping[int, PeerReport], seen: Sequence[SeenVehicle]) -> list[Obstacle]:
        found = [Obstacle(ObstacleKind.SILENT, one.rel_ned_m, self._apart_m) for one in seen if one.rests]
        for sighting in hovering.values():
            kind = ObstacleKind.SILENT if sighting.silent else ObstacleKind.HOVERING
            found += [Obstacle(kind, rel, self._apart_m) for rel in find_hover_places([sighting])]
        return found


@final
class OpenSkyPerception(ObstaclePerception):
    """Without an obstacle sensor: nothing is seen, and nothing is blind."""

    def __init__(self, mission: Mission) -> None:
        super().__init__(mission, math.inf)

    def integrate_scan(
        self, scan: AnyScan, own: Position, now_s: float, neighbours: Sequence[Vec3], unheard: int = 0
    ) -> None:
        """It has no sensor: of no use."""

    def reckon_from(self, led_ne_m: tuple[float, float], reported: Position, turned_rad: float) -> None:
        """It never tells a way."""

    def observe_obstacles(
        self,
        own_ned_m: Vec3,  # noqa: ARG002
        placed_ned_m: Vec3,
        hovering: Mapping[int, PeerReport],
        now_s: float,  # noqa: ARG002
        seen: Sequence[SeenVehicle] = (),
    ) -> LocalObstacleCloud:
        """Of known obstacles alone."""
        return LocalObstacleCloud(
            math.inf, IN_THE_OPEN, trunks=self._trunks_from(placed_ned_m), hovering=self._hovering(hovering, seen)
        )


@final
class SensingPerception(ObstaclePerception):
    """With an obstacle sensor: its scans, as far and for as long as they count."""

    def __init__(
        self, mission: Mission, sensing: Sensing, *, turns_with_yaw: bool = False, is_odometry: bool = False
    ) -> None:
        """`turns_with_yaw`, `is_odometry`: as `OwnMotion` has it."""
        super().__init__(mission, sensing.stale_s)
        self._map: Final = ObstacleMap(mission.separation.hard_m - NEIGHBOUR_NEARER_M)
        self._hulls: Final = HoveringHulls()
        self._mapper: Final = LidarMapper(self._map, self._hulls)
        self._memory: Final = ObstacleMemory()
        self._sight: Final = SightHistory()
        self._kind: Final = ScanClass(sensing.sensor)
        self._noise: Final = ScanNoise(self._kind)
        self._has_widths: Final = self._kind.has_widths
        self._sends_odometry: Final = sensing.sends_odometry and not turns_with_yaw
        self._odometry_s = -math.inf  # the turn that was taken last
        self._frame_rad2: Final = (FRAME_RAD if self._has_widths else FRAME_BY_SECTORS_RAD) ** 2
        self._others: Final = mission.swarm.size - 1
        self._ghosts: Final = GhostTracks()
        self._margin_m: Final = sensing.margin_m
        self._clear_m: Final = sensing.vehicle_radius_m + sensing.margin_m
        hull_m = sensing.vehicle_radius_m
        self.motion: Final = OwnMotion(
            self._kind, turns_with_yaw=turns_with_yaw, is_odometry=is_odometry, hull_m=hull_m, others=self._others
        )
        # Laid where a leader may rise alone: without that it looks at no ray
        self.columns: Final = ColumnMap(clear_m=self._clear_m, top_up_m=mission.ceiling_m + ABOVE_M)

    def correct_place(self, pos_ned_m: Vec3) -> Vec3:
        """By the own motion."""
        return self.motion.correct_place(pos_ned_m)

    def correct_odometry(self, own: Position, now_s: float, *, reckons: bool = False) -> Position:
        """As `OwnMotion.receive_position`."""
        return self.motion.receive_position(own, now_s, reckons=reckons)

    def read_way(self, reported: Position, now_s: float) -> SeenWay | None:
        """By the own motion, in all directions. Beside a wall none: what stands out from it may be others in flight."""
        odometry = self.motion.odometry
        if not odometry.is_corrected(now_s) or odometry.corrected_along is not None:
            return None
        placed = odometry.correct_place(reported.pos_ned_m)
        return SeenWay((placed[0], placed[1]), odometry.frame, max(odometry.frame_rad2, self._frame_rad2))

    def reckon_from(self, led_ne_m: tuple[float, float], reported: Position, turned_rad: float) -> None:
        """As `OwnMotion.reckon_from`."""
        self.motion.reckon_from(led_ne_m, reported, turned_rad)

    def reckon_anew(self) -> None:
        """As `OwnMotion.reckon_anew`."""
        self.motion.reckon_anew()

    def velocity_bias(self, otherwise: Vec3) -> Vec3:
        """By the own motion."""
        return self.motion.velocity_bias(otherwise)

    def setpoint_bias(self, otherwise: Vec3) -> Vec3:
        """By the own motion."""
        return self.motion.setpoint_bias(otherwise)

    def integrate_scan(
        self, scan: AnyScan, own: Position, now_s: float, neighbours: Sequence[Vec3], unheard: int = 0
    ) -> None:
        """Into the obstacle map, as the pose by trunks has it; whole turns correct that pose."""
        placed, turn_rad = self.motion.correct_position(own), self.motion.turn_rad
        if isinstance(scan, ObstacleScan):
            turned = scan if turn_rad == 0.0 else turned_sectors(scan, turn_rad)
            self._map.integrate_scan(turned, placed, now_s, neighbours)
            level = level_scan_of(turned, placed)
            self._integrate_turn(scan.sensor, level, scan.yaw_rad, placed, neighbours, unheard, now_s)
        else:
            rays = scan if turn_rad == 0.0 else turned_rays(scan, turn_rad)
            self.columns.integrate(rays, placed, now_s)
            whole = self._mapper.integrate_rays(rays, placed, now_s, neighbours)
            if whole is not None:
                yaw_rad = scan.last_attitude_rad[2]
                self._integrate_turn(scan.sensor, whole, yaw_rad, placed, neighbours, unheard, now_s)

    def _integrate_turn(
        self,
        sensor: int,
        level: LevelScan,
        yaw_rad: float,
        placed: Position,
        neighbours: Sequence[Vec3],
        unheard: int,
        now_s: float,
    ) -> None:
        self._sight.note_turn(sensor, level, now_s)
        self._noise.note_turn(sensor, level, now_s)
        hovering = self._hulls.places()
        stems = self.motion.integrate_turn(
            level, yaw_rad, placed, neighbours, now_s, unheard=unheard, hovering=hovering
        )
        self._hulls.end_turn(stems, now_s)

    @property
    def sees_motion(self) -> bool:
        """By the own motion, in all directions: a wall alone tells of one."""
        return self.motion.velocity_bias_ne_mps is not None and self.motion.odometry.corrected_along is None

    def find_solitary_trunks(self, flown: Position, now_s: float) -> SolitaryTrunks | None:
        """By raw scans: by sectors trunks of strangers look alike."""
        odometry = self.motion.odometry
        if not self._has_widths or not odometry.is_corrected(now_s):
            return None
        north, east, _ = self.motion.correct_place(flown.pos_ned_m)
        return SolitaryTrunks(find_solitary(odometry.trunks, now_s), (north, east), odometry.frame)

    def take_odometry(self) -> bool:
        """As turns correct the own motion."""
        corrected_s, before_s = self.motion.odometry.corrected_s, self._odometry_s
        self._odometry_s = corrected_s
        return self._sends_odometry and corrected_s > before_s and self.sees_motion

    def find_vehicles(self, own_ned_m: Vec3, heard: Sequence[Neighbour], now_s: float) -> Sequence[SeenVehicle]:
        """By the scans; by sectors, to which trunks in thickets seem to move, only while somebody is not heard."""
        if not self._has_widths and len(heard) >= self._others:
            return ()
        seen = self.motion.vehicles.find_vehicles(self.motion.correct_place(own_ned_m), heard, now_s)
        return seen if self._has_widths else [one for one in seen if not one.heard]

    def nearest_m(self, own: Position | None) -> float:
        """By the map; inf: nothing within NEAR_M."""
        if own is None:
            return math.inf
        norths, easts = self._map.find_near(self.motion.correct_place(own.pos_ned_m), NEAR_M)
        return min([math.hypot(norths[k], easts[k]) for k in range(len(norths))], default=math.inf)

    def sees_several(self, own: Position | None) -> bool:
        """By the map."""
        if own is None:
            return False
        norths, easts = self._map.find_near(self.motion.correct_place(own.pos_ned_m), self._map.max_m)
        found: list[int] = []
        for k in range(len(norths)):
            near = [at for at in found if math.hypot(norths[k] - norths[at], easts[k] - easts[at]) < LEAVES_M]
            if not near:
                found.append(k)
            if len(found) >= EXPECTED_LEAST:
                return True
        return False

    def clear_ghosts(
        self, silent: dict[int, PeerReport], own_ned_m: Vec3, now_s: float, reported: Sequence[Vec3] = ()
    ) -> dict[int, PeerReport]:
        """Without those whose place was seen empty. `reported`: where neighbours are, relative."""
        placed_ned_m = self.motion.correct_place(own_ned_m)
        return self._ghosts.clear(silent, self._map, placed_ned_m, now_s, fresh_s=self.stale_s, reported=reported)

    def observe_obstacles(
        self,
        own_ned_m: Vec3,
        placed_ned_m: Vec3,
        hovering: Mapping[int, PeerReport],
        now_s: float,
        seen: Sequence[SeenVehicle] = (),
    ) -> LocalObstacleCloud:
        """As far as scans saw; while they are stale, all is blind."""
        hits, here_ned_m = self._map, self.motion.correct_place(own_ned_m)
        blind = hits.find_blind(now_s, fresh_s=self.stale_s)
        norths, easts = hits.find_near(here_ned_m, hits.max_m + BEYOND_M)
        self._memory.note_points(norths, easts, here_ned_m, blind, hits.max_m, now_s)
        clear_m = self._clear_m + self._noise.wider_m
        clear_m += find_wider_m(self._kind, self.motion.odometry.shift_sd_m(now_s), self._margin_m)
        cloud = LocalObstacleCloud(
            hits.max_m - clear_m,
            blind,
            sensor_m=hits.max_m,
            trunks=self._trunks_from(placed_ned_m),
            hovering=self._hovering(hovering, seen),
            seen_before=self._memory.seen_before(here_ned_m, clear_m),
            sight=self._sight.seen_from(here_ned_m, hits.max_m),
        )
        cloud.add_points(norths, easts, clear_m)
        return cloud


def build_perception(mission: Mission, me: int, *, is_odometry: bool = False) -> ObstaclePerception:
    """The make that a mission's vehicle has. `is_odometry`: its localiser goes by differences of positions."""
    sensing = mission.sensing
    if sensing is None:
        return OpenSkyPerception(mission)
    turns_with_yaw = not mission.has_satellites(me)
    return SensingPerception(mission, sensing, turns_with_yaw=turns_with_yaw, is_odometry=is_odometry)
