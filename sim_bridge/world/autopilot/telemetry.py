"""The messages that any autopilot makes of its vehicle's state: readings -> message, or None."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from companion.core.model.vectors import sub
from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame, Vec3, Wgs84
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot.battery import Battery
from sim_bridge.world.autopilot.protocols.links import Packed
from sim_bridge.world.autopilot.types import Satellites

NAN = math.nan
UNIX_EPOCH_US: Final = 1_767_225_600_000_000  # the vehicle's GPS clock at boot: 2026-01-01, the same in every run
GRAVITY_MPS2: Final = 9.80665
FIELD_NED_GAUSS = (0.21, 0.01, 0.43)  # central Europe
SEA_LEVEL_HPA: Final = 1013.25
GPS_SATELLITES: Final = 10
PWM_STOPPED_US: Final = 900
PWM_IDLE_US: Final = 1000
PWM_SPAN_US: Final = 1000
U16_MAX: Final = 65535


@dataclass(slots=True)
class Readings:
    """All that the builders need. Positions are NED about the mission's origin unless they say local."""

    now_us: int
    state: AirframeState
    frame: LocalFrame
    origin_ned_m: Vec3  # of the local frame: where the estimator started
    home_ned_m: Vec3 | None
    home_yaw_rad: float
    home_at_us: int
    battery: Battery
    armed: bool
    command_ned_mps: Vec3
    command_yaw_rad: float

    @property
    def boot_ms(self) -> int:
        """Milliseconds since boot, as the uint32 of the wire."""
        return self.now_us // 1000 & 0xFFFFFFFF

    @property
    def local_ned_m(self) -> Vec3:
        """NED metres about the local frame's origin."""
        pos, origin = self.state.pos_ned_m, self.origin_ned_m
        return (pos[0] - origin[0], pos[1] - origin[1], pos[2] - origin[2])

    @property
    def global_position(self) -> Wgs84:
        """Position messages of the vehicle."""
        return self.frame.to_wgs84(self.state.pos_ned_m)

    @property
    def height_m(self) -> float:
        """Above home."""
        ground = self.home_ned_m if self.home_ned_m is not None else self.origin_ned_m
        return ground[2] - self.state.pos_ned_m[2]


Builder = Callable[[Readings], Any]  # pymavlink's message, or Packed; None: nothing to send yet
_ATTITUDE = mav.MAVLink_attitude_message.unpacker
_LOCAL_POSITION_NED = mav.MAVLink_local_position_ned_message.unpacker


def deg_e7(degrees: float) -> int:
    """1e-7 degrees, as positions go over the wire."""
    return round(degrees * 1e7)


def clamped(value: float, low: int, high: int) -> int:
    """`value` as a whole number of low..high: a field cannot hold more."""
    return round(min(max(value, low), high))


def _cm_s(speed_mps: float) -> int:
    """int16 cm/s."""
    return clamped(speed_mps * 100.0, -32767, 32767)


def _heading_cdeg(yaw_rad: float) -> int:
    return round(math.degrees(yaw_rad) * 100.0) % 36000


def _quaternion(attitude_rad: Vec3) -> tuple[float, float, float, float]:
    """w, x, y, z of roll, pitch, yaw."""
    half = [angle / 2.0 for angle in attitude_rad]
    cr, cp, cy = (math.cos(a) for a in half)
    sr, sp, sy = (math.sin(a) for a in half)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def _to_body(ned: Vec3, attitude_rad: Vec3) -> Vec3:
    """A vector in NED -> body axes (front, right, down)."""
    roll, pitch, yaw = attitude_rad
    cr, cp, cy = math.cos(roll), math.cos(pitch), math.cos(yaw)
    sr, sp, sy = math.sin(roll), math.sin(pitch), math.sin(yaw)
    n, e, d = ned
    return (
        cp * cy * n + cp * sy * e - sp * d,
        (sr * sp * cy - cr * sy) * n + (sr * sp * sy + cr * cy) * e + sr * cp * d,
        (cr * sp * cy + sr * sy) * n + (cr * sp * sy - sr * cy) * e + cr * cp * d,
    )


