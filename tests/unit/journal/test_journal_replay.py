"""A recorded flight, run again of its log alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from companion.core.agent import Agent
from companion.journal.channels import ARRIVED, Channel
from companion.journal.reading import find_flights
from companion.journal.recorder import Recorder, files_of
from companion.journal.replay import replay_flight
from companion.journal.segments import DirectWriter
from companion.journal.tape.played import PlayedLink
from companion.journal.tape.tape import PlayedTape, TapeError
from companion.mavlink import dialect
from companion.mavlink.framing.frames import whole
from companion.records.record import RecordKind
from tests.unit.core.core_kit import lease
from tests.unit.journal.journal_kit import START, Messages, fly_ticks, forge, recorded, recorder_of, sealed_anew
from tests.unit.mavlink.endpoint_kit import HOME, TICK_S, command, heartbeat, packed, position
from tests.unit.mavlink.signing_kit import Node, guard, keyring
from tests.unit.mavlink.test_endpoint_peers import beacon_of, signed
from tests.unit.mavlink.test_endpoint_records import FRAME, Noted


def test_every_tick_is_the_same_to_the_bit(tmp_path: Path) -> None:
    replayed = replay_flight(recorded(tmp_path, 60))
    assert (replayed.same, replayed.summary.ticks, replayed.is_same) == (60, 60, True)
    assert replayed.ends == "ended at 2.950 s"
    assert replayed.summary.beacons[5]["KEPT"] == 29  # not the first: its position was not known yet
    assert replayed.summary.beacons[6]["VERSION"] == 1


def test_recorded_and_unrecorded_endpoints_put_out_the_same(tmp_path: Path) -> None:
    disk = DirectWriter(files_of(tmp_path, START, waits_for_disk=False))
    recorder, one = recorder_of(disk)
    _, plain = recorder_of(disk)
    for k in range(40):
        fly_ticks(recorder, 1, first=k)
        fly_ticks(plain, 1, first=k)
    recorder.from_peers(beacon_of(5, abort=True), 12.0)
    plain.from_peers(beacon_of(5, abort=True), 12.0)
    assert recorder.tick(12.0) == plain.tick(12.0)
    assert one.agent.status(12.0) == plain.agent.status(12.0)


def test_events_of_one_tick_are_replayed_in_their_order(tmp_path: Path) -> None:
    """A beacon before the first position is not placed, one behind it is."""
    recorder, _ = recorder_of(DirectWriter(files_of(tmp_path, START, waits_for_disk=False)))
    fly_ticks(recorder, 20)
    recorder.close("ended")

    def swap(messages: Messages) -> Messages:
        at = next(k for k, m in enumerate(messages) if m.channel_id == Channel.PEERS_IN)
        assert messages[at + 1].channel_id == Channel.AUTOPILOT_IN
        moved = [*messages[:at], messages[at + 1], messages[at], *messages[at + 2 :]]
        return sealed_anew([replace(m, sequence=k + 1) for k, m in enumerate(moved)])

    (flight,) = find_flights(tmp_path)
    assert replay_flight(flight).is_same
    forge(flight.segments[1], swap)
    replayed = replay_flight(flight)
    assert not replayed.breaks
    assert replayed.difference


def test_a_difference_names_tick_time_link_and_message(tmp_path: Path) -> None:
    flight = recorded(tmp_path)

    def change(messages: Messages) -> Messages:
        """Vehicle's telemetry of tick 31: it was elsewhere than was recorded."""
        ticks, changed = 0, []
        for m in messages:
            ticks += m.channel_id == Channel.TICK
            if ticks == 30 and m.channel_id == Channel.PEERS_OUT:
                frame = m.data[ARRIVED.size :]
                m = replace(m, data=m.data[: ARRIVED.size] + frame[:4] + bytes([frame[4] ^ 1]) + frame[5:])
            changed.append(m)
        return sealed_anew(changed)

    forge(flight.segments[1], change)
    replayed = replay_flight(flight)
    assert not replayed.breaks
    assert replayed.same == 30
    assert replayed.difference[0] == "tick 31, 1.500 s, output 1:"
    assert replayed.difference[1] == "  to peers, message 1:"
    assert replayed.difference[2].startswith("  then fd")  # its checksum does not hold any more
    assert replayed.difference[3].startswith("  now  SWARM_BEACON (seq ")
    assert not replayed.is_same
    assert replay_flight(flight, to_s=1.45).is_same


