"""What of a beacon is left while nobody vouches for it, and manifests that cannot be."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.core.model.beacon import Candidate, PeerReport
from companion.core.model.states import FlightState, SwarmPhase
from companion.keys.crypto import Signer
from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.mavlink.peers.guard import without_word
from companion.mavlink.peers.manifest import MANIFEST_ID, Manifest, encode_manifest, read_manifest
from tests.unit.core.core_kit import BEACON, lease


def test_of_a_beacon_without_proof_place_velocity_and_what_slows_are_left() -> None:
    kept = replace(
        BEACON,
        vel_ned_mps=(1.0, 2.0, 3.0),
        ref_ned_mps=(3.0, 0.0, 0.0),
        route_cost=2.0,
        governor=0.5,
        hop=3,
        phase=SwarmPhase.TRANSIT,
        state=FlightState.TRANSIT,
        airborne=True,
        stop=1,
        position_error_m=2.0,
    )
    said = replace(
        kept,
        lease=lease(1, 7, established=True),
        candidate=Candidate(3, 0, 9),
        dest_ned_m=(9.0, 9.0, 0.0),
        sighting=PeerReport(2, (1.0, 0.0, 0.0), 0.1, silent=True),
        agreed=True,
        start=True,
        abort=True,
        done=7,
        present=7,
        flown=7,
        parent=2,
    )
    assert without_word(said) == kept


@pytest.mark.parametrize(("boot", "first", "is_one"), [(7, 2, True), (7, 0, True), (0, 2, False), (7, -3, False)])
def test_a_manifest_has_a_boot_and_begins_no_earlier_than_its_clock(boot: int, first: int, *, is_one: bool) -> None:
    payload = encode_manifest(Manifest(boot, first, 5, (b"123456",), ((2, 9),)), 3, Signer(bytes(32)))
    found = read_manifest(wire.Sender(3, COMPONENT, 1).frame(MANIFEST_ID, payload) + bytes(13))
    assert (found is not None) is is_one
    if found is not None:
        assert found[0] == Manifest(boot, first, 5, (b"123456",), ((2, 9),))