def attitude(r: Readings) -> Packed:
    """ATTITUDE: roll, pitch, yaw (rad) and body rates (rad/s)."""
    payload = _ATTITUDE.pack(r.boot_ms, *r.state.attitude_rad, *r.state.rates_radps)
    return Packed(mav.MAVLINK_MSG_ID_ATTITUDE, payload)


def attitude_quaternion(r: Readings) -> Any:
    """ATTITUDE_QUATERNION: the same with w, x, y, z."""
    q = _quaternion(r.state.attitude_rad)
    return mav.MAVLink_attitude_quaternion_message(r.boot_ms, *q, *r.state.rates_radps)


def local_position_ned(r: Readings) -> Packed:
    """LOCAL_POSITION_NED: m about the local frame's origin, and m/s."""
    pos, vel = r.local_ned_m, r.state.vel_ned_mps
    payload = _LOCAL_POSITION_NED.pack(r.boot_ms, pos[0], pos[1], pos[2], vel[0], vel[1], vel[2])
    return Packed(mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED, payload)


def global_position_int(r: Readings) -> Any:
    """GLOBAL_POSITION_INT: 1e-7 degrees, mm above sea level and above home, cm/s, 0.01 degrees."""
    here = r.global_position
    north, east, down = r.state.vel_ned_mps
    return mav.MAVLink_global_position_int_message(
        r.boot_ms,
        deg_e7(here.lat_deg),
        deg_e7(here.lon_deg),
        round(here.alt_m * 1000.0),
        round(r.height_m * 1000.0),
        _cm_s(north),
        _cm_s(east),
        _cm_s(down),
        _heading_cdeg(r.state.attitude_rad[2]),
    )


def gps_raw_int(r: Readings) -> Any:
    """GPS_RAW_INT: a 3D fix; its course is the heading below 0.1 m/s."""
    here = r.global_position
    north, east, _ = r.state.vel_ned_mps
    speed = math.hypot(north, east)
    course = math.atan2(east, north) if speed > 0.1 else r.state.attitude_rad[2]
    alt_mm = round(here.alt_m * 1000.0)
    return mav.MAVLink_gps_raw_int_message(
        r.now_us,
        3,  # GPS_FIX_TYPE_3D_FIX
        deg_e7(here.lat_deg),
        deg_e7(here.lon_deg),
        alt_mm,
        70,  # HDOP, VDOP, accuracies: as recorded
        110,
        clamped(speed * 100.0, 0, U16_MAX - 1),
        _heading_cdeg(course),
        GPS_SATELLITES,
        alt_mm,
        900,
        1780,
        400,
    )


def home_position(r: Readings) -> Any:
    """HOME_POSITION; None before home is set."""
    if r.home_ned_m is None:
        return None
    at = r.frame.to_wgs84(r.home_ned_m)
    local = sub(r.home_ned_m, r.origin_ned_m)
    q = _quaternion((0.0, 0.0, r.home_yaw_rad))
    return mav.MAVLink_home_position_message(
        deg_e7(at.lat_deg),
        deg_e7(at.lon_deg),
        round(at.alt_m * 1000.0),
        *local,
        q,
        0.0,
        0.0,
        0.0,
        r.home_at_us,
    )


def gps_global_origin(r: Readings) -> Any:
    """GPS_GLOBAL_ORIGIN: of the local frame."""
    at = r.frame.to_wgs84(r.origin_ned_m)
    return mav.MAVLink_gps_global_origin_message(
        deg_e7(at.lat_deg), deg_e7(at.lon_deg), round(at.alt_m * 1000.0), r.now_us
    )


def altitude(r: Readings) -> Any:
    """ALTITUDE: metres above sea level, home and the ground."""
    amsl = r.frame.origin.alt_m - r.state.pos_ned_m[2]
    above_origin = -r.state.pos_ned_m[2]  # the mission's origin lies on the ground
    return mav.MAVLink_altitude_message(
        r.now_us, amsl, amsl, -r.local_ned_m[2], r.height_m, amsl - above_origin, above_origin
    )


