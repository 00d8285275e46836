"""Collaborators that an endpoint may have: a survey, which measures stems, a payload, and a link that keeps records.

A vehicle flies without any: `Boundary` is where an error of survey or payload ends.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple, Protocol, final

from companion.core.agent import Agent
from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.localisation.localiser import Localiser
from companion.core.model.actions import Say
from companion.core.model.events import LidarScan
from companion.core.model.neighbour import find_hover_places
from companion.core.model.states import Severity
from companion.core.perception.landmarks.scan_pose import ScanPose
from companion.core.perception.obstacle_cloud import find_hovering
from companion.core.perception.obstacle_perception import SensingPerception
from companion.core.perception.vehicles.vehicle_tracks import MOVES_MPS
from companion.mavlink.sensor_source import PayloadValue
from mission.common.frames import Vec3

Place = tuple[float, float]
FRAME_SD_M: Final = 1.0  # of a position by satellites under trees, level, slow: common to all seen at a time


class StandUpdate(NamedTuple):
    """The stand in figures, from the records that this vehicle has."""

    kind: int  # of the record that tells it to the base station, and
    body: bytes  # of the same
    basal_area_pct: float | None  # half of the interval of the basal area, over it; None: it has none yet
    text: str  # in words; empty: no stems yet


class RecordLink(Protocol):
    """Measurements that come into a log, and frames of the peers' link by which they reach the base station."""

    def append(self, kind: int, body: bytes, now_s: float) -> None:
        """One more record of this vehicle's own."""

    def is_record(self, frame: bytes) -> bool:
        """A whole frame is one of records, by its header alone."""

    def receive(self, frame: bytes, now_s: float) -> bool:
        """A whole frame of the peers' link, which its guard has admitted; False: it is not valid."""

    def frames(self, now_s: float, beacon_bytes: int) -> list[tuple[int, bytes]]:
        """Message ids and payloads to send now, behind so many bytes of beacons."""

    def take_stand(self, *, leads: bool, now_s: float) -> StandUpdate | None:
        """Once a tick; `leads`: this vehicle acts as leader. New figures of the stand, by the records here, once."""

    def count_waiting(self) -> int:
        """Records that this node knows of, and of which it has not heard that the base station has them."""

    def lines(self) -> list[str]:
        """Lines for the operator, since last asked."""

    def counters(self) -> dict[str, int]:
        """Counts for the log: what is made, delivered, lost and refused."""


class Survey(Protocol):
    """Measures stems along the way. Times are the local clock's, s."""

    def integrate(self, scan: LidarScan, pose: ScanPose, now_s: float) -> None:
        """A piece of a scan, and the pose of its tick."""

    def take_records(self, pose: ScanPose | None, now_s: float) -> list[tuple[int, bytes]]:
        """Once a tick: kinds and bodies of records that are finished. `pose`: None while there is none."""

    def take_returns(self) -> list[bytes]:
        """Returns of stems that were fitted, since last asked; none where nobody keeps them."""


class PayloadPlace(NamedTuple):
    """A vehicle's place in the mission's frame, metres from its origin, as it estimates itself."""

    north_m: float
    east_m: float
    up_m: float
    sd_m: float  # level


class Payload(Protocol):
    """Makes records of what other sensors tell. Times are the local clock's, s."""

    def take_records(
        self, values: Iterable[PayloadValue], place: PayloadPlace | None, now_s: float, *, airborne: bool
    ) -> list[tuple[int, bytes]]:
        """Once a tick: kinds and bodies. `values`: that have come since the last; `place`: None: not known."""

    def take_says(self) -> list[Say]:
        """Words for the operator, since last asked."""


@final
class Boundary:
    """The boundary at which an error of what steers nothing ends: it stops for this flight, which goes on.

    A process that ended over it would leave its vehicle to the autopilot.
    """

    def __init__(self, what: str) -> None:
        """`what`: that is said to have stopped."""
        self._what: Final = what
        self._says: list[Say] = []
        self.error = ""  # that stopped it, for the log; empty: it runs

    def attempt(self, work: Callable[[], None]) -> None:
        """Does it, unless an earlier one has failed."""
        if self.error:
            return
        try:
            work()
        except Exception as error:  # noqa: BLE001  not swallowed: said and logged; the flight does not need it
            raised = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{raised.filename.rpartition('/')[2]}:{raised.lineno} in {raised.name}"
            self.error = f"{type(error).__name__}: {error} ({place})"
            self._says.append(Say(Severity.WARNING, f"{self._what}: stopped by an error"))

    def take_says(self) -> list[Say]:
        """Words for the operator, since last asked."""
        says, self._says = self._says, []
        return says


