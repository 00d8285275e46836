"""What companions say on the air: in whose name, and what is kept of it."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.model.beacon import RelativeReport, TrunkReport
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.codec import Codec
from companion.mavlink.framing import wire
from companion.mavlink.own_messages import encode_relative_report, encode_trunk_report
from companion.mavlink.relative import RELATIVE_ID, TRUNKS_ID
from companion.records.frames import RECORD_ID, encode_record
from companion.records.record import Record, RecordKind
from mission.common.frames import LocalFrame, Vec3, Wgs84
from sim_bridge.drive.links.transmitter import Transmitter
from sim_bridge.world.radio import Radio
from tests.unit.core.core_kit import beacon

_CODEC = Codec(1, LocalFrame(Wgs84(47.0, 8.0, 400.0)))
_CODEC.home(dialect.MAVLink_home_position_message(470_000_000, 80_000_000, 400_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))
_CODEC.position(dialect.MAVLink_local_position_ned_message(0, 0, 0, -8, 0, 0, 0))
CLOSE: dict[int, Vec3] = {1: (0.0, 0.0, -8.0), 2: (5.0, 0.0, -8.0), 3: (10.0, 0.0, -8.0)}


def frame(sender: int, *, range_m: float = 30.0, component: int = swarm_beacon.COMPONENT, **changes: Any) -> bytes:
    payload = _CODEC.encode_beacon(beacon(sender, range_m=range_m, **changes))
    assert payload is not None
    return wire.frame(swarm_beacon.MESSAGE_ID, payload, seq=0, system=sender, component=component)


WORD = wire.frame(
    RELATIVE_ID,
    encode_relative_report(RelativeReport(1, 1000, (0.0, 0.0))),
    seq=0,
    system=1,
    component=swarm_beacon.COMPONENT,
)


def on_air() -> tuple[Radio, Transmitter]:
    air = Radio(range_m=30.0, loss=0.0, delay_s=0.0, seed=1)
    air.place(CLOSE)
    return air, Transmitter(air)


def test_a_beacon_goes_on_the_air_as_it_is() -> None:
    air, companions = on_air()
    sent = frame(1)
    assert companions.send(1, sent, 0.0) == (sent,)
    assert [air.deliver(k, 0.0) for k in CLOSE] == [b"", sent, sent]


def test_trunks_go_on_the_air_by_themselves_and_in_the_own_name_alone() -> None:
    air, companions = on_air()
    told = [
        wire.frame(
            TRUNKS_ID,
            encode_trunk_report(TrunkReport(sender, 1000, (0.0, 0.0), ((1.0, 2.0, 0.3),))),
            seq=0,
            system=sender,
            component=swarm_beacon.COMPONENT,
        )
        for sender in (1, 2)
    ]
    companions.send(1, told[0], 0.0)
    companions.send(1, told[1], 0.0)
    assert [air.deliver(k, 0.0) for k in CLOSE] == [b"", told[0], told[0]]
    assert companions.refused == 1


def test_each_radio_is_set_to_the_range_that_its_beacon_announces_before_the_beacon_is_sent() -> None:
    air, companions = on_air()
    companions.send(1, frame(1, range_m=4.0), 0.0)
    assert air.range_m(1) == 4.0
    assert air.range_m(2) == 30.0
    assert air.deliver(2, 0.0) == b""


def test_the_last_beacon_of_each_companion_is_kept_with_its_time() -> None:
    _, companions = on_air()
    companions.send(2, frame(2, hop=3), 1.0)
    companions.send(2, frame(2, hop=4), 1.5)
    assert {k: said.hop for k, said in companions.said.items()} == {2: 4}
    assert companions.said_s == {2: 1.5}


def test_beacon_in_anothers_name_is_refused_and_goes_nowhere() -> None:
    air, companions = on_air()
    assert companions.send(1, frame(2), 0.0) == ()
    assert companions.refused == 1
    assert [air.deliver(k, 0.0) for k in CLOSE] == [b"", b"", b""]
    assert companions.said == {}


def test_forged_beacon_in_a_datagram_does_not_stop_the_genuine_one() -> None:
    air, companions = on_air()
    good = frame(1)
    assert companions.send(1, frame(3, range_m=1.0) + good + frame(2), 0.0) == (good,)
    assert companions.refused == 2
    assert air.range_m(3) == 30.0


@pytest.mark.parametrize("data", [b"", b"\xfd" * 500, frame(1)[:-1], frame(1, component=1), bytes(300)])
def test_what_is_no_beacon_of_a_companion_goes_nowhere(data: bytes) -> None:
    air, companions = on_air()
    assert companions.send(1, data, 0.0) == ()
    assert air.deliver(2, 0.0) == b""


def test_damaged_beacon_goes_nowhere() -> None:
    good = frame(1)
    for at in range(len(good)):
        air, companions = on_air()
        bad = bytearray(good)
        bad[at] ^= 0x40
        assert companions.send(1, bytes(bad), 0.0) == ()
        assert air.deliver(2, 0.0) == b""


def test_a_beacon_and_what_goes_with_it_are_one_datagram_on_the_air() -> None:
    """As they leave the companion: both arrive at once, or neither."""
    air = Radio(range_m=30.0, loss=0.4, delay_s=0.2, seed=1)
    air.place(CLOSE)
    companions, arrived = Transmitter(air), []
    for k in range(200):
        companions.send(1, WORD + frame(1), 0.1 * k)
        arrived.append(air.deliver(2, 0.1 * k))
    assert {data.count(WORD) - data.count(frame(1)) for data in arrived} == {0}
    assert 80 < sum(data.count(WORD) for data in arrived) < 140


def test_what_goes_with_no_beacon_is_not_sent() -> None:
    air, companions = on_air()
    assert companions.send(1, WORD, 0.0) == ()
    assert air.deliver(2, 0.0) == b""


# --- records ---


def record(sender: int, writer: int = 1) -> bytes:
    payload = encode_record(Record(writer, 1, 1, RecordKind.STEM, 0.0, b"a stem"))
    return wire.frame(RECORD_ID, payload, seq=0, system=sender, component=swarm_beacon.COMPONENT)


def test_records_go_on_the_air_after_the_beacon_whoever_wrote_them() -> None:
    air, companions = on_air()
    sent = frame(1)
    assert companions.send(1, record(1, writer=3) + sent, 0.0) == (sent,)
    assert air.deliver(2, 0.0) == sent + record(1, writer=3)


def test_a_record_sent_in_anothers_name_is_refused_and_goes_nowhere() -> None:
    air, companions = on_air()
    companions.send(1, record(2), 0.0)
    assert companions.refused == 1
    assert air.deliver(3, 0.0) == b""


def test_a_damaged_record_goes_nowhere_and_hides_no_beacon() -> None:
    air, companions = on_air()
    sent = frame(1)
    assert companions.send(1, record(1)[:-1] + b"?" + sent, 0.0) == (sent,)
    assert air.deliver(2, 0.0) == sent
