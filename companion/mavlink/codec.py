"""Core types <-> MAVLink messages, and the one place where units and frames of the wire are converted.

The autopilot's local frame starts where its estimator did: GPS_GLOBAL_ORIGIN says where that is, on PX4 and ArduPilot
alike. Until it is heard, HOME_POSITION, which gives one point in both frames, stands in; PX4's first one may be a metre
off, and both autopilots set home anew when they arm. An autopilot that has started again has another frame, and may
tell it once: what was known of the old one is forgotten, and an origin that home contradicts is asked for.

Beacons carry WGS84, so vehicles agree without knowing of each other's local frames; the decoder turns a beacon's
position into one relative to the vehicle's own, and nothing behind it sees an absolute one.
"""

from __future__ import annotations

import math
from typing import Any, Final

from companion.core.model.beacon import Beacon
from companion.core.model.events import (
    Answer,
    AutopilotHealth,
    AutopilotMode,
    AutopilotText,
    BootTime,
    HeardBeacon,
    Landed,
    Position,
    Satellites,
)
from companion.core.model.states import FlightMode, LandedState, Result
from companion.core.model.vectors import ZERO, add, sub
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.beacon import NOWHERE_DEG, Decoded
from companion.mavlink.framing import texts
from companion.mavlink.makes import make_of
from companion.mavlink.makes.make import REQUESTS, Altitude, Make
from companion.mavlink.own_messages import FASTEST_MPS, FURTHEST_M
from mission.common.frames import LocalFrame, Vec3, Wgs84

FIX_3D: Final = 3  # GPS_FIX_TYPE; higher ones are better
U16_MAX: Final = 0xFFFF
U32_MAX: Final = 0xFFFFFFFF
HDOP_M: Final = 1.5  # of error for each unit of HDOP: single frequency, in the open
NO_FIX_SD_M: Final = 99.0
# Both makes say by the same bit that their position is absolute, not counted from somewhere.
ABSOLUTE: Final = dialect.ESTIMATOR_POS_HORIZ_ABS
assert ABSOLUTE == dialect.EKF_POS_HORIZ_ABS
PREARM_OK = dialect.MAV_SYS_STATUS_PREARM_CHECK
_SETPOINT: Final = dialect.MAVLink_set_position_target_local_ned_message.unpacker
_TIMESYNC: Final = dialect.MAVLink_timesync_message.unpacker
_AUTOPILOT: Final = dialect.MAV_COMP_ID_AUTOPILOT1
_LOCAL_NED: Final = dialect.MAV_FRAME_LOCAL_NED
VELOCITY_AND_YAW: Final = 0x9C7  # type mask of SET_POSITION_TARGET_LOCAL_NED
NAN: Final = math.nan  # not known
LIDAR_ESTIMATOR: Final = 7  # MAV_ESTIMATOR_TYPE_LIDAR
ODOMETRY_SD_MPS: Final = 0.1  # of the own motion by trunks, an axis (docs/explanation/own-motion.md)
REBOOT_MS: Final = 5000  # of its own time, back: no frame is late by that
REBOOT_FRAMES: Final = 3  # in a row: one may be a stray
# Between the origin as told and as home has it; recorded: 1.4 m at first, then 0.05 m (both makes)
DOUBT_M: Final = 5.0
MULTICOPTERS = frozenset({2, 3, 4, 13, 14, 15, 29, 35})  # MAV_TYPE: other vehicles number their modes differently
TIME_LIMIT_NS = 1 << 62  # 146 years: beyond it a time is not believed


