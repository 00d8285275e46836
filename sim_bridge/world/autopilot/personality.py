"""Selects the autopilot that a vehicle has, by its name in the mission file."""

from __future__ import annotations

from collections.abc import Mapping

from mission.common.frames import LocalFrame
from mission.document.model import Personality
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.autopilot.ardupilot.autopilot import ArduCopterAutopilot
from sim_bridge.world.autopilot.battery import BatterySpec
from sim_bridge.world.autopilot.protocols.links import Link
from sim_bridge.world.autopilot.px4.autopilot import Px4Autopilot
from sim_bridge.world.autopilot.types import Autopilot, Satellites, StreamProfile
from sim_bridge.world.autopilot.vehicle import PROFILES

AUTOPILOTS: Mapping[Personality, type[Px4Autopilot] | type[ArduCopterAutopilot]] = {
    Personality.PX4: Px4Autopilot,
    Personality.ARDUPILOT: ArduCopterAutopilot,
}
CAPACITY: Mapping[Personality, str] = {Personality.PX4: "BAT1_CAPACITY", Personality.ARDUPILOT: "BATT_CAPACITY"}  # mAh
# Under a canopy: hold when setpoints stop for 0.5 s, never return, land with a critical battery (7 %), ignore an absent
# ground station (design: safety; `companion preflight` wants the same).
CANOPY_PARAMETERS: Mapping[Personality, Mapping[str, float]] = {
    Personality.PX4: {
        "COM_OF_LOSS_T": 0.5,
        "COM_OBL_RC_ACT": 5,
        "NAV_RCL_ACT": 1,
        "COM_RCL_EXCEPT": 4,
        "COM_FLTT_LOW_ACT": 1,
        "COM_POS_LOW_ACT": 5,
        "COM_LOW_BAT_ACT": 2,
        "COM_RC_OVERRIDE": 3,
    },
    Personality.ARDUPILOT: {
        "GUID_TIMEOUT": 0.5,
        "FS_GCS_ENABLE": 0,
        "FS_THR_ENABLE": 3,
        "FS_OPTIONS": 20,
        "FS_DR_ENABLE": 1,
        "BATT_FS_LOW_ACT": 0,
        "BATT_FS_CRT_ACT": 1,
        "BATT_CRT_MAH": 231.0,
        "FENCE_ACTION": 4,
    },
}
# Of one whose height a downward range finder holds; `companion preflight` wants the same for layers of height
RANGE_FINDER_PARAMETERS: Mapping[Personality, Mapping[str, float]] = {
    Personality.PX4: {"EKF2_HGT_REF": 2, "EKF2_RNG_CTRL": 2},
    Personality.ARDUPILOT: {"EK3_SRC1_POSZ": 2, "RNGFND1_TYPE": 100},  # SITL's
}


def make_autopilot(
    personality: Personality,
    sysid: int,
    airframe: Airframe,
    frame: LocalFrame,
    *,
    parameters: Mapping[str, float] | None = None,
    links: Mapping[Link, StreamProfile] = PROFILES,
    battery: BatterySpec | None = None,
    satellites: bool = True,
    shaded: Satellites | None = None,
) -> Autopilot:
    """An autopilot that behaves as `personality`; what is raised, see there. `parameters`: by its own names.

    `satellites`: it knows where on Earth it is. Without, `airframe` must not know it either.
    `shaded`: its fixes, where crowns stand above; None: good ones.
    """
    made = AUTOPILOTS[personality]
    autopilot = made(sysid, airframe, frame, parameters=parameters, links=links, battery=battery)
    if not satellites:
        autopilot.lose_satellites()
    elif shaded is not None:
        autopilot.take_satellites(shaded)
    return autopilot


def odometry_parameters(personality: Personality, altitude_m: float) -> dict[str, float]:
    """Parameters of an autopilot without GNSS: how high it climbs; see `companion preflight`."""
    return {"MIS_TAKEOFF_ALT": altitude_m, "EKF2_GPS_CTRL": 0} if personality is Personality.PX4 else {}
