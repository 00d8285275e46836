"""`sim-bridge serve`: the radio, and which program may speak as which vehicle on it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from companion.mavlink import dialect as mav
from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.mavlink.orders.order import OrderKind
from companion.mavlink.peers.session import OPERATOR_ID
from companion.records.frames import RECORD_ID, VECTOR_ID, encode_record, encode_vector
from companion.records.record import BASE_ID, Record, RecordKind, Vector
from mission.document.model import Mission
from sim_bridge.drive.links.hub import COMPANION_ALIVE_S, OPERATORS_MAX, RadioGate
from sim_bridge.drive.serve.server import Ports, Server
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import PROFILES
from sim_bridge.world.world import World
from tests.unit.drive.serve.server_kit import HERE, THERE, Peer, beacon, frame, heartbeat, ignore, turn
from tests.unit.mavlink import orders_kit


class TestRadio:
    def test_beacons_reach_the_others_as_one_datagram_of_unmodified_frames(
        self, served: Server, join: Callable[[str], Peer]
    ) -> None:
        one, two, three = (join("radio") for _ in range(3))
        for peer, vehicle_id in ((one, 1), (two, 2), (three, 3)):
            peer.send(heartbeat(vehicle_id))
        turn(served)
        assert one.datagrams() == two.datagrams() == three.datagrams() == []
        one.send(beacon(1, 7))
        three.send(beacon(3, 8))
        turn(served)
        (arrived,) = two.datagrams()
        assert sorted([beacon(1, 7), beacon(3, 8)]) == sorted(
            [arrived[: len(beacon(1, 7))], arrived[len(beacon(1, 7)) :]]
        )
        assert one.datagrams() == [beacon(3, 8)]

    def test_vehicles_out_of_range_hear_nothing(
        self, mission: Mission, ports: Ports, join: Callable[[str], Peer]
    ) -> None:
        apart = iter([(0.0, 0.0, 0.0), (100.0, 0.0, 0.0), (10.0, 0.0, 0.0)])
        world = World(mission, lambda _frame, _place, _seed: PointMass(next(apart), 0.0), links=PROFILES)
        made = Server(world, ports, say=ignore)
        near, far = join("radio"), join("radio")
        near.send(heartbeat(3))
        far.send(heartbeat(2))
        sender = join("radio")
        sender.send(beacon(1))
        turn(made)
        assert (near.datagrams(), far.datagrams()) == ([beacon(1)], [])
        made.close()

    def test_the_operator_walks_with_the_swarm_and_orders_go_to_who_is_near(
        self, mission: Mission, ports: Ports, join: Callable[[str], Peer]
    ) -> None:
        apart = iter([(0.0, 0.0, 0.0), (100.0, 0.0, 0.0), (110.0, 0.0, 0.0)])
        world = World(mission, lambda _frame, _place, _seed: PointMass(next(apart), 0.0), links=PROFILES)
        made = Server(world, ports, say=ignore)
        vehicles = [join("radio") for _ in range(3)]
        for vehicle, peer in enumerate(vehicles, 1):
            peer.send(beacon(vehicle))
        operator = join("radio")
        turn(made)
        for peer in vehicles:
            peer.datagrams()
        order = orders_kit.frame(orders_kit.order(OrderKind.ABORT, 5), OPERATOR_ID)
        operator.send(order)
        turn(made)
        assert [peer.datagrams() for peer in vehicles] == [[], [order], [order]]
        made.close()

    def test_a_terminal_beside_the_page_is_heard_and_hears(self, served: Server, join: Callable[[str], Peer]) -> None:
        vehicle, page, terminal = (join("radio") for _ in range(3))
        vehicle.send(heartbeat(1))
        page.send(orders_kit.frame(orders_kit.order(OrderKind.HOLD, 5), OPERATOR_ID))
        turn(served)
        vehicle.datagrams()
        order = orders_kit.frame(orders_kit.order(OrderKind.ABORT, 6), OPERATOR_ID)
        terminal.send(order)
        turn(served)
        assert (vehicle.datagrams(), page.datagrams(), terminal.datagrams()) == ([order], [order], [])
        vehicle.send(beacon(1, 7))
        turn(served)
        assert page.datagrams() == terminal.datagrams() == [beacon(1, 7)]

    def test_beacons_from_before_a_companion_spoke_are_lost(self, served: Server, join: Callable[[str], Peer]) -> None:
        one, two = join("radio"), join("radio")
        one.send(beacon(1, 1))
        turn(served)
        two.send(heartbeat(2))
        turn(served)
        assert two.datagrams() == []


class TestRecords:
    def test_records_reach_the_others_behind_beacons(self, served: Server, join: Callable[[str], Peer]) -> None:
        one, two = join("radio"), join("radio")
        two.send(heartbeat(2))
        one.send(beacon(1) + record(1))
        turn(served)
        assert two.datagrams() == [beacon(1) + record(1)]

    def test_of_a_mission_that_surveys_the_base_station_speaks_too(
        self, mission: Mission, ports: Ports, join: Callable[[str], Peer]
    ) -> None:
        surveys = Mission.model_validate(
            {**mission.model_dump(by_alias=True), "sensing": {"sensor": "scan-1deg"}, "survey": {}}
        )
        made = Server(World(surveys, lambda _f, place, _s: PointMass(place, 0.0), links=PROFILES), ports, say=ignore)
        one, base = join("radio"), join("radio")
        one.send(heartbeat(1))
        base.send(vector(BASE_ID))
        turn(made)
        assert one.datagrams() == [vector(BASE_ID)]
        one.send(record(1))
        turn(made)
        assert base.datagrams() == [record(1)]
        made.close()

    def test_elsewhere_nobody_speaks_as_the_base_station(self, served: Server, join: Callable[[str], Peer]) -> None:
        one, base = join("radio"), join("radio")
        one.send(heartbeat(1))
        base.send(vector(BASE_ID))
        turn(served)
        assert one.datagrams() == []
        assert served.hub.gate.refused == 1


def record(sender: int) -> bytes:
    payload = encode_record(Record(1, 5, 1, RecordKind.STEM, 0.0, b"a stem"))
    return wire.frame(RECORD_ID, payload, seq=0, system=sender, component=COMPONENT)


def vector(sender: int) -> bytes:
    return wire.frame(
        VECTOR_ID, encode_vector(Vector(1, 0, True, False, ())), seq=0, system=sender, component=COMPONENT
    )


class TestRadioGate:
    @pytest.fixture
    def gate(self) -> RadioGate:
        return RadioGate((1, 2), ignore)

    def test_an_address_speaks_for_whom_it_first_spoke(self, gate: RadioGate) -> None:
        assert gate.admit_datagram(heartbeat(1), HERE, 0.0) == (1, b"")
        assert gate.addresses_of(1) == (HERE,)
        assert gate.admit_datagram(beacon(1), HERE, 0.1) == (1, beacon(1))
        assert gate.admit_datagram(beacon(2), HERE, 0.1) == (0, b"")
        assert (gate.refused, gate.addresses_of(2)) == (1, ())

    def test_own_frames_pass_beside_foreign_ones(self, gate: RadioGate) -> None:
        assert gate.admit_datagram(beacon(1, 5) + beacon(2) + beacon(1, 6), HERE, 0.0) == (
            1,
            beacon(1, 5) + beacon(1, 6),
        )
        assert gate.refused == 1

    def test_nobody_takes_over_a_vehicle_while_its_companion_lives(self, gate: RadioGate) -> None:
        gate.admit_datagram(beacon(1), HERE, 0.0)
        assert gate.admit_datagram(beacon(1), THERE, COMPANION_ALIVE_S) == (0, b"")
        assert (gate.refused, gate.addresses_of(1)) == (1, (HERE,))

    def test_a_companion_started_again_takes_over_from_the_dead_one(self, gate: RadioGate) -> None:
        gate.admit_datagram(beacon(1), HERE, 0.0)
        later_s = COMPANION_ALIVE_S + 0.1
        assert gate.admit_datagram(beacon(1), THERE, later_s) == (1, beacon(1))
        assert gate.addresses_of(1) == (THERE,)
        assert gate.admit_datagram(beacon(1), HERE, later_s) == (0, b"")

    def test_a_port_used_again_may_speak_for_another(self, gate: RadioGate) -> None:
        gate.admit_datagram(beacon(1), HERE, 0.0)
        later_s = COMPANION_ALIVE_S + 0.1
        assert gate.admit_datagram(beacon(2), HERE, later_s) == (2, beacon(2))
        assert (gate.addresses_of(1), gate.addresses_of(2)) == ((), (HERE,))

    def test_so_many_of_the_operators_programs_speak_at_a_time(self) -> None:
        gate = RadioGate((1, OPERATOR_ID), ignore)
        programs = [("127.0.0.1", 41000 + each) for each in range(OPERATORS_MAX + 1)]
        words = [gate.admit_datagram(heartbeat(OPERATOR_ID), at, each * 0.01)[0] for each, at in enumerate(programs)]
        assert words == [OPERATOR_ID] * OPERATORS_MAX + [0]
        later_s = COMPANION_ALIVE_S + 0.001
        assert gate.admit_datagram(heartbeat(OPERATOR_ID), programs[-1], later_s)[0] == OPERATOR_ID
        assert gate.addresses_of(OPERATOR_ID) == tuple(programs[1:])

    @pytest.mark.parametrize(
        "data",
        [
            heartbeat(1, component=1),
            heartbeat(3),
            frame(mav.MAVLink_statustext_message(6, b"hello"), 1),
            beacon(1)[:-1],
            beacon(1)[:-1] + bytes([beacon(1)[-1] ^ 1]),
            b"",
            b"\xfd" * 50,
        ],
    )
    def test_only_valid_words_of_a_companion_bind(self, gate: RadioGate, data: bytes) -> None:
        assert gate.admit_datagram(data, HERE, 0.0) == (0, b"")
        assert gate.addresses_of(1) == ()

    def test_an_impostor_is_reported_once(self) -> None:
        said: list[str] = []
        gate = RadioGate((1, 2), said.append)
        gate.admit_datagram(beacon(1), HERE, 0.0)
        for _ in range(5):
            gate.admit_datagram(beacon(1), THERE, 0.1)
        assert said == [
            "radio: 127.0.0.1:40002 speaks as vehicle 1, which 127.0.0.1:40001 already does: "
            "refused for as long as the other lives, and 0.5 s more"
        ]
