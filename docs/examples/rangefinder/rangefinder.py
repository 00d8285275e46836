"""A rangefinder that looks ahead: DISTANCE_SENSOR, as a scan of one sector. What the companion has of it."""

from types import SimpleNamespace

from companion.mavlink import dialect
from companion.mavlink.sensor_source import Finding
from companion.sensors.obstacle_sensor import ObstacleSensor, ScanTally

BEAM_DEG = 10.0


class Rangefinder(ObstacleSensor):
    """A vehicle's rangefinder. Its scans wait for ATTITUDE, as those of other obstacle sensors do."""

    NAME = "rangefinder"
    TITLE = "rangefinder"
    MESSAGES = {dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: "DISTANCE_SENSOR"}
    HELP = "DISTANCE_SENSOR of a rangefinder that looks ahead"
    ABOUT = "A rangefinder that is heard has no gap above `sensing.stale_s`."
    UNUSED = "has no [sensing] with sectors"
    IS_FORWARDED = False  # an autopilot's own may look down

    def decode(self, m, component, now_s):
        """DISTANCE_SENSOR, which waits for the tick's ATTITUDE."""
        return super().decode(to_scan(m), component, now_s)

    def counters(self):
        """Ranges that were dropped."""
        return {name.replace("scans", "rangefinder"): count for name, count in super().counters().items()}

    @classmethod
    def tally(cls, began_s):
        """Counts DISTANCE_SENSOR."""
        return RangefinderTally(began_s)


class RangefinderTally(ScanTally):
    """Tally of what rangefinders send in a while."""

    def note_message(self, m, who, now_s):
        """One DISTANCE_SENSOR."""
        return super().note_message(to_scan(m), who, now_s)

    def check(self, mission, vehicle_id, ended_s, where):
        """Against sensing.stale_s."""
        own = [sensor for sensor in self.sensors(ended_s) if sensor.system == vehicle_id]
        late = any(sensor.gap_s > mission.sensing.stale_s for sensor in own)
        found = "; ".join(sensor.text for sensor in own) or f"no rangefinder on {where}"
        fix = "a busy computer, a slow link?" if late else "" if own else "is its driver running?"
        return Finding(found, f"no gap above {mission.sensing.stale_s:g} s", fix)


def to_scan(m):
    """DISTANCE_SENSOR as the OBSTACLE_DISTANCE of one sector."""
    return SimpleNamespace(
        time_usec=1000 * m.time_boot_ms,
        frame=dialect.MAV_FRAME_BODY_FRD,
        distances=(m.current_distance,),
        increment_f=BEAM_DEG,
        angle_offset=0.0,
        min_distance=m.min_distance,
        max_distance=m.max_distance,
    )