@final
class GuardedSurvey:
    """A survey behind its boundary: all that works for it alone is called here, and none of it past it."""

    def __init__(self, survey: Survey) -> None:
        self._survey: Final = survey
        self._pose: ScanPose | None = None  # of this tick
        self._boundary: Final = Boundary("survey")

    @property
    def error(self) -> str:
        """The error that stopped it, for the log; empty: it runs."""
        return self._boundary.error

    def begin_tick(self, agent: Agent, now_s: float) -> None:
        """Takes the pose, before the scans of this tick correct it."""

        def take_pose() -> None:
            self._pose = scan_pose_of(agent, now_s)

        self._boundary.attempt(take_pose)

    def integrate(self, scan: LidarScan, now_s: float) -> None:
        """A piece of a scan."""
        pose = self._pose
        if pose is not None:
            self._boundary.attempt(lambda: self._survey.integrate(scan, pose, now_s))

    def take_records(self, now_s: float) -> list[tuple[int, bytes]]:
        """Once a tick, as `Survey` has it; none once it has stopped."""
        found: list[tuple[int, bytes]] = []
        self._boundary.attempt(lambda: found.extend(self._survey.take_records(self._pose, now_s)))
        return found

    def take_returns(self) -> list[bytes]:
        """As `Survey` has it."""
        found: list[bytes] = []
        self._boundary.attempt(lambda: found.extend(self._survey.take_returns()))
        return found

    def take_says(self) -> list[Say]:
        """Words for the operator, since last asked."""
        return self._boundary.take_says()


@final
class GuardedPayload:
    """Records of other sensors behind their boundary."""

    def __init__(self, payload: Payload) -> None:
        self._payload: Final = payload
        self._boundary: Final = Boundary("payload")

    @property
    def error(self) -> str:
        """The error that stopped it, for the log; empty: it runs."""
        return self._boundary.error

    def take_records(
        self, agent: Agent, values: Callable[[], Iterable[PayloadValue]], now_s: float
    ) -> list[tuple[int, bytes]]:
        """Once a tick, as `Payload` has it; none once it has stopped. `values`: those that have come since."""
        found: list[tuple[int, bytes]] = []

        def take_values() -> None:
            place, airborne = payload_place_of(agent, now_s), agent.flight.vehicle.airborne
            found.extend(self._payload.take_records(values(), place, now_s, airborne=airborne))

        self._boundary.attempt(take_values)
        return found

    def take_says(self) -> list[Say]:
        """Words for the operator, since last asked."""
        return [*self._payload.take_says(), *self._boundary.take_says()]


def scan_pose_of(agent: Agent, now_s: float) -> ScanPose | None:
    """The pose of this tick; None: the autopilot has told no position yet, or the vehicle has no sensor."""
    own, perception, localiser = agent.flight.vehicle.position, agent.perception, agent.localiser
    if own is None or not isinstance(perception, SensingPerception):
        return None
    motion = perception.motion
    pos, vel = motion.correct_place(own.pos_ned_m), own.vel_ned_mps
    bias = perception.velocity_bias(localiser.velocity_bias_ned_mps)
    off, frame_sd_m = _find_frame(localiser, now_s)
    return ScanPose(
        pos,
        (vel[0] + bias[0], vel[1] + bias[1], vel[2] + bias[2]),
        shift_ne_m=motion.odometry.shift_m,
        turn_rad=motion.turn_rad,
        to_mission_ne_m=(own.pos_ned_m[0] + off[0] - pos[0], own.pos_ned_m[1] + off[1] - pos[1]),
        frame_sd_m=frame_sd_m,
        airborne=agent.flight.vehicle.airborne,
        trunks=motion.odometry.trunks,
        frame=motion.odometry.frame,
        standing_ne_m=_find_standing(agent, perception, pos, now_s),
    )


def payload_place_of(agent: Agent, now_s: float) -> PayloadPlace | None:
    """The place of this tick; None: the autopilot tells none, or none any more."""
    vehicle = agent.flight.vehicle
    own = vehicle.position
    if own is None or vehicle.position_missing(now_s):
        return None
    pos = own.pos_ned_m
    off, frame_sd_m = _find_frame(agent.localiser, now_s)
    return PayloadPlace(pos[0] + off[0], pos[1] + off[1], -pos[2], frame_sd_m)


def _find_frame(localiser: Localiser, now_s: float) -> tuple[Place, float]:
    """The mission's frame less the own one, and its standard error, level."""
    off = localiser.offset_ned_m
    if not isinstance(localiser, GnssDeniedLocaliser):
        return (off[0], off[1]), FRAME_SD_M
    of_fix = localiser.global_localisation.told_off_ne_m(now_s)
    if of_fix is not None:  # by the own satellites, as where all have them: what the flight goes by lags behind
        return of_fix, FRAME_SD_M
    return (off[0], off[1]), localiser.global_localisation.sd_m


def _find_standing(agent: Agent, perception: SensingPerception, pos_ned_m: Vec3, now_s: float) -> list[Place]:
    """Places of vehicles that hover, silent or held by their autopilots, and of those seen that no trunk outruns.

    A neighbour that its companion steers needs no place here: what stands where it is heard is tracked as no trunk.
    """
    neighbours = agent.localiser.neighbours
    rels = find_hover_places(find_hovering(agent.localiser.silent, neighbours).values())
    seen = [one for one in perception.motion.vehicles.find_vehicles(pos_ned_m, neighbours, now_s) if not one.heard]
    rels += [one.rel_ned_m for one in seen if math.hypot(one.vel_ned_mps[0], one.vel_ned_mps[1]) < MOVES_MPS]
    return [(pos_ned_m[0] + rel[0], pos_ned_m[1] + rel[1]) for rel in rels]