class Codec:
    """Decodes for one vehicle, and remembers its home, its last position and its autopilot's make.

    Positions are NED metres about the mission's origin, velocities NED m/s. A message whose content makes no sense is
    decoded to None, counted in `dropped`, and changes nothing. Messages have their fields as attributes, by their
    MAVLink names and in their MAVLink units.
    """

    __slots__ = (
        "_boot_ms",
        "_broadcasts_position",
        "_earlier_count",
        "_ekf_flags",
        "_frame",
        "_home_ned_m",
        "_home_origin_ned_m",
        "_is_anchored",
        "_local_to_mission",
        "_pos_ned_m",
        "_texts",
        "dropped",
        "has_answered",
        "make",
        "origin_doubted",
        "origin_known",
        "other_versions",
        "reboots",
        "vehicle_id",
    )

    def __init__(
        self, vehicle_id: int, frame: LocalFrame, *, start_ned_m: Vec3 | None = None, broadcasts_position: bool = True
    ) -> None:
        """`start_ned_m`: where the mission has a vehicle without GNSS start; its local frame is tied there.

        `broadcasts_position`: beacons carry their senders' positions; else only heights.
        """
        self.vehicle_id = vehicle_id
        self._frame = frame
        self._local_to_mission: Vec3 | None = start_ned_m
        self._is_anchored = start_ned_m is not None
        self._broadcasts_position = broadcasts_position
        self._home_ned_m: Vec3 | None = None
        self._home_origin_ned_m: Vec3 | None = None  # where home had the local frame start when it was looked at last
        self._pos_ned_m: Vec3 | None = None
        self._boot_ms = 0  # the autopilot's time at the last position
        self._earlier_count = 0  # positions since that are of a much earlier one
        self._ekf_flags = 0
        self._texts = texts.Reader()
        self.make: Make | None = None  # of the autopilot, once recognised
        self.origin_known = False  # GPS_GLOBAL_ORIGIN has been seen
        self.origin_doubted = False  # home has contradicted it since
        self.reboots = 0  # of the autopilot, that were noticed
        self.dropped = 0  # well-formed messages whose content was refused
        self.has_answered = False  # the autopilot, when it was asked for its time: several times a second
        self.other_versions = 0  # beacons of another version than this companion's

    # --- from the autopilot ---

    def position(self, m: Any) -> Position | None:
        """LOCAL_POSITION_NED -> position and velocity; None until the local frame is tied to the mission's."""
        self._note_boot_time(m.time_boot_ms)
        if self._local_to_mission is None:
            return None
        local, velocity = (m.x, m.y, m.z), (m.vx, m.vy, m.vz)
        if not (_is_within(local, FURTHEST_M) and _is_within(velocity, FASTEST_MPS)):
            self.dropped += 1
            return None
        self._pos_ned_m = add(self._local_to_mission, local)
        return Position(self._pos_ned_m, velocity, m.time_boot_ms / 1e3)

    def _note_boot_time(self, boot_ms: int) -> None:
        """Forget frame and home when the autopilot has started again: its time is far behind, and stays there."""
        if boot_ms > self._boot_ms - REBOOT_MS:
            self._boot_ms, self._earlier_count = boot_ms, 0
            return
        self._earlier_count += 1
        if self._earlier_count < REBOOT_FRAMES:
            return
        self._boot_ms, self._earlier_count = boot_ms, 0
        self.reboots += 1
        if not self._is_anchored:
            self._local_to_mission = self._home_ned_m = self._home_origin_ned_m = self._pos_ned_m = None
            self.origin_known = self.origin_doubted = False

    def origin(self, m: Any) -> None:
        """GPS_GLOBAL_ORIGIN: where the autopilot's local frame starts."""
        if self._is_anchored:  # whatever origin was set in an autopilot without GNSS
            return
        origin_ned_m = self._frame.to_ned(Wgs84(m.latitude / 1e7, m.longitude / 1e7, m.altitude / 1e3))
        if not _is_within(origin_ned_m, FURTHEST_M):
            self.dropped += 1
            return
        self._local_to_mission = origin_ned_m
        self.origin_known, self.origin_doubted = True, False

    def home(self, m: Any) -> None:
        """HOME_POSITION: what a takeoff on ArduPilot counts from, and one point in the local frame and on Earth."""
        if self._is_anchored:
            return
        home_ned_m = self._frame.to_ned(Wgs84(m.latitude / 1e7, m.longitude / 1e7, m.altitude / 1e3))
        if not (_is_within(home_ned_m, FURTHEST_M) and _is_within((m.x, m.y, m.z), FURTHEST_M)):
            self.dropped += 1
            return
        self._home_ned_m = home_ned_m
        told, before = sub(home_ned_m, (m.x, m.y, m.z)), self._home_origin_ned_m
        tied = self._local_to_mission
        if not self.origin_known or tied is None:
            self._local_to_mission = told
        elif before is None or math.dist(told, before) > DOUBT_M:  # the same is not asked about again
            self._home_origin_ned_m = told
            self.origin_doubted = math.dist(told, tied) > DOUBT_M

    @property
    def frame_known(self) -> bool:
        """The autopilot's local frame is tied to the mission's."""
        return self._local_to_mission is not None

    @property
    def is_anchored(self) -> bool:
        """It has no satellites: its local frame is tied to where the mission has it start."""
        return self._is_anchored

    @property
    def home_known(self) -> bool:
        """HOME_POSITION has been seen."""
        return self._home_ned_m is not None

    def mode(self, m: Any) -> AutopilotMode | None:
        """HEARTBEAT of the autopilot, which it is recognised by; None when it comes from something else."""
        if m.autopilot == dialect.MAV_AUTOPILOT_INVALID:
            return None
        armed = bool(m.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        make = make_of(m.autopilot)
        self.make = make if m.type in MULTICOPTERS else None
        if make is None:
            return AutopilotMode(FlightMode.OTHER, armed, f"autopilot {m.autopilot} is unknown")
        if m.type not in MULTICOPTERS:
            return AutopilotMode(FlightMode.OTHER, armed, f"vehicle type {m.type} is no multicopter")
        mode = make.modes.get(m.custom_mode, FlightMode.OTHER)
        name = make.mode_names.get(m.custom_mode, f"custom mode {m.custom_mode:#x}")
        failsafe = m.system_status in (dialect.MAV_STATE_CRITICAL, dialect.MAV_STATE_EMERGENCY)
        return AutopilotMode(mode, armed, name, failsafe, make.traits)

    def ekf(self, m: Any) -> None:
        """EKF_STATUS_REPORT: a part of ArduPilot's readiness, reported with the next SYS_STATUS."""
        self._ekf_flags = m.flags

    def estimator(self, m: Any) -> None:
        """ESTIMATOR_STATUS: the same of PX4's, whether its position goes by GNSS."""
        self._ekf_flags = m.flags

    def satellites(self, m: Any) -> Satellites:
        """GPS_RAW_INT -> whether the estimator goes by GNSS, and how wrong a fix is, as far as it is reported."""
        if 0 < m.h_acc < U32_MAX:
            sd_m = m.h_acc / 1e3
        else:
            sd_m = HDOP_M * m.eph / 100.0 if m.eph != U16_MAX and m.fix_type >= FIX_3D else NO_FIX_SD_M
        used = bool(self._ekf_flags & ABSOLUTE) if self._ekf_flags else m.fix_type >= FIX_3D
        return Satellites(used, sd_m, m.fix_type >= FIX_3D)

    def health(self, m: Any) -> AutopilotHealth:
        """SYS_STATUS -> ready to arm, as its make shows it, and the battery's charge in percent."""
        battery = m.battery_remaining if 0 <= m.battery_remaining <= 100 else None
        needed = self.make.ready_ekf_flags if self.make is not None else 0
        positioned = self._ekf_flags & needed == needed
        if self._is_anchored:  # relative to where it began is enough
            positioned |= bool(self._ekf_flags & dialect.EKF_POS_HORIZ_REL)
        ready = bool(m.onboard_control_sensors_health & PREARM_OK) and positioned
        return AutopilotHealth(ready, battery)

    def landed(self, m: Any) -> Landed | None:
        """EXTENDED_SYS_STATE -> landed or not."""
        try:
            return Landed(LandedState(m.landed_state))
        except ValueError:
            self.dropped += 1
            return None

    def answer(self, m: Any) -> Answer | None:
        """COMMAND_ACK; None for a command that the core did not ask for."""
        request = REQUESTS.get(m.command)
        if request is None:
            return None
        try:
            return Answer(request, Result(m.result))
        except ValueError:
            self.dropped += 1
            return None

    def boot_time(self, m: Any, now_s: float) -> BootTime | None:
        """TIMESYNC that answers a request of ours; `now_s`: its arrival."""
        if not 0 < m.tc1 < TIME_LIMIT_NS:
            self.dropped += 1
            return None
        self.has_answered = True
        return BootTime(m.tc1 / 1e9, now_s - m.ts1 / 1e9)

    def text(self, m: Any) -> AutopilotText | None:
        """STATUSTEXT; None while more chunks of it are to come, or one of them was lost."""
        lost = self._texts.lost
        text = self._texts.read_text(m)
        self.dropped += self._texts.lost - lost
        if text is None:
            return None
        return AutopilotText(m.severity, text.strip())

    # --- to the autopilot ---

    def setpoint(self, vel_ned_mps: Vec3, yaw_rad: float, time_ms: int) -> bytes:
        """SET_POSITION_TARGET_LOCAL_NED's payload with velocity and yaw, NED; `time_ms`: 0..2^32-1."""
        payload: bytes = _SETPOINT.pack(
            time_ms,
            0.0,
            0.0,
            0.0,
            vel_ned_mps[0],
            vel_ned_mps[1],
            vel_ned_mps[2],
            0.0,
            0.0,
            0.0,
            yaw_rad,
            0.0,
            VELOCITY_AND_YAW,
            self.vehicle_id,
            _AUTOPILOT,
            _LOCAL_NED,
        )
        return payload

    def odometry(self, vel_ned_mps: Vec3, time_us: int) -> Any:
        """A velocity alone, NED, by ODOMETRY, all else of it NaN, or as the make takes it.

        `time_us`: by the clock of our TIMESYNC.
        """
        variance = ODOMETRY_SD_MPS * ODOMETRY_SD_MPS
        if self.make is not None and not self.make.takes_odometry:
            diagonal = [variance if k % 4 == 0 else 0.0 for k in range(9)]
            return dialect.MAVLink_vision_speed_estimate_message(time_us, *vel_ned_mps, diagonal)
        variances = [NAN] * 21  # the upper right triangle of a 6 x 6 matrix
        variances[0] = variances[6] = variances[11] = variance
        return dialect.MAVLink_odometry_message(
            time_us,
            _LOCAL_NED,
            _LOCAL_NED,
            *(NAN, NAN, NAN),
            (NAN, NAN, NAN, NAN),
            *vel_ned_mps,
            *(NAN, NAN, NAN),
            (NAN,) * 21,
            variances,
            estimator_type=LIDAR_ESTIMATOR,
        )

    def timesync(self, tc1_ns: int, ts1_ns: int) -> bytes:
        """TIMESYNC's payload: a request of ours (`tc1_ns` 0), or the answer to one with that `ts1_ns`."""
        payload: bytes = _TIMESYNC.pack(tc1_ns, ts1_ns)
        return payload

    def command(self, command: int, *parameters: float, confirmation: int = 0) -> Any:
        """COMMAND_LONG to the vehicle's autopilot; `parameters`: at most 7, the rest is 0."""
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        return dialect.MAVLink_command_long_message(
            self.vehicle_id, dialect.MAV_COMP_ID_AUTOPILOT1, command, confirmation, *padded
        )

    def altitude(self, altitude_m: float) -> Altitude:
        """`altitude_m`: above the mission's origin. While home is unknown, above home is above the vehicle itself."""
        home_ned_m = self._home_ned_m or self._pos_ned_m or ZERO
        if self._is_anchored:  # what it takes for sea level is its barometer's; it climbs as its own parameter says
            return Altitude(math.nan, altitude_m + home_ned_m[2])
        return Altitude(self._frame.origin.alt_m + altitude_m, altitude_m + home_ned_m[2])

    # --- between companions ---

    def encode_beacon(self, beacon: Beacon, pos_ned_m: Vec3 | None = None, off_ned_m: Vec3 = ZERO) -> bytes | None:
        """SWARM_BEACON's payload, with the vehicle's own position; None while that is not known.

        `pos_ned_m`: in a GNSS-denied swarm, broadcast instead; None: only the height is.
        `off_ned_m`: position flown by less the one that the autopilot has reported.
        """
        if self._pos_ned_m is None:
            return None
        own_ned_m = self._pos_ned_m if off_ned_m == ZERO else add(self._pos_ned_m, off_ned_m)
        if not self._broadcasts_position:
            there = self._frame.to_wgs84(pos_ned_m or (0.0, 0.0, own_ned_m[2]))
            if pos_ned_m is None:
                there = Wgs84(NOWHERE_DEG, NOWHERE_DEG, there.alt_m)
            return swarm_beacon.encode(beacon, there)
        return swarm_beacon.encode(beacon, self._frame.to_wgs84(own_ned_m))

    def beacon(self, decoded: Decoded) -> HeardBeacon | None:
        """A neighbour's SWARM_BEACON; None while the vehicle's own position is not known."""
        if decoded.version != swarm_beacon.VERSION:
            self.other_versions += 1
            return None
        if self._pos_ned_m is None:
            return None
        rel_ned_m = sub(decoded.pos_ned_m, self._pos_ned_m)
        if not self._broadcasts_position:  # of whatever is received, only the height
            rel_ned_m = (0.0, 0.0, rel_ned_m[2])
        if decoded.said is None or not _is_within(rel_ned_m, FURTHEST_M):
            self.dropped += 1
            return None
        return HeardBeacon(decoded.said, rel_ned_m, is_vouched=decoded.is_vouched)


def _is_within(v: Vec3, most: float) -> bool:
    """Every component is at most `most` in size, in the unit of both; false for NaN and infinity."""
    return -most <= v[0] <= most and -most <= v[1] <= most and -most <= v[2] <= most
