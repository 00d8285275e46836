"""Answers from outside the endpoint's inputs: those of a guard with keys, a link of records, and the orders' disk.

They depend on a key, a disk or a random number. While a flight is recorded they are put on a tape in the order in which
the endpoint asks; a replay plays them back to the same questions, and needs neither key nor disk.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from typing import Any, Final

from companion.core.model.actions import Say
from companion.core.model.beacon import Beacon
from companion.core.model.states import Severity
from companion.mavlink.beacon import Decoded
from companion.mavlink.harvest import RecordLink, StandUpdate
from companion.mavlink.orders.book import Marks
from companion.mavlink.peers.guard import Guard, without_word
from companion.records.frames import is_record_frame

Answer = list[Any]  # of what CBOR holds; the first value is its name
YES, NO = 1, 0
CODES: Final = 2  # verdicts from here on: refused, and why


class TapeError(Exception):
    """A replay asks what the recorded endpoint did not, or has another record."""


class Tape:
    """Answers of one tick: verdicts (a byte each), and lists, each in their order."""

    def __init__(self) -> None:
        self._verdicts = bytearray()
        self._lists: list[Answer] = []

    def put_verdict(self, verdict: int) -> None:
        """One more."""
        self._verdicts.append(verdict)

    def put_list(self, answer: Answer) -> None:
        """One more."""
        self._lists.append(answer)

    def take_verdicts(self) -> bytes:
        """The verdicts since last asked."""
        verdicts = bytes(self._verdicts)
        self._verdicts.clear()
        return verdicts

    def take_lists(self) -> list[Answer]:
        """The lists since last asked."""
        answers, self._lists = self._lists, []
        return answers


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
        """The guard's answer: all of it, or what slows alone."""
        believed = self._guard.believe(decoded, sender, now_s)
        self._tape.put_verdict(believed is decoded)
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


class PlayedTape(Tape):
    """Answers that were recorded, in their order."""

    def __init__(self) -> None:
        super().__init__()
        self._verdicts_left: deque[int] = deque()
        self._lists_left: deque[Answer] = deque()

    def load_answers(self, verdicts: bytes, lists: Iterable[Answer]) -> None:
        """The answers of the next tick. TapeError: the last one has asked for fewer."""
        left = len(self._verdicts_left) + len(self._lists_left)
        if left:
            raise TapeError(f"{left} answers were asked for in the tick before then, and are not now")
        self._verdicts_left.extend(verdicts)
        self._lists_left.extend(lists)

    def next_verdict(self) -> int:
        """The next one. TapeError: there is none."""
        if not self._verdicts_left:
            raise TapeError("a verdict more is asked for than then")
        return self._verdicts_left.popleft()

    def next_list(self, name: str) -> list[Any]:
        """The next list, of this name. TapeError: there is none, or another."""
        if not self._lists_left:
            raise TapeError(f"{name}: is asked for, and was not then")
        answer = self._lists_left.popleft()
        if answer[:1] != [name]:
            raise TapeError(f"{name}: is asked for; then it was {answer!r:.40}")
        return answer[1:]


class PlayedGuard:
    """Repeats the answers of a guard with keys."""

    def __init__(self, tape: PlayedTape, flags: int) -> None:
        self.flags = flags
        self.cloned = False
        self.refused: Counter[str] = Counter()
        self._tape: Final = tape
        self._reasons: list[str] = []

    def passes(self, frame: bytes, now_s: float) -> bool:  # noqa: ARG002
        """The verdict of then."""
        return self._count_refusal(self._tape.next_verdict()) == YES

    def take_admitted(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> None:
        """Nothing is kept: what comes of it is on the tape."""

    def admits(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bool:  # noqa: ARG002
        """The verdict of then."""
        return self._count_refusal(self._tape.next_verdict()) == YES

    def take_proof(self, frame: bytes, now_s: float) -> bool:  # noqa: ARG002
        """The verdict of then."""
        if self._tape.next_verdict() == NO:
            return False
        self._count_refusal(self._tape.next_verdict())
        self.cloned = self._tape.next_verdict() == YES
        return True

    def holds_mac(self, frame: bytes) -> bool:  # noqa: ARG002
        """The verdict of then."""
        return self._tape.next_verdict() == YES

    def boots(self) -> dict[int, int]:
        """None: no endpoint asks."""
        return {}

    def believe(self, decoded: Decoded, sender: int, now_s: float) -> Decoded:  # noqa: ARG002
        """As much as then."""
        if self._tape.next_verdict() == YES or decoded.said is None:
            return decoded
        return Decoded(decoded.version, without_word(decoded.said), decoded.pos_ned_m)

    def seal(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bytes:  # noqa: ARG002
        """The frame, with the seal of then."""
        return self.seal_proof(frame)

    def proof(self, now_s: float) -> tuple[int, bytes] | None:  # noqa: ARG002
        """The proof of then."""
        if self._tape.next_verdict() == NO:
            return None
        message_id, payload = self._tape.next_list("proof")
        return message_id, payload

    def seal_proof(self, frame: bytes) -> bytes:
        """The frame, with the seal of then."""
        kept, seal = self._tape.next_list("seal")
        return frame[:kept] + bytes(seal)

    def take_says(self) -> list[Say]:
        """Words of then."""
        if self._tape.next_verdict() == NO:
            return []
        return [Say(Severity(severity), text) for severity, text in self._tape.next_list("says")]

    def _count_refusal(self, verdict: int) -> int:
        if verdict >= CODES:
            if verdict - CODES == len(self._reasons):
                self._reasons += self._tape.next_list("reason")
            if verdict - CODES >= len(self._reasons):
                raise TapeError(f"verdict {verdict}: a reason that was not told")
            self.refused[self._reasons[verdict - CODES]] += 1
        return verdict


class PlayedLink:
    """Repeats the answers of a link of records, and compares what the endpoint records."""

    def __init__(self, tape: PlayedTape) -> None:
        self._tape: Final = tape

    def append(self, kind: int, body: bytes, now_s: float) -> None:  # noqa: ARG002
        """TapeError: it is not the record of then."""
        if self._tape.next_list("record") != [int(kind), body]:
            raise TapeError("another record is made than then")

    def is_record(self, frame: bytes) -> bool:
        """By the frame alone."""
        return is_record_frame(frame)

    def receive(self, frame: bytes, now_s: float) -> bool:  # noqa: ARG002
        """The verdict of then."""
        return self._tape.next_verdict() == YES

    def frames(self, now_s: float, beacon_bytes: int) -> list[tuple[int, bytes]]:  # noqa: ARG002
        """Frames of then."""
        return [(message_id, payload) for message_id, payload in self._tape.next_list("frames")]

    def take_stand(self, *, leads: bool, now_s: float) -> StandUpdate | None:  # noqa: ARG002
        """Figures of then."""
        if self._tape.next_verdict() == NO:
            return None
        kind, body, basal_area_pct, text = self._tape.next_list("stand")
        return StandUpdate(kind, body, basal_area_pct, text)

    def lines(self) -> list[str]:
        """Lines of then."""
        return self._tape.next_list("lines")

    def counters(self) -> dict[str, int]:
        """None: a replay writes no log."""
        return {}


class PlayedMarks:
    """Repeats the answers of the disk of a book of orders."""

    def __init__(self, tape: PlayedTape) -> None:
        self._tape: Final = tape

    def save(self, state: bytes, *, wait: bool) -> bool:  # noqa: ARG002
        """The answer of then."""
        return self._tape.next_verdict() == YES
