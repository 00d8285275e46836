"""Puts the answers of what an endpoint asks on a tape."""

from __future__ import annotations

from collections import Counter
from typing import Final

from companion.core.model.actions import Say
from companion.core.model.beacon import Beacon
from companion.journal.tape.tape import CODES, NO, YES, Tape
from companion.mavlink.beacon import Decoded
from companion.mavlink.framing.signing import Gate
from companion.mavlink.harvest import RecordLink, StandUpdate
from companion.mavlink.orders.book import Marks
from companion.mavlink.peers.belief import limit_belief
from companion.mavlink.peers.guard import Guard


class RecordedGuard:
    """A guard with keys, whose answers are put on a tape. (An open one is not: it asks nobody.)"""

    def __init__(self, guard: Guard, tape: Tape) -> None:
        self.flags: int = guard.flags
        self.cloned: bool = guard.cloned
        self.refused: Counter[str] = guard.refused
        self._guard: Final = guard
        self._tape: Final = tape
        self._seen: Counter[str] = Counter(guard.refused)
        self._codes: dict[str, int] = {}  # reasons, as they came

    def passes(self, frame: bytes, now_s: float) -> bool:
        """The guard's verdict, and why not."""
        passed = self._guard.passes(frame, now_s)
        self._tape.put_verdict(YES if passed else self._refusal())
        return passed

    def take_admitted(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> None:
        """To the guard, which answers nothing."""
        self._guard.take_admitted(frame, now_s, said, named=named)

    def admits(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bool:
        """The guard's verdict, and why not."""
        admitted = self._guard.admits(frame, now_s, said, named=named)
        self._tape.put_verdict(YES if admitted else self._refusal())
        return admitted

    def take_proof(self, frame: bytes, now_s: float) -> bool:
        """The guard's verdict, why a proof counts nothing, and whether there is a clone."""
        taken = self._guard.take_proof(frame, now_s)
        self._tape.put_verdict(taken)
        if taken:
            self._tape.put_verdict(self._refusal())
            self.cloned = self._guard.cloned
            self._tape.put_verdict(self.cloned)
        return taken

    def holds_mac(self, frame: bytes) -> bool:
        """The guard's verdict."""
        holds = self._guard.holds_mac(frame)
        self._tape.put_verdict(holds)
        return holds

    def boots(self) -> dict[int, int]:
        """As the guard. No endpoint asks: it is for those who make orders."""
        return self._guard.boots()

    def believe(self, decoded: Decoded, sender: int, now_s: float) -> Decoded:
        """The guard's answer: all of it, or what slows alone, and why a manifest that had waited counts nothing."""
        believed = self._guard.believe(decoded, sender, now_s)
        self._tape.put_verdict(YES if believed is decoded else self._refusal())
        if believed is not decoded:
            vouched = believed.is_vouched
            self._tape.put_verdict(vouched)
            self._tape.put_verdict(believed == limit_belief(decoded, is_proven=True, is_vouched=vouched))
        return believed

    def seal(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bytes:
        """The frame as the guard seals it."""
        return self._record_seal(frame, self._guard.seal(frame, now_s, said, named=named))

    def proof(self, now_s: float) -> tuple[int, bytes] | None:
        """The guard's proof."""
        proof = self._guard.proof(now_s)
        self._tape.put_verdict(proof is not None)
        if proof is not None:
            self._tape.put_list(["proof", *proof])
        return proof

    def seal_proof(self, frame: bytes) -> bytes:
        """The frame as the guard seals it."""
        return self._record_seal(frame, self._guard.seal_proof(frame))

    def take_liars(self) -> list[int]:
        """The guard's."""
        liars = self._guard.take_liars()
        self._tape.put_verdict(len(liars) > 0)
        if liars:
            self._tape.put_list(["liars", *liars])
        return liars

    def take_proofs(self) -> list[bytes]:
        """The guard's."""
        proofs = self._guard.take_proofs()
        self._tape.put_verdict(len(proofs) > 0)
        if proofs:
            self._tape.put_list(["proofs", *proofs])
        return proofs

    def take_says(self) -> list[Say]:
        """Words of the guard."""
        says = self._guard.take_says()
        self._tape.put_verdict(len(says) > 0)
        if says:
            self._tape.put_list(["says", *([int(say.severity), say.text] for say in says)])
        return says

    def _record_seal(self, frame: bytes, sealed: bytes) -> bytes:
        """Puts down what was added to a frame, behind so many bytes of it."""
        kept = len(frame) if sealed.startswith(frame) else 0
        self._tape.put_list(["seal", kept, sealed[kept:]])
        return sealed

    def _refusal(self) -> int:
        """The code of the reason that was counted since last asked; NO: none was."""
        for reason, count in self.refused.items():
            if count != self._seen[reason]:
                self._seen[reason] = count
                if reason not in self._codes:
                    self._codes[reason] = CODES + len(self._codes)
                    self._tape.put_list(["reason", reason])
                return self._codes[reason]
        return NO


class RecordedGate(Gate):
    """The gate of a signed autopilot link, whose answers are put on a tape."""

    def __init__(self, gate: Gate, tape: Tape) -> None:
        super().__init__(takes_signed=True)
        self._gate: Final = gate
        self._tape: Final = tape

    def admits(self, frame: bytes) -> bool:
        """The gate's verdict."""
        admitted = self._gate.admits(frame)
        self._tape.put_verdict(admitted)
        self.signed, self.refused = self._gate.signed, self._gate.refused
        return admitted

    def seal(self, frame: bytes, now_s: float) -> bytes:
        """The frame as the gate seals it. Its signature is put down, which is what follows the frame's own bytes."""
        sealed = self._gate.seal(frame, now_s)
        self._tape.put_list(["sign", sealed[len(frame) :]])
        return sealed

    def counters(self) -> dict[str, int]:
        """The gate's."""
        return self._gate.counters()


class RecordedLink:
    """A link of records whose answers are put on a tape, and the records that the endpoint makes."""

    def __init__(self, link: RecordLink, tape: Tape) -> None:
        self._link: Final = link
        self._tape: Final = tape

    def append(self, kind: int, body: bytes, now_s: float) -> None:
        """Hands it on."""
        self._tape.put_list(["record", int(kind), body])
        self._link.append(kind, body, now_s)

    def is_record(self, frame: bytes) -> bool:
        """By the frame alone."""
        return self._link.is_record(frame)

    def receive(self, frame: bytes, now_s: float) -> bool:
        """The link's verdict."""
        taken = self._link.receive(frame, now_s)
        self._tape.put_verdict(taken)
        return taken

    def frames(self, now_s: float, beacon_bytes: int) -> list[tuple[int, bytes]]:
        """Frames of the link."""
        found = self._link.frames(now_s, beacon_bytes)
        self._tape.put_list(["frames", *([message_id, payload] for message_id, payload in found)])
        return found

    def take_stand(self, *, leads: bool, now_s: float) -> StandUpdate | None:
        """Figures of the link's stand."""
        update = self._link.take_stand(leads=leads, now_s=now_s)
        self._tape.put_verdict(update is not None)
        if update is not None:
            self._tape.put_list(["stand", *update])
        return update

    def count_waiting(self) -> int:
        """The link's count."""
        count = self._link.count_waiting()
        self._tape.put_list(["waiting", count])
        return count

    def lines(self) -> list[str]:
        """Lines of the link."""
        found = self._link.lines()
        self._tape.put_list(["lines", *found])
        return found

    def counters(self) -> dict[str, int]:
        """Counts of the link, for the log alone."""
        return self._link.counters()


class RecordedMarks:
    """The disk of a book of orders, whose answers are put on a tape. The book itself is run again."""

    def __init__(self, marks: Marks, tape: Tape) -> None:
        self._marks: Final = marks
        self._tape: Final = tape

    def save(self, state: bytes, *, wait: bool) -> bool:
        """The disk's answer."""
        is_saved = self._marks.save(state, wait=wait)
        self._tape.put_verdict(is_saved)
        return is_saved
