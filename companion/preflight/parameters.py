"""The autopilot's parameters as they must be under a canopy: what is good, and why. Data.

Values and their meanings: PX4 1.14-1.16 and ArduCopter 4.5-4.7, whose own references name them. An int is an integer
parameter, a float a REAL32. One law is above all: nothing may end in a return flight, which first climbs into the
branches.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from mission.model import Mission

FLOAT_TOLERANCE = 1e-6  # of REAL32


class Kind(StrEnum):
    """Autopilots that a companion can fly."""

    PX4 = "px4"
    ARDUPILOT = "ardupilot"


@dataclass(frozen=True, slots=True)
class Rule:
    """One parameter. `good`: value -> what it does; the first of them is what `--apply` sets."""

    name: str
    good: Mapping[int | float, str]
    why: str
    older_names: tuple[str, ...] = ()  # of the same parameter in earlier firmwares
    optional: bool = False  # older firmwares have none: only a warning

    @property
    def names(self) -> tuple[str, ...]:
        """To be tried in this order."""
        return (self.name, *self.older_names)

    @property
    def wanted(self) -> int | float:
        """What `--apply` sets."""
        return next(iter(self.good))

    def fits(self, value: float) -> bool:
        """`value`, as read, is a good one."""
        return any(math.isclose(value, good, rel_tol=FLOAT_TOLERANCE, abs_tol=FLOAT_TOLERANCE) for good in self.good)

    @property
    def text(self) -> str:
        """The good values in words."""
        return " or ".join(f"{value:g} ({meaning})" for value, meaning in self.good.items())


PX4_RULES = (
    Rule(
        "COM_OF_LOSS_T",
        {0.5: "seconds"},
        "A vehicle whose companion hangs flies on blindly for this long; the companion itself counts on 0.5 s.",
    ),
    Rule(
        "COM_OBL_RC_ACT",
        {5: "hold", 4: "land"},
        "What follows. The default, 0, wants a pilot's sticks; without them it descends and drifts sideways.",
    ),
    Rule(
        "NAV_RCL_ACT",
        {1: "hold", 3: "land"},
        "Under trees the pilot's radio will drop out. The default, 2, returns, and climbs for it.",
    ),
    Rule(
        "COM_RCL_EXCEPT",
        {4: "not in OFFBOARD", 0: "in every mode"},
        "Where the pilot's radio drops out the mission goes on. With 0 each loss takes the vehicle out of the swarm.",
    ),
    Rule(
        "NAV_DLL_ACT",
        {0: "none", 1: "hold", 3: "land"},
        "The ground station is out of reach by design. 2 returns, and refuses to arm beside a companion alone.",
    ),
    Rule(
        "COM_LOW_BAT_ACT",
        {2: "land when critical"},
        "The companion lands at 10 %; this is for when it cannot. The default only warns; 3 returns.",
    ),
    Rule(
        "COM_FLTT_LOW_ACT",
        {1: "warn", 0: "none"},
        "The default, 3, returns as soon as the battery is just enough for the way home.",
        optional=True,
    ),
    Rule(
        "COM_POS_LOW_ACT",
        {5: "land", 2: "hold", 1: "warn", 0: "none"},
        "A poor position is usual under a canopy. The default, 3, returns.",
        optional=True,
    ),
    Rule(
        "COM_RC_OVERRIDE",
        {3: "in auto modes and in OFFBOARD"},
        "A pilot who moves the sticks has the vehicle, whatever the companion does.",
    ),
    Rule(
        "GF_ACTION",
        {2: "hold", 5: "land"},
        "The second fence, behind the companion's own. 3 returns, 4 cuts the motors.",
    ),
)
ARDUPILOT_RULES = (
    Rule(
        "GUID_TIMEOUT",
        {0.5: "seconds"},
        "A vehicle whose companion hangs flies on blindly for this long (default 3 s), then brakes.",
    ),
    Rule(
        "FS_GCS_ENABLE",
        {0: "none", 5: "land", 7: "brake or land"},
        "The ground station is out of reach by design. 1, 3, 4 and 6 return or retrace.",
    ),
    Rule(
        "MAV_GCS_SYSID",
        {255: "the ground station"},
        "Heartbeats of this system id are the ground station's: never a vehicle's own, which its companion shares.",
        older_names=("SYSID_MYGCS",),
    ),
    Rule(
        "FS_THR_ENABLE",
        {3: "land", 7: "brake or land"},
        "Under trees the pilot's radio will drop out. The default, 1, returns, and climbs for it.",
    ),
    Rule(
        "FS_OPTIONS",
        {20: "GUIDED goes on", 4: "GUIDED goes on", 16: "in every mode", 0: "in every mode"},
        "Where the pilot's radio drops out the mission goes on; else each loss takes the vehicle out of the swarm.",
    ),
    Rule(
        "FS_EKF_ACTION",
        {1: "land", 3: "land, in every mode"},
        "Without a position the vehicle comes down where it is. 2 wants a pilot, 0 does nothing.",
    ),
    Rule(
        "FS_DR_ENABLE",
        {1: "land", 0: "none"},
        "While the position is only guessed: the default, 2, returns by guesswork.",
        optional=True,
    ),
    Rule(
        "BATT_FS_LOW_ACT",
        {1: "land", 0: "none", 7: "brake or land"},
        "Low: the companion gives up leadership and lands at 10 %. 2, 3, 4 and 6 return or retrace.",
    ),
    Rule(
        "BATT_FS_CRT_ACT",
        {1: "land", 7: "brake or land"},
        "Critical, when the companion has not landed: down, here.",
    ),
    Rule(
        "FENCE_ACTION",
        {4: "brake, or land", 2: "land"},
        "The second fence, behind the companion's own. 1, 3 and 5 return or retrace; 0 only reports.",
    ),
)
RULES: Mapping[Kind, tuple[Rule, ...]] = {Kind.PX4: PX4_RULES, Kind.ARDUPILOT: ARDUPILOT_RULES}
FENCE_TYPE_ALTITUDE, FENCE_TYPE_POLYGON = 1, 4  # ArduPilot's bits of FENCE_TYPE


def rules(kind: Kind, mission: Mission) -> tuple[Rule, ...]:
    """Those of the table, and the fence's that depend on the mission."""
    return RULES[kind] + fence_rules(kind, mission)


def fence_rules(kind: Kind, mission: Mission) -> tuple[Rule, ...]:
    """The mission's ceiling, counted from home by both autopilots, and what makes the fence work."""
    ceiling_m = mission.fence.altitude_max_m
    if kind is Kind.PX4:
        return (Rule("GF_MAX_VER_DIST", {ceiling_m: "metres"}, "The mission's fence.altitude_max_m, above home."),)
    types, words = FENCE_TYPE_ALTITUDE, "ceiling"
    if mission.fence.polygon_enu_m is not None:
        types, words = FENCE_TYPE_ALTITUDE | FENCE_TYPE_POLYGON, "ceiling and polygon"
    return (
        Rule("FENCE_ENABLE", {1: "on"}, "The fence works only when it is on."),
        Rule("FENCE_TYPE", {types: words}, "What the mission's fence has; no circle about home (2), no floor (8)."),
        Rule("FENCE_ALT_MAX", {ceiling_m: "metres"}, "The mission's fence.altitude_max_m, above home."),
    )
