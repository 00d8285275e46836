"""Requests to the autopilot, one at a time: repeated until they show, their refusals told with the autopilot's reasons.

| answer | what follows |
|---|---|
| ACCEPTED, IN_PROGRESS, none | asked again while it does not show |
| TEMPORARILY_REJECTED, FAILED, CANCELLED | told, asked again |
| DENIED, UNSUPPORTED | told, not asked again; a landing is asked for again for ever |
"""

from __future__ import annotations

from collections import deque
from typing import Final

from companion.core.model.actions import Ask, Say
from companion.core.model.events import Answer, AutopilotText
from companion.core.model.states import AutopilotTraits, Request, Result, Severity

RETRY_S: Final = 1.5  # without an answer, or after a refusal
REFUSALS_SAID: Final = 3  # the first few reach the operator; all are retried
REASON_S: Final = 0.2  # an autopilot gives its reasons before its answer, or so soon after it
REASONS_LIMIT: Final = 4
FOR_GOOD = frozenset({Result.DENIED, Result.UNSUPPORTED})
NO_NEWS = frozenset({Result.ACCEPTED, Result.IN_PROGRESS})


class AutopilotRequests:
    """Repeats a request until it shows: `send_request` each tick, `receive_answer`; `says` is for the operator."""

    def __init__(self) -> None:
        self.refused_for_good = False  # what was asked for last
        self.request: Request | None = None  # asked for last, in this step of the flight
        self.arm_shows_by_s = -1e9  # a HEARTBEAT from before may still say disarmed
        self._asked_s = -1e9
        self._answer: Result | None = None
        self._answered_s = -1e9  # the first answer
        self._refusals = 0
        self._refusal: tuple[float, str] | None = None  # since when, and what, its reasons still coming in
        self._reasons: deque[str] = deque(maxlen=REASONS_LIMIT)

    def reset(self) -> None:
        """Another step of the flight: whatever was asked for is asked for no more."""
        self.refused_for_good = False
        self.request, self._answer = None, None
        self._asked_s = -1e9
        self._refusals = 0

    def send_request(self, ask: Ask, traits: AutopilotTraits, now_s: float) -> list[Ask]:
        """To be sent now: `ask`, or nothing while the one before may still show."""
        if not self.may_ask(traits, now_s):
            return []
        if ask.request is not self.request:
            self.reset()
        elif self._answer is None:
            self._report_refusal(f"{ask.request.value} not answered", now_s)
        elif self._answer in NO_NEWS:
            self._report_refusal(f"{ask.request.value} answered {self._answer.name}, without effect", now_s)
        self.request, self._asked_s, self._answer = ask.request, now_s, None
        if ask.request is Request.ARM:
            self.arm_shows_by_s = now_s + traits.mode_shows_s
        self._reasons.clear()
        return [ask]

    def may_ask(self, traits: AutopilotTraits, now_s: float) -> bool:
        """True once the request asked for last should have shown."""
        return now_s >= self._shows_until_s(traits)

    def _shows_until_s(self, traits: AutopilotTraits) -> float:
        """Time when the request asked for last should have shown."""
        if self._answer not in NO_NEWS:
            return self._asked_s + RETRY_S
        if self.request is Request.TAKEOFF:
            return self._asked_s + traits.climb_shows_s
        return self._answered_s + traits.mode_shows_s

    def receive_answer(self, event: Answer | AutopilotText, now_s: float) -> None:
        """An answer (to another's request: no effect), or a text, which may be a reason."""
        if isinstance(event, AutopilotText):
            if event.severity <= Severity.WARNING and event.text not in self._reasons:
                self._reasons.append(event.text)
        elif event.request is self.request:
            if self._answer is None:
                self._answered_s = now_s
            self._answer = event.result
            if event.result not in NO_NEWS:
                self._report_refusal(f"{event.request.value} refused ({event.result.name})", now_s)
                self.refused_for_good = event.result in FOR_GOOD and event.request is not Request.LAND

    def says(self, now_s: float) -> list[Say]:
        """Messages to the operator about it."""
        if self._refusal is None or now_s - self._refusal[0] < REASON_S:
            return []
        text = ": ".join([self._refusal[1], "; ".join(self._reasons)] if self._reasons else [self._refusal[1]])
        self._refusal = None
        return [Say(Severity.WARNING, text)]

    def _report_refusal(self, what: str, now_s: float) -> None:
        self._refusals += 1
        if self._refusals <= REFUSALS_SAID:
            self._refusal = (now_s, what)
