"""`companion watch --key`: a forged vehicle is never in the picture, and who speaks without the key is named."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from companion.core.model.beacon import RelativeReport
from companion.keys.keyring import OPERATOR
from companion.mavlink.framing import wire
from companion.mavlink.own_messages import encode_relative_report
from companion.mavlink.peers.frame_mac import seal
from companion.mavlink.peers.guard import CHECKS_MAX
from companion.mavlink.peers.manifest import MANIFEST_ID, Manifest, encode_manifest, read_manifest
from companion.mavlink.peers.session import BASE_ID, open_session
from companion.mavlink.relative import RELATIVE_ID
from companion.records.frames import RECORD_ID, encode_record
from companion.records.record import Record, RecordKind
from companion.watch.alarms import alarms
from companion.watch.heard import FRESH_S, Heard
from companion.watch.listening_guard import PAST_MAX, ListeningGuard
from tests.unit.mavlink.signing_kit import MISSION, PERIOD_S, Node, beacon_frame, keyring
from tests.unit.watch.watch_kit import LEADS, beacon, frame


def watching() -> Heard:
    return Heard(ListeningGuard(open_session(keyring(OPERATOR), BASE_ID, MISSION, 1)))


def fly(one: Heard, nodes: list[Node], now_s: float, seconds: float) -> float:
    """Each sends a beacon a period, and a manifest when it is due; returns the time after."""
    for _ in range(round(seconds / PERIOD_S)):
        for node in nodes:
            one.receive_datagram(b"".join(node.send(now_s)), now_s)
        now_s = round(now_s + PERIOD_S, 6)
    return now_s


def kinds(one: Heard, now_s: float) -> set[tuple[str, tuple[int, ...]]]:
    return {(alarm.kind, alarm.vehicles) for alarm in alarms(one.picture(now_s))}


def shown(one: Heard, now_s: float) -> list[int]:
    return [vehicle.id for vehicle in one.picture(now_s).vehicles]


def test_members_are_shown_proven_with_all_that_they_say() -> None:
    one = watching()
    nodes = [Node(1), Node(2)]
    for node in nodes:
        node.says = {"lease": LEADS}
    now_s = fly(one, nodes, 100.0, 4.0)
    picture = one.picture(now_s)
    assert [(v.id, v.leader) for v in picture.vehicles] == [(1, 1), (2, 1)]
    assert all(v.unproven_s is not None and v.unproven_s < 1.0 for v in picture.vehicles)
    assert (picture.strangers, picture.refused <= 2) == ((), True)  # a beacon each, until the first manifest


def test_unsigned_beacon_is_not_shown_and_its_name_is_told_for_a_while() -> None:
    one = watching()
    now_s = fly(one, [Node(1)], 100.0, 2.0)
    before = one.picture(now_s).vehicles
    for k in (1, 3):
        one.receive_datagram(beacon(k, vel_ned_mps=(9.0, 0.0, 0.0)), now_s)
    assert one.picture(now_s).vehicles == before
    assert {("stranger", (1,)), ("stranger", (3,))} <= kinds(one, now_s)
    assert not one.picture(now_s + 3.0).strangers


def test_forged_recorded_and_other_missions_frames_are_not_shown() -> None:
    one, node = watching(), Node(1)
    now_s = fly(one, [node], 100.0, 2.0)
    recorded = b"".join(node.send(now_s))
    one.receive_datagram(recorded, now_s)
    before = one.picture(now_s)
    one.receive_datagram(recorded, now_s)
    stranger = Node(3, ring=keyring(3, secret=b"x" * 32))
    other = Node(4, mission=b"n" * 32)
    fly(one, [stranger, other], now_s, 2.0)
    tampered = bytearray(b"".join(node.send(now_s)))
    tampered[20] ^= 1
    one.receive_datagram(bytes(tampered), now_s)
    assert one.picture(now_s).vehicles == before.vehicles
    assert {("stranger", (3,)), ("stranger", (4,))} <= kinds(one, now_s + 2.0)


def test_member_that_speaks_as_another_is_told_and_its_word_is_not_shown() -> None:
    one, genuine = watching(), Node(1)
    now_s = fly(one, [genuine], 100.0, 3.0)
    key = open_session(keyring(2), 2, MISSION, 77).stream_key(0, 1, 1001)
    assert key is not None
    one.receive_datagram(seal(beacon_frame(1, abort=True, lease=LEADS), key, 0, int((now_s + 0.01) * 1e5)), now_s)
    (vehicle,) = one.picture(now_s).vehicles
    assert (vehicle.abort, vehicle.leader) == (False, 0)
    now_s = fly(one, [genuine], now_s, 1.5)
    assert ("stranger", (1,)) in kinds(one, now_s)
    now_s = fly(one, [genuine], now_s, 3.0)
    assert kinds(one, now_s) <= {("stranger", (1,))}


def test_manifest_by_anothers_key_or_of_another_mission_begins_no_boot() -> None:
    one = watching()
    now_s = fly(one, [Node(1)], 100.0, 2.0)
    other = Node(1, boot=50, mission=b"n" * 32)
    of_another_mission = [data for data in other.send(now_s) if read_manifest(data)]
    session = open_session(keyring(2), 2, MISSION, 77)
    payload = encode_manifest(Manifest(50, 1, 1, (), ()), 1, session.signer)
    by_another = wire.frame(MANIFEST_ID, payload, seq=0, system=1, component=191, flags=1)
    for data in (*of_another_mission, seal(by_another, session.keys[0], 0, 1)):
        for at_s in (now_s, now_s + 10.0):  # while it is heard, and when it is not any more
            one.receive_datagram(data, at_s)
            assert "has not made" in one.picture(at_s).strangers[0][1]
            assert not one.picture(at_s + 3.0).strangers
    assert len(of_another_mission) == 1


def test_records_want_the_key_as_well() -> None:
    one = watching()
    record = Record(1, 0, 1, RecordKind.STEM, 0.0, b"")
    one.receive_datagram(frame(RECORD_ID, encode_record(record), 1), 100.0)
    assert one.harvest.text(0) == ""


def test_member_without_its_own_key_stays_unproven() -> None:
    one, node = watching(), Node(1)
    node.says = {"lease": LEADS}
    now_s = fly(one, [node], 100.0, 2.0)
    for _ in range(80):  # what has the swarm's key alone cannot make a manifest
        one.receive_datagram(node.send(now_s)[0], now_s)
        now_s = round(now_s + PERIOD_S, 6)
    (vehicle,) = one.picture(now_s).vehicles
    assert vehicle.age_s < FRESH_S
    assert vehicle.leader == 0
    assert ("unproven", (1,)) in kinds(one, now_s)


def test_boot_that_is_over_never_comes_back() -> None:
    one = watching()
    first = Node(1, boot=11)
    recorded = [b"".join(first.send(90.0 + k * PERIOD_S)) for k in range(30)]
    now_s = 100.0
    for data in recorded[:15]:
        one.receive_datagram(data, now_s)
        now_s = round(now_s + PERIOD_S, 6)
    now_s = fly(one, [Node(1, boot=12)], now_s, 0.5)
    assert "two speak as it" in one.picture(now_s).strangers[0][1]
    now_s = fly(one, [Node(1, boot=13)], now_s + 2.0, 1.0)
    assert "started again" in one.picture(now_s).strangers[0][1]
    before, now_s = one.picture(now_s + 2.0).vehicles, now_s + 2.0
    for data in recorded[15:]:
        one.receive_datagram(data, now_s)
    assert one.picture(now_s).vehicles == before
    assert "a recording" in one.picture(now_s).strangers[0][1]


def test_relative_reports_want_the_key_as_well() -> None:
    one = watching()
    now_s = fly(one, [Node(1)], 100.0, 2.0)
    report = RelativeReport(1, 1000, (1.0, 2.0), None, 0.0, ())
    one.receive_datagram(frame(RELATIVE_ID, encode_relative_report(report), 1), now_s)
    assert ("stranger", (1,)) in kinds(one, now_s)
    assert not one._reports


def test_tables_are_bounded() -> None:
    one = watching()
    now_s = 100.0
    for boot in range(1, 2 * PAST_MAX):
        now_s = fly(one, [Node(1, boot=boot)], now_s + 2.0, 0.3)
    assert shown(one, now_s) == [1]
    for k in range(256):
        one.receive_datagram(beacon(k), now_s)
    assert len(one.picture(now_s).strangers) <= 256


def test_flood_of_manifests_costs_a_few_signatures_a_second() -> None:
    class Counting:
        checked = 0

        def holds(self, _signature: bytes, _data: bytes) -> bool:
            self.checked += 1
            return False

    counting: Any = Counting()
    session = open_session(keyring(OPERATOR), BASE_ID, MISSION, 1)
    one = Heard(ListeningGuard(replace(session, verifiers={1: counting})))
    for boot in range(1, 100):
        one.receive_datagram(b"".join(Node(1, boot=boot).send(100.0)), 100.0)
    assert counting.checked == CHECKS_MAX
