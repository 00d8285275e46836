"""A good mission in a few figures, and these in words."""

from __future__ import annotations

from typing import Any

from mission.common.problems import printable
from mission.document.airtime import airtime_s, battery_mah, battery_share
from mission.document.load import MAX_PLACE_CHARS
from mission.document.model import Mission


def summarise(file: str, mission: Mission) -> dict[str, Any]:
    """Its figures, as `mission check --json` has them."""
    return {
        "file": file,
        "ok": True,
        "name": mission.name,
        "vehicles": mission.swarm.size,
        "stops": len(mission.route.stops),
        "lanes": len(mission.lanes),
        "distance_m": mission.way_m,
        "vel_leader_mps": mission.route.vel_leader_mps,
        "transit_s": mission.way_m / mission.route.vel_leader_mps,
        "airtime_s": round(airtime_s(mission), 1),
        "battery_mah": round(battery_mah(mission)),
        "battery_share": round(battery_share(mission), 3),
        "origin": mission.origin is not None,
        "flies_blind": mission.flies_blind,
        "problems": [],
    }


def describe_airtime(result: dict[str, Any]) -> str:
    """Least time in the air, and the charge that it takes."""
    minutes, charge = (
        result["airtime_s"] / 60.0,
        f"{result['battery_mah']} mAh, {100.0 * result['battery_share']:.0f} %",
    )
    return f"at least {minutes:.1f} min in the air: {charge} of the smallest simulated battery"


def describe(result: dict[str, Any]) -> str:
    """Sentence about `result`, of `summarise`."""
    vehicles = "1 vehicle" if result["vehicles"] == 1 else f"{result['vehicles']} vehicles"
    stops = {0: "", 1: " over 1 stop"}.get(result["stops"], f" over {result['stops']} stops")
    lanes = f" over {result['lanes']} lane{'s' * (result['lanes'] > 1)}" if result["lanes"] else ""
    return (
        f"{printable(result['file'], MAX_PLACE_CHARS)}: ok: {result['name'] or 'unnamed'}, {vehicles}, "
        f"{result['distance_m']:.1f} m{stops}{lanes}, "
        f"{result['transit_s']:.1f} s at {result['vel_leader_mps']} m/s"
        f"{'' if result['origin'] else '; no [origin]: for the simulator alone'}"
        f"{'; no [sensing]: vehicles do not see the forest' * result['flies_blind']}"
    )
