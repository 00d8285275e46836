"""What a beacon may say that its sender has not vouched for, field by field; frames and manifests that come back."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.core.localisation.peer_reports import TAKEN_BACK
from companion.core.model.beacon import Beacon, Candidate, Lease, PeerReport
from companion.core.model.states import SwarmPhase
from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.mavlink.peers.frame_mac import mac_of, seal
from companion.mavlink.peers.guard import OpenGuard
from companion.mavlink.peers.manifest import Manifest
from companion.mavlink.peers.stream import Stream
from tests.unit.core.core_kit import beacon
from tests.unit.mavlink.signing_kit import PERIOD_S, Node, beacon_frame, exchange, met
from tests.unit.mavlink.test_signing_checks import counted
from tests.unit.mavlink.test_signing_words import manifest_of

LEASE = Lease(1, 50, 2, 7, established=True, heir=3, ends=90, quorum=True)
CANDIDATE = Candidate(3, 1, 9)
ALARM = PeerReport(4, (1.0, 0.0, 0.0), 0.1, silent=True, relays=1)
TAKES_BACK = replace(ALARM, silent=False, relays=TAKEN_BACK)
SAID = beacon(
    1,
    lease=LEASE,
    candidate=CANDIDATE,
    sighting=TAKES_BACK,
    phase=SwarmPhase.TRANSIT,
    stop=1,
    done=3,
    present=7,
    flown=7,
)
NEWS = {
    "leader": {"lease": replace(LEASE, leader=2)},
    "priority": {"lease": replace(LEASE, priority=3)},
    "established": {"lease": replace(LEASE, established=False)},
    "heir": {"lease": replace(LEASE, heir=4)},
    "ends": {"lease": replace(LEASE, ends=91)},
    "quorum": {"lease": replace(LEASE, quorum=False)},
    "no lease": {"lease": None},
    "candidate": {"candidate": replace(CANDIDATE, vehicle=2)},
    "its priority": {"candidate": replace(CANDIDATE, priority=2)},
    "its score": {"candidate": replace(CANDIDATE, score=8)},
    "no candidate": {"candidate": None},
    "alarm taken back": {"sighting": replace(TAKES_BACK, vehicle=3)},
    "none taken back": {"sighting": None},
    "phase": {"phase": SwarmPhase.COVERAGE},
    "stop": {"stop": 2},
    "done": {"done": 7},
    "present": {"present": 15},
    "flown": {"flown": 15},
}
NO_NEWS = {
    "count": {"lease": replace(LEASE, seq=51)},
    "score": {"lease": replace(LEASE, score=8)},
    "velocity": {"vel_ned_mps": (1.0, 0.0, 0.0)},
    "an alarm": {"sighting": ALARM},
}


def frame_at(timestamp: int) -> bytes:
    return seal(beacon_frame(1), b"k" * 32, 0, timestamp)


def vouched(said: Beacon) -> Stream:
    """A sender that has vouched for this beacon."""
    stream, frame = Stream(7, 4, 0.0), frame_at(5)
    stream.take_frame(frame, said, 1.0, named=True)
    assert stream.vouch(Manifest(7, 5, 5, (mac_of(frame),), ()), 1.0)
    return stream


@pytest.mark.parametrize("changes", NEWS.values(), ids=NEWS.keys())
def test_news_counts_once_its_sender_has_vouched_for_it(changes: dict[str, object]) -> None:
    said = replace(SAID, **changes)
    for before, after in ((SAID, said), (said, SAID)):
        stream = vouched(before)
        assert stream.is_proven(before, 1.0)
        assert not stream.is_proven(after, 1.0)


@pytest.mark.parametrize("changes", NEWS.values(), ids=NEWS.keys())
def test_a_manifest_that_names_news_is_checked_at_once(changes: dict[str, object]) -> None:
    stream, first, second = vouched(SAID), frame_at(6), frame_at(7)
    stream.take_frame(first, SAID, 1.1, named=True)
    assert stream.is_known(Manifest(7, 5, 6, (mac_of(frame_at(5)), mac_of(first)), ()), 1.1)
    stream.take_frame(second, replace(SAID, **changes), 1.2, named=True)
    assert not stream.is_known(Manifest(7, 6, 7, (mac_of(first), mac_of(second)), ()), 1.2)


@pytest.mark.parametrize("changes", NO_NEWS.values(), ids=NO_NEWS.keys())
def test_what_is_no_news_counts_as_what_was_vouched_for(changes: dict[str, object]) -> None:
    base = replace(SAID, sighting=None)
    assert vouched(base).is_proven(replace(base, **changes), 1.0)


@pytest.mark.parametrize("at", [6, 7, 8])
def test_a_frame_that_a_manifest_does_not_name_is_found_at_either_end_of_its_time(at: int) -> None:
    stream, forged = vouched(SAID), frame_at(at)
    stream.take_frame(forged, SAID, 1.1, named=True)
    manifest = Manifest(7, 6, 8, (), ())
    assert not stream.is_known(manifest, 1.1)
    assert stream.is_vouched(1.1)
    assert not stream.vouch(manifest, 1.1)
    assert not stream.is_vouched(1.1)
    assert stream.is_proven(SAID, 1.1)  # whoever says it again


@pytest.mark.parametrize("at", [6, 9])
def test_a_frame_of_another_time_is_left_to_another_manifest(at: int) -> None:
    stream = vouched(SAID)
    stream.take_frame(frame_at(at), SAID, 1.1, named=True)
    assert stream.is_known(Manifest(7, 7, 8, (), ()), 1.1)


def test_own_manifests_that_come_back_neither_ground_nor_cost_a_signature() -> None:
    """A relay or a wall sends them back, however often; the own boot is in no echo."""
    (two, verifier), other = counted(2, 2), Node(1)
    now_s = exchange([other, two], 100.0, 20) + 1.1
    for _ in range(5):
        two.guard.take_proof(manifest_of(two, now_s), now_s)
        now_s = round(now_s + 1.1, 6)
    assert not two.guard.cloned
    assert verifier.count == 0


def test_a_manifest_that_was_checked_costs_no_second_signature() -> None:
    one, (two, verifier) = Node(1), counted(2, 1)
    now_s = exchange([one, two], 100.0, 20) + 5.0
    frame = manifest_of(one, now_s)
    verifier.count = 0
    for k in range(10):
        assert two.guard.take_proof(frame, now_s + 6.0 * k)
    assert verifier.count == 1
    assert two.guard.refused["repeated"] == 9


def test_manifests_of_one_that_does_not_hear_this_one_are_counted() -> None:
    one, two = Node(1), Node(2)
    for count in (1, 2, 3):
        two.guard.take_proof(manifest_of(one, 2.0 * count), 2.0 * count)
        assert dict(two.guard.refused) == {"not met": count}


def test_frames_of_each_epoch_hold_by_a_key_that_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    (one, two), now_s = met(1, 2)
    monkeypatch.setattr(type(two.guard._session), "stream_key", lambda *_: pytest.fail("made again"))
    unnamed = wire.frame(0, b"x", seq=0, system=1, component=COMPONENT, flags=1)
    for k in range(3):
        assert two.guard.admits(one.guard.seal(unnamed, now_s + k * PERIOD_S, named=False), now_s + k * PERIOD_S)


def test_a_radio_without_keys_takes_no_signed_frame() -> None:
    """A signature that is not read proves nothing."""
    (one, _), now_s = met(1, 2)
    sealed, unsigned = one.send(now_s)[0], wire.frame(0, b"x", seq=0, system=1, component=COMPONENT)
    guard = OpenGuard()
    for count in (1, 2):
        assert not guard.passes(sealed, now_s)
        assert not guard.admits(sealed, now_s)
        assert dict(guard.refused) == {"signed": 2 * count}
    assert guard.passes(unsigned, now_s)


def test_each_time_somebody_speaks_as_another_is_counted() -> None:
    (one, two), now_s = met(1, 2)
    false = Node(1)
    false.guard._own_key = one.guard._own_key
    for count in (1, 2):
        now_s += 5.0
        two.receive(false.send(now_s)[:1], now_s)
        two.guard.take_proof(manifest_of(one, now_s + 0.01), now_s + 0.01)
        assert two.guard.refused["disowned"] == count


def test_a_beacon_is_new_by_the_newest_beacon_whatever_records_have_come() -> None:
    (one, two), now_s = met(1, 2)
    record = wire.frame(0, b"x", seq=0, system=1, component=COMPONENT, flags=1)
    assert two.guard.admits(one.guard.seal(record, now_s + 2.0, named=False), now_s, named=False)
    other = Node(1)
    other.guard._own_key = one.guard._own_key
    sealed = other.send(now_s + 0.1)[0]  # its counter is behind that of the record
    assert two.guard.passes(sealed, now_s + 0.1)
    two.guard.take_admitted(sealed, now_s + 0.1)
    two.guard.refused.clear()
    for count in (1, 2):
        assert not two.guard.passes(sealed, now_s + 0.1)
        assert dict(two.guard.refused) == {"repeated": count}
