"""Frames of a radio without keys: repeated, changed, made up; and what an insider signs in a signed swarm."""

from __future__ import annotations

from companion.mavlink.beacon import COMPONENT, MESSAGE_ID, beacons
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import SIGNED, source, whole
from companion.mavlink.peers.frame_mac import is_signed
from mission.document.model import Mission
from mission.schema.kinds import Lie
from sim_bridge.drive.links.insider import Insiders
from sim_bridge.drive.links.outsider import OUTSIDER_ID, Outsider
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.world.radio import Radio
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.unit.core.core_kit import beacon, mission
from tests.unit.drive.links.test_transmitter import CLOSE, frame


def flies() -> Mission:
    return mission(swarm={"size": 3}).with_origin(DEFAULT_ORIGIN)


def flagged(data: bytes) -> bytes:
    """The same frame, whose header says that it is signed."""
    return wire.frame(MESSAGE_ID, data[10:-2], seq=0, system=data[5], component=COMPONENT, flags=SIGNED)


def outsider() -> Outsider:
    air = Radio(range_m=30.0, loss=0.0, delay_s=0.0, seed=1)
    air.place(CLOSE)
    return Outsider(flies(), air)


def test_it_hears_and_is_heard_beside_its_vehicle_and_sends_nothing_else() -> None:
    one = outsider()
    one.receive(frame(1) + frame(2), 1.0)
    assert one.tick(1.0) == []
    one.beside = 2
    assert one.pos_ned_m == CLOSE[2]
    assert one.id == OUTSIDER_ID
    assert 1 <= len(one.tick(1.0)) <= 6
    one.beside = 0
    assert (one.tick(1.05), one.pos_ned_m) == ([], CLOSE[2])


def test_its_frames_are_valid_and_in_the_names_of_others() -> None:
    one, heard = outsider(), (frame(1), frame(3))
    one.beside = 2
    one.receive(b"".join(heard), 1.0)
    sent = [data for tick in range(100) for data in one.tick(1.0 + 0.05 * tick)]
    assert {source(data)[0] for data in sent} == {1, 3}
    assert all([(start, end) for start, end, _ in whole(data)] == [(0, len(data))] for data in sent)
    assert 0.1 < sum(data in heard for data in sent) / len(sent) < 0.5
    read = [found for data in sent for found in beacons(data)]  # those of a changed byte that is none are not
    assert len(read) > 0.7 * len(sent)
    assert not any(is_signed(data) for data in sent)  # as those were that it heard


def test_a_signed_insider_vouches_for_its_lies() -> None:
    """Its frame is admitted, and proven by its manifest; a lie that it did not sign is not admitted."""
    keys = FleetKeys(flies())
    guards = {k: keys.guard(k) for k in (1, 2)}
    insiders = Insiders(flies())
    insiders.sign_with(keys.sessions)

    def exchange(now_s: float, lies: dict[int, Lie]) -> tuple[bytes, bool]:
        """What is sent of a beacon of 1, and whether 2 admits it."""
        insiders.set_lies(lies)
        sealed = guards[1].seal(flagged(frame(1)), now_s, beacon(1))
        ((_, _, fields),) = beacons(sealed)
        sent = insiders.rewrite_beacon(1, sealed, fields, now_s, CLOSE)
        admitted = guards[2].admits(sent, now_s, beacon(1))
        for one, other in ((1, 2), (2, 1)):
            proof = guards[one].proof(now_s)
            if proof is not None:
                data = wire.frame(*proof, seq=0, system=one, component=COMPONENT, flags=SIGNED)
                guards[other].take_proof(insiders.rewrite_proof(one, guards[one].seal_proof(data)), now_s)
        return sent, admitted

    for tick in range(30):  # they meet
        sent, admitted = exchange(0.1 * tick, {})
    assert admitted
    for tick in range(30, 60):
        lie, admitted = exchange(0.1 * tick, {1: Lie.PUSH})
        assert admitted
        assert lie[10:-15] != sent[10:-15]
    for tick in range(60, 90):
        assert exchange(0.1 * tick, {})[1]
    assert not guards[2].refused["disowned"]
    insiders.sign_with({})
    assert not exchange(9.0, {1: Lie.PUSH})[1]
