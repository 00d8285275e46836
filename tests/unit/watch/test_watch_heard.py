"""What was heard, without sockets: ages, ghosts, what is not known; and that it is in the beacons."""

from __future__ import annotations

from dataclasses import asdict, fields, replace
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common

from companion.core.localisation.peer_reports import TAKEN_BACK
from companion.core.model.beacon import Candidate, PeerReport, RelativeReport
from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.own_messages import AIRBORNE, BEACON_PAYLOAD, encode_relative_report
from companion.mavlink.relative import RELATIVE_ID
from companion.mavlink.schema.tables.beacon import BEACON
from companion.mavlink.schema.tables.measurements import RELATIVE
from companion.records.frames import RECORD_ID, VECTOR_ID, encode_record, encode_vector
from companion.records.record import BASE_ID, Entry, LogKey, Record, RecordKind, Vector
from companion.records.summary import StandSummary, encode_summary
from companion.watch.alarms import Alarm, alarms
from companion.watch.heard import Heard, Picture, Told, Vehicle
from mission.common.frames import LocalFrame, Wgs84
from mission.document.model import Mission
from sim_bridge.drive.fly import Flight
from tests.flights import flown, short_mission
from tests.unit.watch.watch_kit import HERE, LEADS, beacon, frame, said


def heard(*datagrams: tuple[bytes, float]) -> Heard:
    one = Heard()
    for data, at_s in datagrams:
        one.receive_datagram(data, at_s)
    return one


def kinds(picture: Picture, mission: Mission | None = None) -> list[tuple[str, tuple[int, ...]]]:
    return [(alarm.kind, alarm.vehicles) for alarm in alarms(picture, mission)]


def test_ages_count_from_the_last_beacon_by_the_own_clock_alone() -> None:
    one = heard((beacon(1, time_ms=9_000_000), 10.0), (beacon(2, time_ms=5), 10.4), (beacon(1, time_ms=1), 10.5))
    assert [(v.id, v.age_s) for v in one.picture(12.0).vehicles] == [(1, 1.5), (2, pytest.approx(1.6))]
    assert one.picture(12.0).silence_s == 1.5
    assert Heard().picture(99.0) == Picture((), (), (), None, None, None, (), 0)


def test_what_a_vehicle_does_not_tell_is_not_known() -> None:
    nowhere = Wgs84(swarm_beacon.NOWHERE_DEG, swarm_beacon.NOWHERE_DEG, 4.0)
    (one,) = heard((beacon(3, here=nowhere, lease=None), 0.0)).picture(0.0).vehicles
    assert (one.place, one.leader, one.battery_percent, one.to_leader_ne_m) == (None, 0, None, None)


@pytest.mark.parametrize(
    ("candidate", "percent"),
    [(Candidate(2, 0, 7), (70, 79)), (Candidate(2, 0, 10), (100, 100)), (Candidate(5, 0, 1), None), (None, None)],
)
def test_a_battery_is_told_by_a_vehicle_that_proposes_itself(
    candidate: Candidate | None, percent: tuple[int, int] | None
) -> None:
    (one,) = heard((beacon(2, candidate=candidate), 0.0)).picture(0.0).vehicles
    assert one.battery_percent == percent


def test_vehicles_that_others_name_and_silent_ones_are_shown_as_what_others_say() -> None:
    sighting = PeerReport(4, (30.0, 0.0, 0.0), 5.0, silent=True)
    one = heard((beacon(1, present=0b100111, flown=0b1111, sighting=sighting), 0.0), (beacon(2), 0.0))
    picture = one.picture(1.0)
    assert picture.not_heard == (3, 4, 6)
    (told,) = picture.told
    assert (told.id, told.by, told.age_s, told.silent) == (4, 1, 6.0, True)
    assert told.place is not None
    there = LocalFrame(HERE).to_ned(Wgs84(*told.place))
    assert there == pytest.approx((30.0, 0.0, 0.0), abs=0.02)
    assert one.picture(3.0).told == ()  # nobody says so any more


def test_one_that_takes_an_alarm_back_says_nothing_of_where_the_vehicle_is() -> None:
    sighting = PeerReport(4, (30.0, 0.0, 0.0), 5.0, silent=True)
    back = PeerReport(4, (0.0, 0.0, 0.0), 0.0, silent=False, relays=TAKEN_BACK)
    one = heard((beacon(1, sighting=sighting), 0.0), (beacon(2, sighting=back), 0.1))
    (told,) = one.picture(1.0).told
    assert (told.id, told.by, told.silent) == (4, 1, True)


