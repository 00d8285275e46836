"""SWARM_BEACON: one table of its fields, from which it is encoded, checked and documented.

A vehicle decodes one beacon from each neighbour each period, so this is done without pymavlink's objects; tests hold
the bytes equal to pymavlink's, and the table equal to swarm.xml, which says what each field means.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import partial
from typing import Any, Final, NamedTuple, TypeVar, final

from companion.core.model.beacon import Beacon, Candidate, Lease, PeerReport
from companion.core.model.states import FlightState, SwarmPhase
from companion.core.model.vectors import ZERO
from companion.mavlink import dialect
from companion.mavlink.frames import BAD_STARTS_MAX, find, payload_of, source
from mission.common.frames import LocalFrame, Vec3, Wgs84
from mission.schema.tables import MAX_STOPS

VERSION: Final = 1  # of what the fields mean; docs/reference/stability.md says what changes it
MESSAGE_ID = dialect.MAVLINK_MSG_ID_SWARM_BEACON
COMPONENT = dialect.MAV_COMP_ID_ONBOARD_COMPUTER
FURTHEST_M: Final = 50_000.0  # beyond it a position, and
FASTEST_MPS: Final = 100.0  # beyond it a velocity is not believed
NOWHERE_DEG: Final = (2**31 - 1) / 1e7  # latitude and longitude that are not told: INT32_MAX on the wire

ESTABLISHED = dialect.SWARM_BEACON_FLAGS_ESTABLISHED
AIRBORNE = dialect.SWARM_BEACON_FLAGS_AIRBORNE
START = dialect.SWARM_BEACON_FLAGS_START
ABORT = dialect.SWARM_BEACON_FLAGS_ABORT
DESTINATION = dialect.SWARM_BEACON_FLAGS_DESTINATION
AGREED = dialect.SWARM_BEACON_FLAGS_AGREED
QUORUM = dialect.SWARM_BEACON_FLAGS_QUORUM
SEEN_SILENT = dialect.SWARM_BEACON_FLAGS_SEEN_SILENT

Read = TypeVar("Read")
_MEMBERS_BYTES: Final = 96
_SEEN_AGE_MAX_DS = 0xFFFF
_PHASES = tuple(SwarmPhase)
STOP_SHIFT: Final = 3  # of the field `phase`: above it the stop
PHASE_MASK: Final = (1 << STOP_SHIFT) - 1
PHASE_MOST = MAX_STOPS << STOP_SHIFT | len(_PHASES) - 1
_STATES = tuple(FlightState)
_NO_LEASE = Lease(0, 0, 0, 0, established=False)
_NO_CANDIDATE = Candidate(0, 0, 0)
_NOTHING_SEEN = PeerReport(0, ZERO, 0.0, silent=False)
_STRUCT_CODES = {"uint8_t": "B", "uint16_t": "H", "uint32_t": "I", "int32_t": "i", "float": "f", "uint8_t[96]": "96s"}


@final
class Said:
    """What goes into one beacon, with what is absent filled in. No NamedTuple: every field is made from it."""

    __slots__ = ("beacon", "candidate", "dest_ned_m", "here", "lease", "seen")

    def __init__(self, beacon: Beacon, here: Wgs84) -> None:
        lease, candidate, seen = beacon.lease, beacon.candidate, beacon.sighting
        self.beacon: Final = beacon
        self.here: Final = here  # the sender
        self.dest_ned_m: Final[Vec3] = beacon.dest_ned_m or ZERO
        self.lease: Final[Lease] = _NO_LEASE if lease is None else lease
        self.candidate: Final[Candidate] = _NO_CANDIDATE if candidate is None else candidate
        self.seen: Final[PeerReport] = _NOTHING_SEEN if seen is None else seen


class Field(NamedTuple):
    """One field: how it is sent, what it is made from, and the values that a receiver believes, both included."""

    name: str
    type: str  # MAVLink's
    unit: str  # as in swarm.xml
    say: Callable[[Said], float | bytes]
    least: float = -math.inf
    most: float = math.inf

    @property
    def is_checked(self) -> bool:
        """Some values, or NaN, are not believed."""
        return self.type == "float" or self.least > -math.inf or self.most < math.inf


# In the order of the wire. A field outside its bounds, or NaN, makes a receiver drop the whole beacon.
FIELDS = (
    Field("time_boot_ms", "uint32_t", "ms", lambda s: s.beacon.time_ms & 0xFFFFFFFF),
    Field("lat", "int32_t", "degE7", lambda s: round(s.here.lat_deg * 1e7)),
    Field("lon", "int32_t", "degE7", lambda s: round(s.here.lon_deg * 1e7)),
    Field("alt", "int32_t", "mm", lambda s: round(s.here.alt_m * 1e3)),
    Field("vx", "float", "m/s", lambda s: s.beacon.vel_ned_mps[0], -FASTEST_MPS, FASTEST_MPS),
    Field("vy", "float", "m/s", lambda s: s.beacon.vel_ned_mps[1], -FASTEST_MPS, FASTEST_MPS),
    Field("vz", "float", "m/s", lambda s: s.beacon.vel_ned_mps[2], -FASTEST_MPS, FASTEST_MPS),
    Field("ref_vx", "float", "m/s", lambda s: s.beacon.ref_ned_mps[0], -FASTEST_MPS, FASTEST_MPS),
    Field("ref_vy", "float", "m/s", lambda s: s.beacon.ref_ned_mps[1], -FASTEST_MPS, FASTEST_MPS),
    Field("ref_vz", "float", "m/s", lambda s: s.beacon.ref_ned_mps[2], -FASTEST_MPS, FASTEST_MPS),
    Field("dest_x", "float", "m", lambda s: s.dest_ned_m[0], -FURTHEST_M, FURTHEST_M),
    Field("dest_y", "float", "m", lambda s: s.dest_ned_m[1], -FURTHEST_M, FURTHEST_M),
    Field("dest_z", "float", "m", lambda s: s.dest_ned_m[2], -FURTHEST_M, FURTHEST_M),
    Field("route_cost", "float", "", lambda s: s.beacon.route_cost, 0.0),
    Field("governor", "float", "", lambda s: s.beacon.governor, 0.0, 1.0),
    Field("leader_seq", "uint32_t", "", lambda s: s.lease.seq),
    Field("leader_ends", "uint32_t", "", lambda s: s.lease.ends),
    Field("seen_x", "float", "m", lambda s: s.seen.rel_ned_m[0], -FURTHEST_M, FURTHEST_M),
    Field("seen_y", "float", "m", lambda s: s.seen.rel_ned_m[1], -FURTHEST_M, FURTHEST_M),
    Field("seen_z", "float", "m", lambda s: s.seen.rel_ned_m[2], -FURTHEST_M, FURTHEST_M),
    Field("range_dm", "uint16_t", "dm", lambda s: round(s.beacon.range_m * 10.0)),
    Field("seen_age", "uint16_t", "ds", lambda s: min(_SEEN_AGE_MAX_DS, round(s.seen.age_s * 10.0))),
    Field("leader", "uint8_t", "", lambda s: s.lease.leader),
    Field("leader_priority", "uint8_t", "", lambda s: s.lease.priority),
    Field("leader_score", "uint8_t", "", lambda s: s.lease.score),
    Field("heir", "uint8_t", "", lambda s: s.lease.heir),
    Field("hop", "uint8_t", "", lambda s: s.beacon.hop),
    Field("candidate", "uint8_t", "", lambda s: s.candidate.vehicle),
    Field("candidate_priority", "uint8_t", "", lambda s: s.candidate.priority),
    Field("candidate_score", "uint8_t", "", lambda s: s.candidate.score),
    Field("parent", "uint8_t", "", lambda s: s.beacon.parent),
    Field("phase", "uint8_t", "", lambda s: s.beacon.phase | s.beacon.stop << STOP_SHIFT, 0, PHASE_MOST),
    Field("flags", "uint8_t", "", lambda s: _flags(s)),
    Field("flight_state", "uint8_t", "", lambda s: s.beacon.state, 0, len(_STATES) - 1),
    Field("seen", "uint8_t", "", lambda s: s.seen.vehicle),
    Field("version", "uint8_t", "", lambda _: VERSION, VERSION, VERSION),
    Field("members", "uint8_t[96]", "", lambda s: members(s.beacon.done, s.beacon.present, s.beacon.flown)),
)
PAYLOAD = struct.Struct("<" + "".join(_STRUCT_CODES[field.type] for field in FIELDS))
_CHECKED = tuple((at, field.least, field.most) for at, field in enumerate(FIELDS) if field.is_checked)

_CRC_EXTRA = bytes([dialect.MAVLink_swarm_beacon_message.crc_extra])
_ID_BYTES = MESSAGE_ID.to_bytes(3, "little")


class WireBeacon(NamedTuple):
    """The fields as they are on the wire, in its order; units as in `FIELDS`."""

    time_boot_ms: int
    lat: int
    lon: int
    alt: int
    vx: float
    vy: float
    vz: float
    ref_vx: float
    ref_vy: float
    ref_vz: float
    dest_x: float
    dest_y: float
    dest_z: float
    route_cost: float
    governor: float
    leader_seq: int
    leader_ends: int
    seen_x: float
    seen_y: float
    seen_z: float
    range_dm: int
    seen_age: int
    leader: int
    leader_priority: int
    leader_score: int
    heir: int
    hop: int
    candidate: int
    candidate_priority: int
    candidate_score: int
    parent: int
    phase: int
    flags: int
    flight_state: int
    seen: int
    version: int
    members: bytes  # 96: three sets of 256 bits, see `members` and `sets`

    @property
    def swarm_phase(self) -> int:
        """Phase of the swarm, without the stop; above the last SwarmPhase: of another version."""
        return self.phase & PHASE_MASK

    @property
    def stop(self) -> int:
        """Which of the mission's visits the phase is about."""
        return self.phase >> STOP_SHIFT

    @property
    def acting_leader(self) -> int:
        """System id of the leader that it follows and that has held its lease long enough to act; 0: none."""
        return self.leader if self.flags & ESTABLISHED else 0


