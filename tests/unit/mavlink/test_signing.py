"""Signed frames: what is forged, repeated, of another flight or in another's name has no effect."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from companion.core.localisation.peer_reports import TAKEN_BACK
from companion.core.model.beacon import Candidate, PeerReport
from companion.keys.crypto import public_key
from companion.mavlink import dialect
from companion.mavlink.framing import wire
from companion.mavlink.peers.frame_mac import TIMESTAMP_MAX, seal, timestamp_of
from companion.mavlink.peers.manifest import read_manifest
from companion.mavlink.peers.session import BASE_ID, open_session
from companion.mavlink.peers.stream import AHEAD_S, CHECKED_S, DISPUTED_S
from companion.mavlink.schema.tables.signing import MACS_MAX
from tests.unit.core.core_kit import beacon, lease
from tests.unit.mavlink.signing_kit import (
    MISSION,
    PERIOD_S,
    Node,
    beacon_frame,
    exchange,
    guard,
    keyring,
    met,
    seed,
    with_secrets,
)


def test_those_that_meet_hear_one_another_and_believe() -> None:
    nodes = [Node(k) for k in (1, 2, 3)]
    exchange(nodes, 50.0, 6)
    for node in nodes:
        assert {sender for sender, _ in node.heard} == {1, 2, 3} - {node.id}
        assert all(believed for _, believed in node.heard[-2:])
        assert node.texts == []


def test_nothing_counts_before_its_sender_has_heard_this_boot() -> None:
    one, deaf = Node(1), Node(2)
    for k in range(30):
        now_s = 50.0 + k * PERIOD_S
        one.receive(deaf.send(now_s), now_s)  # a link of one way
        one.send(now_s)
    assert one.heard == []
    assert one.guard.refused["not met"] > 0


def test_signature_is_mavlinks_own() -> None:
    """pymavlink checks it, with this boot's key."""
    nodes, now_s = met(1, 2)
    session = open_session(keyring(1), 1, MISSION, 1001)
    frame = nodes[0].send(now_s)[0]
    mav = dialect.MAVLink(None)
    mav.signing.secret_key = session.stream_key(0, 1, 1001)
    mav.signing.timestamp = timestamp_of(frame)
    read = mav.decode(bytearray(frame))
    assert read.get_type() == "SWARM_BEACON"
    mav.signing.secret_key = b"x" * 32
    with pytest.raises(dialect.MAVError, match="signature"):
        dialect_with(mav).decode(bytearray(frame))


def dialect_with(mav: dialect.MAVLink) -> dialect.MAVLink:
    other = dialect.MAVLink(None)
    other.signing.secret_key, other.signing.timestamp = mav.signing.secret_key, mav.signing.timestamp
    return other


def test_every_changed_byte_is_refused_and_the_genuine_frame_taken() -> None:
    (one, two), now_s = met(1, 2)
    frame = one.send(now_s)[0]
    for at in range(len(frame)):
        for bit in range(8):
            changed = bytearray(frame)
            changed[at] ^= 1 << bit
            two.receive([bytes(changed)], now_s)
    assert two.heard == []
    two.receive([frame], now_s)
    assert two.heard == [(1, True)]


def test_unsigned_beacon_is_refused_and_said_once() -> None:
    (_one, two), now_s = met(1, 2)
    payload = beacon_frame(1)[10:-2]
    for _ in range(5):
        two.receive([wire.frame(52100, payload, seq=0, system=1, component=191)], now_s)
    assert two.heard == []
    assert two.texts == ["vehicle 1 sends unsigned frames: ignored"]


@pytest.mark.parametrize("other", ["secret", "mission"])
def test_another_key_or_mission_is_not_heard_and_said(other: str) -> None:
    one = Node(1)
    two = Node(2, ring=keyring(2, secret=b"x" * 32)) if other == "secret" else Node(2, mission=b"n" * 32)
    exchange([one, two], 50.0, 30)
    assert one.heard == two.heard == []
    assert one.texts == ["vehicle 2 has another key, or another mission file: ignored"]


def test_repeated_frame_is_refused() -> None:
    (one, two), now_s = met(1, 2)
    first, second = one.send(now_s), one.send(now_s + PERIOD_S)
    two.receive(first, now_s)
    two.receive(second, now_s + PERIOD_S)
    two.heard.clear()
    two.receive([*first, *second, *first], now_s + 2 * PERIOD_S)
    assert two.heard == []


def test_recording_of_an_earlier_boot_is_refused_after_a_reboot_of_either() -> None:
    (one, _two), now_s = met(1, 2)
    recorded = [one.send(round(now_s + k * PERIOD_S, 6)) for k in range(30)]
    again = Node(2, boot=77)  # the same clock, the same vehicle, another boot
    other = Node(1, boot=78)
    for k, frames in enumerate(recorded):
        again.receive(frames, now_s + k * PERIOD_S)
        again.send(now_s + k * PERIOD_S)
    assert again.heard == []
    exchange([other, again], now_s, 20)
    again.heard.clear()
    for frames in recorded:
        again.receive(frames, now_s + 2.0)
    assert again.heard == []
    exchange([other, again], now_s + 2.0, 3)
    assert len(again.heard) == 3