def test_a_word_goes_with_its_own_beacon_alone() -> None:
    word = RelativeReport(2, 1000, (3.0, 4.0), (-20.0, 5.0), 1.5)
    both = frame(RELATIVE_ID, encode_relative_report(word), 2) + beacon(2, candidate=Candidate(2, 0, 2))
    one = heard((both, 0.0))
    (vehicle,) = one.picture(0.0).vehicles
    assert (vehicle.to_leader_ne_m, vehicle.leader_sd_m) == ((-20.0, 5.0), 1.5)
    assert vehicle.battery_percent is None  # its score is divided
    one.receive_datagram(beacon(2, time_ms=1100), 0.1)
    assert one.picture(0.1).vehicles[0].to_leader_ne_m is None


def test_a_vehicle_without_satellites_is_where_it_reckons_from_its_leader_when_it_spoke() -> None:
    nowhere = Wgs84(swarm_beacon.NOWHERE_DEG, swarm_beacon.NOWHERE_DEG, 460.0)
    word = frame(RELATIVE_ID, encode_relative_report(RelativeReport(2, 1000, (0.0, 0.0), (-20.0, 5.0), 1.5)), 2)
    follower = word + beacon(2, here=nowhere)
    alone = heard((follower, 0.0)).picture(0.0).vehicles[0]
    assert (alone.place, alone.reckoned, alone.alt_m) == (None, None, 460.0)  # nobody knows where its leader is
    one = heard((beacon(1), 0.0), (follower, 0.1))
    one.receive_datagram(beacon(1, here=LocalFrame(HERE).to_wgs84((500.0, 0.0, 0.0))), 5.0)
    ghost = one.picture(5.0).vehicles[1]
    assert ghost.reckoned is not None
    assert LocalFrame(HERE).to_ned(Wgs84(*ghost.reckoned)) == pytest.approx((20.0, -5.0, -10.0), abs=0.01)
    late = heard((beacon(1), 0.0), (follower, 4.0)).picture(4.0).vehicles[1]
    assert late.reckoned is None  # the leader's place is old


def test_other_messages_and_broken_beacons_change_nothing() -> None:
    one = heard((beacon(1), 0.0))
    before = one.picture(1.0)
    mav = common.MAVLink(None, srcSystem=1, srcComponent=1)
    others = [
        mav.global_position_int_encode(0, 480000000, 90000000, 1, 1, 0, 0, 0, 0),
        mav.heartbeat_encode(2, 12, 0, 0, 4),
        mav.sys_status_encode(0, 0, 0, 0, 12000, 100, 15, 0, 0, 0, 0, 0, 0),
        mav.statustext_encode(2, b"battery low"),
    ]
    good = beacon(1, time_ms=2000)
    from_autopilot = frame(swarm_beacon.MESSAGE_ID, swarm_beacon.encode(said(1), HERE), 1, component=1)
    for data in (*(m.pack(mav) for m in others), good[:-1] + b"\0", good[:40], b"\xfd" * 900, from_autopilot):
        one.receive_datagram(data, 0.5)
    assert one.picture(1.0) == before


def test_signed_beacon_is_shown_though_nobody_checks_it() -> None:
    one = heard((beacon(1), 0.0))
    good = beacon(2, time_ms=2000)
    signed = bytearray(good[:-2])
    signed[2] = 1
    crc = dialect.x25crc(bytes(signed[1:]) + bytes([dialect.MAVLink_swarm_beacon_message.crc_extra])).crc
    one.receive_datagram(bytes(signed) + crc.to_bytes(2, "little") + bytes(13), 0.5)
    assert [vehicle.id for vehicle in one.picture(1.0).vehicles] == [1, 2]


def test_a_beacon_of_another_version_is_named_and_not_read() -> None:
    payload = bytearray(swarm_beacon.encode(said(5), HERE).ljust(BEACON_PAYLOAD.size, b"\0"))
    payload[BEACON_PAYLOAD.size - 99] += 1  # before members, position_error and accused
    picture = heard((frame(swarm_beacon.MESSAGE_ID, bytes(payload), 5), 0.0)).picture(0.0)
    assert (picture.vehicles, picture.other_versions) == ((), (5,))
    assert kinds(picture) == [("version", (5,))]


# --- alarms -----------------------------------------------------------------------------------------------------------


def test_a_link_that_is_lost_in_the_air_is_an_alarm_and_on_the_ground_none() -> None:
    one = heard((beacon(2), 5.0), (beacon(3, airborne=False), 5.0), (beacon(1), 7.8))
    assert kinds(one.picture(7.9)) == []
    one.receive_datagram(beacon(1), 9.0)
    assert kinds(one.picture(9.1)) == [("link", (2,))]
    (alarm,) = alarms(one.picture(9.1))
    assert alarm == Alarm("link", (2,), "Vehicle 2: link lost in the air, last heard 4 s ago", grave=True)
    one.receive_datagram(beacon(2), 9.2)
    assert kinds(one.picture(9.3)) == []


