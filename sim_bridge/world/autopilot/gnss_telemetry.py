"""Telemetry of an autopilot whose receiver fails: no fix, and then no position."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from companion.mavlink import dialect as mav
from sim_bridge.world.autopilot.estimates.gnss_faults import FaultyGnss
from sim_bridge.world.autopilot.telemetry import Builder, Readings, gps_raw_no_fix

OF_POSITION: tuple[int, ...] = (  # not sent by an estimator that has none
    mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
    mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    mav.MAVLINK_MSG_ID_ODOMETRY,
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
)


def failing_builders(gnss: FaultyGnss, builders: Mapping[int, Builder]) -> dict[int, Builder]:
    """The `builders` of messages with fix and position, for a GNSS that fails."""
    found: dict[int, Builder] = {
        message_id: partial(_while_known, gnss, builders[message_id])
        for message_id in OF_POSITION
        if message_id in builders
    }
    fix = builders[mav.MAVLINK_MSG_ID_GPS_RAW_INT]
    found[mav.MAVLINK_MSG_ID_GPS_RAW_INT] = lambda r: fix(r) if gnss.has_fix else gps_raw_no_fix(r)
    return found


def _while_known(gnss: FaultyGnss, told: Builder, readings: Readings) -> Any:
    return told(readings) if gnss.has_position else None