def test_one_that_begins_anew_is_met_again_and_its_old_boot_no_more() -> None:
    (one, two), now_s = met(1, 2)
    old = one.send(now_s)
    new = Node(1, boot=5)
    now_s = exchange([new, two], now_s + 2.0, 10)
    assert two.heard[-1] == (1, True)
    two.heard.clear()
    two.receive(old, now_s)
    assert two.heard == []


def test_timestamp_far_ahead_is_refused_and_locks_nobody_out() -> None:
    (one, two), now_s = met(1, 2)
    key = open_session(keyring(1), 1, MISSION, 1001).stream_key(0, 1, 1001)
    assert key is not None
    ahead = timestamp_of(one.send(now_s)[0]) + int((AHEAD_S + 1.0) * 1e5)
    for timestamp in (ahead, TIMESTAMP_MAX):
        two.receive([seal(beacon_frame(1), key, 0, timestamp)], now_s)
    assert two.heard == []
    exchange([one, two], now_s + PERIOD_S, 3)
    assert len(two.heard) == 3


# --- in another's name ---


def forged(node_id: int, boot: int, now_s: float, **says: object) -> bytes:
    """By a member that has the swarm's secret, as another."""
    key = open_session(keyring(3), 3, MISSION, 1003).stream_key(0, node_id, boot)
    assert key is not None
    return seal(beacon_frame(node_id, **says), key, 0, int(now_s * 1e5) + 50)


def test_word_of_a_member_in_anothers_name_never_counts_and_is_found_within_two_seconds() -> None:
    (one, two), now_s = met(1, 2)
    began_s = now_s
    while not two.texts and now_s < began_s + 5.0:
        two.receive(one.send(now_s), now_s)
        two.receive([forged(1, 1001, now_s, lease=lease(3, 9), abort=True)], now_s)
        one.receive(two.send(now_s), now_s)
        now_s = round(now_s + PERIOD_S, 6)
    assert two.texts == ["somebody speaks as vehicle 1: it only slows"]
    assert now_s - began_s <= 2.0
    two.heard.clear()
    exchange([one, two], now_s, 2)
    assert {believed for _, believed in two.heard} <= {False}  # and what it says itself, not yet again
    exchange([one, two], now_s + DISPUTED_S, 45)
    assert two.heard[-1] == (1, True)


def test_forged_word_is_not_believed_for_a_moment() -> None:
    (one, two), now_s = met(1, 2)
    two.receive(one.send(now_s), now_s)
    two.heard.clear()
    two.receive([forged(1, 1001, now_s, lease=lease(3, 9))], now_s)
    two.receive([forged(1, 1001, now_s + 0.001, phase=beacon(1).phase.__class__.LAND)], now_s)
    assert two.heard == [(1, False), (1, False)]


@pytest.mark.parametrize(
    "says",
    [
        {"lease": lease(1, 5000)},
        {"lease": lease(1, 6), "done": 15},
        {"lease": lease(1, 6), "present": 15},
        {"lease": lease(1, 6), "flown": 15},
        {"lease": lease(1, 6), "candidate": Candidate(3, 9, 9)},
        {"lease": lease(1, 6), "sighting": PeerReport(3, (0.0, 0.0, 0.0), 0.0, silent=False, relays=TAKEN_BACK)},
    ],
)
def test_forged_beacon_with_the_word_of_its_sender_moves_nothing_else(says: dict[str, object]) -> None:
    (one, two), now_s = met(1, 2)
    one.says = {"lease": lease(1, 5)}
    now_s = exchange([one, two], now_s, 3)
    two.heard.clear()
    two.receive([forged(1, 1001, now_s, lease=lease(1, 6))], now_s)
    assert two.heard == [(1, True)]  # as it would say itself
    two.receive([forged(1, 1001, now_s + 0.001, **says)], now_s)
    assert two.heard[-1] == (1, False)


def test_count_of_a_lease_goes_on_between_two_manifests() -> None:
    (one, two), now_s = met(1, 2)
    for count in range(5, 60):
        one.says = {"lease": lease(1, count)}
        now_s = exchange([one, two], now_s, 1)
    assert all(believed for _, believed in two.heard)


def test_news_of_the_sender_itself_counts_at_once() -> None:
    (one, two), now_s = met(1, 2)
    one.says = {"lease": lease(1, 5)}
    assert two.receive(one.send(now_s), now_s) == [(1, True)]


def test_manifest_of_a_member_in_anothers_name_is_refused() -> None:
    (one, two, three), now_s = met(1, 2, 3)
    forger = guard(1, boot=1001, ring=replace(keyring(1), seed=seed(3)))
    now_s += CHECKED_S
    payload = forger.proof(now_s)
    assert payload is not None
    frame = forger.seal_proof(wire.frame(*payload, seq=0, system=1, component=191, flags=1))
    two.receive([frame], now_s)
    assert two.guard.refused["forged manifest"] == 1
    assert (one.texts, two.texts, three.texts) == ([], [], [])