def vfr_hud(r: Readings) -> Any:
    """VFR_HUD: m/s over the ground, heading in degrees, throttle in percent, climb in m/s."""
    north, east, down = r.state.vel_ned_mps
    speed = math.hypot(north, east)
    return mav.MAVLink_vfr_hud_message(
        speed,
        speed,
        _heading_cdeg(r.state.attitude_rad[2]) // 100,
        clamped(r.state.throttle * 100.0, 0, 100),
        r.frame.origin.alt_m - r.state.pos_ned_m[2],
        -down,
    )


def attitude_target(r: Readings) -> Any:
    """The airframe's own loops are not seen here: its attitude stands for the target."""
    roll, pitch, _ = r.state.attitude_rad
    q = _quaternion((roll, pitch, r.command_yaw_rad))
    return mav.MAVLink_attitude_target_message(r.boot_ms, 0, q, 0.0, 0.0, 0.0, r.state.throttle)


def position_target_local_ned(r: Readings) -> Any:
    """POSITION_TARGET_LOCAL_NED: the velocity (NED m/s) and the heading that are flown now."""
    return mav.MAVLink_position_target_local_ned_message(
        r.boot_ms,
        mav.MAV_FRAME_LOCAL_NED,
        0x7,  # as PX4 while it follows a velocity
        NAN,
        NAN,
        NAN,
        *r.command_ned_mps,
        0.0,
        0.0,
        0.0,
        r.command_yaw_rad,
        0.0,
    )


def servo_output_raw(r: Readings) -> Any:
    """SERVO_OUTPUT_RAW: microseconds of PWM, the same for all four rotors."""
    pwm = PWM_IDLE_US + clamped(r.state.throttle * PWM_SPAN_US, 0, PWM_SPAN_US) if r.armed else PWM_STOPPED_US
    return mav.MAVLink_servo_output_raw_message(r.now_us & 0xFFFFFFFF, 0, pwm, pwm, pwm, pwm, *[PWM_STOPPED_US] * 12)


def highres_imu(r: Readings) -> Any:
    """Without the acceleration of manoeuvres, which the airframe does not report: gravity only."""
    roll_pitch_yaw = r.state.attitude_rad
    specific_force = _to_body((0.0, 0.0, -GRAVITY_MPS2), roll_pitch_yaw)
    amsl = r.frame.origin.alt_m - r.state.pos_ned_m[2]
    pressure_hpa = SEA_LEVEL_HPA * max(1.0 - 2.25577e-5 * amsl, 0.01) ** 5.25588  # standard atmosphere
    return mav.MAVLink_highres_imu_message(
        r.now_us,
        *specific_force,
        *r.state.rates_radps,
        *_to_body(FIELD_NED_GAUSS, roll_pitch_yaw),
        pressure_hpa,
        0.0,
        amsl,
        15.0,
        0x1FF,  # which fields are new: as recorded
        0,
    )


_UNKNOWN_COVARIANCE = [NAN] + [0.0] * 20  # "set the first to NaN"


def odometry(r: Readings) -> Any:
    """ODOMETRY in the local frame; velocities NED m/s, covariances unknown."""
    return mav.MAVLink_odometry_message(
        r.now_us,
        mav.MAV_FRAME_LOCAL_NED,
        mav.MAV_FRAME_LOCAL_NED,
        *r.local_ned_m,
        _quaternion(r.state.attitude_rad),
        *r.state.vel_ned_mps,
        *r.state.rates_radps,
        _UNKNOWN_COVARIANCE,
        _UNKNOWN_COVARIANCE,
        0,
        8,  # MAV_ESTIMATOR_TYPE_AUTOPILOT
        0,
    )


def estimator_status(r: Readings) -> Any:
    """ESTIMATOR_STATUS: no errors; its flags say whether there is a position."""
    flags = 895 if r.home_ned_m is not None else 0  # as recorded with a position
    return mav.MAVLink_estimator_status_message(r.now_us, flags, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.3)


