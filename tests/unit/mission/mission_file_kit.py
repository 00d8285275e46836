"""A mission file with every key, and what is wrong with a changed one."""

from __future__ import annotations

import pytest

from mission.document.load import MissionError, Problem, parse_mission

# Every key there is, one to a line, so that every refusal has a line to name
FULL = """\
# a comment
schema = 1
name = "all keys"
sensors = ["sonar"]
[origin]
lat_deg = 49.5
lon_deg = 6.36
alt_m = 310.0
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [130.0, 0.0, 8.0]
vel_leader_mps = 3.0
arrival_distance_m = 5.0
at_end = "land"
[swarm]
size = 8
leader_priority = [2, 1]
reelection_period_s = 30.0
start_timeout_s = 20.0
gnss = "all"
position_error_max_m = 10.0
position_uncertain = "return"
[radio]
transit_range_m = 30.0
full_range_m = 55.0
beacon_rate_hz = 10.0
bit_rate_kbps = 250.0
[separation]
hard_m = 5.0
soft_m = 10.0
height_layers = false
[coverage]
shape = "ring"
radius_m = 15.0
keep_out_m = 2.0
duration_s = 45.0
[limits]
speed_max_mps = 5.0
climb_max_mps = 1.5
acceleration_max_mps2 = 3.0
[fence]
altitude_min_m = 2.0
altitude_max_m = 30.0
polygon_enu_m = [[-40.0, -50.0], [170.0, -50.0], [170.0, 50.0], [-40.0, 50.0]]
[sensing]
range_m = 34.0
rate_hz = 10.0
field_of_view_deg = 360.0
vehicle_radius_m = 0.35
margin_m = 0.3
stale_s = 0.3
sensor = "multi-layer"
upside_down = false
sends_odometry = false
[survey]
reach_m = 7.0
dbh_min_m = 0.08
taper_cm_per_m = 1.0
taper_sd_cm_per_m = 0.4
lane_m = 20.0
rise_to_m = 32.0
[survey.until]
basal_area_pct = 15.0
confidence = 0.9
after_s = 20.0
[[payload]]
name = "light"
unit = "lx"
period_s = 10.0
source = "NAMED_VALUE_FLOAT.light"
[forest]
grade = [0.01, -0.02]
[forest.shapes]
lean_deg = 1.5
ellipse = 0.06
taper_exponent = 0.7
taper_exponent_sd = 0.15
bark_m = 0.004
forks = 0.03
stubs_per_tree = 1.0
saplings_per_ha = 100.0
litter_per_ha = 200.0
[forest.stand]
seed = 5
density_per_ha = 400.0
margin_m = 40.0
area_enu_m = [[-40.0, -50.0], [170.0, -50.0], [170.0, 50.0], [-40.0, 50.0]]
spacing_min_m = 1.5
dbh_min_m = 0.1
dbh_mean_m = 0.25
dbh_max_m = 0.5
dbh_shape = 2.0
species = ["spruce", "spruce"]
height_mean_m = 17.0
crown_base_share = 1.0
undergrowth_per_ha = 100.0
undergrowth_height_m = 1.5
clearing_m = 2.0
[[forest.trees]]
base_enu_m = [130.0, 0.0]
trunk_radius_m = 0.6
height_m = 28.0
[[forest.boxes]]
centre_enu_m = [60.0, 30.0]
length_m = 10.0
width_m = 4.0
height_m = 12.0
rotation_deg = 15.0
[ranging]
radio = true
start_enu_m = [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0], [0.0, 8.0, 0.0], [8.0, 8.0, 0.0], \
[-8.0, 0.0, 0.0], [-8.0, 8.0, 0.0], [-8.0, -8.0, 0.0], [8.0, -8.0, 0.0]]
reach_m = 25.0
rate_hz = 10.0
[sim]
seed = 1
wind_mps = [0.0, 0.0, 0.0]
turbulence_mps = 0.0
radio_loss = 0.0
radio_delay_s = 0.0
radio_trunks = "attenuated"
radio_trunk_db = 6.0
personality = "px4"
personalities = { 3 = "ardupilot" }
estimates = "exact"
velocity_bias_mps = 0.4
climb_bias_mps = 0.1
velocity_noise_mps = 0.2
position_noise_m = 0.3
estimate_delay_s = 0.3
range_finder = true
drag = "low"
battery_mah = { 2 = 1000.0 }
placement = "random"
placement_spacing_m = 6.0
time_limit_s = 300.0
[sim.lidar]
noise_m = 0.05
dropout = 0.02
delay_s = 0.0
via = "link"
[sim.ranging]
noise_m = 0.1
loss = 0.1
late = 0.1
trunks = "late"
slots_hz = 320.0
start_error_m = 0.5
[sim.odometry]
velocity_noise_mps = 0.1
velocity_bias_mps = 0.05
yaw_deg = 2.0
[sim.satellites]
crowns = "clear"
crown_db_per_m = 1.0
[[sim.faults]]
kind = "late"
vehicles = [4, 5]
at_s = 10.0
phase = "transit"
for_s = 5.0
late_s = 1.5
"""

STOPS = """\
[[route.stops]]
pos_enu_m = [60.0, 20.0, 8.0]
duration_s = 30.0
"""


def _of_kind(kind: str, numbers: str) -> str:
    """FULL with a fault of another kind, which has other numbers."""
    return FULL.replace('kind = "late"', f'kind = "{kind}"').replace("late_s = 1.5", numbers)


SCANS = _of_kind("scan-errors", "noise_m = 0.1\ndelay_s = 0.2")
OTHER_FAULTS = {  # by the key that FULL's fault does not have
    "sim.faults[0].wind_mps": _of_kind("wind", "wind_mps = [4.0, -3.0]"),
    "sim.faults[0].drift_mps": _of_kind("gnss-drift", "drift_mps = [0.1, 0.0]"),
    "sim.faults[0].jump_m": _of_kind("position-jump", "jump_m = [6.0, 0.0]"),
    "sim.faults[0].height_m": _of_kind("height-error", "height_m = 10.0"),
    "sim.faults[0].noise_m": SCANS,
    "sim.faults[0].delay_s": SCANS,
    "sim.faults[0].lie": _of_kind("insider", 'lie = "push"'),
    "sim.faults[0].bias_m": _of_kind("range-errors", "bias_m = 0.2\nnoise_m = 0.1"),
}


def with_value(key: str, value: str, text: str = "") -> tuple[str, int]:
    """`text`, or FULL (with STOPS or another fault for their keys), with another value for `key`, and its line."""
    if not text:
        text = FULL + STOPS if key.startswith("route.stops") else OTHER_FAULTS.get(key, FULL)
    lines, table = text.splitlines(), ""
    for index, line in enumerate(lines):
        if line.startswith("["):
            table = line.strip("[]") + ("[0]." if line.startswith("[[") else ".")
        elif table + line.split(" = ")[0] == key:
            lines[index] = f"{line.split(' = ')[0]} = {value}"
            return "\n".join(lines), index + 1
    raise AssertionError(f"no {key}")


def without(key: str) -> str:
    text, line = with_value(key, "")
    lines = text.splitlines()
    lines[line - 1] = ""
    return "\n".join(lines)


def problems_of(text: str) -> tuple[Problem, ...]:
    with pytest.raises(MissionError) as caught:
        parse_mission(text, "m.toml")
    return caught.value.problems


def only_problem(text: str) -> Problem:
    problems = problems_of(text)
    assert len(problems) == 1, [str(problem) for problem in problems]
    return problems[0]
