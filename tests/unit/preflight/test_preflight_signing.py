"""The row `signing`: an autopilot that refuses who has no key passes, and each that does not is told by name."""

from __future__ import annotations

import argparse
import json
import socket
from collections import deque
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import pytest

from companion.mavlink import dialect as mav
from companion.mavlink.autopilot_link.signing import LinkSigning, timestamp_at
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import SIGNED, whole
from companion.preflight import command, signing
from companion.preflight.report import Verdict
from companion.preflight.signing import FrameStream, SigningProbe, SigningRelay
from companion.preflight.survey import Parameter, Survey
from companion.shell.urls import Scheme, Url
from mission.document.load import load_mission
from sim_bridge.world.autopilot import Link as Side
from tests.unit.world.autopilot.ardupilot.ardupilot_kit import Flight as Copter
from tests.unit.world.autopilot.autopilot_kit import STEP_S
from tests.unit.world.autopilot.px4.px4_kit import Flight as Px4

ME = 1
HAPPEN_LIMIT_S = 60.0  # on a busy machine
MISSION = """
schema = 1
[origin]
lat_deg = 47.0
lon_deg = 8.0
alt_m = 400.0
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [60.0, 0.0, 8.0]
vel_leader_mps = 2.0
[swarm]
size = 3
"""
KEY = sha256(b"of this vehicle").digest()
OTHER = sha256(b"of another").digest()
NOW = timestamp_at(1_800_000_000.0)


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    """The autopilot here answers at once, and lives a step each time that it is asked for what it sends."""
    for name, seconds in {"LISTEN_S": 0.1, "ANSWER_S": 0.05, "ASK_S": 0.01, "HELLO_S": 0.01, "SETTLE_S": 0.05}.items():
        monkeypatch.setattr(signing, name, seconds)


def same(data: bytes) -> bytes:
    return data


class Wired:
    """A link to a simulated autopilot, with a way to change what goes in and what comes out."""

    up = True

    def __init__(self, flight: Px4 | Copter, into: Callable[[bytes], bytes] = same) -> None:
        self.flight = flight
        self.into = into
        self.sent: list[bytes] = []
        self._out: deque[bytes] = deque()

    def fileno(self) -> int:
        return -1

    def recv(self) -> bytes | None:
        if self._out:
            return self._out.popleft()
        autopilot = self.flight.autopilot
        autopilot.update(self.flight.now_s)
        self.flight.steps += round(0.5 / STEP_S)
        self._out += autopilot.transmit(Side.ONBOARD, self.flight.now_s)
        return None

    def send(self, data: bytes) -> None:
        self.sent.append(data)
        changed = self.into(data)
        if changed:
            self.flight.autopilot.receive(Side.ONBOARD, changed, self.flight.now_s)

    def close(self) -> None:
        pass


def probe(link: Wired, key: bytes = KEY, timestamp: int = NOW) -> SigningProbe:
    return SigningProbe(link, LinkSigning(key, timestamp=timestamp), ME, is_stream=False)


def with_key(flight: Px4 | Copter, key: bytes = KEY, timestamp: int = NOW) -> Px4 | Copter:
    flight.send(mav.MAVLink_setup_signing_message(ME, 1, list(key), timestamp))
    return flight


@pytest.fixture(params=[Px4, Copter])
def flight(request: pytest.FixtureRequest) -> Px4 | Copter:
    made: Px4 | Copter = request.param()
    made.run(1.0)
    return made


def test_autopilot_with_the_key_passes(flight: Px4 | Copter) -> None:
    link = Wired(with_key(flight))
    row = probe(link).check()
    assert (row.name, row.verdict) == ("signing", Verdict.PASS), row
    assert "are refused, signed ones answered" in row.found


def test_autopilot_whose_clock_is_behind_takes_the_time_over_and_passes(flight: Px4 | Copter) -> None:
    row = probe(Wired(with_key(flight, timestamp=NOW - 10**10))).check()
    assert row.verdict is Verdict.PASS, row


