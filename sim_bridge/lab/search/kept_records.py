"""Finds records of a survey that were lost without a fault, or had not come to the base station at the end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from mission.document.model import AtEnd, Mission
from mission.schema.kinds import FaultKind
from sim_bridge.judge.fault_events import SILENCING, FaultEvent
from sim_bridge.judge.verdict import Grade

RECORDS: Final = "records"
MEANS: Final = "records were lost that no fault took, or had not come to the base station beside which all had landed"
# What a companion had not written when it was killed is gone; so is what a full disk did not take
TAKING: Final = (*SILENCING, FaultKind.DISK_FULL)
PARTING: Final = (FaultKind.BASE_LOST, FaultKind.PARTITION, *SILENCING)


def find_lacking_records(summary: Mapping[str, Any], mission: Mission, faults: Sequence[FaultEvent]) -> str:
    """The lacking records by the figures in `summary` (`Harvest.figures`), in words, or ""."""
    if not mission.keeps_records:
        return ""
    taken = {k for fault in faults if fault.kind in TAKING for k in fault.vehicles}
    unwritten = {k: count for k, count in summary["records_unwritten"].items() if int(k) not in taken}
    if unwritten:
        return "; ".join([f"{count} records of vehicle {k} were not written" for k, count in unwritten.items()])
    made, delivered = summary["records_made"], summary["records_delivered"]
    if delivered > made:
        return f"{delivered} records delivered of {made} made"
    end_s = summary["sim_time_s"]
    parted = any(fault.kind in PARTING and (fault.until_s is None or fault.until_s >= end_s) for fault in faults)
    home = mission.route.at_end is AtEnd.RETURN and summary["grade"] == Grade.ARRIVED and not parted
    waiting = summary["records_waiting"] if home else {}
    return "; ".join([f"{count} records still on vehicle {k}, at the base station" for k, count in waiting.items()])
