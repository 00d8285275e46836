"""What tests of the `companion` program fly: a mission file that it takes as it is."""

from __future__ import annotations

MISSION = """\
schema = 1
name = "test"
[origin]
lat_deg = 47.0
lon_deg = 8.0
alt_m = 400.0
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [60.0, 0.0, 8.0]
vel_leader_mps = 3.0
[swarm]
size = 2
"""
