"""Plays the answers of a tape back to what an endpoint asks."""

from __future__ import annotations

from collections import Counter
from typing import Final

from companion.core.model.actions import Say
from companion.core.model.beacon import Beacon
from companion.core.model.states import Severity
from companion.journal.tape.tape import CODES, NO, YES, PlayedTape, TapeError
from companion.mavlink.autopilot_link.signing import as_signed
from companion.mavlink.beacon import Decoded
from companion.mavlink.framing.signing import Gate
from companion.mavlink.harvest import StandUpdate
from companion.mavlink.peers.belief import limit_belief
from companion.records.frames import is_record_frame


class PlayedGuard:
    """Repeats the answers of a guard with keys."""

    def __init__(self, tape: PlayedTape, flags: int, *, tells_vouched: bool = True) -> None:
        """`tells_vouched`: the tape has whether a sender vouches for where it is, and who is proven to lie."""
        self.flags = flags
        self.cloned = False
        self.refused: Counter[str] = Counter()
        self._tape: Final = tape
        self._tells_vouched: Final = tells_vouched
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
        if self._count_refusal(self._tape.next_verdict()) == YES:
            return decoded
        if not self._tells_vouched:
            return limit_belief(decoded, is_proven=False, is_vouched=True)
        is_vouched, is_proven = self._tape.next_verdict() == YES, self._tape.next_verdict() == YES
        return limit_belief(decoded, is_proven=is_proven, is_vouched=is_vouched)

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

    def take_liars(self) -> list[int]:
        """The liars that were proven then."""
        if not self._tells_vouched or self._tape.next_verdict() == NO:
            return []
        return [int(liar) for liar in self._tape.next_list("liars")]

    def take_proofs(self) -> list[bytes]:
        """The proofs that were passed on then."""
        if not self._tells_vouched or self._tape.next_verdict() == NO:
            return []
        return [bytes(proof) for proof in self._tape.next_list("proofs")]

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


class PlayedGate(Gate):
    """Repeats the answers of the gate of a signed autopilot link."""

    def __init__(self, tape: PlayedTape) -> None:
        super().__init__(takes_signed=True)
        self._tape: Final = tape

    def admits(self, frame: bytes) -> bool:  # noqa: ARG002
        """The verdict of then."""
        return self._tape.next_verdict() == YES

    def seal(self, frame: bytes, now_s: float) -> bytes:  # noqa: ARG002
        """The frame, with the signature of then."""
        (signature,) = self._tape.next_list("sign")
        return as_signed(frame) + bytes(signature)


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

    def count_waiting(self) -> int:
        """The count of then."""
        (count,) = self._tape.next_list("waiting")
        return int(count)

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