def vibration(r: Readings) -> Any:
    """VIBRATION: none."""
    return mav.MAVLink_vibration_message(r.now_us, 0.0, 0.0, 0.0, 0, 0, 0)


def system_time(r: Readings) -> Any:
    """SYSTEM_TIME: Unix time from UNIX_EPOCH_US on, and milliseconds since boot."""
    return mav.MAVLink_system_time_message(UNIX_EPOCH_US + r.now_us, r.boot_ms)


def timesync_request(r: Readings) -> Any:
    """TIMESYNC as PX4 asks for it by itself: tc1 = 0."""
    return mav.MAVLink_timesync_message(0, r.now_us * 1000)


def ping_request(r: Readings) -> Any:
    """PING as a broadcast, numbered once a second."""
    return mav.MAVLink_ping_message(r.now_us, r.now_us // 1_000_000, 0, 0)


# In the order in which those due together go out. The position comes last: in lockstep it is the tick.
COMMON_BUILDERS: dict[int, Builder] = {
    mav.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
    mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: gps_global_origin,
    mav.MAVLINK_MSG_ID_HOME_POSITION: home_position,
    mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS: estimator_status,
    mav.MAVLINK_MSG_ID_VIBRATION: vibration,
    mav.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
    mav.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: servo_output_raw,
    mav.MAVLINK_MSG_ID_ATTITUDE_TARGET: attitude_target,
    mav.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: position_target_local_ned,
    mav.MAVLINK_MSG_ID_HIGHRES_IMU: highres_imu,
    mav.MAVLINK_MSG_ID_ATTITUDE: attitude,
    mav.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: attitude_quaternion,
    mav.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
    mav.MAVLINK_MSG_ID_ALTITUDE: altitude,
    mav.MAVLINK_MSG_ID_ODOMETRY: odometry,
    mav.MAVLINK_MSG_ID_TIMESYNC: timesync_request,
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
}


def _nothing(r: Readings) -> None:
    """Not sent."""
    del r


def gps_raw_no_fix(r: Readings) -> Any:
    """GPS_RAW_INT of a receiver without a GNSS fix."""
    return mav.MAVLink_gps_raw_int_message(r.now_us, 1, 0, 0, 0, U16_MAX, U16_MAX, U16_MAX, U16_MAX, 0, 0, 0, 0, 0)


def estimator_status_relative(r: Readings) -> Any:
    """ESTIMATOR_STATUS: attitude, velocities, level position relative, heights; none absolute."""
    return mav.MAVLink_estimator_status_message(r.now_us, 0x2F, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.3)


def gps_raw_int_of(r: Readings, satellites: Satellites) -> Any:
    """GPS_RAW_INT of a receiver under crowns: its fix, eph as HDOP, h_acc as the receiver has it."""
    fix = satellites.fix
    if not fix.is_3d:
        message = gps_raw_no_fix(r)
        message.satellites_visible = fix.satellites
        return message
    message = gps_raw_int(r)
    at = r.frame.to_wgs84(satellites.fix_ned_m)
    message.lat, message.lon = deg_e7(at.lat_deg), deg_e7(at.lon_deg)
    message.eph, message.satellites_visible = clamped(fix.hdop * 100.0, 0, U16_MAX - 1), fix.satellites
    message.h_acc = round(fix.sd_m * 1000.0)
    return message


def estimator_status_of(r: Readings, satellites: Satellites) -> Any:
    """ESTIMATOR_STATUS: relative alone while its estimator does not go by GNSS."""
    return estimator_status(r) if satellites.uses else estimator_status_relative(r)


# What an autopilot that flies by odometry sends instead.
NO_SATELLITES: dict[int, Builder] = {
    mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: _nothing,
    mav.MAVLINK_MSG_ID_HOME_POSITION: _nothing,
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _nothing,
    mav.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_no_fix,
    mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS: estimator_status_relative,
}
