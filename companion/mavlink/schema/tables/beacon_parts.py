"""Values within a SWARM_BEACON that it may be without: its rows stand in `beacon`."""

from __future__ import annotations

from typing import Final

from companion.mavlink.schema.rows import Part, Value

PARTS: Final = (
    Part(
        attribute="lease",
        name="Lease",
        about="A leader's claim as it travels from neighbour to neighbour. Compared by `election.rank`.",
        when="leader",
        by_place=("leader", "seq", "priority", "score", "established", "heir", "ends", "quorum"),
    ),
    Part(
        attribute="candidate",
        name="Candidate",
        about="A vehicle that could lead: by priority, then score.",
        when="candidate",
        note="the best of the sender and those behind it to succeed that leader",
        by_place=("vehicle", "priority", "score"),
    ),
    Part(
        attribute="sighting",
        name="PeerReport",
        about="A third vehicle's position when it was last heard, as it travels with the beacons.",
        when="seen",
        note="of one that fell silent, or is heard though a neighbour calls it silent",
        by_place=("vehicle", "rel_ned_m", "age_s", "silent"),
        local=(
            Value(
                "sighting.received",
                kind="bool",
                note="from another vehicle's beacon, not heard here (not on the wire)",
                default="False",
            ),
            Value(
                "sighting.every_height",
                kind="bool",
                note="it was on its way up or down (not on the wire)",
                default="False",
            ),
            Value(
                "sighting.elsewhere",
                kind="tuple[Vec3, ...]",
                note="other places at which it may hover, by others' words (not on the wire)",
                default="()",
            ),
        ),
        default="None",
    ),
    Part(
        attribute="echo",
        name="BeaconEcho",
        about="Receipt of a neighbour's beacon, by which that one measures how old this vehicle's beacons are.",
        when="echo",
        note="of one neighbour's beacon, each neighbour in turn",
        by_place=("vehicle", "time_ms", "hold_s"),
        default="None",
    ),
)
