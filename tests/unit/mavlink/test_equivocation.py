"""A member that vouches for two words at once is proven to, by two manifests of its own; no honest one ever is."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.mavlink.peers.equivocation import KEPT_MAX, TRIED_MAX, contradict
from companion.mavlink.peers.manifest import Manifest, read_manifest
from tests.unit.core.core_kit import lease
from tests.unit.mavlink.signing_kit import PERIOD_S, Node, guard, keyring, met, seed

pytestmark = pytest.mark.sources


def manifest(first: int, last: int, macs: str, boot: int = 7) -> Manifest:
    return Manifest(boot, first, last, tuple([mac.encode() * 6 for mac in macs]), ())


@pytest.mark.parametrize(
    ("one", "other", "contradicts"),
    [
        (manifest(1, 6, "abcde"), manifest(3, 9, "cdefg"), False),
        (manifest(1, 6, "abcde"), manifest(7, 9, "fg"), False),  # of another time
        (manifest(1, 6, "abcde"), manifest(3, 9, "xdefg"), True),  # its first frame is denied
        (manifest(1, 6, "abcde"), manifest(3, 9, "cdxfg"), True),  # one within
        (manifest(1, 6, "abcde"), manifest(3, 9, "cd"), True),  # what was named is left out
        (manifest(1, 9, "abcdefgh"), manifest(3, 6, "cde"), False),  # within the other
        (manifest(1, 9, "abcdefgh"), manifest(3, 6, "cdx"), True),
        (manifest(1, 6, "abcde"), manifest(1, 6, "abcde"), False),  # the same
        (manifest(1, 6, "abcde"), manifest(1, 6, "abcdx"), True),  # a count that is used twice
        (manifest(1, 6, "abcde"), manifest(3, 9, "xdefg", boot=8), False),
        (manifest(1, 6, ""), manifest(3, 9, "xdefg"), False),
    ],
)
def test_two_manifests_contradict_where_they_disagree_about_one_time(
    one: Manifest, other: Manifest, *, contradicts: bool
) -> None:
    assert contradict(one, other) is contradicts
    assert contradict(other, one) is contradicts


@pytest.mark.parametrize("seed_", range(20))
def test_no_two_manifests_of_an_honest_one_contradict(seed_: int) -> None:
    """Whatever comes between its beacons, and however it pauses."""
    rng, node, now_s, kept = random.Random(seed_), Node(1), 100.0, []
    record = wire.frame(0, b"x", seq=0, system=1, component=COMPONENT, flags=1)
    for _ in range(120):
        for frame in node.send(now_s):
            found = read_manifest(frame)
            if found is not None:
                kept.append(found[0])
        for _ in range(rng.randrange(3)):
            node.guard.seal(record, now_s, named=rng.random() < 0.3)
        now_s += rng.choice((PERIOD_S, PERIOD_S, 0.02, 3.0))
    assert len(kept) > 20
    assert not any(contradict(one, other) for one in kept for other in kept)


class TwoFaced(Node):
    """One boot of one vehicle that says one thing to some, and vouches for it, and another to others."""

    def __init__(self, owner: int, late_s: float) -> None:
        super().__init__(owner)
        self.other = Node(owner)
        self.other.says = {"lease": lease(owner, 9, established=True)}
        self._late_s = late_s

    def send_to_others(self, now_s: float) -> list[bytes]:
        self.other.guard._streams = self.guard._streams  # it has met the same
        return self.other.send(now_s + self._late_s)


def proofs_of(node: Node) -> list[bytes]:
    return node.guard.take_proofs()


@pytest.mark.parametrize("late_s", [0.0, 0.013])
def test_whoever_hears_both_has_the_proof_and_whoever_is_sent_it_has_it_too(late_s: float) -> None:
    liar, two, three = TwoFaced(1, late_s), Node(2), Node(3)
    now_s, proofs = 100.0, []
    for k in range(60):
        mine, others = liar.send(now_s), liar.send_to_others(now_s)
        two.receive(mine, now_s)
        three.receive(others, now_s)
        if k > 40:
            two.receive(others[1:], now_s)  # a manifest for others reaches it
        for node in (two, three):
            liar.receive(node.send(now_s), now_s)
        proofs += proofs_of(two)
        now_s = round(now_s + PERIOD_S, 6)
    assert two.guard.take_liars() == [1]
    assert len(proofs) == 2
    assert three.guard.take_liars() == []
    for frame in proofs:
        assert three.guard.take_proof(frame, now_s)
    assert three.guard.take_liars() == [1]
    assert len(proofs_of(three)) == 2  # and on to those that did not hear it
    for frame in proofs:
        three.guard.take_proof(frame, now_s)
    assert (three.guard.take_liars(), proofs_of(three)) == ([], [])


def test_what_others_make_in_its_name_proves_nothing_and_costs_little() -> None:
    (one, two), now_s = met(1, 2)
    forger = guard(1, boot=1001, ring=replace(keyring(1), seed=seed(3)))
    checks = 0
    real = two.guard._witness._holds

    def counted(sender: int, signed: object) -> bool:
        nonlocal checks
        checks += 1
        return real(sender, signed)  # type: ignore[arg-type]

    two.guard._witness._holds = counted  # type: ignore[method-assign]
    for k in range(50):
        two.receive(one.send(now_s), now_s)
        for _ in range(4):
            forger.seal(wire.frame(0, b"x", seq=0, system=1, component=COMPONENT, flags=1), now_s + 0.01 * k)
            proof = forger.proof(now_s + 2.0 * k)
            if proof is not None:
                frame = wire.frame(*proof, seq=0, system=1, component=COMPONENT, flags=1)
                two.guard.take_proof(forger.seal_proof(frame), now_s)
        now_s = round(now_s + PERIOD_S, 6)
    assert two.guard.take_liars() == []
    assert checks <= 2 * TRIED_MAX * 6
    assert all(len(kept) <= KEPT_MAX for kept in two.guard._witness._kept.values())