def test_autopilot_without_a_key_fails(flight: Px4 | Copter) -> None:
    row = probe(Wired(flight)).check()
    assert (row.verdict, row.fix) == (Verdict.FAIL, signing.GIVE_FIX)
    assert "not at all" in row.found


def test_autopilot_with_another_key_fails(flight: Px4 | Copter) -> None:
    row = probe(Wired(with_key(flight, OTHER))).check()
    assert (row.verdict, row.fix) == (Verdict.FAIL, signing.GIVE_FIX)
    assert "0 frames signed" in row.found


def test_nobody_there_fails(flight: Px4 | Copter) -> None:
    link = Wired(flight)
    link.recv = lambda: None  # type: ignore[method-assign]
    assert probe(link).check().found == "nothing is heard"


def taking_all() -> Callable[[bytes], bytes]:
    """As one takes it that looks at no signature: whatever comes counts as if it had the key."""
    key = LinkSigning(KEY, timestamp=NOW)

    def resign(data: bytes) -> bytes:
        frames = [data[start:end] for start, end, _ in whole(data)]
        bare = [wire.pack(wire.decode(frame), seq=0, system=frame[5], component=frame[6]) for frame in frames]
        return b"".join([key.seal(frame, 0.0) for frame in bare])

    return resign


def test_autopilot_that_signs_and_takes_everything_is_found(flight: Px4 | Copter) -> None:
    row = probe(Wired(with_key(flight), taking_all())).check()
    assert (row.verdict, row.fix) == (Verdict.FAIL, signing.TAKES_ALL_FIX)
    assert "it answers UNSIGNED requests" in row.found


def test_autopilot_that_takes_any_signature_is_found(flight: Px4 | Copter) -> None:
    resign = taking_all()
    row = probe(Wired(with_key(flight), lambda data: resign(data) if data[2] & SIGNED else b"")).check()
    assert (row.verdict, row.fix) == (Verdict.FAIL, signing.TAKES_ALL_FIX)
    assert "it answers requests signed by ANOTHER key" in row.found


def test_autopilot_that_refuses_even_the_key_is_found(flight: Px4 | Copter) -> None:
    row = probe(Wired(with_key(flight), lambda _data: b"")).check()
    assert (row.verdict, row.fix) == (Verdict.FAIL, signing.GIVE_FIX)
    assert "does not answer signed requests" in row.found


def test_second_autopilot_on_the_link_is_found(flight: Px4 | Copter) -> None:
    link = Wired(with_key(flight))
    genuine = link.recv
    beat = wire.pack(mav.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3), seq=0, system=ME, component=1)

    def recv() -> bytes | None:
        data = genuine()
        return None if data is None else data + beat

    link.recv = recv  # type: ignore[method-assign]
    row = probe(link).check()
    assert row.verdict is Verdict.FAIL
    assert "two keys, or two autopilots" in row.found


def test_autopilot_that_signs_is_told_to_who_looks_without_a_key(flight: Px4 | Copter) -> None:
    row = probe(Wired(with_key(flight)), OTHER).find_signatures()
    assert row is not None
    assert (row.name, row.verdict, row.fix) == ("signing", Verdict.FAIL, signing.NO_KEY_FIX)
    assert "answered nothing that was not" in row.found


def test_autopilot_that_does_not_sign_has_no_such_row(flight: Px4 | Copter) -> None:
    assert probe(Wired(flight), OTHER).find_signatures() is None


def test_key_is_given_and_then_passes(flight: Px4 | Copter) -> None:
    link = Wired(flight)
    one = probe(link)
    assert one.give_key(KEY)
    assert one.check().verdict is Verdict.PASS
    assert not probe(link, timestamp=NOW + 10**7).give_key(KEY)  # it has it
    assert probe(link, OTHER, NOW + 10**7).give_key(OTHER)  # which it refuses
    assert probe(link, OTHER, NOW + 10**7).check().verdict is Verdict.FAIL
    assert probe(link, timestamp=NOW + 2 * 10**7).check().verdict is Verdict.PASS


def test_armed_autopilot_is_given_no_key() -> None:
    flight = Px4().airborne()
    link = Wired(flight)
    assert not probe(link).give_key(KEY)
    assert not [data for data in link.sent if bytes(KEY) in data]


