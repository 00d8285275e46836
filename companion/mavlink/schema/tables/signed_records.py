"""Tables of records in a signed swarm: each bears its writer's signature, and what the base station has the base's."""

from __future__ import annotations

from typing import Final

from companion.mavlink.schema.rows import Message, field
from companion.mavlink.schema.tables.measurements import ENTRY_BYTES
from companion.mavlink.schema.tables.signing import SIGNATURE

SIGNED_BODY_MAX: Final = 172  # bytes of a record: with it and its signature the message is 255
BASE_ENTRIES_MAX: Final = 8  # logs in a message; more are more messages
SEE: Final = "[signed records](../explanation/signed-frames.md#records)"

SIGNED_RECORD: Final = Message(
    id=52108,
    name="SWARM_SIGNED_RECORD",
    meaning="In a signed swarm, in place of SWARM_RECORD: a record with the signature of the vehicle that made it, from"
    " its writer or passed on unchanged. Who has the fleet's public keys knows by itself whose it is.",
    see=SEE,
    fields=(
        field("made_usec", "uint64_t", "As in SWARM_RECORD.", unit="us", most=1 << 52),
        field("log_id", "uint32_t", "As in SWARM_RECORD."),
        field("log_number", "uint32_t", "As in SWARM_RECORD.", least=1, most=(1 << 24) - 1),
        field("log_writer", "uint8_t", "System id of the vehicle that made and signed it.", least=1, most=250),
        field("record_kind", "uint8_t", "As in SWARM_RECORD.", least=1, most=4),
        field("body_size", "uint8_t", "Of the body.", unit="bytes", most=SIGNED_BODY_MAX),
        field(
            "ed25519",
            f"uint8_t[{SIGNATURE}]",
            'Ed25519 by the writer\'s key, of "understory record 1", the `mission_hash` of its vectors (4 bytes, low '
            "byte first), the fields before this one as they are sent, and the body.",
        ),
        field("record_body", f"uint8_t[{SIGNED_BODY_MAX}]", "As in SWARM_RECORD."),
    ),
)

BASE_VECTOR: Final = Message(
    id=52109,
    name="SWARM_BASE_VECTOR",
    meaning="In a signed swarm, in place of the base station's SWARM_RECORD_VECTOR: what it has, with its signature. "
    "Vehicles pass it on unchanged as the acknowledgement: nothing else lets one delete.",
    see=SEE,
    fields=(
        field(
            "told_count",
            "uint64_t",
            "Counts these messages, over restarts of the base station: an earlier one is a copy.",
        ),
        field("base_epoch", "uint32_t", "As in SWARM_RECORD_VECTOR; never 0.", unit="s"),
        field("mission_hash", "uint32_t", "As in SWARM_RECORD_VECTOR."),
        field("node_flags", "uint8_t", "2: the base station has no room for more records."),
        field(
            "ed25519",
            f"uint8_t[{SIGNATURE}]",
            'Ed25519 by the operator\'s key, of "understory base vector 1", the fields before this one as they are '
            "sent, and all of the entries.",
        ),
        field("log_entries", f"uint8_t[{BASE_ENTRIES_MAX * ENTRY_BYTES}]", "As in SWARM_RECORD_VECTOR, fewer."),
    ),
)
