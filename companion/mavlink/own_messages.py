"""Our own messages: the fields as they are sent, encoders, decoders, and what a receiver believes."""

# Generated from companion/mavlink/schema by `make dialect`; do not edit.

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple

from companion.core.model.beacon import Beacon, BeaconEcho, Candidate, Lease, PeerReport, RelativeReport, TrunkReport
from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink.packing import (
    pack_cm,
    pack_ranges,
    pack_seen,
    pack_sets,
    pack_trunks,
    unpack_cm,
    unpack_ranges,
    unpack_seen,
    unpack_sets,
    unpack_trunks,
)
from mission.common.frames import Wgs84

VERSION: Final = 1  # of what the fields of a beacon mean
FURTHEST_M: Final = 50000.0  # beyond it a position, and
FASTEST_MPS: Final = 100.0  # beyond it a velocity is not believed
ESTABLISHED: Final = 1  # SWARM_BEACON.flags
AIRBORNE: Final = 2  # SWARM_BEACON.flags
START: Final = 4  # SWARM_BEACON.flags
ABORT: Final = 8  # SWARM_BEACON.flags
DESTINATION: Final = 16  # SWARM_BEACON.flags
AGREED: Final = 32  # SWARM_BEACON.flags
QUORUM: Final = 64  # SWARM_BEACON.flags
SEEN_SILENT: Final = 128  # SWARM_BEACON.flags
_FLIGHT_STATES: Final = tuple(FlightState)
_SWARM_PHASES: Final = tuple(SwarmPhase)


class WireBeacon(NamedTuple):
    """SWARM_BEACON: the fields as they are sent, in that order; units as in docs/reference/beacon.md."""

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
    echo_time: int
    echo_hold: int
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
    echo: int
    version: int
    members: bytes
    position_error: int
    accused: int

    @property
    def swarm_phase(self) -> int:
        """Phase of the swarm, without the stop; above the last SwarmPhase: of another version."""
        return self.phase & 7

    @property
    def stop(self) -> int:
        """Number of the mission's visit that the phase is about."""
        return self.phase >> 3

    @property
    def acting_leader(self) -> int:
        """System id of the leader that it follows and that has held its lease long enough to act; 0: none."""
        return self.leader if self.flags & ESTABLISHED else 0


BEACON_PAYLOAD: Final = struct.Struct("<IiiifffffffffffIIfffHHHHBBBBBBBBBBBBBBB96sBB")
# `_make`, without its frame.
_wire_beacon: Final[Callable[..., WireBeacon]] = partial(tuple.__new__, WireBeacon)


def unpack_beacon(payload: bytes) -> WireBeacon:
    """A payload, whole -> its fields."""
    return _wire_beacon(BEACON_PAYLOAD.unpack(payload))


_NO_LEASE: Final = Lease(
    leader=0,
    seq=0,
    priority=0,
    score=0,
    established=False,
    heir=0,
    ends=0,
    quorum=True,
)


_NO_CANDIDATE: Final = Candidate(
    vehicle=0,
    priority=0,
    score=0,
)


_NO_SIGHTING: Final = PeerReport(
    vehicle=0,
    rel_ned_m=(0.0, 0.0, 0.0),
    age_s=0.0,
    silent=False,
    relays=0,
)


_NO_ECHO: Final = BeaconEcho(
    vehicle=0,
    time_ms=0,
    hold_s=0.0,
)


