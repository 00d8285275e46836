"""A simulator of a Meadow, `python -m meadow_simulator PORT ID`: a point that moves as its setpoints say."""

import contextlib
import math
import socket
import sys
import time

from meadow_make import AUTOPILOT, DOWN, STAY, STEERED

from companion.mavlink import dialect
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import Framing
from mission.common.frames import LocalFrame, Wgs84

TICK_S = 0.05
HOME = Wgs84(47.397742, 8.545594, 488.0)
SPACING_M = 6.0  # vehicle 2 stands so far east of vehicle 1
SETPOINTS_END_S = 0.5  # then it stays


class Meadow:
    """One vehicle and its autopilot."""

    def __init__(self, vehicle_id):
        self.mode, self.armed, self.climbs_to_m, self.setpoint_s = STAY, False, 0.0, -math.inf
        self.pos, self.vel = [0.0, SPACING_M * (vehicle_id - 1), 0.0], [0.0, 0.0, 0.0]  # NED about HOME
        self.sender, self.framing = wire.Sender(vehicle_id, 1), Framing()
        self.out = []

    def read(self, data, now_s):
        """Commands and setpoints."""
        for incoming in self.framing.read_messages(data):
            m = incoming.message
            if incoming.message_id == dialect.MAVLINK_MSG_ID_COMMAND_LONG:
                self.obey(m)
            elif incoming.message_id == dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
                self.setpoint_s = now_s
                if self.mode == STEERED and not self.climbs_to_m:
                    self.vel = [m.vx, m.vy, m.vz]

    def obey(self, m):
        """One command, which is then acknowledged."""
        match m.command:
            case dialect.MAV_CMD_COMPONENT_ARM_DISARM:
                self.armed = m.param1 == 1.0
            case dialect.MAV_CMD_DO_SET_MODE:
                self.mode = int(m.param2)
            case dialect.MAV_CMD_NAV_TAKEOFF:
                self.climbs_to_m = m.param7
            case dialect.MAV_CMD_NAV_LAND:
                self.mode = DOWN
        self.out.append(dialect.MAVLink_command_ack_message(m.command, 0))

    def move(self, now_s):
        """One tick."""
        up_m = -self.pos[2]
        if self.mode == STEERED and not self.climbs_to_m and now_s - self.setpoint_s > SETPOINTS_END_S:
            self.mode = STAY
        if not self.armed or self.mode == STAY:
            self.vel = [0.0, 0.0, 0.0]
        elif self.climbs_to_m:
            self.vel = [0.0, 0.0, -2.0]
            if up_m >= self.climbs_to_m - 0.1:
                self.climbs_to_m, self.vel = 0.0, [0.0, 0.0, 0.0]
        elif self.mode == DOWN:
            self.vel, self.armed = [0.0, 0.0, 1.0], up_m > 0.05
        self.pos = [at + vel * TICK_S for at, vel in zip(self.pos, self.vel, strict=True)]
        self.pos[2] = min(0.0, self.pos[2])

    def say(self, tick):
        """Frames of a tick."""
        ms, place = tick * 50, LocalFrame(HOME).to_wgs84(tuple(self.pos))
        lat, lon = round(place.lat_deg * 1e7), round(place.lon_deg * 1e7)
        up_mm, vel_cmps = round(-self.pos[2] * 1e3), [round(100 * vel) for vel in self.vel]
        landed = 1 if up_mm < 100 else 3 if self.climbs_to_m else 2
        self.out += [
            dialect.MAVLink_local_position_ned_message(ms, *self.pos, *self.vel),
            dialect.MAVLink_global_position_int_message(
                ms, lat, lon, round(HOME.alt_m * 1e3) + up_mm, up_mm, *vel_cmps, 0
            ),
            dialect.MAVLink_attitude_message(ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            dialect.MAVLink_extended_sys_state_message(0, landed),
        ]
        if tick % 20 == 0:
            home = round(HOME.lat_deg * 1e7), round(HOME.lon_deg * 1e7), round(HOME.alt_m * 1e3)
            state = dialect.MAV_STATE_ACTIVE if self.armed else dialect.MAV_STATE_STANDBY
            self.out += [
                dialect.MAVLink_heartbeat_message(2, AUTOPILOT, 128 * self.armed, self.mode, state, 3),
                dialect.MAVLink_sys_status_message(0, 0, 1 << 28, 0, 0, 0, 90, 0, 0, 0, 0, 0, 0),
                dialect.MAVLink_gps_global_origin_message(*home, 0),
                dialect.MAVLink_home_position_message(*home, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0),
            ]
        said, self.out = b"".join(map(self.sender.pack, self.out)), []
        return said


def main():
    """Until it is ended: 20 times a second."""
    port, vehicle = int(sys.argv[1]), Meadow(int(sys.argv[2]))
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.connect(("127.0.0.1", port))
    link.setblocking(False)
    began_s = time.monotonic()
    tick = 0
    while True:
        tick += 1
        time.sleep(max(0.0, began_s + tick * TICK_S - time.monotonic()))
        now_s = time.monotonic()
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):  # nobody is there yet
            while True:
                vehicle.read(link.recv(65536), now_s)
        vehicle.move(now_s)
        with contextlib.suppress(ConnectionRefusedError):
            link.send(vehicle.say(tick))


if __name__ == "__main__":
    main()
