"""Rules of `[[payload]]`: units, names apart, and no more records than disks and radio hold."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from mission.common.problems import shown
from mission.schema.conflict import Conflict, conflict
from mission.schema.payload import SOURCES
from mission.schema.tables import MissionTables

# Of the whole swarm: 90,000 in an hour, beside what a survey makes; a vehicle's disk holds 200,000 of all vehicles
RECORDS_MAX_HZ: Final = 25.0
AIR_BITS: Final = 8.0 * 180.0 * 2.0  # of a record: signed, with all that a radio sends besides; and handed on once
AIR_SHARE: Final = 0.2  # of the channel: a survey's records and the beacons are on it, too
COLUMNS: Final = frozenset(  # that each row of the base station's files has besides
    {"fid", "geom", "east_m", "north_m", "up_m", "vehicle_id", "flight", "made_s", "position_sd_m"}
)


def conflicts(mission: MissionTables) -> Iterator[Conflict]:
    """Every law that `mission` breaks."""
    headings: dict[str, int] = {}
    sources: dict[str, int] = {}
    for k, one in enumerate(mission.payload):
        unit = SOURCES.get(one.source)
        if unit not in (None, one.unit):
            yield conflict(mission, (f"payload.{k}.unit",), f'must be "{unit}", in which {one.source} comes')
        if one.heading in COLUMNS:
            yield conflict(mission, (f"payload.{k}.name",), f"heads a column {one.heading}, which all records have")
        for key, seen, value in (("name", headings, one.heading), ("source", sources, one.source)):
            if value in seen:
                yield conflict(mission, (f"payload.{k}.{key}",), f"is that of payload[{seen[value]}], too")
            seen.setdefault(value, k)
    yield from _rate(mission)


def records_hz(mission: MissionTables) -> float:
    """Records of `[[payload]]` that the whole swarm makes in a second."""
    return mission.swarm.size * sum(1.0 / one.period_s for one in mission.payload)


def records_max_hz(mission: MissionTables) -> float:
    """The most that it may."""
    kbps = mission.radio.bit_rate_kbps
    return RECORDS_MAX_HZ if kbps is None else min(RECORDS_MAX_HZ, AIR_SHARE * kbps * 1e3 / AIR_BITS)


def _rate(mission: MissionTables) -> Iterator[Conflict]:
    rate_hz, most_hz = records_hz(mission), records_max_hz(mission)
    if rate_hz <= most_hz:
        return
    fastest = min(range(len(mission.payload)), key=lambda k: mission.payload[k].period_s)
    others = f"swarm.size = {shown(mission.swarm.size)}"
    if most_hz < RECORDS_MAX_HZ:
        others += f", radio.bit_rate_kbps = {shown(mission.radio.bit_rate_kbps)}"
    yield Conflict(
        (("payload", fastest, "period_s"),),
        shown(mission.payload[fastest].period_s),
        f"all vehicles' payload makes {rate_hz:.1f} records a second: must be at most {most_hz:.1f} ({others})",
    )