def test_compared_are_the_ticks_between_two_times(tmp_path: Path) -> None:
    flight = recorded(tmp_path)
    shown: list[int] = []
    replayed = replay_flight(flight, from_s=0.5, to_s=1.0, show=lambda body, _since_s: shown.append(body["tick"]))
    assert shown == list(range(11, 22))
    assert (replayed.same, replayed.summary.ticks, replayed.is_same) == (11, 11, True)


def signed_flight(folder: Path, *, strangers: bool = False) -> Recorder:
    """Vehicle 3 with its keys, and two others that meet it; what others send, with keys of another swarm."""
    recorder, endpoint = recorder_of(DirectWriter(files_of(folder, START, waits_for_disk=False)), guard=guard(3))
    nodes = [Node(1), Node(2)]
    odd = [Node(4, ring=keyring(4, secret=b"o" * 32))] if strangers else []
    sent: bytes = b""
    for k in range(60):
        now_s = 100.0 + k * TICK_S
        if k % 20 == 0:
            recorder.from_autopilot(packed(HOME, heartbeat()), now_s)
        recorder.from_autopilot(packed(position(1.0, boot_ms=1000 + 50 * k)), now_s)
        if k % 2 == 0:
            for node in (*nodes, *odd):
                # A new leader at half time that lands all, and manifests that are lost: its word does not count.
                says = {"lease": lease(1 if k < 30 else 2, 1 + k), "abort": 30 <= k < 36}
                node.says = {"time_ms": 1000 + 50 * k, **says}
                frames = node.send(now_s)
                recorder.from_peers(b"".join(frames[: 1 if 30 <= k < 36 else None]), now_s)
                if strangers and node.id == 2 and k == 40:
                    recorder.from_peers(frames[0], now_s)  # once more
                for other in nodes:
                    if other is not node and node not in odd:
                        other.receive(frames, now_s)
                if sent:
                    node.receive([sent[start:end] for start, end, _ in whole(sent)], now_s)
            sent = b""
        sent += recorder.tick(now_s).peers
    assert endpoint.agent.localiser.peers is not None
    recorder.close("ended")
    return recorder


def test_a_replay_of_a_signed_flight_needs_no_key(tmp_path: Path) -> None:
    signed_flight(tmp_path)
    (flight,) = find_flights(tmp_path)
    replayed = replay_flight(flight)
    assert (replayed.difference, replayed.same, replayed.is_same) == ([], 60, True)
    assert replayed.summary.beacons[1]["KEPT"] > 20
    assert set(replayed.summary.refused) <= {"not met"}
    assert "secret" not in flight.segments[1].read_bytes().decode(errors="replace")


def test_a_word_that_was_not_believed_then_is_not_now(tmp_path: Path) -> None:
    signed_flight(tmp_path)
    (flight,) = find_flights(tmp_path)

    def believe(messages: Messages) -> Messages:
        """All of it: verdicts that are 0 between two beacons."""
        return sealed_anew(
            [
                replace(m, data=bytes(1 if v == 0 and k else v for k, v in enumerate(m.data)))
                if m.channel_id == Channel.VERDICTS and len(m.data) > 6
                else m
                for m in messages
            ]
        )

    assert replay_flight(flight).is_same
    forge(flight.segments[1], believe)
    assert replay_flight(flight).difference


def test_answers_that_nobody_asks_for_are_a_difference(tmp_path: Path) -> None:
    signed_flight(tmp_path)
    (flight,) = find_flights(tmp_path)

    def add(messages: Messages) -> Messages:
        at = next(k for k, m in enumerate(messages) if m.channel_id == Channel.VERDICTS)
        more = replace(messages[at], data=messages[at].data + b"\1")
        return sealed_anew([*messages[:at], more, *messages[at + 1 :]])

    forge(flight.segments[1], add)
    assert "1 answers were asked for in the tick before then, and are not now" in replay_flight(flight).difference[0]


