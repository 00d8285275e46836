"""The nouns of the flight software, with their units and frames; vectors and linear algebra. Everything stands on it.

| quantity | unit, frame |
|---|---|
| time | seconds of the local monotonic clock; no two vehicles' clocks need to agree |
| position | NED metres about the mission's origin (down = 0 is the ground there) |
| relative position | NED metres, from the vehicle itself to the other |
| velocity | NED metres per second over ground |
| yaw | radians from north towards the east |
| altitude | metres above the origin's ground |
| vehicle id | the MAVLink system id, 1..250 |
"""