_as_fields: Callable[[tuple[Any, ...]], WireBeacon] = partial(tuple.__new__, WireBeacon)  # _make, without its frame


# --- out ---


def encode(beacon: Beacon, here: Wgs84) -> bytes:
    """The payload of SWARM_BEACON, with its trailing zeros, of a sender at `here` (level: NOWHERE_DEG, not told).

    struct.error when a number does not fit its field: the core keeps them in bounds.
    """
    said = Said(beacon, here)
    return PAYLOAD.pack(*[field.say(said) for field in FIELDS])


def _flags(said: Said) -> int:
    beacon, lease = said.beacon, said.lease
    return (
        (ESTABLISHED if lease.established else 0)
        | (AIRBORNE if beacon.airborne else 0)
        | (START if beacon.start else 0)
        | (ABORT if beacon.abort else 0)
        | (DESTINATION if beacon.dest_ned_m is not None else 0)
        | (AGREED if beacon.agreed else 0)
        | (QUORUM if lease.quorum else 0)
        | (SEEN_SILENT if said.seen.silent else 0)
    )


def members(done: int, present: int, flown: int) -> bytes:
    """Three sets (bit k-1: vehicle k, at most 256), their bytes in turn: MAVLink 2 cuts trailing zeros off, so a small
    swarm sends a few bytes.
    """
    data = bytearray(_MEMBERS_BYTES)
    for at, bits in enumerate((done, present, flown)):
        data[at::3] = bits.to_bytes(_MEMBERS_BYTES // 3, "little")
    return bytes(data)


# --- in ---


def beacons(data: bytes, beside: Callable[[bytes], bool] | None = None) -> list[tuple[int, bytes, WireBeacon]]:
    """(sender's system id, frame, fields) of each SWARM_BEACON of a companion in a datagram, of whatever version.

    Only a beacon whose checksum holds is taken, and the length that anything else claims is not used: a stray start
    byte does not hide the beacon behind it. After BAD_STARTS_MAX of them the rest of the datagram is dropped.
    """
    return read_each(data, unpack, beside)


def read_each(
    data: bytes, read: Callable[[bytes], Read | None], beside: Callable[[bytes], bool] | None = None
) -> list[tuple[int, bytes, Read]]:
    """As `beacons`, with what `read` makes of a frame instead of its fields; it answers None to what is no beacon.

    `beside` is asked about each other frame: True takes it, as a valid one.
    """
    each: list[tuple[int, bytes, Read]] = []
    at = bad = 0
    while bad < BAD_STARTS_MAX:
        start, end, message_id = find(data, at)
        if start == len(data):
            break
        frame = data[start:end]
        found = read(frame) if message_id == MESSAGE_ID else None
        if found is None:
            if beside is not None and end <= len(data) and message_id != MESSAGE_ID and beside(frame):
                at = end
                continue
            at = start + 1
            bad += 1
            continue
        at = end
        sender, component = source(frame)
        if component == COMPONENT:
            each.append((sender, frame, found))
    return each


class Decoded(NamedTuple):
    """What a beacon says, alike for every receiver."""

    version: int
    said: Beacon | None  # None: a field is outside its bounds, as another version is
    pos_ned_m: Vec3  # the sender's, in the mission's frame


class Reader:
    """Reads beacons for the receivers of one mission, for `read_each`.

    Receivers in one process may share a reader that remembers: a frame that reaches many of them is decoded once.
    """

    __slots__ = ("_frame", "_known", "_remembers")

    def __init__(self, frame: LocalFrame, *, remembers: int = 0) -> None:
        """`remembers`: that many frames at most."""
        self._frame = frame
        self._remembers = remembers
        self._known: dict[bytes, Decoded] = {}

    def read(self, frame: bytes) -> Decoded | None:
        """A whole SWARM_BEACON frame -> what it says; None as `unpack`."""
        known = self._known.get(frame) if self._remembers else None
        if known is not None:
            return known
        fields = unpack(frame)
        if fields is None:
            return None
        decoded = decode(frame[5], fields, self._frame)
        if self._remembers:
            if len(self._known) >= self._remembers:
                self._known.clear()
            self._known[frame] = decoded
        return decoded


def unpack(frame: bytes) -> WireBeacon | None:
    """A whole SWARM_BEACON frame -> its fields, a signature unread; None when it is none, or its checksum is wrong."""
    payload = payload_of(frame, _ID_BYTES, _CRC_EXTRA, PAYLOAD.size)
    return None if payload is None else _as_fields(PAYLOAD.unpack(payload))


def decode(sender: int, fields: WireBeacon, frame: LocalFrame) -> Decoded:
    """Fields -> what they say; `sender`: system id, `frame`: the mission's."""
    there = Wgs84(fields.lat / 1e7, fields.lon / 1e7, fields.alt / 1e3)
    return Decoded(fields.version, _said(sender, fields), frame.to_ned(there))


def _said(sender: int, fields: WireBeacon) -> Beacon | None:
    for at, least, most in _CHECKED:
        if not least <= fields[at] <= most:  # type: ignore[operator]  # numbers; false for NaN
            return None
    # All of them at once: by its name, each is looked up in the class of the tuple.
    # fmt: off
    (
        time_boot_ms, _lat, _lon, _alt, vx, vy, vz, ref_vx, ref_vy, ref_vz, dest_x, dest_y, dest_z,
        route_cost, governor, leader_seq, leader_ends, seen_x, seen_y, seen_z, range_dm, seen_age,
        leader, leader_priority, leader_score, heir, hop, candidate_id, candidate_priority, candidate_score,
        parent, phase, flags, flight_state, seen_id, _version, members_of,
    ) = fields
    # fmt: on
    stop, phase = phase >> STOP_SHIFT, phase & PHASE_MASK
    if phase >= len(_PHASES):
        return None
    lease = None
    if leader:
        lease = Lease(
            leader,
            leader_seq,
            leader_priority,
            leader_score,
            bool(flags & ESTABLISHED),
            heir,
            leader_ends,
            bool(flags & QUORUM),
        )
    sighting = None
    if seen_id:
        sighting = PeerReport(seen_id, (seen_x, seen_y, seen_z), seen_age / 10.0, bool(flags & SEEN_SILENT))
    candidate = None
    if candidate_id:
        candidate = Candidate(candidate_id, candidate_priority, candidate_score)
    done, present, flown = sets(members_of)
    return Beacon(
        sender,
        time_boot_ms,
        (vx, vy, vz),
        (ref_vx, ref_vy, ref_vz),
        (dest_x, dest_y, dest_z) if flags & DESTINATION else None,
        route_cost,
        governor,
        lease,
        hop,
        bool(flags & AGREED),
        candidate,
        parent,
        _PHASES[phase],
        _STATES[flight_state],
        bool(flags & AIRBORNE),
        bool(flags & START),
        bool(flags & ABORT),
        done,
        range_dm / 10.0,
        present,
        flown,
        sighting,
        stop,
    )


def sets(data: bytes) -> tuple[int, int, int]:
    """`members` back to (done, present, flown)."""
    data = data.rstrip(b"\0")  # 3 bytes for each 8 vehicles are left
    return (
        int.from_bytes(data[0::3], "little"),
        int.from_bytes(data[1::3], "little"),
        int.from_bytes(data[2::3], "little"),
    )


def is_within(v: Vec3, most: float) -> bool:
    """Whether every component is at most `most` in size, in the unit of both; false for NaN and infinity."""
    return -most <= v[0] <= most and -most <= v[1] <= most and -most <= v[2] <= most
