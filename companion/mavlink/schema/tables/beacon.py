"""SWARM_BEACON: the table. One row is one field; everything else about it is generated (`make dialect`).

CONTRIBUTING.md shows how a field is added.
"""

from __future__ import annotations

from typing import Final

from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink.schema.rows import Bits, Message, Value, field, vector
from companion.mavlink.schema.tables.beacon_parts import PARTS
from mission.schema.tables import MAX_LANES, MAX_STOPS

VERSION: Final = 1  # of what the fields mean; docs/reference/stability.md says what changes it
FURTHEST_M: Final = 50_000.0  # beyond it a position, and
FASTEST_MPS: Final = 100.0  # beyond it a velocity is not believed
PHASE_BITS: Final = 3

BEACON: Final = Message(
    id=52100,
    name="SWARM_BEACON",
    meaning="What each vehicle says of itself to those in radio range, at the mission's beacon rate; and "
    "once between two of those when it follows another leader.",
    value="Beacon",
    about="SWARM_BEACON: what a vehicle says of itself at the mission's beacon rate; the codec adds where it is.",
    by_place=("sender", "time_ms"),
    header=(Value("sender"),),
    beside=(("here", "Wgs84"),),
    fields=(
        field(
            "time_boot_ms",
            "uint32_t",
            "Sender's clock; a receiver compares it with earlier beacons of the same sender, and echoes it.",
            Value("time_ms", note="the sender's clock, never compared with another's"),
            unit="ms",
            pack="{} & 0xFFFFFFFF",
        ),
        field(
            "lat",
            "int32_t",
            "Latitude (WGS84); INT32_MAX: not broadcast, see SWARM_RELATIVE.",
            Value("here.lat_deg", kind="float"),
            unit="degE7",
            pack="round({} * 1e7)",
            unpack="{} / 1e7",
        ),
        field(
            "lon",
            "int32_t",
            "Longitude (WGS84), the same.",
            Value("here.lon_deg", kind="float"),
            unit="degE7",
            pack="round({} * 1e7)",
            unpack="{} / 1e7",
        ),
        field(
            "alt",
            "int32_t",
            "Altitude above mean sea level.",
            Value("here.alt_m", kind="float"),
            unit="mm",
            pack="round({} * 1e3)",
            unpack="{} / 1e3",
        ),
        *vector(
            ("vx", "vy", "vz"),
            "vel_ned_mps",
            ("Velocity north.", "Velocity east.", "Velocity down."),
            unit="m/s",
            most=FASTEST_MPS,
        ),
        *vector(
            ("ref_vx", "ref_vy", "ref_vz"),
            "ref_ned_mps",
            (
                "Reference velocity north, handed down from the leader.",
                "Reference velocity east.",
                "Reference velocity down.",
            ),
            unit="m/s",
            most=FASTEST_MPS,
            note="reference velocity handed down from the leader",
        ),
        *vector(
            ("dest_x", "dest_y", "dest_z"),
            "dest_ned_m",
            ("Vector from the sender to the destination, north.", "The same, east.", "The same, down."),
            unit="m",
            most=FURTHEST_M,
            note="from the sender to the destination",
            when="flags & DESTINATION",
        ),
        field(
            "route_cost",
            "float",
            "Cost of the route to the leader; 0 is the leader.",
            Value("route_cost", kind="float"),
            least=0.0,
        ),
        field(
            "governor",
            "float",
            "Share of cruise speed that the sender and those that follow it can keep up with, 0..1.",
            Value("governor", kind="float"),
            least=0.0,
            most=1.0,
        ),
        field(
            "leader_seq",
            "uint32_t",
            "Lease of the leader: its count of periods.",
            Value("lease.seq", note="the leader's count of periods: only an advancing one renews the lease"),
        ),
        field(
            "leader_ends",
            "uint32_t",
            "The count at which the heir takes over; 0: not announced.",
            Value("lease.ends", default="0"),
        ),
        *vector(
            ("seen_x", "seen_y", "seen_z"),
            "sighting.rel_ned_m",
            (
                "Vector from the sender to the vehicle in `seen`, where it was last heard, north.",
                "The same, east.",
                "The same, down.",
            ),
            unit="m",
            most=FURTHEST_M,
            note="from the one that keeps it (in a beacon: from the sender) to that vehicle",
        ),
        field(
            "range_dm",
            "uint16_t",
            "Radio range that the sender uses now.",
            Value("range_m", kind="float"),
            unit="dm",
            pack="round({} * 10.0)",
            unpack="{} / 10.0",
        ),
        field(
            "seen_age",
            "uint16_t",
            "In the low 13 bits the time since that vehicle was heard, in ds (8191: longer); above them the number of"
            " members over which the sender was told so, 0: it has heard that vehicle itself, 7: it takes back that it"
            " is silent, and hears it not.",
            Value("sighting.age_s", kind="float", note="since it was heard"),
            Value(
                "sighting.relays",
                note="members over which its sender was told; TAKEN_BACK: it takes its alarm back",
                default="0",
            ),
            pack="pack_seen({}, {})",
            unpack="unpack_seen({})",
        ),
        field(
            "echo_time",
            "uint16_t",
            "`time_boot_ms` of the quickest beacon of the vehicle in `echo` since the last echo of it: the low 16"
            " bits.",
            Value("echo.time_ms", note="the stamp of its beacon: the low 16 bits"),
            unit="ms",
            pack="{} & 0xFFFF",
        ),
        field(
            "echo_hold",
            "uint16_t",
            "Time since that beacon was taken in.",
            Value("echo.hold_s", kind="float", note="since that beacon was taken in"),
            unit="ms",
            pack="min(0xFFFF, round({} * 1e3))",
            unpack="{} / 1e3",
        ),
        field("leader", "uint8_t", "System id of the leader; 0: none.", Value("lease.leader")),
        field(
            "leader_priority",
            "uint8_t",
            "Static priority of the leader.",
            Value("lease.priority", note="static, from the mission; higher leads"),
        ),
        field(
            "leader_score",
            "uint8_t",
            "Score of the leader when it claimed, or was last re-elected.",
            Value("lease.score", note="resources when it claimed or was re-elected; higher leads"),
        ),
        field(
            "heir",
            "uint8_t",
            "System id of the vehicle that succeeds the leader; 0: none.",
            Value("lease.heir", note="which takes over when the count reaches `ends`; 0: none", default="0"),
        ),
        field("hop", "uint8_t", "Hops to the leader.", Value("hop")),
        field(
            "candidate",
            "uint8_t",
            "System id of the best candidate for the lead among the sender and those behind it; 0: none.",
            Value("candidate.vehicle"),
        ),
        field("candidate_priority", "uint8_t", "Its static priority.", Value("candidate.priority")),
        field("candidate_score", "uint8_t", "Its score.", Value("candidate.score")),
        field(
            "parent",
            "uint8_t",
            "System id of the neighbour that the sender follows; 0: none.",
            Value("parent", note="0: none"),
        ),
        field(
            "phase",
            "uint8_t",
            "Phase of the swarm in the low three bits; above them the tree that it is bound for, or at: 0 is"
            " the first.",
            enum="SWARM_PHASE",
            bits=(
                Bits(
                    "swarm_phase",
                    "Phase of the swarm, without the stop; above the last SwarmPhase: of another version.",
                    Value("phase", kind="SwarmPhase"),
                    width=PHASE_BITS,
                ),
                Bits(
                    "stop",
                    "Number of the mission's visit that the phase is about.",
                    Value("stop", default="0", note="which of the mission's visits the phase is about"),
                    width=8 - PHASE_BITS,
                ),
            ),
            least=0,
            most=max(MAX_STOPS, 2 * MAX_LANES) << PHASE_BITS | len(SwarmPhase) - 1,
        ),
        field(
            "flags",
            "uint8_t",
            "Flags.",
            enum="SWARM_BEACON_FLAGS",
            bits=(
                Bits(
                    "ESTABLISHED",
                    "The leader named here has held its lease long enough to act.",
                    Value("lease.established", kind="bool", note="held long enough to act"),
                ),
                Bits("AIRBORNE", "The sender flies under its companion's control.", Value("airborne", kind="bool")),
                Bits(
                    "START",
                    "An operator has allowed the flight; flooded.",
                    Value("start", kind="bool", note="an operator has allowed the flight"),
                ),
                Bits(
                    "ABORT",
                    "An operator has ordered all to land; flooded, latched.",
                    Value("abort", kind="bool", note="an operator has ordered all to land"),
                ),
                Bits("DESTINATION", "The vector to the destination is known.", is_there="dest_ned_m"),
                Bits(
                    "AGREED",
                    "The sender, all that it hears and all behind it follow the leader named here.",
                    Value(
                        "agreed", kind="bool", note="the sender, all that it hears and all behind it follow that leader"
                    ),
                ),
                Bits(
                    "QUORUM",
                    "The leader named here has the majority of those that took off in its part of the swarm.",
                    Value(
                        "lease.quorum",
                        kind="bool",
                        default="True",
                        absent="True",
                        note="its part of the swarm is the majority of those that took off",
                    ),
                ),
                Bits(
                    "SEEN_SILENT",
                    "The vehicle in `seen` is not heard any more: it hovers, link lost.",
                    Value("sighting.silent", kind="bool", note="none hears it any more: it hovers there, link lost"),
                ),
            ),
        ),
        field(
            "flight_state",
            "uint8_t",
            "State of the sender's own flight.",
            Value("state", kind="FlightState"),
            least=0,
            most=len(FlightState) - 1,
        ),
        field(
            "seen",
            "uint8_t",
            "System id of a third vehicle that fell silent in the air, or that is heard though somebody "
            "calls it silent; 0: none. One a beacon, in turn.",
            Value("sighting.vehicle"),
        ),
        field(
            "echo",
            "uint8_t",
            "System id of a neighbour one of whose beacons is echoed, by which that one measures the age of this one's;"
            " 0: none. One a beacon, in turn.",
            Value("echo.vehicle"),
        ),
        field(
            "version",
            "uint8_t",
            "What the fields mean, as a whole: 1. A receiver drops beacons of any other version.",
            pack="VERSION",
            least=VERSION,
            most=VERSION,
        ),
        field(
            "members",
            "uint8_t[96]",
            "Three sets of vehicles, byte by byte in turn; bit k-1 of a set: vehicle k. First: in the "
            "sender's branch, has done what the phase asks. Second: is in the sender's branch. Third: has "
            "taken off, as far as the sender knows.",
            Value("done", note="bit k-1: vehicle k of the sender's branch has done what the phase asks"),
            Value("present", note="bit k-1: vehicle k is in the sender's branch", default="0"),
            Value("flown", note="bit k-1: vehicle k has taken off, as far as the sender knows", default="0"),
            pack="pack_sets({}, {}, {})",
            unpack="unpack_sets({})",
        ),
        # The last two: MAVLink sends no zeros at the end, and they are zero but where satellites were lost, or one
        # leads astray.
        field(
            "position_error",
            "uint8_t",
            "How far the sender may be level from where it says, beyond what goes with GNSS: it has lost its fix, and"
            " reckons; 255: as much, or more.",
            Value(
                "position_error_m",
                kind="float",
                default="0.0",
                note="that it may be off, level, beyond what goes with GNSS: it has lost its fix",
            ),
            unit="dm",
            pack="min(255, round({} * 10.0))",
            unpack="{} / 10.0",
        ),
        field(
            "accused",
            "uint8_t",
            "System id of a leader that the sender has given up by what it observes itself; 0: none.",
            Value(
                "accused",
                default="0",
                note="a leader that the sender has given up by what it observes itself; 0: none",
            ),
        ),
    ),
    parts=PARTS,
    derived=(
        (
            "acting_leader",
            "self.leader if self.flags & ESTABLISHED else 0",
            "System id of the leader that it follows and that has held its lease long enough to act; 0: none.",
        ),
    ),
)
