"""A signed autopilot link, words about the links, and figures of the stand: replayed of the log alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from companion.core.model.actions import Say
from companion.core.model.states import Severity
from companion.journal.channels import Channel
from companion.journal.reading import Flight, find_flights
from companion.journal.recorder import Recorder, files_of
from companion.journal.replay import replay_flight
from companion.journal.segments import DirectWriter
from companion.mavlink.harvest import StandUpdate
from companion.records.record import RecordKind
from tests.unit.journal.journal_kit import START, Messages, fly_ticks, forge, recorder_of, sealed_anew
from tests.unit.mavlink.endpoint_kit import HOME, TICK_S, heartbeat, position
from tests.unit.mavlink.signing_kit import Node, guard
from tests.unit.mavlink.test_autopilot_link import KEY, NOW, OTHER, frame, link_end, signed
from tests.unit.mavlink.test_endpoint_records import Noted


def writer_in(folder: Path) -> DirectWriter:
    return DirectWriter(files_of(folder, START, waits_for_disk=False))


def the_flight(folder: Path) -> Flight:
    (flight,) = find_flights(folder)
    return flight


def signed_link(folder: Path, *, by_vehicle: bool) -> Recorder:
    """Both links signed, on each some of whom has no key. `by_vehicle`: the radio's datagrams are taken in between."""
    recorder, endpoint = recorder_of(writer_in(folder), guard=guard(3), gate=link_end())
    assert recorder.hello()
    nodes: Sequence[Node] = [Node(1), Node(2)]
    for k in range(40):
        now_s = 100.0 + k * TICK_S
        messages = [HOME, heartbeat()] if k % 20 == 0 else []
        genuine = [signed(m, NOW + 10 * k + j) for j, m in enumerate((*messages, position(1.0, boot_ms=1000 + 50 * k)))]
        data = b"".join([signed(heartbeat(1), NOW + 9, key=OTHER), *genuine, frame(position(900.0))])
        peers = [b"".join(node.send(now_s)) for node in nodes] if k % 2 == 0 else []
        read = recorder.read_autopilot(data) if by_vehicle else []
        for datagram in peers:
            recorder.from_peers(datagram, now_s)
        if by_vehicle:
            recorder.autopilot_says(read, now_s)
        else:
            recorder.from_autopilot(data, now_s)
        recorder.tick(now_s)
    assert endpoint.autopilot_gate.refused == 80
    assert endpoint.codec.make is not None
    recorder.close("ended")
    return recorder


def test_a_signed_autopilot_link_is_replayed_without_its_key(tmp_path: Path) -> None:
    for by_vehicle in (True, False):
        folder = tmp_path / str(by_vehicle)
        signed_link(folder, by_vehicle=by_vehicle)
        replayed = replay_flight(the_flight(folder))
        assert (replayed.difference, replayed.same, replayed.is_same) == ([], 40, True)
        data = the_flight(folder).segments[1].read_bytes()
        assert KEY not in data
        assert KEY.hex().encode() not in data


def test_another_verdict_of_the_link_than_then_is_a_difference(tmp_path: Path) -> None:
    signed_link(tmp_path, by_vehicle=False)
    flight = the_flight(tmp_path)

    def refuse(messages: Messages) -> Messages:
        """The position of the first tick, behind a forged heartbeat, HOME and a genuine one."""
        first = next(k for k, m in enumerate(messages) if m.channel_id == Channel.VERDICTS)
        m = messages[first]
        at = m.data.index(b"\0\1\1\1\0")
        changed = replace(m, data=m.data[: at + 3] + b"\0" + m.data[at + 4 :])
        return sealed_anew([*messages[:first], changed, *messages[first + 1 :]])

    assert replay_flight(flight).is_same
    forge(flight.segments[1], refuse)
    assert replay_flight(flight).difference


def test_a_word_about_the_links_is_said_again(tmp_path: Path) -> None:
    recorder, _ = recorder_of(writer_in(tmp_path))
    fly_ticks(recorder, 10)
    recorder.report_surroundings(Say(Severity.WARNING, "peers' link flooded: 4120 lost unread"))
    fly_ticks(recorder, 10, first=10)
    recorder.close("ended")
    said: list[tuple[int, str]] = []
    flight = the_flight(tmp_path)
    replayed = replay_flight(
        flight, show=lambda body, _since_s: said.extend((body["tick"], s["text"]) for s in body["said"])
    )
    assert (replayed.difference, replayed.is_same) == ([], True)
    assert (11, "peers' link flooded: 4120 lost unread") in said
    forge(flight.segments[1], lambda all_: sealed_anew([m for m in all_ if m.channel_id != Channel.SURROUNDINGS_IN]))
    assert replay_flight(flight).difference


def test_figures_of_the_stand_are_answered_for_by_the_log(tmp_path: Path) -> None:
    noted = Noted()
    recorder, _ = recorder_of(writer_in(tmp_path), records=noted)
    for k in range(20):
        if k == 7:
            noted.stand = StandUpdate(int(RecordKind.STEM), b"figures", 12.5, "42 stems")
        fly_ticks(recorder, 1, first=k)
    recorder.close("ended")
    said: list[str] = []
    replayed = replay_flight(
        the_flight(tmp_path), show=lambda body, _since_s: said.extend(s["text"] for s in body["said"])
    )
    assert (replayed.difference, replayed.is_same) == ([], True)
    assert "stand: 42 stems" in said
