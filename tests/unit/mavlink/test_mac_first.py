"""A signed radio: what has no MAC of the swarm is dropped before anything of it is decoded."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.model.beacon import RelativeReport, TrunkReport
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.beacon import REFUSED, Reader
from companion.mavlink.framing import wire
from companion.mavlink.orders.desk import open_desk
from companion.mavlink.own_messages import encode_relative_report, encode_trunk_report
from companion.mavlink.peers import manifest, peers_link
from companion.mavlink.peers.frame_mac import seal
from companion.mavlink.peers.peers_link import PeersLink
from companion.mavlink.relative import RELATIVE_ID, TRUNKS_ID
from mission.common.frames import LocalFrame
from tests.unit.mavlink.signing_kit import HERE, beacon_frame, met

pytestmark = pytest.mark.sources


def linked() -> tuple[PeersLink, bytes, bytes, bytes, float]:
    """A link that has met 2, and a beacon, a manifest and a report of 2 that are genuine."""
    (one, two), now_s = met(1, 2)
    link = PeersLink(1, Reader(LocalFrame(HERE)), one.guard, None, open_desk(None), ranging=True)
    now_s += 1.1
    sealed, proof = two.send(now_s)
    report = RelativeReport(2, 1000, (0.0, 0.0))
    payload = encode_relative_report(report)
    frame = wire.frame(RELATIVE_ID, payload, seq=0, system=2, component=191, flags=1)
    return link, sealed, proof, two.guard.seal(frame, now_s + 0.01), now_s + 0.02


def forged(frame: bytes) -> bytes:
    """With another MAC."""
    return frame[:-1] + bytes([frame[-1] ^ 1])


def test_what_is_forged_is_not_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    link, sealed, proof, report, now_s = linked()
    decoded: list[str] = []

    def note(module: Any, name: str) -> None:
        real = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *rest: decoded.append(name) or real(*rest))

    note(swarm_beacon, "decode")
    note(manifest, "read_payload")
    note(peers_link, "read_relative_report")
    for frame in (sealed, proof, report):
        for _ in range(100):
            assert link.read_datagram(forged(frame), now_s) == []
    assert decoded == []
    assert sum(link.guard.refused.values()) >= 300
    heard = link.read_datagram(sealed + report + proof, now_s)
    assert len(heard) == 2
    assert sorted(decoded) == ["decode", "read_payload", "read_relative_report"]


def test_forged_trunks_are_not_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    (one, two), now_s = met(1, 2)
    link = PeersLink(1, Reader(LocalFrame(HERE)), one.guard, None, open_desk(None), ranging=True, trunks=True)
    payload = encode_trunk_report(TrunkReport(2, 1000, (0.0, 0.0), ((1.0, 2.0, 0.3),)))
    frame = wire.frame(TRUNKS_ID, payload, seq=0, system=2, component=191, flags=1)
    sealed = two.guard.seal(frame, now_s + 1.1)
    monkeypatch.setattr(peers_link, "read_trunk_report", lambda _: pytest.fail("decoded"))
    assert link.read_datagram(forged(sealed), now_s + 1.11) == []
    assert link.read_datagram(frame, now_s + 1.11) == []
    monkeypatch.undo()
    assert len(link.read_datagram(sealed, now_s + 1.12)) == 1


def test_what_does_not_pass_takes_no_place_among_what_a_reader_remembers() -> None:
    reader = Reader(LocalFrame(HERE), remembers=1)
    genuine = seal(beacon_frame(2), b"key", 0, 1)
    first = reader.decode_frame(genuine, lambda _frame: True)
    for k in range(3, 9):
        assert reader.decode_frame(seal(beacon_frame(k), b"key", 0, 1), lambda _frame: False) is REFUSED
    assert reader.decode_frame(genuine, lambda _frame: False) is REFUSED
    assert reader.decode_frame(genuine, lambda _frame: True) is first