def test_another_record_than_then_is_a_difference() -> None:
    tape = PlayedTape()
    link = PlayedLink(tape)
    tape.load_answers(b"", [["record", 1, b"a stem"], ["record", 1, b"a stem"]])
    link.append(1, b"a stem", 10.0)
    with pytest.raises(TapeError, match="another record"):
        link.append(1, b"another", 10.0)


def test_what_people_read_of_a_tick_is_compared_too(tmp_path: Path) -> None:
    flight = recorded(tmp_path)

    def change(messages: Messages) -> Messages:
        ticks = [k for k, m in enumerate(messages) if m.channel_id == Channel.TICK]
        m = messages[ticks[16]]
        data = m.data.replace(b'"cuts":[]', b'"cuts":[{"reason":"SPEED","by_mps":1.0}]')
        return sealed_anew([*messages[: ticks[16]], replace(m, data=data), *messages[ticks[16] + 1 :]])

    forge(flight.segments[1], change)
    replayed = replay_flight(flight)
    assert replayed.breaks == []
    assert replayed.difference == [
        "tick 17, 0.800 s: cuts then [{'reason': 'SPEED', 'by_mps': 1.0}], now []",
    ]


def test_datagrams_that_are_read_before_they_have_their_time(tmp_path: Path) -> None:
    """As the loop does by the vehicle's clock."""
    recorder, _ = recorder_of(DirectWriter(files_of(tmp_path, START, waits_for_disk=False)))
    for k in range(20):
        messages = recorder.read_autopilot(packed(HOME, heartbeat(), position(1.0 + k)))
        recorder.from_peers(beacon_of(5, time_ms=1000 + 50 * k), 10.0 + k * TICK_S)
        recorder.autopilot_says(messages, 10.0 + k * TICK_S)
        recorder.tick(10.0 + k * TICK_S)
    recorder.close("ended")
    (flight,) = find_flights(tmp_path)
    replayed = replay_flight(flight)
    assert (replayed.difference, replayed.same) == ([], 20)
    assert replayed.summary.beacons[5]["KEPT"] == 19


@pytest.mark.parametrize("grounded", ["", "no preflight"])
def test_the_preflights_word_is_handed_in_again(grounded: str, tmp_path: Path) -> None:
    recorder, _ = recorder_of(DirectWriter(files_of(tmp_path, START, waits_for_disk=False)), grounded=grounded)
    fly_ticks(recorder, 5)
    recorder.from_autopilot(packed(command(dialect.MAV_CMD_MISSION_START), system=255, component=190), 10.25)
    said = [say.text for say in recorder.tick(10.25).said]
    assert said == [*(["grounded, no preflight"] if grounded else []), "preflight waived: all"]
    recorder.close("ended")
    (flight,) = find_flights(tmp_path)
    assert replay_flight(flight).is_same


def test_frames_that_the_guard_refuses_are_told_by_its_reasons(tmp_path: Path) -> None:
    signed_flight(tmp_path, strangers=True)
    (flight,) = find_flights(tmp_path)
    replayed = replay_flight(flight)
    assert (replayed.difference, replayed.is_same) == ([], True)
    assert replayed.summary.refused["forged manifest"] > 0
    assert replayed.summary.refused["repeated"] == 1
    assert 4 not in replayed.summary.beacons


def test_keys_are_not_in_the_log(tmp_path: Path) -> None:
    signed_flight(tmp_path)
    (flight,) = find_flights(tmp_path)
    data, ring = flight.segments[1].read_bytes(), keyring(3)
    for secret in (ring.seed, *ring.secrets.values(), guard(3)._own_key):
        assert secret not in data
        assert secret.hex().encode() not in data


