"""What a guard refuses while a beacon is believed or not is replayed in its tick, as what it refuses of frames."""

from __future__ import annotations

from dataclasses import replace

from companion.core.model.beacon import Beacon
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


def test_how_far_a_beacon_was_believed_and_who_was_proven_to_lie_is_played_back() -> None:
    (one, two), now_s = met(1, 2)
    tape, told = Tape(), lease(1, 9, established=True)
    recorded, witness = RecordedGuard(two.guard, tape), two.guard._witness
    forger = guard(1, boot=1001)
    beacons = [beacon(1), beacon(1, dest_ned_m=(9.0, 0.0, 0.0)), beacon(1, lease=told)]

    def hear(at_s: float, said: Beacon) -> Decoded:
        decoded = Decoded(1, said, (0.0, 0.0, 0.0))
        assert recorded.admits(forger.seal(beacon_frame(1), at_s, said), at_s, said)
        return recorded.believe(decoded, 1, at_s)

    believed = [hear(now_s + 0.01, beacons[0])]
    for frame in one.send(now_s + 1.1):  # its manifest does not name that frame
        recorded.take_proof(frame, now_s + 1.1)
    believed += [hear(now_s + 1.1 + 0.01 * (k + 1), said) for k, said in enumerate(beacons)]
    assert [found.is_vouched for found in believed] == [True, False, False, False]
    witness._liars, witness._proofs = [3], [b"one", b"two"]
    asked = [recorded.take_liars(), recorded.take_liars(), recorded.take_proofs(), recorded.take_proofs()]
    assert asked == [[3], [], [b"one", b"two"], []]
    played_tape = PlayedTape()
    played_tape.load_answers(tape.take_verdicts(), tape.take_lists())
    played = PlayedGuard(played_tape, recorded.flags)
    again = []
    for k, said in enumerate([beacons[0], *beacons]):
        assert played.admits(b"", now_s)
        again.append(played.believe(Decoded(1, said, (0.0, 0.0, 0.0)), 1, now_s))
        if k == 0:
            assert not played.take_proof(b"", now_s)
            assert played.take_proof(b"", now_s)
    assert again == believed
    assert [played.take_liars(), played.take_liars(), played.take_proofs(), played.take_proofs()] == asked