def test_silence_of_all_is_one_alarm_and_not_one_for_each() -> None:
    one = heard((beacon(1), 0.0), (beacon(2), 0.0))
    assert kinds(one.picture(2.9)) == []
    assert kinds(one.picture(60.0)) == [("silence", ())]
    assert "60 s" in alarms(one.picture(60.0))[0].text


def test_a_swarm_in_the_air_that_nobody_leads_is_an_alarm_until_it_is_led_again() -> None:
    unled = {"lease": replace(LEADS, established=False)}
    one = heard((beacon(1), 0.0))
    for tick in range(1, 30):
        one.receive_datagram(beacon(2, **unled), tick / 10.0)
    assert one.picture(1.9).led_s == pytest.approx(1.9)
    assert ("leader", ()) in kinds(one.picture(2.9))
    one.receive_datagram(beacon(2), 3.0)
    assert ("leader", ()) not in kinds(one.picture(3.0))
    on_ground = heard((beacon(2, airborne=False, **unled), 0.0))
    assert kinds(on_ground.picture(1.0)) == []


def test_two_leaders_no_majority_and_a_leader_that_was_never_heard_are_said() -> None:
    apart = replace(LEADS, leader=4, quorum=False)
    one = heard((beacon(1), 0.0))
    for tick in range(1, 25):
        one.receive_datagram(beacon(1), tick / 10.0)
        one.receive_datagram(beacon(2, lease=apart), tick / 10.0)
    assert kinds(one.picture(1.9)) == [("unheard", (4,)), ("majority", (4,))]  # one may just be taking over
    assert kinds(one.picture(2.4)) == [("leaders", (1, 4)), ("unheard", (4,)), ("majority", (4,))]
    one.receive_datagram(beacon(2), 2.5)
    assert kinds(one.picture(2.6)) == []


def test_orders_pilots_and_landings_that_nobody_ordered_are_said() -> None:
    landing = {"state": FlightState.LANDING}
    assert kinds(heard((beacon(1, abort=True, **landing), 0.0)).picture(0.0)) == [("abort", ())]
    assert kinds(heard((beacon(1, **landing), 0.0)).picture(0.0)) == [("lands", (1,))]
    assert kinds(heard((beacon(1, phase=SwarmPhase.LAND, **landing), 0.0)).picture(0.0)) == []
    assert kinds(heard((beacon(1, state=FlightState.RELEASED), 0.0)).picture(0.0)) == [("pilot", (1,))]


@pytest.mark.parametrize(("score", "grave"), [(0, False), (1, True), (2, None)])
def test_a_low_battery_is_an_alarm_where_the_radio_tells_it(score: int, grave: bool | None) -> None:
    found = alarms(heard((beacon(2, candidate=Candidate(2, 0, score)), 0.0)).picture(0.0))
    assert [alarm.grave for alarm in found if alarm.kind == "battery"] == ([] if grave is None else [grave])


@pytest.mark.parametrize(
    ("ned_m", "kind"),
    [
        ((0.0, 0.0, -8.0), None),
        ((0.0, 68.0, -8.0), "near"),
        ((0.0, 75.0, -8.0), "fence"),
        ((0.0, 0.0, -18.0), "near"),
        ((0.0, 0.0, -25.0), "fence"),
    ],
)
def test_the_missions_fence_is_looked_at(ned_m: tuple[float, float, float], kind: str | None) -> None:
    square = ((-50, -70), (-50, 70), (70, 70), (70, -70))
    mission = short_mission(fence={"polygon_enu_m": square, "altitude_max_m": 20.0})
    assert mission.origin is not None
    here = LocalFrame(mission.origin.wgs84).to_wgs84(ned_m)
    found = kinds(heard((beacon(1, here=here), 0.0)).picture(0.0), mission)
    assert found == ([] if kind is None else [(kind, (1,))])
    assert kinds(heard((beacon(1, here=here, airborne=False), 0.0)).picture(0.0), mission) == []


# --- beacon fields only -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [Vehicle, Told, Picture])
def test_every_field_of_the_picture_is_from_values_of_messages_and_when_they_came(kind: type) -> None:
    rows = [*BEACON.fields, *RELATIVE.fields]
    on_air = {value.path.partition("[")[0] for row in rows for value in row.carried()}
    assert {"here.lat_deg", "here.lon_deg", "here.alt_m"} < on_air
    beside = {"here", "version", "sender", "arrival"}
    names = {field.name for field in fields(kind)} - {"vehicles", "told"}
    sources = kind.SOURCES  # type: ignore[attr-defined]
    assert names == set(sources) - {"vehicles", "told"}
    for name, known in sources.items():
        assert known, name
        assert set(known) <= on_air | beside, name


