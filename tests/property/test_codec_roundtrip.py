"""Beacons through the wire and back, for any that an agent can send; and any field of any value through the decoder."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.localisation.peer_reports import TAKEN_BACK
from companion.core.model.beacon import NO_ROUTE, Beacon, Candidate, Lease, PeerReport
from companion.core.model.states import FlightState, SwarmPhase
from companion.core.swarm.election import HOP_LIMIT, SEQ_LIMIT
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.codec import Codec
from companion.mavlink.framing import wire
from mission.common.frames import LocalFrame, Vec3, Wgs84
from mission.schema.tables import MAX_STOPS
from tests.unit.core.core_kit import beacon, is_finite

SEEN_MOST_S = 819.1  # what was heard longer ago is told as this

coordinates = st.floats(-20_000.0, 20_000.0)
places = st.tuples(coordinates, coordinates, st.floats(-500.0, 0.0))
origins = st.builds(Wgs84, st.floats(-85.0, 85.0), st.floats(-179.0, 179.0), st.floats(-500.0, 9_000.0))
velocities = st.tuples(*[st.floats(-100.0, 100.0)] * 3)
leases = st.builds(
    Lease,
    st.integers(1, 250),
    st.integers(0, SEQ_LIMIT),
    st.integers(0, 250),
    st.integers(0, 10),
    st.booleans(),
    st.integers(0, 250),
    st.integers(0, SEQ_LIMIT),
    st.booleans(),
)
sightings = st.builds(
    PeerReport,
    st.integers(1, 250),
    st.tuples(*[st.floats(-9_000.0, 9_000.0)] * 3),
    st.floats(0.0, 6_553.0),
    st.booleans(),
    relays=st.integers(0, TAKEN_BACK),
)
beacons = st.builds(
    Beacon,
    sender=st.integers(1, 250),
    time_ms=st.integers(0, 2**32 - 1),
    vel_ned_mps=velocities,
    ref_ned_mps=velocities,
    dest_ned_m=st.none() | st.tuples(*[st.floats(-50_000.0, 50_000.0)] * 3),
    route_cost=st.floats(0.0, NO_ROUTE),
    governor=st.floats(0.0, 1.0),
    lease=st.none() | leases,
    hop=st.integers(0, HOP_LIMIT),
    agreed=st.booleans(),
    candidate=st.none() | st.builds(Candidate, st.integers(1, 250), st.integers(0, 250), st.integers(0, 10)),
    parent=st.integers(0, 250),
    phase=st.sampled_from(SwarmPhase),
    stop=st.integers(0, MAX_STOPS),
    state=st.sampled_from(FlightState),
    airborne=st.booleans(),
    start=st.booleans(),
    abort=st.booleans(),
    done=st.integers(0, 2**250 - 1),
    range_m=st.floats(0.1, 6_553.0),
    present=st.integers(0, 2**250 - 1),
    flown=st.integers(0, 2**250 - 1),
    sighting=st.none() | sightings,
)


def single(x: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", x))[0])


def at(frame: LocalFrame, vehicle_id: int, pos_ned_m: Vec3) -> Codec:
    codec = Codec(vehicle_id, frame)
    start = frame.to_wgs84(pos_ned_m)
    codec.home(
        dialect.MAVLink_home_position_message(
            round(start.lat_deg * 1e7), round(start.lon_deg * 1e7), round(start.alt_m * 1e3), 0, 0, 0, [0] * 4, 0, 0, 0
        )
    )
    assert codec.position(dialect.MAVLink_local_position_ned_message(0, 0, 0, 0, 0, 0, 0)) is not None
    return codec


def framed(payload: bytes, sender: int) -> bytes:
    return wire.frame(swarm_beacon.MESSAGE_ID, payload, seq=0, system=sender, component=swarm_beacon.COMPONENT)


@given(beacons, origins, places, places)
@settings(max_examples=40)
def test_beacon_comes_back_to_the_wires_resolution(said: Beacon, origin: Wgs84, here: Vec3, there: Vec3) -> None:
    frame = LocalFrame(origin)
    me, other = at(frame, 251, here), at(frame, said.sender, there)
    payload = other.encode_beacon(said)
    assert payload is not None
    ((sender, _, fields),) = swarm_beacon.beacons(framed(payload, said.sender))
    found = me.beacon(swarm_beacon.decode(sender, fields, frame))
    assert found is not None
    heard = found.said
    # 1e-7 degrees are 1.1 cm, rounded twice for each of the two.
    assert found.rel_ned_m == pytest.approx(tuple(t - h for h, t in zip(here, there, strict=True)), abs=0.025)
    assert heard.vel_ned_mps == tuple(map(single, said.vel_ned_mps))
    assert heard.ref_ned_mps == tuple(map(single, said.ref_ned_mps))
    assert (heard.dest_ned_m is None) == (said.dest_ned_m is None)
    if said.dest_ned_m is not None:
        assert heard.dest_ned_m == tuple(map(single, said.dest_ned_m))
    assert heard.route_cost == single(said.route_cost)
    assert heard.governor == single(said.governor)
    assert heard.range_m == pytest.approx(said.range_m, abs=0.051)
    if said.sighting is None:
        assert heard.sighting is None
    else:
        assert heard.sighting is not None
        assert (heard.sighting.vehicle, heard.sighting.silent) == (said.sighting.vehicle, said.sighting.silent)
        assert heard.sighting.age_s == pytest.approx(min(said.sighting.age_s, SEEN_MOST_S), abs=0.051)
        assert heard.sighting.relays == said.sighting.relays
        assert heard.sighting.rel_ned_m == tuple(map(single, said.sighting.rel_ned_m))
    floats = {"sighting", "vel_ned_mps", "ref_ned_mps", "dest_ned_m", "route_cost", "governor", "range_m"}
    for name in set(Beacon.__slots__) - floats:
        assert getattr(heard, name) == getattr(said, name), name


int8, int32 = st.integers(0, 255), st.integers(-(2**31), 2**31 - 1)
anything = st.builds(
    swarm_beacon.WireBeacon,
    *[st.integers(0, 2**32 - 1), int32, int32, int32],
    *[st.floats(width=32)] * 11,
    *[st.integers(0, 2**32 - 1)] * 2,
    *[st.floats(width=32)] * 3,
    *[st.integers(0, 65535)] * 2,
    *[int8] * 13,
    st.just(swarm_beacon.VERSION) | int8,
    st.binary(min_size=96, max_size=96),
)
FRAME = LocalFrame(Wgs84(47.0, 8.0, 400.0))


def near(fields: swarm_beacon.WireBeacon) -> swarm_beacon.WireBeacon:
    """The same at a place that is believed, so that the other fields matter."""
    return fields._replace(lat=470_000_500, lon=80_000_500, alt=408_000)


@given(anything, st.booleans(), st.data())
@settings(max_examples=80)
def test_decoded_beacon_is_sound_or_none_whatever_the_fields_hold(
    fields: swarm_beacon.WireBeacon, is_near: bool, data: st.DataObject
) -> None:
    if is_near:
        fields = near(fields)._replace(
            phase=fields.phase % 6, flight_state=fields.flight_state % 12, vx=0.0, vy=0.0, vz=0.0
        )
        fields = fields._replace(version=swarm_beacon.VERSION)
        fields = fields._replace(ref_vx=1.0, ref_vy=0.0, ref_vz=0.0, governor=0.5, dest_x=1.0, dest_y=0.0, dest_z=0.0)
        fields = fields._replace(seen_x=1.0, seen_y=0.0, seen_z=0.0)
        field = data.draw(st.sampled_from(["vx", "ref_vy", "dest_z", "governor", "route_cost", "seen_x"]))
        fields = fields._replace(**{field: data.draw(st.floats(width=32))})
    codec = at(FRAME, 1, (0.0, 0.0, -8.0))
    found = codec.beacon(swarm_beacon.decode(2, fields, FRAME))
    assert (found is None) == (codec.dropped + codec.other_versions == 1)
    if found is None:
        return
    said = found.said
    vectors: list[Any] = [found.rel_ned_m, said.vel_ned_mps, said.ref_ned_mps, said.dest_ned_m or (0.0, 0.0, 0.0)]
    assert all(map(is_finite, vectors))
    assert max(abs(x) for x in (*said.vel_ned_mps, *said.ref_ned_mps)) <= 100.0
    assert max(abs(x) for x in found.rel_ned_m) <= 50_000.0
    assert 0.0 <= said.governor <= 1.0
    assert said.route_cost >= 0.0
    assert not math.isnan(said.range_m)
    assert isinstance(said.phase, SwarmPhase)
    assert isinstance(said.state, FlightState)


def test_sender_is_who_the_frame_says_it_is() -> None:
    me, other = at(FRAME, 1, (0.0, 0.0, -8.0)), at(FRAME, 9, (5.0, 0.0, -8.0))
    payload = other.encode_beacon(beacon(77))
    assert payload is not None
    ((sender, _, fields),) = swarm_beacon.beacons(framed(payload, 9))
    found = me.beacon(swarm_beacon.decode(sender, fields, FRAME))
    assert found is not None
    assert found.said.sender == 9
