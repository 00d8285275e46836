"""Tables of what is measured, by radios, odometers and lidars, and of the records in which it reaches the base."""

from __future__ import annotations

from typing import Final

from companion.mavlink.schema.rows import Message, Value, field
from companion.mavlink.schema.tables.beacon import FURTHEST_M

RAYS_MAX: Final = 112  # of a lidar in a message: 253 bytes of MAVLink's 255
ENTRY_BYTES: Final = 21  # of a vector: vehicle, log, four numbers of three bytes, a bitmap of four
ENTRIES_MAX: Final = 11  # in a message; more logs are more messages
BODY_MAX: Final = 236  # bytes of a record: with it the message is 255, all that MAVLink carries in a frame
TRUNKS_MAX: Final = 12  # in a message
TRUNK_BYTES: Final = 5
HOW_TO: Final = "[fly with GNSS on the leader alone](../how-to/fly-gnss-denied.md)"

RANGES: Final = Message(
    id=52101,
    name="SWARM_RANGES",
    meaning="Distances to other vehicles that this vehicle's range radio has measured, from its driver to "
    "its companion: at most 32, as soon as they are there. No standard message tells of distances to"
    " other vehicles: DISTANCE_SENSOR looks along an orientation, LANDING_TARGET is of a place to "
    "land.",
    see=HOW_TO,
    fields=(
        field(
            "time_boot_ms",
            "uint32_t",
            "When this was sent, by the driver's own clock since it began; 0: it has none. By it frames that are sent "
            "again, or were held back, are told from new ones.",
            unit="ms",
        ),
        field(
            "ranges",
            "uint8_t[128]",
            "Groups of four bytes: system id of the other vehicle (0: none); the distance in centimetres, "
            "low byte first; how long ago it was measured, in 10 ms.",
        ),
    ),
)

RELATIVE: Final = Message(
    id=52102,
    name="SWARM_RELATIVE",
    meaning="Sent before each SWARM_BEACON in a swarm of which not all have satellite positions: what the "
    "others need to find the sender by odometry and ranges.",
    see=HOW_TO,
    value="RelativeReport",
    about="SWARM_RELATIVE: what goes with each beacon in a GNSS-denied swarm. North: of the sender's compass.",
    by_place=("sender", "time_ms", "odo_ne_m", "to_leader_ne_m", "leader_sd_m", "ranges"),
    header=(Value("sender"),),
    fields=(
        field(
            "time_boot_ms",
            "uint32_t",
            "That of the beacon behind it.",
            Value("time_ms", note="of its beacon"),
            unit="ms",
            pack="{} & 0xFFFFFFFF",
        ),
        field(
            "odo_n",
            "float",
            "How far the sender's odometer has come from its start, along the north of its own compass.",
            Value(
                "odo_ne_m[0]",
                kind="tuple[float, float]",
                note="how far its odometer has come from where the mission has it start",
            ),
            unit="m",
            least=-FURTHEST_M,
            most=FURTHEST_M,
        ),
        field("odo_e", "float", "The same, east.", Value("odo_ne_m[1]"), unit="m", least=-FURTHEST_M, most=FURTHEST_M),
        field(
            "leader_n",
            "float",
            "From the sender to the leader as it estimates it, north.",
            Value(
                "to_leader_ne_m[0]",
                kind="tuple[float, float] | None",
                note="where it has the leader, of the swarm's north",
                default="None",
                when="leader_sd >= 0.0",
            ),
            unit="m",
            least=-FURTHEST_M,
            most=FURTHEST_M,
        ),
        field(
            "leader_e",
            "float",
            "The same, east.",
            Value("to_leader_ne_m[1]"),
            unit="m",
            least=-FURTHEST_M,
            most=FURTHEST_M,
        ),
        field(
            "leader_sd",
            "float",
            "Standard deviation of that where it is largest; -1: not known.",
            Value("leader_sd_m", kind="float", note="how sure of that", default="0.0"),
            unit="m",
            pack="-1.0 if value.to_leader_ne_m is None else {}",
            unpack="max(0.0, {})",
            least=-FURTHEST_M,
            most=FURTHEST_M,
        ),
        field(
            "place_sd",
            "uint16_t",
            "How far the sender's way to d2 may be off, level: standard deviation; UINT16_MAX: not known.",
            Value(
                "position_sd_m",
                kind="float | None",
                note="how far its way to d2 may be off, level; None: it does not know",
                default="None",
            ),
            unit="cm",
            pack="pack_cm({})",
            unpack="unpack_cm({})",
        ),
        field(
            "ranges",
            "uint8_t[128]",
            "Distances that the sender measured since its last beacon, as in SWARM_RANGES; of each pair one "
            "vehicle tells: the lower id if the sum of both is even.",
            Value("ranges", kind="tuple[RangeTo, ...]", note="that it measured since its last beacon", default="()"),
            pack="pack_ranges({})",
            unpack="unpack_ranges({})",
        ),
    ),
)

