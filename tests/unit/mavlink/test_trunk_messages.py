"""SWARM_TRUNKS: there and back, as pymavlink has it, what is not believed, and its way through a companion."""

from __future__ import annotations

import math

import pytest

from companion.core.model.beacon import TrunkReport
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.beacon import Reader
from companion.mavlink.framing import wire
from companion.mavlink.orders.desk import open_desk
from companion.mavlink.own_messages import encode_trunk_report
from companion.mavlink.packing import pack_trunks, unpack_trunks
from companion.mavlink.peers.guard import OpenGuard
from companion.mavlink.peers.peers_link import PeersLink
from companion.mavlink.relative import TRUNKS_ID, is_trunk_report, read_relative_report, read_trunk_report
from mission.common.frames import LocalFrame, Wgs84

TRUNKS = ((1.25, -0.07, 0.3), (-327.67, 327.67, 2.55), *((0.5 * k, -0.25 * k, 0.01 * k) for k in range(1, 11)))
REPORT = TrunkReport(5, 123456, (1.5, -80.25), TRUNKS)


def framed(report: TrunkReport, *, component: int = swarm_beacon.COMPONENT) -> bytes:
    return wire.frame(TRUNKS_ID, encode_trunk_report(report), seq=0, system=report.sender, component=component)


def link(*, trunks: bool) -> PeersLink:
    return PeersLink(
        1, Reader(LocalFrame(Wgs84(47.0, 8.0, 400.0))), OpenGuard(), None, open_desk(None), ranging=True, trunks=trunks
    )


def test_a_report_comes_back_to_the_centimetre_and_reads_alike_in_pymavlink() -> None:
    frame = framed(REPORT)
    found = read_trunk_report(frame)
    assert found is not None
    assert (found.sender, found.time_ms, found.odo_ne_m) == (5, 123456, (1.5, -80.25))
    assert [one for trunk in found.trunks for one in trunk] == pytest.approx([k for one in TRUNKS for k in one])
    message = wire.decode(frame)
    assert (message.time_boot_ms, message.odo_n) == (123456, 1.5)
    assert unpack_trunks(bytes(message.trunks)) == found.trunks


def test_twelve_trunks_are_84_bytes_and_fewer_are_less() -> None:
    assert len(framed(REPORT)) == 84
    assert len(framed(TrunkReport(5, 123456, (1.5, -80.25), TRUNKS[:6]))) == 54
    assert unpack_trunks(pack_trunks(TRUNKS * 2)) == unpack_trunks(pack_trunks(TRUNKS))


def test_what_does_not_fit_is_cut_and_no_trunk_is_none() -> None:
    assert unpack_trunks(pack_trunks([(1e6, -1e6, 9.0), (0.0, 0.0, 0.0)])) == (
        (327.67, -327.67, 2.55),
        (0.0, 0.0, 0.01),
    )
    assert unpack_trunks(bytes(60)) == ()


def test_a_damaged_report_is_none_and_nothing_raises() -> None:
    good = framed(REPORT)
    assert is_trunk_report(good)
    assert read_trunk_report(good[:-1] + bytes([good[-1] ^ 1])) is None
    assert read_relative_report(good) is None
    for at in range(len(good)):
        assert read_trunk_report(good[:at]) is None
    for odo in ((math.nan, 0.0), (0.0, math.inf), (6e4, 0.0)):
        assert read_trunk_report(framed(TrunkReport(5, 1, odo, TRUNKS))) is None


def test_reports_are_read_where_trunks_are_shared_alone() -> None:
    (found,) = link(trunks=True).read_datagram(framed(REPORT), 1.0)
    assert isinstance(found, TrunkReport)
    assert link(trunks=False).read_datagram(framed(REPORT), 1.0) == []
    assert link(trunks=True).read_datagram(framed(REPORT, component=196), 1.0) == []


def test_the_dialect_has_it() -> None:
    assert dialect.mavlink_map[TRUNKS_ID].msgname == "SWARM_TRUNKS"
