"""What the bridge has of the rangefinder: where its beam ends, and the frames that its driver sends."""

import math

from companion.mavlink import dialect
from companion.mavlink.framing import wire

RATE_HZ = 10.0
DRIVER = 180  # its MAVLink component


class RangefinderModel:
    """The rangefinders of all vehicles: a level beam, without noise, that trunks end."""

    is_optical = True  # a vehicle that is blind (`--blind`) sends nothing

    def __init__(self, mission, stand, ids):
        self.stand, self.reach_m = stand, mission.sensing.range_m
        self.drivers = {k: wire.Sender(k, DRIVER) for k in ids}
        self.due_s = dict.fromkeys(ids, 0.0)

    def frames(self, vehicle_id, state, positions_ned_m, now_s):
        """DISTANCE_SENSOR, ten times a second."""
        if now_s < self.due_s[vehicle_id]:
            return b""
        self.due_s[vehicle_id] = now_s + 1.0 / RATE_HZ - 1e-6
        range_m = min(self.ranges_m(state), default=self.reach_m + 0.01)  # beyond its reach: nothing there
        values = (20, round(self.reach_m * 100), round(range_m * 100), 0, 0, 0, 255)
        message = dialect.MAVLink_distance_sensor_message(round(now_s * 1000), *values)
        return self.drivers[vehicle_id].pack(message)

    def ranges_m(self, state):
        """Of the trunks that the beam meets."""
        north_m, east_m, _ = state.pos_ned_m
        yaw_rad = state.attitude_rad[2]
        for tree in self.stand.near(east_m, north_m, self.reach_m):
            north, east = tree.north_m - north_m, tree.east_m - east_m
            ahead_m = north * math.cos(yaw_rad) + east * math.sin(yaw_rad)
            aside_m = east * math.cos(yaw_rad) - north * math.sin(yaw_rad)
            if ahead_m > 0.0 and abs(aside_m) < tree.radius_m:
                range_m = ahead_m - math.sqrt(tree.radius_m**2 - aside_m**2)
                if range_m <= self.reach_m:
                    yield max(0.2, range_m)