def encode_beacon(value: Beacon, here: Wgs84) -> bytes:
    """The payload of SWARM_BEACON, with its trailing zeros.

    struct.error when a number does not fit its field: the core keeps them in bounds.
    """
    lease = value.lease
    if lease is None:
        lease = _NO_LEASE
    candidate = value.candidate
    if candidate is None:
        candidate = _NO_CANDIDATE
    sighting = value.sighting
    if sighting is None:
        sighting = _NO_SIGHTING
    echo = value.echo
    if echo is None:
        echo = _NO_ECHO
    dest_ned_m = value.dest_ned_m or (0.0, 0.0, 0.0)
    return BEACON_PAYLOAD.pack(
        value.time_ms & 0xFFFFFFFF,
        round(here.lat_deg * 1e7),
        round(here.lon_deg * 1e7),
        round(here.alt_m * 1e3),
        value.vel_ned_mps[0],
        value.vel_ned_mps[1],
        value.vel_ned_mps[2],
        value.ref_ned_mps[0],
        value.ref_ned_mps[1],
        value.ref_ned_mps[2],
        dest_ned_m[0],
        dest_ned_m[1],
        dest_ned_m[2],
        value.route_cost,
        value.governor,
        lease.seq,
        lease.ends,
        sighting.rel_ned_m[0],
        sighting.rel_ned_m[1],
        sighting.rel_ned_m[2],
        round(value.range_m * 10.0),
        pack_seen(sighting.age_s, sighting.relays),
        echo.time_ms & 0xFFFF,
        min(0xFFFF, round(echo.hold_s * 1e3)),
        lease.leader,
        lease.priority,
        lease.score,
        lease.heir,
        value.hop,
        candidate.vehicle,
        candidate.priority,
        candidate.score,
        value.parent,
        value.phase | value.stop << 3,
        (ESTABLISHED if lease.established else 0)
        | (AIRBORNE if value.airborne else 0)
        | (START if value.start else 0)
        | (ABORT if value.abort else 0)
        | (DESTINATION if value.dest_ned_m is not None else 0)
        | (AGREED if value.agreed else 0)
        | (QUORUM if lease.quorum else 0)
        | (SEEN_SILENT if sighting.silent else 0),
        value.state,
        sighting.vehicle,
        echo.vehicle,
        VERSION,
        pack_sets(value.done, value.present, value.flown),
        min(255, round(value.position_error_m * 10.0)),
        value.accused,
    )


def decode_beacon(sender: int, fields: WireBeacon) -> Beacon | None:
    """Fields -> the value; None: one of them is not believed."""
    (
        time_boot_ms,
        _lat,
        _lon,
        _alt,
        vx,
        vy,
        vz,
        ref_vx,
        ref_vy,
        ref_vz,
        dest_x,
        dest_y,
        dest_z,
        route_cost,
        governor,
        leader_seq,
        leader_ends,
        seen_x,
        seen_y,
        seen_z,
        range_dm,
        seen_age,
        echo_time,
        echo_hold,
        leader,
        leader_priority,
        leader_score,
        heir,
        hop,
        candidate,
        candidate_priority,
        candidate_score,
        parent,
        phase,
        flags,
        flight_state,
        seen,
        echo,
        version,
        members,
        position_error,
        accused,
    ) = fields
    if not (
        -100.0 <= vx <= 100.0
        and -100.0 <= vy <= 100.0
        and -100.0 <= vz <= 100.0
        and -100.0 <= ref_vx <= 100.0
        and -100.0 <= ref_vy <= 100.0
        and -100.0 <= ref_vz <= 100.0
        and -50000.0 <= dest_x <= 50000.0
        and -50000.0 <= dest_y <= 50000.0
        and -50000.0 <= dest_z <= 50000.0
        and route_cost >= 0.0
        and 0.0 <= governor <= 1.0
        and -50000.0 <= seen_x <= 50000.0
        and -50000.0 <= seen_y <= 50000.0
        and -50000.0 <= seen_z <= 50000.0
        and phase <= 245
        and phase & 7 < 6
        and flight_state <= 11
        and version == 1
    ):
        return None
    age_s, relays = unpack_seen(seen_age)
    done, present, flown = unpack_sets(members)
    return Beacon(
        sender,
        time_boot_ms,
        (vx, vy, vz),
        (ref_vx, ref_vy, ref_vz),
        (dest_x, dest_y, dest_z) if flags & DESTINATION else None,
        route_cost,
        governor,
        Lease(
            leader,
            leader_seq,
            leader_priority,
            leader_score,
            (flags & ESTABLISHED) != 0,
            heir,
            leader_ends,
            (flags & QUORUM) != 0,
        )
        if leader
        else None,
        range_dm / 10.0,
        hop,
        Candidate(
            candidate,
            candidate_priority,
            candidate_score,
        )
        if candidate
        else None,
        parent,
        _SWARM_PHASES[phase & 7],
        (flags & AIRBORNE) != 0,
        (flags & START) != 0,
        (flags & ABORT) != 0,
        (flags & AGREED) != 0,
        _FLIGHT_STATES[flight_state],
        done,
        PeerReport(
            seen,
            (seen_x, seen_y, seen_z),
            age_s,
            (flags & SEEN_SILENT) != 0,
            relays,
        )
        if seen
        else None,
        BeaconEcho(
            echo,
            echo_time,
            echo_hold / 1e3,
        )
        if echo
        else None,
        phase >> 3,
        present,
        flown,
        position_error / 10.0,
        accused,
    )


