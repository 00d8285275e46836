"""The signatures of manifests: which are checked, and when."""

from __future__ import annotations

from dataclasses import replace

from companion.keys.crypto import Verifier
from companion.mavlink.framing import wire
from companion.mavlink.peers.guard import CHECKS_MAX
from companion.mavlink.peers.manifest import Manifest, read_manifest
from companion.mavlink.peers.stream import CHECKED_S, HEARD_MAX, PROVEN_S, Stream, Waiting
from tests.unit.core.core_kit import beacon, lease
from tests.unit.mavlink.signing_kit import PERIOD_S, Node, beacon_frame, exchange, guard, keyring, met, seed
from tests.unit.mavlink.test_signing import forged


def test_flood_of_manifests_costs_few_signatures() -> None:
    (one, two), now_s = met(1, 2)
    two.guard.refused.clear()
    for k in range(1000):
        message, payload = one.guard.proof(now_s + 5.0 + k) or (0, b"")
        changed = payload[:-1] + bytes([payload[-1] ^ 1])
        frame = one.guard.seal_proof(wire.frame(message, changed, seq=0, system=1, component=191, flags=1))
        two.receive([frame], now_s + 5.0)
    assert two.guard.refused == {"forged manifest": CHECKS_MAX, "too many manifests": 1000 - CHECKS_MAX}


class CountingVerifier:
    """Counts what it is asked."""

    def __init__(self, public: bytes) -> None:
        self.count = 0
        self._verifier = Verifier(public)

    def holds(self, signature: bytes, message: bytes) -> bool:
        self.count += 1
        return self._verifier.holds(signature, message)


def counted(owner: int, of: int) -> tuple[Node, CountingVerifier]:
    node = Node(owner)
    verifier = node.guard._session.verifiers[of] = CountingVerifier(keyring(of).vehicles[of])
    return node, verifier


def test_manifests_that_tell_nothing_new_are_seldom_checked_and_news_at_once() -> None:
    one, (two, verifier) = Node(1), counted(2, 1)
    now_s = exchange([one, two], 100.0, 20)
    verifier.count = 0
    two.heard.clear()
    now_s = exchange([one, two], now_s, 400)
    assert 8 <= verifier.count <= 11  # of 40
    assert {believed for _, believed in two.heard} == {True}
    before = verifier.count
    one.says = {"lease": lease(1, 9)}
    now_s = exchange([one, two], now_s, 1)
    assert verifier.count == before + 1
    assert two.heard[-1] == (1, True)


def test_manifest_that_was_put_off_is_checked_once_there_is_no_newer_one() -> None:
    one, (two, verifier) = Node(1), counted(2, 1)
    now_s = exchange([one, two], 100.0, 30)
    verifier.count = 0
    two.heard.clear()
    for _ in range(80):  # 8 s without another manifest
        two.receive(one.send(now_s)[:1], now_s)
        now_s = round(now_s + PERIOD_S, 6)
    believed = [whole for _, whole in two.heard]
    assert verifier.count == 1
    assert believed == sorted(believed, reverse=True)
    assert PROVEN_S - 1.0 <= sum(believed) * PERIOD_S <= PROVEN_S + 0.1


def test_forged_frame_is_disputed_though_a_forged_manifest_had_named_it() -> None:
    """By a member that has the group's key, while the owner's manifests tell nothing new."""
    (one, two), now_s = met(1, 2)
    frame = forged(1, 1001, now_s)
    forger = guard(1, boot=1001, ring=replace(keyring(1), seed=seed(3)))
    forger.seal(beacon_frame(1), now_s, beacon(1))
    message, payload = forger.proof(now_s + 0.001) or (0, b"")
    two.receive([frame], now_s)
    two.receive([forger.seal_proof(wire.frame(message, payload, seq=0, system=1, component=191, flags=1))], now_s)
    began_s = now_s
    while not two.texts and now_s - began_s < 3.0:
        now_s = exchange([one, two], now_s, 1)
    assert two.texts == ["somebody speaks as vehicle 1: it only slows"]
    assert now_s - began_s <= 2.0


def test_unnamed_frames_in_anothers_name_silence_none_of_its_beacons() -> None:
    """Records are not in manifests: a member could make one that is ahead, and all that the owner says would be old."""
    (one, two), now_s = met(1, 2)
    assert two.guard.admits(forged(1, 1001, now_s + 2.5), now_s, named=False)
    exchange([one, two], now_s, 5)
    assert two.heard == [(1, True)] * 5
    assert not two.guard.admits(forged(1, 1001, now_s + 2.5), now_s, named=False)  # again


def test_forged_frames_in_the_own_name_accuse_nobody() -> None:
    (one, two), now_s = met(1, 2)
    other = Node(2, ring=keyring(2, secret=b"o" * 32))
    two.receive(other.send(now_s), now_s)
    assert two.texts == []
    one.receive(other.send(now_s), now_s)
    assert one.texts == ["vehicle 2 has another key, or another mission file: ignored"]