def recorded_manifests(owner: int, count: int) -> list[bytes]:
    """Of as many earlier boots, sealed with the swarm's secret."""
    found = []
    for boot in range(5000, 5000 + count):
        earlier = guard(owner, boot=boot)
        sent = earlier.proof(10.0)
        assert sent is not None
        found.append(earlier.seal_proof(wire.frame(*sent, seq=0, system=owner, component=191, flags=1)))
    return found


def test_flood_of_recorded_manifests_neither_silences_nor_unproves_a_sender() -> None:
    (one, two), now_s = met(1, 2)
    recorded = recorded_manifests(1, 40)
    for k in range(100):
        one.says = {"lease": lease(1, k // 5)}  # news that must be proven
        two.receive(recorded, now_s)
        now_s = exchange([one, two], now_s, 1)
    assert [sender for sender, _ in two.heard] == [1] * 100
    assert all(believed for _, believed in two.heard)
    sent = two.guard.proof(now_s + 5.0)
    assert sent is not None
    frame = two.guard.seal_proof(wire.frame(*sent, seq=0, system=2, component=191, flags=1))
    found = read_manifest(frame)
    assert found is not None
    assert (1, 1001) in found[0].echoes  # whoever must still meet this vehicle can


def test_manifests_go_with_beacons_not_with_every_tick() -> None:
    (one, _), now_s = met(1, 2)
    one.says = {"lease": lease(1, 5)}
    sent = [one.send(now_s)]
    for k in range(1, 20):  # 20 Hz; a beacon in every other tick
        at_s = now_s + k * PERIOD_S / 2
        proof = one.guard.proof(at_s) if k % 2 else None
        sent += [one.send(at_s)] if k % 2 == 0 else []
        assert proof is None
    assert sum(len(frames) - 1 for frames in sent) <= 6  # news go with three or four beacons, then one a second


def test_texts_are_of_members_alone() -> None:
    (_, two), now_s = met(1, 2)
    payload = beacon_frame(1)[10:-2]
    for sender in range(1, 256):
        two.receive([wire.frame(52100, payload, seq=0, system=sender, component=191)], now_s)
    assert len(two.texts) <= 6


# --- clones, rotation, the base ---


def test_clone_is_said_and_the_one_that_was_there_is_still_heard() -> None:
    (one, two), now_s = met(1, 2)
    clone = Node(1, boot=66)
    now_s = exchange([one, two, clone], now_s, 20)
    assert "vehicle 1 is there twice: the later is ignored" in two.texts
    assert clone.guard.cloned
    assert "another companion flies as vehicle 1" in clone.texts
    assert two.guard.refused["not met"] > 0  # what the clone says
    two.heard.clear()
    two.receive(one.send(now_s), now_s)
    assert two.heard == [(1, True)]


def test_two_epochs_are_heard_while_secrets_are_rotated() -> None:
    old, new = b"o" * 32, b"n" * 32
    one = Node(1, ring=with_secrets(keyring(1), {0: old, 1: new}, 0))
    two = Node(2, ring=with_secrets(keyring(2), {0: old, 1: new}, 1))
    exchange([one, two], 50.0, 10)
    assert one.heard[-1] == (2, True)
    assert two.heard[-1] == (1, True)


def test_revoked_vehicle_is_not_heard_though_it_has_the_secret() -> None:
    ring = keyring(2)
    without = {k: key for k, key in ring.vehicles.items() if k != 1}
    one, two = Node(1), Node(2, ring=replace(ring, vehicles=without))
    exchange([one, two], 50.0, 20)
    assert two.heard == []
    assert two.texts == ["vehicle 1 is not of this fleet, or revoked: ignored"]


def test_keyring_of_another_owner_opens_no_session() -> None:
    with pytest.raises(ValueError, match="vehicle 1"):
        open_session(keyring(1), 2, MISSION, 5)
    with pytest.raises(ValueError, match="the operator"):
        open_session(keyring(0), 2, MISSION, 5)
    assert open_session(keyring(0), BASE_ID, MISSION, 5).me == BASE_ID
    assert public_key(seed(0)) == keyring(0).operator


def test_lost_manifests_and_frames_dispute_nobody() -> None:
    rng = random.Random(7)
    (one, two), now_s = met(1, 2)
    for k in range(1200):
        one.says = {"lease": lease(1, k // 40)}
        for frame in one.send(now_s):
            if rng.random() > 0.5:
                two.receive([frame], now_s)
        answer = two.send(now_s)
        one.receive(answer, now_s)
        now_s = round(now_s + PERIOD_S, 6)
    assert two.texts == []
    believed = [whole for _, whole in two.heard]
    assert sum(believed) > 0.95 * len(believed)
    assert MACS_MAX == 20