def here_of(fields: WireBeacon) -> Wgs84:
    """Carried by a beacon beside its value."""
    return Wgs84(
        fields.lat / 1e7,
        fields.lon / 1e7,
        fields.alt / 1e3,
    )


class WireRelativeReport(NamedTuple):
    """SWARM_RELATIVE: the fields as they are sent, in that order; units as in docs/reference/beacon.md."""

    time_boot_ms: int
    odo_n: float
    odo_e: float
    leader_n: float
    leader_e: float
    leader_sd: float
    place_sd: int
    ranges: bytes


RELATIVE_REPORT_PAYLOAD: Final = struct.Struct("<IfffffH128s")
# `_make`, without its frame.
_wire_relative_report: Final[Callable[..., WireRelativeReport]] = partial(tuple.__new__, WireRelativeReport)


def unpack_relative_report(payload: bytes) -> WireRelativeReport:
    """A payload, whole -> its fields."""
    return _wire_relative_report(RELATIVE_REPORT_PAYLOAD.unpack(payload))


def encode_relative_report(value: RelativeReport) -> bytes:
    """The payload of SWARM_RELATIVE, with its trailing zeros.

    struct.error when a number does not fit its field: the core keeps them in bounds.
    """
    to_leader_ne_m = value.to_leader_ne_m or (0.0, 0.0)
    return RELATIVE_REPORT_PAYLOAD.pack(
        value.time_ms & 0xFFFFFFFF,
        value.odo_ne_m[0],
        value.odo_ne_m[1],
        to_leader_ne_m[0],
        to_leader_ne_m[1],
        -1.0 if value.to_leader_ne_m is None else value.leader_sd_m,
        pack_cm(value.position_sd_m),
        pack_ranges(value.ranges),
    )


def decode_relative_report(sender: int, fields: WireRelativeReport) -> RelativeReport | None:
    """Fields -> the value; None: one of them is not believed."""
    (
        time_boot_ms,
        odo_n,
        odo_e,
        leader_n,
        leader_e,
        leader_sd,
        place_sd,
        ranges,
    ) = fields
    if not (
        -50000.0 <= odo_n <= 50000.0
        and -50000.0 <= odo_e <= 50000.0
        and -50000.0 <= leader_n <= 50000.0
        and -50000.0 <= leader_e <= 50000.0
        and -50000.0 <= leader_sd <= 50000.0
    ):
        return None
    return RelativeReport(
        sender,
        time_boot_ms,
        (odo_n, odo_e),
        (leader_n, leader_e) if leader_sd >= 0.0 else None,
        max(0.0, leader_sd),
        unpack_ranges(ranges),
        unpack_cm(place_sd),
    )


class WireTrunkReport(NamedTuple):
    """SWARM_TRUNKS: the fields as they are sent, in that order; units as in docs/reference/beacon.md."""

    time_boot_ms: int
    odo_n: float
    odo_e: float
    trunks: bytes


TRUNK_REPORT_PAYLOAD: Final = struct.Struct("<Iff60s")
# `_make`, without its frame.
_wire_trunk_report: Final[Callable[..., WireTrunkReport]] = partial(tuple.__new__, WireTrunkReport)


def unpack_trunk_report(payload: bytes) -> WireTrunkReport:
    """A payload, whole -> its fields."""
    return _wire_trunk_report(TRUNK_REPORT_PAYLOAD.unpack(payload))


def encode_trunk_report(value: TrunkReport) -> bytes:
    """The payload of SWARM_TRUNKS, with its trailing zeros.

    struct.error when a number does not fit its field: the core keeps them in bounds.
    """
    return TRUNK_REPORT_PAYLOAD.pack(
        value.time_ms & 0xFFFFFFFF,
        value.odo_ne_m[0],
        value.odo_ne_m[1],
        pack_trunks(value.trunks),
    )


def decode_trunk_report(sender: int, fields: WireTrunkReport) -> TrunkReport | None:
    """Fields -> the value; None: one of them is not believed."""
    (
        time_boot_ms,
        odo_n,
        odo_e,
        trunks,
    ) = fields
    if not (-50000.0 <= odo_n <= 50000.0 and -50000.0 <= odo_e <= 50000.0):
        return None
    return TrunkReport(
        sender,
        time_boot_ms,
        (odo_n, odo_e),
        unpack_trunks(trunks),
    )