def test_frames_of_a_stream_are_put_together() -> None:
    gate = LinkSigning(KEY, timestamp=NOW)
    beat = wire.pack(mav.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3), seq=0, system=ME, component=1)
    sent = [gate.seal(beat, 0.0) for _ in range(5)]
    data = b"".join(sent)
    stream = FrameStream(is_stream=True)
    assert [frame for at in range(0, len(data), 7) for frame in stream.split_frames(data[at : at + 7])] == sent
    datagrams = FrameStream(is_stream=False)
    assert datagrams.split_frames(data[:-1]) == sent[:-1]
    assert datagrams.split_frames(b"noise" + sent[0]) == sent[:1]


class Far:
    """The other end of a link that is a pair of sockets."""

    up = True

    def __init__(self) -> None:
        self._near, self.socket = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._near.setblocking(False)
        self.socket.settimeout(HAPPEN_LIMIT_S)

    def fileno(self) -> int:
        return self._near.fileno()

    def recv(self) -> bytes | None:
        try:
            return self._near.recv(65536)
        except BlockingIOError:
            return None

    def send(self, data: bytes) -> None:
        self._near.send(data)

    def close(self) -> None:
        self._near.close()
        self.socket.close()


def test_relay_signs_for_a_program_and_hands_it_what_is_signed() -> None:
    autopilot, far = LinkSigning(KEY, timestamp=NOW), Far()
    beat = wire.pack(mav.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3), seq=0, system=ME, component=1)
    program = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    program.settimeout(HAPPEN_LIMIT_S)
    with SigningRelay(far, LinkSigning(KEY, timestamp=NOW), is_stream=False) as relay:
        program.connect((relay.url.place, relay.url.number))
        program.send(beat)
        assert autopilot.admits(far.socket.recv(65536))
        genuine = autopilot.seal(beat, 0.0)
        far.socket.send(beat)
        far.socket.send(LinkSigning(OTHER, timestamp=NOW + 100).seal(beat, 0.0))
        far.socket.send(genuine)
        assert program.recv(65536) == genuine
    program.close()
    far.close()


def looked(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, flight: Px4 | Copter, *, tells: bool, signs: bool = False
) -> list[tuple[str, Verdict]]:
    """Rows of a preflight, up to those of the autopilot, whose surveyor was told its parameters, or none."""
    value = 0.5 if tells else None
    survey = Survey(heard=(ME,), parameters={name: Parameter(name=name, value=value) for name in ("ONE", "TWO")})
    monkeypatch.setattr(command, "take_survey", lambda *_args, **_options: survey)
    monkeypatch.setattr(command, "open_link", lambda _url: Wired(flight))
    monkeypatch.setattr(command, "_signed", lambda arguments, _opened: ((), arguments.autopilot))
    mission, report = tmp_path / "mission.toml", tmp_path / "report.json"
    mission.write_text(MISSION)
    asked = {"mission": str(mission), "id": ME, "autopilot": Url(Scheme.UDP_OUT, "127.0.0.1", 9), "sensors": {}}
    asked |= {"apply": False, "report": str(report), "json": True, "key": None, "sign_autopilot": signs}
    assert command.preflight(argparse.Namespace(**asked), load_mission(str(mission))) == command.EXIT_FAIL
    rows = json.loads(report.read_text())["checks"]
    return [(row["name"], Verdict(row["verdict"])) for row in rows][:2]


def test_preflight_without_a_key_says_why_nothing_is_answered(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, flight: Px4 | Copter
) -> None:
    says = [("mission", Verdict.PASS), ("signing", Verdict.FAIL)]
    silent = [("mission", Verdict.PASS), ("id", Verdict.PASS)]
    assert looked(monkeypatch, tmp_path, flight, tells=False) == silent  # it does not sign
    with_key(flight)
    assert looked(monkeypatch, tmp_path, flight, tells=False) == says
    assert looked(monkeypatch, tmp_path, flight, tells=True) == silent  # it signs, and takes all
    assert looked(monkeypatch, tmp_path, flight, tells=False, signs=True) == silent  # the row is another's
