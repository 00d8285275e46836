"""An endpoint and its records: what it hands on, what it sends behind its beacons, what it says."""

from __future__ import annotations

from companion.core.model.actions import Say
from companion.core.model.states import Severity, SwarmPhase
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing import wire
from companion.mavlink.harvest import StandUpdate
from companion.records.frames import RECORD_ID, encode_record, is_record_frame, read_record
from companion.records.record import Record, RecordKind
from tests.unit.core.core_kit import mission
from tests.unit.mavlink.endpoint_kit import COMPANION, HOME, ME, TICK_S, heartbeat, packed, position
from tests.unit.mavlink.test_endpoint_peers import beacon_of

PAYLOAD = encode_record(Record(5, 1, 1, RecordKind.STEM, 0.0, b"a stem"))
FRAME = wire.frame(RECORD_ID, PAYLOAD, seq=0, system=5, component=COMPANION)


class Noted:
    """A `RecordLink` that notes what it is handed."""

    def __init__(self) -> None:
        self.appended: list[tuple[int, bytes, float]] = []
        self.received: list[bytes] = []
        self.times_s: set[float] = set()
        self.beacon_bytes: list[int] = []
        self.to_say: list[str] = []
        self.stand: StandUpdate | None = None
        self.led: set[bool] = set()

    def append(self, kind: int, body: bytes, now_s: float) -> None:
        self.appended.append((kind, body, now_s))

    def is_record(self, frame: bytes) -> bool:
        return is_record_frame(frame)

    def receive(self, frame: bytes, now_s: float) -> bool:
        if read_record(frame) is None:
            return False
        self.received.append(frame)
        self.times_s.add(now_s)
        return True

    def frames(self, now_s: float, beacon_bytes: int) -> list[tuple[int, bytes]]:
        self.times_s.add(now_s)
        self.beacon_bytes.append(beacon_bytes)
        return [(RECORD_ID, PAYLOAD)]

    def take_stand(self, *, leads: bool, now_s: float) -> StandUpdate | None:
        self.times_s.add(now_s)
        self.led.add(leads)
        stand, self.stand = self.stand, None
        return stand

    def counters(self) -> dict[str, int]:
        return {}

    def lines(self) -> list[str]:
        said, self.to_say = self.to_say, []
        return said


def recording() -> tuple[Endpoint, Noted]:
    noted = Noted()
    one = Endpoint(mission(), ME, records=noted)
    one.from_autopilot(packed(HOME, position(), heartbeat()), 10.0)
    return one, noted


def test_records_of_the_peers_link_are_handed_on_beside_beacons() -> None:
    one, noted = recording()
    one.from_peers(beacon_of(5) + FRAME + FRAME + beacon_of(6), 10.0)
    assert noted.received == [FRAME, FRAME]
    assert (noted.times_s, noted.appended) == ({10.0}, [])
    assert {peer.id for peer in one.agent.localiser.peers.neighbours((1.0, 0.0, -8.0), 10.0)} == {5, 6}


def test_a_datagram_of_records_alone_is_no_bad_one() -> None:
    one, _ = recording()
    one.from_peers(FRAME, 10.0)
    assert one.peers.without_beacon == 0
    one.from_peers(FRAME[:-1] + b"?", 10.0)  # its checksum is wrong
    assert one.peers.without_beacon == 1


def test_a_companion_without_records_passes_them_over() -> None:
    one = Endpoint(mission(), ME)
    one.from_peers(FRAME + beacon_of(5), 10.0)
    assert one.peers.without_beacon == 0
    assert one.tick(10.0).records == []


def test_records_go_out_after_the_beacon_each_in_a_datagram_of_its_own() -> None:
    one, noted = recording()
    sent = [one.tick(10.0 + k * TICK_S) for k in range(4)]
    assert [len(out.peers) for out in sent] == noted.beacon_bytes
    assert max(noted.beacon_bytes) > 0
    assert all(read_record(out.records[0]) is not None and len(out.records) == 1 for out in sent)


def test_frames_of_one_link_are_numbered_through() -> None:
    one, _ = recording()
    numbers: list[int] = []
    for k in range(8):
        out = one.tick(10.0 + k * TICK_S)
        numbers += [data[4] for data in (out.peers, *out.records) if data]
    assert numbers == list(range(len(numbers)))


def test_what_the_records_have_to_say_is_said_with_the_next_tick_once() -> None:
    one, noted = recording()
    noted.to_say = ["records: the disk takes them again"]
    said = [one.tick(10.0 + k * TICK_S).said for k in range(4)]
    wanted = Say(Severity.WARNING, "records: the disk takes them again")
    assert [wanted in texts for texts in said] == [False, True, False, False]


def test_figures_of_the_stand_reach_the_agent_and_the_operator() -> None:
    flown = mission(
        sensing={"sensor": "scan-1deg"},
        survey={"until": {"basal_area_pct": 10.0, "after_s": 5.0}},
        route={"at_end": "land"},
    )
    noted = Noted()
    one = Endpoint(flown, ME, records=noted)
    one.from_autopilot(packed(HOME, position(), heartbeat()), 10.0)
    noted.stand = StandUpdate(4, b"", 8.0, "38 stems; 23 +/- 2 m2/ha")
    said = one.tick(10.0).said + one.tick(10.0 + TICK_S).said
    assert Say(Severity.INFO, "stand: 38 stems; 23 +/- 2 m2/ha") in said
    assert noted.led == {False}
    phases = one.agent.swarm.phases
    phases.adopt_phase(SwarmPhase.COVERAGE, 20.0)
    assert not phases.decide_phase(0, to_goal_m=0.0, started=True, now_s=24.9)
    assert phases.decide_phase(0, to_goal_m=0.0, started=True, now_s=25.1)