def test_another_verdict_than_then_is_a_difference(tmp_path: Path) -> None:
    """Of the same frames: a replay that did not hand the verdicts in would tell nothing of this."""
    signed_flight(tmp_path)
    (flight,) = find_flights(tmp_path)

    def refuse(messages: Messages) -> Messages:
        """All that was admitted but the first answers, in which the senders are met."""
        late = len(messages) // 2
        return sealed_anew(
            [
                replace(m, data=m.data.replace(b"\1", b"\0")) if m.channel_id == Channel.VERDICTS and k > late else m
                for k, m in enumerate(messages)
            ]
        )

    forge(flight.segments[1], refuse)
    replayed = replay_flight(flight)
    assert not replayed.breaks
    assert replayed.difference


def test_a_replay_that_asks_more_or_less_than_then_says_so(tmp_path: Path) -> None:
    signed_flight(tmp_path)
    (flight,) = find_flights(tmp_path)
    forge(flight.segments[1], lambda messages: sealed_anew([m for m in messages if m.channel_id != Channel.VERDICTS]))
    assert replay_flight(flight).difference == ["tick 1, 0.000 s: a verdict more is asked for than then"]


def test_records_are_answered_for_by_the_log(tmp_path: Path) -> None:
    noted = Noted()
    recorder, endpoint = recorder_of(DirectWriter(files_of(tmp_path, START, waits_for_disk=False)), records=noted)
    for k in range(20):
        recorder.from_peers(FRAME, 10.0 + k / 20)
        noted.to_say = ["no room"] if k == 7 else []
        assert endpoint.records is not None
        if k == 9:
            endpoint.records.append(RecordKind.STEM, b"a stem", 10.0 + k / 20)
        fly_ticks(recorder, 1, first=k)
    recorder.close("ended")
    assert noted.received
    assert noted.appended
    (flight,) = find_flights(tmp_path)
    replayed = replay_flight(flight, to_s=0.44)
    assert (replayed.same, replayed.is_same) == (9, True)
    # Nobody makes that record in the replay.
    assert "frames: is asked for; then it was ['record', " in replay_flight(flight).difference[0]


class BrokenError(Exception):
    pass


def test_a_crash_is_recorded_with_what_it_crashed_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder, endpoint = recorder_of(DirectWriter(files_of(tmp_path, START, waits_for_disk=False)))
    fly_ticks(recorder, 20)

    observe = type(endpoint.agent).observe

    def crash(agent: Agent, now_s: float) -> Any:
        if now_s > 10.98:
            raise BrokenError
        return observe(agent, now_s)

    with monkeypatch.context() as change:
        change.setattr(type(endpoint.agent), "observe", crash)
        with pytest.raises(BrokenError):
            fly_ticks(recorder, 1, first=20)
        recorder.close("broken")
        (flight,) = find_flights(tmp_path)
        assert replay_flight(flight).is_same  # the defect is still there
    replayed = replay_flight(flight)  # it is mended
    assert replayed.same == 20
    assert replayed.difference == ["the end: it ended in an error then, and does not now"]


def test_a_law_that_the_log_does_not_hold_is_not_run_again(tmp_path: Path) -> None:
    flight = recorded(tmp_path, flown_by="law mine")
    replayed = replay_flight(flight)
    assert replayed.stopped == "it was flown by law mine, which the log does not hold"
    assert (replayed.same, replayed.summary.ticks, replayed.is_same) == (0, 40, False)


def test_signed_frames_are_refused_as_then(tmp_path: Path) -> None:
    recorder, _ = recorder_of(DirectWriter(files_of(tmp_path, START, waits_for_disk=False)))
    fly_ticks(recorder, 5)
    recorder.from_peers(signed(beacon_of(7)) + beacon_of(8), 10.3)
    recorder.tick(10.3)
    recorder.close("ended")
    (flight,) = find_flights(tmp_path)
    replayed = replay_flight(flight)
    assert replayed.is_same
    assert replayed.summary.refused == {"signed": 1}
    assert replayed.summary.beacons[8] == {"KEPT": 1}
