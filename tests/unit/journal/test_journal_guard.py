"""What a guard refuses while a beacon is believed or not is replayed in its tick, as what it refuses of frames."""

from __future__ import annotations

from dataclasses import replace

from companion.journal.tape.played import PlayedGuard
from companion.journal.tape.recorded import RecordedGuard
from companion.journal.tape.tape import PlayedTape, Tape
from companion.mavlink.beacon import Decoded
from companion.mavlink.framing import wire
from companion.mavlink.peers.stream import PROVEN_S
from tests.unit.core.core_kit import beacon, lease
from tests.unit.mavlink.signing_kit import PERIOD_S, beacon_frame, guard, keyring, met, seed


def test_a_manifest_that_had_waited_and_was_forged_is_counted_in_the_tick_of_then() -> None:
    (one, two), now_s = met(1, 2)
    tape, said = Tape(), beacon(1)
    recorded = RecordedGuard(two.guard, tape)
    forger = guard(1, boot=1001, ring=replace(keyring(1), seed=seed(3)))  # by a member, which has the group's key
    message, payload = forger.proof(now_s + 0.5) or (0, b"")
    forged = forger.seal_proof(wire.frame(message, payload, seq=0, system=1, component=191, flags=1))
    assert recorded.take_proof(forged, now_s + 0.5)
    now_s += PROVEN_S + PERIOD_S
    unproven = Decoded(1, beacon(1, lease=lease(1, 9)), (0.0, 0.0, 0.0))
    frames = [one.guard.seal(beacon_frame(1), now_s + k, said) for k in (0.0, 0.1)]
    answers = []
    for k, frame in enumerate(frames):
        answers.append(recorded.admits(frame, now_s + 0.1 * k, said))
        answers.append(recorded.believe(unproven, 1, now_s + 0.1 * k) is unproven)
    assert answers == [True, False, True, False]
    before = {"forged manifest": 1}
    assert two.guard.refused["forged manifest"] == 1
    played_tape = PlayedTape()
    played_tape.load_answers(tape.take_verdicts(), tape.take_lists())
    played = PlayedGuard(played_tape, recorded.flags)
    assert played.take_proof(forged, now_s)
    assert dict(played.refused) == {}
    assert [played.admits(frames[0], now_s), played.believe(unproven, 1, now_s) is unproven] == [True, False]
    assert dict(played.refused) == before
    assert [played.admits(frames[1], now_s), played.believe(unproven, 1, now_s) is unproven] == [True, False]
    assert dict(played.refused) == before