def test_captured_beacons_of_a_flight_show_what_pymavlink_reads_in_them_and_nothing_else(tmp_path: Path) -> None:
    """The radio of a flight, with its leader killed, as a receiver in the middle of the swarm hears it."""
    captured: list[tuple[float, bytes]] = []

    def listen(flight: Flight) -> None:
        for frames in flight.last.frames.values():
            captured.extend((flight.world.now_s, one) for one in frames)

    faults = [{"kind": "kill", "at_s": 25.0}]
    flown(short_mission(swarm={"size": 3}, sim={"faults": faults}), tmp_path / "run", watch=listen)
    one, last = Heard(), {}
    began_s: dict[tuple[str, tuple[int, ...]], float] = {}
    mav = dialect.MAVLink(None)
    for at_s, data in captured:
        one.receive_datagram(data, at_s)
        for alarm in alarms(one.picture(at_s)):
            began_s.setdefault((alarm.kind, alarm.vehicles), at_s)
        message = mav.decode(bytearray(data))
        last[message.get_srcSystem()] = (message, at_s)
    end_s = captured[-1][0]
    picture = one.picture(end_s)
    assert [vehicle.id for vehicle in picture.vehicles] == sorted(last) == [1, 2, 3]
    lost = 0
    for vehicle in picture.vehicles:
        message, at_s = last[vehicle.id]
        assert vehicle.age_s == end_s - at_s
        lost += vehicle.age_s > 10.0
        assert vehicle.place == (message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)
        assert vehicle.vel_ned_mps == (message.vx, message.vy, message.vz)
        assert (vehicle.leader, vehicle.hop, vehicle.parent) == (message.leader, message.hop, message.parent)
        assert vehicle.range_m == message.range_dm / 10.0
        assert vehicle.airborne == bool(message.flags & AIRBORNE)
        assert vehicle.state == FlightState(message.flight_state).name.lower()
        assert vehicle.phase == SwarmPhase(message.phase & 7).name.lower()
    assert lost == 1
    ((kind, which),) = began_s  # that another leads from then on is no alarm
    assert kind == "link"
    assert which == tuple(k for k, (_, at_s) in last.items() if at_s < 30.0)
    assert began_s[kind, which] == pytest.approx(28.0, abs=0.15)
    told = {key for vehicle in asdict(picture)["vehicles"] for key in vehicle}
    assert told == set(Vehicle.SOURCES)


def record(sender: int, one: Record) -> bytes:
    return frame(RECORD_ID, encode_record(one), sender)


def vector(sender: int, *entries: Entry, epoch: int = 7, is_base: bool = False) -> bytes:
    return frame(VECTOR_ID, encode_vector(Vector(epoch, 0, is_base, False, entries, 5)), sender)


def test_progress_of_records_is_what_vectors_tell_and_the_stand_what_its_leader_does() -> None:
    one = Heard()
    assert one.harvest.text(0) == ""
    one.receive_datagram(vector(2, Entry(LogKey(2, 9), 30, 30, 30, 10, 0), Entry(LogKey(3, 9), 5, 5, 5, 0, 0)), 0.0)
    assert one.harvest.text(0) == "10 of 35 records delivered"
    one.receive_datagram(vector(BASE_ID, Entry(LogKey(2, 9), 20, 20, 25, 20, 0b11), is_base=True), 1.0)
    assert one.harvest.text(0) == "22 of 35 records delivered"
    for number, (vehicle, stems, fused) in enumerate([(2, 38, 30), (3, 12, 20), (2, 7, 10)], start=31):
        body = encode_summary(StandSummary(fused, stems, None, 0.95, None, None))
        one.receive_datagram(record(1, Record(vehicle, 9, number, RecordKind.SUMMARY, 1.0, body)), 2.0)
    assert one.harvest.text(3).endswith(" records delivered; 12 stems")
    assert one.harvest.text(0).endswith("; 38 stems")  # the most records


def test_a_new_base_station_has_nothing_and_another_that_says_it_is_one_counts_for_nothing() -> None:
    one = Heard()
    one.receive_datagram(vector(BASE_ID, Entry(LogKey(2, 9), 20, 20, 20, 20, 0), is_base=True), 0.0)
    one.receive_datagram(vector(4, Entry(LogKey(2, 9), 99, 99, 99, 99, 0), is_base=True), 0.0)
    assert one.harvest.text(0) == "20 of 20 records delivered"
    one.receive_datagram(vector(BASE_ID, Entry(LogKey(2, 9), 3, 3, 3, 3, 0), epoch=8, is_base=True), 1.0)
    assert one.harvest.text(0) == "3 of 20 records delivered"
