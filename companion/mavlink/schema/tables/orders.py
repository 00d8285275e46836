"""SWARM_ORDER: the table of the operator's message."""

from __future__ import annotations

from typing import Final

from companion.mavlink.schema.rows import Message, field

ORDER_VERSION: Final = 1  # of what the fields mean
SIGNATURE_BYTES: Final = 64
BOOTS_BYTES: Final = 164  # what MAVLink's 255 leave

ORDER: Final = Message(
    id=52106,
    name="SWARM_ORDER",
    meaning="An order of the operator to all vehicles, by the operator's own key: a vehicle passes it on as it came, "
    "and none can make one. Its Ed25519 signature is over the 18 bytes `understory order 1` and all fields but itself, "
    "in the order of the wire.",
    see="[start, hold, land, abort](../how-to/start-hold-land-abort.md)",
    fields=(
        field(
            "order_counter",
            "uint64_t",
            "The operator's count of orders, which only grows. A vehicle obeys none that is not above all that it has "
            "seen, but for a LAND or ABORT of the flight that it is in.",
            least=1,
        ),
        field("flight_nonce", "uint8_t[8]", "The flight that it is about, drawn for its START; zeros: none yet."),
        field("mission_digest", "uint8_t[8]", "Of the mission file, the first 8 bytes of SHA-256."),
        field(
            "order_version", "uint8_t", "What the fields mean, as a whole: 1.", least=ORDER_VERSION, most=ORDER_VERSION
        ),
        field("order_kind", "uint8_t", "What is ordered.", enum="SWARM_ORDER_KIND", least=1, most=4),
        field(
            "hand_back",
            "uint8_t",
            "Of a START: a vehicle that a pilot has taken over, and that its companion is to steer again; 0: none.",
        ),
        field("order_signature", f"uint8_t[{SIGNATURE_BYTES}]", "By the operator's key."),
        field(
            "boot_marks",
            f"uint8_t[{BOOTS_BYTES}]",
            "For each vehicle in turn, min(32, 1312 / swarm size) bits, low ones first: its boot nonce modulo "
            "(2^bits - 1), plus 1; 0: not named. On the ground a START counts for those alone that it names: recorded, "
            "it is dead for a vehicle that is started again.",
        ),
    ),
)
