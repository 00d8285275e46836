"""Our own messages, and what their rows refer to by name."""

from __future__ import annotations

from typing import Final

from companion.core.model.states import SwarmPhase
from companion.mavlink.schema.rows import Enumeration, Message
from companion.mavlink.schema.tables.beacon import BEACON, FASTEST_MPS, FURTHEST_M, VERSION
from companion.mavlink.schema.tables.measurements import LIDAR_SCAN, RANGES, RECORD, RECORD_VECTOR, RELATIVE, TRUNKS
from companion.mavlink.schema.tables.orders import ORDER
from companion.mavlink.schema.tables.signed_records import BASE_VECTOR, SIGNED_RECORD
from companion.mavlink.schema.tables.signing import MANIFEST

OWN: Final[tuple[Message, ...]] = (
    *(BEACON, RANGES, RELATIVE, LIDAR_SCAN, RECORD_VECTOR, RECORD),
    *(ORDER, MANIFEST, SIGNED_RECORD, BASE_VECTOR, TRUNKS),
)
CONSTANTS: Final = {  # name in own_messages.py: value, reason
    "VERSION": (VERSION, "of what the fields of a beacon mean"),
    "FURTHEST_M": (FURTHEST_M, "beyond it a position, and"),
    "FASTEST_MPS": (FASTEST_MPS, "beyond it a velocity is not believed"),
}
IMPORTS: Final = {  # names that rows may use: where they are
    "FlightState": "companion.core.model.states",
    "SwarmPhase": "companion.core.model.states",
    "Vec3": "mission.common.frames",
    "Wgs84": "mission.common.frames",
    "RangeTo": "companion.core.model.beacon",
    "ToldTrunk": "companion.core.model.beacon",
    "pack_cm": "companion.mavlink.packing",
    "unpack_cm": "companion.mavlink.packing",
    "pack_ranges": "companion.mavlink.packing",
    "unpack_ranges": "companion.mavlink.packing",
    "pack_seen": "companion.mavlink.packing",
    "unpack_seen": "companion.mavlink.packing",
    "pack_trunks": "companion.mavlink.packing",
    "unpack_trunks": "companion.mavlink.packing",
    "pack_sets": "companion.mavlink.packing",
    "unpack_sets": "companion.mavlink.packing",
}
ALIASES: Final = {  # types of the core's values: what, meaning
    "RangeTo": (
        "tuple[int, float, float]",
        "a vehicle, the distance to it in metres, and how many seconds ago it was measured",
    ),
    "ToldTrunk": ("tuple[float, float, float]", "its axis north and east of who tells it, and its diameter, metres"),
}
ENUMERATIONS: Final = (
    Enumeration(
        name="SWARM_PHASE",
        meaning="What the swarm is doing, as its leader announces it.",
        entries=tuple(
            (phase.name, phase.value, meaning)
            for phase, meaning in {
                SwarmPhase.ASSEMBLE: "On the ground, until all are ready.",
                SwarmPhase.GATHER: "Take off and gather about d1.",
                SwarmPhase.TRANSIT: "d1 to d2.",
                SwarmPhase.COVERAGE: "Spread around the tree at d2.",
                SwarmPhase.RETURN: "d2 to d1.",
                SwarmPhase.LAND: "Spread out level and land.",
            }.items()
        ),
    ),
    Enumeration(
        name="SWARM_ORDER_KIND",
        meaning="What an operator orders.",
        entries=(
            ("START", 1, "Fly the mission; in the air: go on after a HOLD."),
            ("HOLD", 2, "Every vehicle holds where it is, until a START."),
            ("LAND", 3, "The swarm spreads out level and lands, as at the mission's end. Cannot be taken back."),
            ("ABORT", 4, "Every vehicle lands where it is, now. Cannot be taken back."),
        ),
    ),
)