TRUNKS: Final = Message(
    id=52110,
    name="SWARM_TRUNKS",
    meaning="Once a second behind a SWARM_BEACON, in a swarm of which not all have satellite positions and whose "
    "vehicles carry raw lidars: trunks about the sender, by which others that have seen them find its place and turn.",
    see="[trunks shared between vehicles](../explanation/own-motion.md#shared-trunks)",
    value="TrunkReport",
    about="SWARM_TRUNKS: solitary trunks about its sender. North: of the sender's odometry.",
    by_place=("sender", "time_ms", "odo_ne_m", "trunks"),
    header=(Value("sender"),),
    fields=(
        field(
            "time_boot_ms",
            "uint32_t",
            "That of the beacon before it.",
            Value("time_ms", note="of its beacon"),
            unit="ms",
            pack="{} & 0xFFFFFFFF",
        ),
        field(
            "odo_n",
            "float",
            "How far the sender's odometer has come from its start, as in SWARM_RELATIVE, north.",
            Value("odo_ne_m[0]", kind="tuple[float, float]", note="as its odometer has come, when these were about it"),
            unit="m",
            least=-FURTHEST_M,
            most=FURTHEST_M,
        ),
        field("odo_e", "float", "The same, east.", Value("odo_ne_m[1]"), unit="m", least=-FURTHEST_M, most=FURTHEST_M),
        field(
            "trunks",
            f"uint8_t[{TRUNK_BYTES * TRUNKS_MAX}]",
            "The nearest first, groups of five bytes: the trunk's axis from the sender in centimetres, north and east "
            "along the axes of its odometer (each an int16, low byte first), and its diameter in cm (0: none).",
            Value("trunks", kind="tuple[ToldTrunk, ...]", note="the nearest first"),
            pack="pack_trunks({})",
            unpack="unpack_trunks({})",
        ),
    ),
)

LIDAR_SCAN: Final = Message(
    id=52103,
    name="SWARM_LIDAR_SCAN",
    meaning="A piece of a lidar's raw scan: rays of one layer, side by side, in the order in which they were measured. "
    "From the lidar's driver to its vehicle's companion, on a link of their own: a turn is several pieces, each sent "
    "as soon as it is there, and 10 kB/s or more. Of the standard messages OBSTACLE_DISTANCE has 72 sectors and one "
    "time for all.",
    see="[connect a lidar](../how-to/connect-a-lidar.md)",
    fields=(
        field(
            "time_usec",
            "uint64_t",
            "When the first ray was measured, by any clock that runs and that all pieces have.",
            unit="us",
        ),
        field("ray_time", "float", "Time from one ray to the next.", unit="s", least=0.0, most=0.1),
        field(
            "first_bearing",
            "float",
            "Bearing of the first ray, clockwise from ahead, seen from above, in the vehicle's own level plane.",
            unit="deg",
            least=-360.0,
            most=360.0,
        ),
        field(
            "bearing_step",
            "float",
            "From one ray to the next, clockwise; negative: counter-clockwise. Not 0.",
            unit="deg",
            least=-30.0,
            most=30.0,
        ),
        field("ray_elevation", "float", "Of all rays, above that plane.", unit="deg", least=-90.0, most=90.0),
        field("near_cm", "uint16_t", "The lidar's least range: what is nearer counts as being there.", unit="cm"),
        field("far_cm", "uint16_t", "Its greatest range.", unit="cm", least=1),
        field("turn_number", "uint8_t", "Counts turns, or frames, modulo 256: the same in all pieces of one."),
        field(
            "ranges_mm",
            f"uint16_t[{RAYS_MAX}]",
            "Range along each ray. 0 or 1: not measured; UINT16_MAX, or beyond the greatest range: nothing there. "
            "Zeros at the end are no rays: a last ray that was not measured is 1.",
            unit="mm",
        ),
    ),
)

RECORD_VECTOR: Final = Message(
    id=52104,
    name="SWARM_RECORD_VECTOR",
    meaning="The records that a vehicle or the base station has, log by log, and what it knows to be at the base "
    "station: once a second, in as many messages as there are logs to tell of. Neighbours send what is missing.",
    see="[collect records](../how-to/collect-records.md)",
    fields=(
        field(
            "base_epoch",
            "uint32_t",
            "When the base station's file was made, UTC: what is acknowledged is in that file. A later one stands for "
            "all before it. 0: no base station was heard of.",
            unit="s",
        ),
        field(
            "mission_hash",
            "uint32_t",
            "Of the mission's name and origin, the first 4 bytes of SHA-256: vectors of another mission are ignored.",
        ),
        field("base_hops", "uint8_t", "To the base station: 0 from itself, UINT8_MAX: it is not heard."),
        field("node_flags", "uint8_t", "1: the sender is the base station. 2: it has no room for more records."),
        field(
            "log_entries",
            f"uint8_t[{ENTRIES_MAX * ENTRY_BYTES}]",
            "Groups of 21 bytes, numbers low byte first: system id of the log's writer (0: no more groups); log id, 4 "
            "bytes; the number up to which nothing is missing, 3; the number at which the bitmap begins, 3; the "
            "highest number that the sender has, 3; the number up to which the base station has all, 3; bitmap, 4: bit "
            "k set, number (beginning + 1 + k) is there.",
        ),
    ),
)

RECORD: Final = Message(
    id=52105,
    name="SWARM_RECORD",
    meaning="One record of one vehicle's log, from its writer or passed on by another vehicle. A frame carries it "
    "whole: there are no fragments. Sent after the beacons, in the airtime that they leave.",
    see="[collect records](../how-to/collect-records.md)",
    fields=(
        field("made_usec", "uint64_t", "When it was made, by its writer's clock.", unit="us", most=1 << 52),
        field("log_id", "uint32_t", "Drawn when the writer's log was begun."),
        field("log_number", "uint32_t", "In that log: 1, 2, 3 and so on.", least=1, most=(1 << 24) - 1),
        field("log_writer", "uint8_t", "System id of the vehicle that made it.", least=1, most=250),
        field(
            "record_kind",
            "uint8_t",
            "1: stem. 2: area seen. 3: of another sensor. 4: stand in figures.",
            least=1,
            most=4,
        ),
        field("body_size", "uint8_t", "Of the body.", unit="bytes", most=BODY_MAX),
        field("record_body", f"uint8_t[{BODY_MAX}]", "As its kind says, in CBOR (RFC 8949)."),
    ),
)
