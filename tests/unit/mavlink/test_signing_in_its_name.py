"""A member speaks in the name of a dead one, or of a live one; what was heard of an earlier boot comes again."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.core.model.beacon import PeerReport
from companion.mavlink.peers.belief import without_word
from companion.mavlink.peers.guard import ALIVE_S
from companion.mavlink.peers.stream import DISPUTED_S, PROVEN_S
from tests.unit.core.core_kit import lease
from tests.unit.mavlink.signing_kit import PERIOD_S, Node, exchange, met

pytestmark = pytest.mark.sources
LEASE = lease(1, 7, established=True)


def forger_of(one: Node) -> Node:
    """A member that makes frames of this boot, of which it has the key, and none of its manifests."""
    false = Node(one.id, boot=one.guard._session.boot)
    false.says = dict(one.says)
    return false


def forge(false: Node, receiver: Node, now_s: float) -> list[tuple[int, bool]]:
    return receiver.receive(false.send(now_s)[:1], now_s)


def test_a_boot_that_another_one_has_followed_never_counts_again() -> None:
    (one, two), now_s = met(1, 2)
    recorded = []
    for _ in range(100):
        frames = one.send(now_s)
        recorded.append(frames)
        now_s = round(now_s + PERIOD_S, 6)
    again = Node(1, boot=77)
    now_s = exchange([again, two], now_s + ALIVE_S, 20)
    assert two.guard.boots() == {1: 77}
    now_s += 2.0 * ALIVE_S  # it is not heard for a while
    two.heard.clear()
    for frames in recorded:
        two.receive(frames, now_s)
        now_s += PERIOD_S
    assert two.heard == []
    assert two.guard.refused["of a boot that is over"] > 0
    assert "recording of vehicle 1: ignored" in two.texts
    now_s = exchange([again, two], now_s, 12)
    assert two.guard.boots() == {1: 77}
    assert all(sender == 1 for sender, _ in two.heard)
    assert two.heard[-1] == (1, True)


def test_beacons_in_the_name_of_one_that_is_dead_are_not_vouched_for() -> None:
    (one, two), now_s = met(1, 2)
    false = forger_of(one)
    until_s, vouched = now_s + PROVEN_S + 1.0, []
    while now_s < until_s:
        assert forge(false, two, now_s)
        vouched.append((now_s, two.believed[-1].is_vouched))
        now_s = round(now_s + PERIOD_S, 6)
    assert vouched[0][1]
    assert not any(is_vouched for at_s, is_vouched in vouched if at_s > 100.0 + 2.0 + PROVEN_S + PERIOD_S)


def test_a_companion_that_begins_anew_is_met_though_another_speaks_in_its_name() -> None:
    (one, two), now_s = met(1, 2)
    false, again = forger_of(one), Node(1, boot=77)
    until_s = now_s + 2.0 * PROVEN_S
    while now_s < until_s:
        forge(false, two, now_s)
        two.receive(again.send(now_s), now_s)
        again.receive(two.send(now_s), now_s)
        now_s = round(now_s + PERIOD_S, 6)
    assert two.guard.boots() == {1: 77}
    assert two.heard[-1] == (1, True)
    assert not forge(false, two, now_s)


def test_the_word_of_one_that_is_spoken_for_stays_and_no_way_is_added_to_it() -> None:
    """Or a member deposes every leader by one frame each three seconds."""
    (one, two), now_s = met(1, 2)
    one.says["lease"] = LEASE
    now_s = exchange([one, two], now_s, 12)
    false = forger_of(one)
    false.says |= {"dest_ned_m": (9.0, 9.0, 0.0), "sighting": PeerReport(2, (1.0, 0.0, 0.0), 0.1, silent=True)}
    said = []
    for k in range(60):
        if k % 20 == 0:
            forge(false, two, now_s + 0.01)
            said.append(two.believed[-1])
        two.receive(one.send(now_s + 0.05), now_s + 0.05)
        said.append(two.believed[-1])
        now_s = round(now_s + PERIOD_S, 6)
    assert any("speaks as vehicle 1" in text for text in two.texts)
    disputed = [one for one in said if not one.is_vouched]
    assert len(disputed) > 30
    for one_said in disputed:
        assert one_said.said is not None
        assert one_said.said.lease is not None
        assert one_said.said.dest_ned_m is None
        assert one_said.said.sighting is None


def test_another_word_in_its_name_does_not_count_while_it_is_spoken_for() -> None:
    (one, two), now_s = met(1, 2)
    false = forger_of(one)
    forge(false, two, now_s + 0.01)
    now_s = exchange([one, two], now_s + 0.05, 11)
    assert any("speaks as vehicle 1" in text for text in two.texts)
    false.says["lease"] = LEASE
    forge(false, two, now_s)
    left = two.believed[-1]
    assert left.said is not None
    assert left.said == without_word(replace(left.said, lease=LEASE))
    assert not left.is_vouched


def test_it_is_vouched_for_again_once_nobody_else_speaks_in_its_name() -> None:
    (one, two), now_s = met(1, 2)
    forge(forger_of(one), two, now_s + 0.01)
    now_s = exchange([one, two], now_s + 0.05, 11)
    assert not two.believed[-1].is_vouched
    exchange([one, two], now_s, round((DISPUTED_S + 2.0) / PERIOD_S))
    assert two.believed[-1].is_vouched
    assert two.heard[-1] == (1, True)
