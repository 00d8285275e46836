"""External autopilots (SITL, HITL): their routes, and what each says of its vehicle."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from companion.core.model.states import LandedState
from companion.mavlink import dialect
from companion.mavlink.framing import wire
from mission.common.frames import LocalFrame, Vec3, Wgs84, enu_to_ned
from mission.document.model import Mission, Origin
from sim_bridge.drive.external.truth import TRUTH_HZ, TRUTH_IDS, TRUTH_STREAMS, Truth, position_of, rates_of, truth_of
from sim_bridge.drive.links.ports import Address, Listener, Reader
from sim_bridge.drive.links.router import HEARD, AutopilotSockets, Router
from sim_bridge.judge.estimate_errors import EstimateErrors

POSITION_STALE_S = 1.0  # older than that, a position is unknown: the vehicle's radio is off the air
ASK_S = 2.0
# As a part of the vehicle that is no companion, no ground station: no failsafe depends on it.
BRIDGE_COMPONENT = 240  # MAV_COMP_ID_UDP_BRIDGE
STREAMS_HZ = {dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 20.0, dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0}
ATTITUDE_HZ = 20.0  # for the obstacle sensors
SILENT_S = 3.0  # three heartbeats
DOWN_WITHIN_M = 0.1  # of the height at which it stood last, and slower than this, a vehicle is down in truth
DOWN_MPS = 0.5


class Telemetry:
    """Latest telemetry of one autopilot. `now_s`: time of arrival."""

    __slots__ = (
        "armed",
        "attitude_rad",
        "attitude_s",
        "heard_s",
        "home",
        "landed",
        "make",
        "position",
        "position_s",
        "rates_radps",
        "stood_m",
        "truth",
        "truth_s",
        "vel_ned_mps",
    )

    def __init__(self) -> None:
        self.position: Wgs84 | None = None
        self.vel_ned_mps: Vec3 = (0.0, 0.0, 0.0)
        self.position_s = -math.inf
        self.attitude_rad: Vec3 = (0.0, 0.0, 0.0)  # roll, pitch, yaw
        self.rates_radps: Vec3 = (0.0, 0.0, 0.0)  # body p, q, r
        self.attitude_s = -math.inf
        self.heard_s = -math.inf
        self.home: Wgs84 | None = None
        self.armed = False
        self.landed = LandedState.UNDEFINED
        self.make: int | None = None  # MAV_AUTOPILOT
        self.truth: Truth | None = None  # by its simulator
        self.truth_s = -math.inf
        self.stood_m: float | None = None  # true altitude when the autopilot last had it on the ground

    def receive_message(self, m: Any, now_s: float) -> None:
        """A valid message of this autopilot; what makes no sense changes nothing of the rest."""
        self.heard_s = now_s
        match m.get_msgId():
            case dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT if (
                position := position_of(m.lat, m.lon, m.alt / 1e3)
            ) is not None:
                self.position, self.position_s = position, now_s
                self.vel_ned_mps = (m.vx / 100.0, m.vy / 100.0, m.vz / 100.0)
            case dialect.MAVLINK_MSG_ID_ATTITUDE if math.isfinite(m.roll + m.pitch + m.yaw):
                self.attitude_rad, self.attitude_s = (m.roll, m.pitch, m.yaw), now_s
                self.rates_radps = rates_of(m.rollspeed, m.pitchspeed, m.yawspeed)
            case dialect.MAVLINK_MSG_ID_HOME_POSITION:
                self.home = position_of(m.latitude, m.longitude, m.altitude / 1e3) or self.home
            case dialect.MAVLINK_MSG_ID_HEARTBEAT:
                self.armed = bool(m.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
                self.make = m.autopilot
            case dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE if m.landed_state <= max(LandedState):
                self.landed = LandedState(m.landed_state)
            case id_ if id_ in TRUTH_IDS:
                told = truth_of(m, self.truth, self.position, self.vel_ned_mps)
                if told is not self.truth:
                    self.truth, self.truth_s = told, now_s
                    if told is not None and told.has_height and self.on_ground:
                        self.stood_m = told.position.alt_m

    @property
    def on_ground(self) -> bool:
        """As the autopilot has it."""
        return self.landed is LandedState.ON_GROUND or (self.landed is LandedState.UNDEFINED and not self.armed)

    @property
    def is_down(self) -> bool:
        """On the ground by the truth, where that tells heights: an autopilot finds it a second or more after it is."""
        truth = self.truth
        if self.on_ground or truth is None or not truth.has_height or self.stood_m is None:
            return self.on_ground
        return truth.position.alt_m < self.stood_m + DOWN_WITHIN_M and math.hypot(*truth.vel_ned_mps) < DOWN_MPS


def origin_at_home(mission: Mission, home: Wgs84) -> Mission:
    """`mission` placed so that `home` is on its ground at the horizontal place of d1."""
    north_m, east_m, _ = enu_to_ned(mission.route.d1_enu_m)
    origin = LocalFrame(home).to_wgs84((-north_m, -east_m, 0.0))
    return mission.with_origin(Origin(lat_deg=origin.lat_deg, lon_deg=origin.lon_deg, alt_m=home.alt_m))


def strays(mission: Mission, positions: Mapping[int, Vec3]) -> list[str]:
    """Words about vehicles that stand too far from d1 to hear a swarm there: simulators start where they please."""
    d1_ned_m, range_m = enu_to_ned(mission.route.d1_enu_m), mission.radio.transit_range_m
    from_d1_m = {k: math.dist(position[:2], d1_ned_m[:2]) for k, position in positions.items()}
    return [
        f"vehicle {k} stands {distance_m:.0f} m from d1: further than the radio range of {range_m:g} m"
        for k, distance_m in from_d1_m.items()
        if distance_m > range_m
    ]


def silent_ones(telemetry: Mapping[int, Telemetry], now_s: float) -> set[int]:
    """Vehicles whose autopilots have said nothing for SILENT_S."""
    return {k for k, heard in telemetry.items() if now_s - heard.heard_s > SILENT_S}


def still_up(telemetry: Mapping[int, Telemetry], silent: Collection[int]) -> list[int]:
    """Vehicles that are armed or off the ground, as far as their autopilots speak."""
    return [k for k, heard in telemetry.items() if (heard.armed or not heard.on_ground) and k not in silent]


class Autopilots:
    """External autopilots: sockets, routes, and what is heard of each vehicle. `listener.poll` makes it hear."""

    def __init__(
        self, ids: Sequence[int], sockets: AutopilotSockets, say: Callable[[str], None], *, sensing: bool = False
    ) -> None:
        """`sensing`: hear how the vehicles are tilted, too."""
        self.ids = ids
        self._sensing = sensing
        self._streams_hz = STREAMS_HZ | ({dialect.MAVLINK_MSG_ID_ATTITUDE: ATTITUDE_HZ} if sensing else {})
        self.router = Router(sockets, say, HEARD | self._streams_hz.keys() | TRUTH_IDS)
        self.by_truth: frozenset[int] = frozenset()  # vehicles whose positions are their simulators'
        self._truth_wanted = frozenset(ids)
        self.telemetry = {k: Telemetry() for k in ids}
        self.frame: LocalFrame | None = None
        self.to_companion: Callable[[int, bytes], None] = lambda _id, _data: None
        self._asked_s = dict.fromkeys(ids, -math.inf)
        self.listener = Listener()
        for bound in set(sockets.bound.values()):
            self.listener.listen(bound, self._reader(bound))

    def request_streams(self, now_s: float) -> None:
        """For the streams that do not flow, from time to time: ArduPilot streams nothing until asked."""
        for vehicle_id, heard in self.telemetry.items():
            flows = now_s - heard.position_s < ASK_S and heard.landed is not LandedState.UNDEFINED
            flows = flows and (not self._sensing or now_s - heard.attitude_s < ASK_S)
            flows = flows and not self._lacks_truth(vehicle_id, now_s - ASK_S)
            if (flows and heard.home is not None) or now_s - self._asked_s[vehicle_id] < ASK_S:
                continue
            self._asked_s[vehicle_id] = now_s
            home = dialect.MAVLINK_MSG_ID_HOME_POSITION
            wanted = [(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, id_, 1e6 / hz) for id_, hz in self._streams(vehicle_id)]
            asks = [*wanted, (dialect.MAV_CMD_REQUEST_MESSAGE, home, 0.0)]
            self.router.send(vehicle_id, b"".join([_command(vehicle_id, *ask) for ask in asks]))

    def lacks_truth(self) -> bool:
        """One may still tell the truth, of a make whose simulator does."""
        return any(self._lacks_truth(k, -math.inf) for k in self.ids)

    def fix_position_sources(self) -> None:
        """From now on positions are the truth of those that have told it by now, the estimates of the others.

        No vehicle changes from one to the other in a flight: it would jump.
        """
        self.by_truth = self._truth_wanted = frozenset(self.truths())

    def truths(self) -> dict[int, Truth]:
        """The last that each simulator has told, where it does."""
        return {k: heard.truth for k, heard in self.telemetry.items() if heard.truth is not None}

    def heights_by_estimates(self) -> list[int]:
        """Vehicles whose hits of the ground nobody tells in time to see how hard they were."""
        told = self.truths()
        return [k for k in self.ids if k not in self.by_truth or not told[k].has_height]

    def _lacks_truth(self, vehicle_id: int, since_s: float) -> bool:
        heard = self.telemetry[vehicle_id]
        return vehicle_id in self._truth_wanted and heard.make in TRUTH_STREAMS and heard.truth_s <= since_s

    def _streams(self, vehicle_id: int) -> list[tuple[int, float]]:
        make = self.telemetry[vehicle_id].make
        told = TRUTH_STREAMS.get(make, ()) if make is not None and vehicle_id in self._truth_wanted else ()
        return [*self._streams_hz.items(), *[(id_, TRUTH_HZ) for id_ in told]]

    def land(self, vehicle_id: int) -> None:
        """Tell the autopilot itself, where no companion does."""
        self.router.send(vehicle_id, _command(vehicle_id, dialect.MAV_CMD_NAV_LAND))

    def positions(self) -> dict[int, Vec3]:
        """NED metres about the origin, of those whose position is not stale."""
        fresh_s = time.monotonic() - POSITION_STALE_S
        told_s = {k: h.truth_s if k in self.by_truth else h.position_s for k, h in self.telemetry.items()}
        return {k: self.position(k) for k, at_s in told_s.items() if at_s >= fresh_s}

    def attitudes(self) -> dict[int, Vec3]:
        """Roll, pitch, yaw (rad), of those that have told theirs not long ago."""
        fresh_s = time.monotonic() - POSITION_STALE_S
        told: dict[int, Vec3] = {}
        for k, heard in self.telemetry.items():
            if k in self.by_truth and heard.truth is not None:
                if heard.truth_s >= fresh_s:
                    told[k] = heard.truth.attitude_rad
            elif heard.attitude_s >= fresh_s:
                told[k] = heard.attitude_rad
        return told

    def add_errors(self, errors: EstimateErrors) -> None:
        """Adds the errors of the estimates against the truth, where both are fresh."""
        assert self.frame is not None
        fresh_s = time.monotonic() - POSITION_STALE_S
        for k in self.by_truth:
            heard = self.telemetry[k]
            if heard.truth is None or heard.position is None or min(heard.truth_s, heard.position_s) < fresh_s:
                continue
            elapsed_s = heard.position_s - heard.truth_s
            believed, true = self.frame.to_ned(heard.position), self.frame.to_ned(heard.truth.position)
            moved = [elapsed_s * speed_mps for speed_mps in heard.truth.vel_ned_mps]
            off_n, off_e, off_d = (b - t - m for b, t, m in zip(believed, true, moved, strict=True))
            has_yaw = heard.attitude_s >= fresh_s
            yaw_off_rad = heard.attitude_rad[2] - heard.truth.attitude_rad[2] if has_yaw else None
            errors.add((off_n, off_e, off_d), has_height=heard.truth.has_height, yaw_off_rad=yaw_off_rad)

    def position(self, vehicle_id: int) -> Vec3:
        """The last one: the truth where its simulator tells it, else its estimate."""
        heard = self.telemetry[vehicle_id]
        position = heard.truth.position if heard.truth is not None and vehicle_id in self.by_truth else heard.position
        assert self.frame is not None
        assert position is not None
        return self.frame.to_ned(position)

    def velocity(self, vehicle_id: int) -> Vec3:
        """As `position`: NED m/s."""
        heard = self.telemetry[vehicle_id]
        told = heard.truth if vehicle_id in self.by_truth else None
        return heard.vel_ned_mps if told is None else told.vel_ned_mps

    def rates(self, vehicle_id: int) -> Vec3:
        """As `position`: body p, q, r, rad/s."""
        heard = self.telemetry[vehicle_id]
        told = heard.truth if vehicle_id in self.by_truth else None
        return heard.rates_radps if told is None else told.rates_radps

    def missing(self, *, home_of: int | None) -> str:
        """The first vehicle that lacks something, and its lack, in words; empty: all is there."""
        for vehicle_id, heard in self.telemetry.items():
            if not self.router.knows(vehicle_id):
                return f"vehicle {vehicle_id}: no autopilot with that system id was heard"
            if heard.position is None:
                return f"vehicle {vehicle_id}: its autopilot knows no global position (GLOBAL_POSITION_INT)"
            if heard.home is None and vehicle_id == home_of:
                return f"vehicle {vehicle_id}: its autopilot knows no home (HOME_POSITION)"
        return ""

    def _reader(self, bound: socket.socket) -> Reader:
        def receive_datagram(data: bytes, address: Address, now_s: float) -> None:
            parts, messages = self.router.route_datagram(bound, data, address, now_s)
            for m in messages:
                self.telemetry[m.get_srcSystem()].receive_message(m, now_s)
            for vehicle_id, its in parts.items():
                self.to_companion(vehicle_id, its)

        return receive_datagram


def _command(vehicle_id: int, command: int, *parameters: float) -> bytes:
    padded = (*parameters, *(0.0,) * (7 - len(parameters)))
    target = (vehicle_id, dialect.MAV_COMP_ID_AUTOPILOT1)
    message = dialect.MAVLink_command_long_message(*target, command, 0, *padded)
    return wire.pack(message, seq=0, system=vehicle_id, component=BRIDGE_COMPONENT)
