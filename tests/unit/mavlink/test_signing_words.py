"""What of a beacon is left while nobody vouches for it, and manifests that cannot be."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.core.model.beacon import Candidate, PeerReport
from companion.core.model.states import FlightState, Severity, SwarmPhase
from companion.keys.crypto import Signer
from companion.keys.keyring import OPERATOR
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.mavlink.own_messages import decode_beacon
from companion.mavlink.peers.belief import without_word
from companion.mavlink.peers.frame_mac import mac_of, seal
from companion.mavlink.peers.guard import CHECKS_MAX, CHECKS_S, OpenGuard
from companion.mavlink.peers.manifest import MANIFEST_ID, Manifest, encode_manifest, read_manifest
from companion.mavlink.peers.session import BASE_ID, OPERATOR_ID, name_of, open_session
from companion.mavlink.peers.stream import AHEAD_S, CHECKED_S, PROVEN_S, Stream
from tests.unit.core.core_kit import BEACON, lease
from tests.unit.mavlink.signing_kit import PERIOD_S, Node, keyring, met

pytestmark = pytest.mark.sources


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


def manifest_of(node: Node, now_s: float) -> bytes:
    proof = node.guard.proof(now_s)
    assert proof is not None
    return node.guard.seal_proof(wire.frame(*proof, seq=0, system=node.id, component=COMPONENT, flags=1))


def test_each_refusal_of_a_manifest_is_counted_once_by_its_reason() -> None:
    (one, two), now_s = met(1, 2)
    two.guard.refused.clear()
    now_s += CHECKED_S  # until then what tells nothing new waits
    frame = manifest_of(one, now_s + 2.0)
    assert two.guard.take_proof(frame, now_s)
    assert dict(two.guard.refused) == {}
    for count in (1, 2):
        assert two.guard.take_proof(frame, now_s)
        assert dict(two.guard.refused) == {"repeated": count}
    two.guard.refused.clear()
    own = manifest_of(two, now_s + 2.0)
    for count in (1, 2):
        assert two.guard.take_proof(own, now_s)
        assert dict(two.guard.refused) == {"own": count}
    assert not two.guard.cloned
    two.guard.refused.clear()
    forged = bytearray(manifest_of(one, now_s + 4.0))
    forged[-1] ^= 1
    for count in (1, 2):
        assert two.guard.take_proof(bytes(forged), now_s)
        assert dict(two.guard.refused) == {"forged manifest": count}


def test_manifests_of_one_that_is_no_member_are_counted_and_its_name_told_once() -> None:
    ring = keyring(2)
    without = {k: key for k, key in ring.vehicles.items() if k != 1}
    one, two = Node(1), Node(2, ring=replace(ring, vehicles=without))
    for count in (1, 2, 3):
        assert two.guard.take_proof(manifest_of(one, 10.0 * count), 5.0)
        assert dict(two.guard.refused) == {"of no member": count}
    assert [(say.severity, say.text) for say in two.guard.take_says()] == [
        (Severity.WARNING, "vehicle 1 is not of this fleet, or revoked: ignored")
    ]


def test_a_second_companion_of_one_name_is_told_as_critical_by_both() -> None:
    (one, two), now_s = met(1, 2)
    clone = Node(1, boot=66)
    clone.guard.take_proof(manifest_of(two, now_s + 1.0), now_s)
    clones = manifest_of(clone, now_s + 1.0)  # it has heard vehicle 2, so vehicle 2 might meet it
    two.receive(one.send(now_s), now_s)
    two.guard.refused.clear()
    two.guard.take_proof(clones, now_s)
    assert dict(two.guard.refused) == {"twice": 1}
    text = "vehicle 1 is there twice: the later is ignored"
    assert [(say.severity, say.text) for say in two.guard.take_says()] == [(Severity.CRITICAL, text)]
    one.guard.take_proof(clones, now_s)
    assert not one.guard.cloned  # it does not hear this one yet: a recording looks the same
    clone.guard.take_proof(manifest_of(one, now_s + 1.0), now_s)
    one.guard.take_proof(manifest_of(clone, now_s + 3.0), now_s)
    assert one.guard.cloned
    text = "another companion flies as vehicle 1"
    assert [(say.severity, say.text) for say in one.guard.take_says()] == [(Severity.CRITICAL, text)]


def test_so_many_signatures_are_checked_in_a_second_and_no_more() -> None:
    (_, two), now_s = met(1, 2)
    now_s += PROVEN_S
    forger = Node(1, boot=1001, ring=replace(keyring(1), seed=keyring(3).seed))
    for begins_s in (now_s, now_s + CHECKS_S):
        two.guard.refused.clear()
        for k in range(CHECKS_MAX + 5):
            two.guard.take_proof(manifest_of(forger, 100.0 * begins_s + 2.0 * k), begins_s)
        assert dict(two.guard.refused) == {"forged manifest": CHECKS_MAX, "too many manifests": 5}
    texts = [say.text for say in two.guard.take_says()]
    assert texts == ["flood of manifests in the name of vehicle 1"]


def test_what_waited_while_a_receiver_stalled_does_not_make_it_deaf() -> None:
    """A socket that is full keeps the first of them: what comes next is no more ahead than before."""
    (one, two), now_s = met(1, 2)
    waited = [one.send(round(now_s + k * PERIOD_S, 6))[0] for k in range(70)]
    now_s += 70 * PERIOD_S
    two.receive(waited[:10], now_s)
    two.receive(one.send(now_s + PERIOD_S)[:1], now_s + PERIOD_S)
    assert len(two.heard) == 11


def test_after_a_pause_a_sender_may_be_ahead_by_as_much() -> None:
    (one, two), now_s = met(1, 2)
    for pause_s in (2.0, 30.0):
        now_s += pause_s
        two.receive(one.send(now_s)[:1], now_s)
        assert two.heard, pause_s
        two.heard.clear()
    two.guard.refused.clear()
    two.receive(one.send(now_s + AHEAD_S + 0.5)[:1], now_s)
    assert dict(two.guard.refused) == {"ahead of its sender's clock": 1}
    assert two.heard == []


def test_what_is_left_of_a_beacon_is_where_its_sender_is() -> None:
    (one, two), now_s = met(1, 2)
    one.says["done"] = 7  # a word that its sender has not vouched for
    frame = one.send(now_s + 0.1)[0]
    fields = swarm_beacon.unpack(frame)
    assert fields is not None
    told = decode_beacon(frame[5], fields)
    assert two.guard.admits(frame, now_s + 0.1, told)
    left = two.guard.believe(swarm_beacon.Decoded(1, told, (1.0, 2.0, 3.0)), 1, now_s + 0.1)
    assert left.said == without_word(told)
    assert (left.version, left.pos_ned_m) == (1, (1.0, 2.0, 3.0))


def test_a_manifest_of_one_frame_vouches_for_it() -> None:
    stream, told = Stream(7, 4, 0.0), replace(BEACON, done=3)
    frame = seal(wire.frame(0, b"x", seq=0, system=1, component=COMPONENT, flags=1), b"k" * 32, 0, 5)
    stream.take_frame(frame, told, 1.0, named=True)
    assert not stream.is_proven(told, 1.0)
    assert stream.vouch(Manifest(7, 5, 5, (mac_of(frame),), ()), 1.0)
    assert stream.is_proven(told, 1.0)
    assert not stream.is_proven(replace(told, done=1), 1.0)


def test_one_that_speaks_as_another_is_told_as_critical() -> None:
    (one, two), now_s = met(1, 2)
    false = Node(1)
    false.guard._own_key = one.guard._own_key
    two.receive(false.send(now_s + 0.05)[:1], now_s + 0.05)
    two.guard.take_says()
    one.send(now_s + 0.1)
    two.guard.take_proof(manifest_of(one, now_s + 2.0), now_s + 0.1)
    text = "somebody speaks as vehicle 1: it only slows"
    assert [(say.severity, say.text) for say in two.guard.take_says()] == [(Severity.CRITICAL, text)]


def test_a_sealed_frame_that_makes_no_sense_as_a_manifest_is_none() -> None:
    (one, two), now_s = met(1, 2)
    payload = encode_manifest(Manifest(0, 2, 5, (), ()), 1, Signer(bytes(32)))
    frame = one.guard.seal_proof(wire.frame(MANIFEST_ID, payload, seq=0, system=1, component=COMPONENT, flags=1))
    assert not two.guard.take_proof(frame, now_s)
    assert not two.guard.take_proof(one.send(now_s)[0], now_s)  # nor is a beacon one


def test_an_own_frame_that_comes_back_is_counted_as_such() -> None:
    (one, two), now_s = met(1, 2)
    one.guard.refused.clear()
    one.receive(one.send(now_s)[:1], now_s)
    assert dict(one.guard.refused) == {"own": 1}
    assert two.guard.flags == 1


@pytest.mark.parametrize("boot", [0, -1, 1 << 32])
def test_a_boot_has_32_bits_and_is_not_none(boot: int) -> None:
    with pytest.raises(ValueError, match=rf"boot {boot}: must be 1\.\.2\^32-1"):
        open_session(keyring(1), 1, bytes(32), boot)
    assert open_session(keyring(1), 1, bytes(32), (1 << 32) - 1).boot == (1 << 32) - 1


def test_frames_that_no_manifest_names_dispute_nobody() -> None:
    """Records go beside beacons, and are many."""
    (one, two), now_s = met(1, 2)
    record = wire.frame(0, b"x", seq=0, system=1, component=COMPONENT, flags=1)
    for k in range(3):
        assert two.guard.admits(one.guard.seal(record, now_s + 0.01 * k, named=False), now_s, named=False)
    assert two.receive(one.send(now_s + 0.1), now_s + 0.1) == [(1, True)]
    two.guard.take_proof(manifest_of(one, now_s + 2.0), now_s + 0.1)
    assert "disowned" not in two.guard.refused
    assert two.guard.take_says() == []


def test_a_frame_with_a_wrong_mac_is_counted_as_forged() -> None:
    (one, two), now_s = met(1, 2)
    two.guard.refused.clear()
    frame = one.send(now_s)[0]
    two.receive([frame[:-1] + bytes([frame[-1] ^ 1])], now_s)
    assert dict(two.guard.refused) == {"forged, or of another boot": 1}


def test_a_radio_without_keys_grounds_nobody() -> None:
    open_guard = OpenGuard()
    assert (open_guard.cloned, open_guard.flags, dict(open_guard.refused)) == (False, 0, {})


def test_the_operator_is_named_so() -> None:
    """Its system id tells a reader nothing."""
    one = Node(1)
    other = Node(OPERATOR_ID, ring=keyring(OPERATOR, secret=b"o" * 32))
    one.receive(other.send(100.0), 100.0)
    assert one.texts == ["the operator has another key, or another mission file: ignored"]
    assert (name_of(BASE_ID), name_of(3)) == ("the base station", "vehicle 3")