def test_an_old_manifest_that_is_sent_again_opens_no_way_for_old_frames() -> None:
    """Whoever records one that had waited, and what came after it, has nothing to repeat: not of the unnamed either."""
    (one, two), now_s = met(1, 2)
    proof = one.guard.proof(now_s + 1.0)
    assert proof is not None
    manifest = one.guard.seal_proof(wire.frame(*proof, seq=0, system=1, component=191, flags=1))
    now_s += 2.0
    record = one.guard.seal(beacon_frame(1), now_s, named=False)
    assert two.guard.admits(record, now_s, named=False)
    two.receive([manifest], now_s + PROVEN_S)
    assert not two.guard.admits(record, now_s + PROVEN_S, named=False)
    assert two.guard.refused["repeated"] == 1


def after_a_check() -> tuple[Node, Node, CountingVerifier, float]:
    """A sender, who has just had a manifest of it checked, the count of such checks since, and the time."""
    one, (two, verifier) = Node(1), counted(2, 1)
    now_s, before = exchange([one, two], 100.0, 25), verifier.count
    while verifier.count == before:
        now_s = exchange([one, two], now_s, 1)
    verifier.count = 0
    return one, two, verifier, now_s


def put_off() -> tuple[Node, Node, CountingVerifier, list[bytes], float]:
    """The same after manifests that were put off, and these."""
    one, two, verifier, now_s = after_a_check()
    manifests: list[bytes] = []
    for _ in range(30):
        frames = one.send(now_s)
        two.receive(frames, now_s)
        manifests += frames[1:]
        now_s = round(now_s + PERIOD_S, 6)
    assert (len(manifests), verifier.count) == (3, 0)
    return one, two, verifier, manifests, now_s


def test_an_old_manifest_that_was_put_off_takes_no_newer_ones_place() -> None:
    """Repeated by somebody without a key, it would leave beacons unproven that a newer one, heard before, proves."""
    _, two, _, manifests, now_s = put_off()
    stream = two.guard._streams[1]
    waiting = stream.waiting
    two.guard.refused.clear()
    two.receive(manifests, now_s)
    assert two.guard.refused["repeated"] == len(manifests)
    assert stream.waiting is waiting


def test_an_old_manifest_that_was_put_off_is_not_checked_when_one_is_due_again() -> None:
    one, two, verifier, manifests, now_s = put_off()
    two.receive(manifests, now_s + CHECKED_S)
    assert verifier.count == 0
    two.receive(one.send(now_s + CHECKED_S), now_s + CHECKED_S)
    assert verifier.count == 1


def test_a_genuine_signature_under_another_body_keeps_no_genuine_manifest_out() -> None:
    """A member puts it there: who has not had the genuine one yet would take that for a repetition."""
    one, two, _, now_s = after_a_check()
    frames: list[bytes] = []
    while len(frames) < 2:
        frames = one.send(now_s)
        two.receive(frames[:1], now_s)
        now_s = round(now_s + PERIOD_S, 6)
    stream = two.guard._streams[1]
    found = read_manifest(frames[1])
    assert found is not None
    manifest, signed, signature = found
    stream.put_off(Waiting(replace(manifest, first=manifest.first - 1), signed + b"x", signature, now_s))
    assert not stream.has_heard(manifest, signed, signature)
    two.receive(frames[1:], now_s)
    assert stream.has_heard(manifest, signed, signature)


def test_a_manifest_that_comes_late_takes_no_newer_ones_place() -> None:
    """Kept back by somebody without a key, and then let through: it is heard for the first time."""
    one, two, _, now_s = after_a_check()
    manifests: list[bytes] = []
    while len(manifests) < 2:
        beacon_alone, *manifest = one.send(now_s)
        two.receive([beacon_alone], now_s)
        manifests += manifest
        now_s = round(now_s + PERIOD_S, 6)
    early, late = manifests
    two.receive([late], now_s)
    waiting = two.guard._streams[1].waiting
    assert waiting is not None
    two.receive([early], now_s)
    assert two.guard._streams[1].waiting is waiting


def test_a_manifest_that_comes_late_and_is_checked_leaves_a_newer_one() -> None:
    one, two, verifier, now_s = after_a_check()
    kept_back: list[bytes] = []
    while not kept_back:
        beacon_alone, *kept_back = one.send(now_s)
        two.receive([beacon_alone], now_s)
        now_s = round(now_s + PERIOD_S, 6)
    now_s = exchange([one, two], now_s, 12)
    waiting = two.guard._streams[1].waiting
    assert (waiting is not None, verifier.count) == (True, 0)
    two.receive(kept_back, now_s + CHECKED_S)
    assert verifier.count == 1
    assert two.guard._streams[1].waiting is waiting


def test_of_manifests_that_were_put_off_the_last_ones_are_known_again() -> None:
    """A member makes as many as it likes: what is remembered of them is bounded."""
    stream = Stream(1001, 0, 100.0)
    manifests = [Manifest(1001, 1, k, (), ()) for k in range(1, HEARD_MAX + 11)]
    for manifest in manifests:
        stream.put_off(Waiting(manifest, b"%d" % manifest.last, b"signature", 100.0))
    known = [stream.has_heard(manifest, b"%d" % manifest.last, b"signature") for manifest in manifests]
    assert known == [False] * 10 + [True] * HEARD_MAX


def test_a_leader_whose_count_advances_is_believed_all_the_time() -> None:
    (one, two), now_s = met(1, 2)
    for count in range(1, 301):
        one.says = {"lease": lease(1, count)}
        now_s = exchange([one, two], now_s, 1)
    assert two.heard == [(1, True)] * 300
