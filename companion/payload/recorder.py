"""Makes records of what other sensors tell, at the periods that the mission gives, along one vehicle's way."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from companion.core.model.actions import Say
from companion.core.model.states import Severity
from companion.mavlink.harvest import PayloadPlace
from companion.mavlink.sensor_source import PayloadValue
from companion.payload.sample import PAYLOAD_KIND, VALUE_MAX, PayloadSample, encode_sample
from mission.document.model import Mission
from mission.schema.payload import Payload

SILENT_S: Final = 5.0  # or three periods: a source that was not heard for so long is said to be missing
AGAIN_S: Final = 60.0  # between two words on one source: one that comes and goes is no flood


class PayloadRecorder:
    """`take_records` once a tick. A value is recorded where the vehicle is in the tick with which it came.

    At most one record a period of each quantity: of the first value that comes once the period is over. What does not
    come, or is no number, is not recorded, and said.
    """

    def __init__(self, mission: Mission, vehicle_id: int) -> None:
        self._vehicle_id: Final = vehicle_id
        self._channels: Final = [_Channel(one) for one in mission.payload]
        self._says: list[Say] = []
        self._since_s: float | None = None  # in the air
        self._lost_s = -math.inf  # when it was said that the place is not known

    def take_records(
        self, values: Iterable[PayloadValue], place: PayloadPlace | None, now_s: float, *, airborne: bool
    ) -> list[tuple[int, bytes]]:
        """Kinds and bodies. `values`: that have come since the last tick; `place`: None: not known.

        On the ground nothing is recorded.
        """
        if not airborne:
            self._since_s = None
            return []
        if self._since_s is None:
            self._since_s = now_s
        newest = {value.source: value.value for value in values}
        found: list[tuple[int, bytes]] = []
        for channel in self._channels:
            text = channel.take_value(newest.get(channel.spec.source), self._since_s, now_s)
            if text is not None:
                self._says.append(Say(Severity.WARNING, f"payload: {channel.spec.name} {text}"))
            if channel.is_due and place is not None:
                channel.note_recorded(now_s)
                found.append((PAYLOAD_KIND, self._encode(channel, place)))
            elif channel.is_due and now_s - self._lost_s >= AGAIN_S:
                self._lost_s = now_s
                self._says.append(Say(Severity.WARNING, "payload: position unknown: not recorded"))
        return found

    def take_says(self) -> list[Say]:
        """Words for the operator, since last asked."""
        says, self._says = self._says, []
        return says

    def _encode(self, channel: _Channel, place: PayloadPlace) -> bytes:
        spec = channel.spec
        return encode_sample(PayloadSample(self._vehicle_id, spec.name, spec.unit, channel.value, *place))


class _Channel:
    """One quantity."""

    def __init__(self, spec: Payload) -> None:
        self.spec: Final = spec
        self.value = 0.0
        self.is_due = False  # `value` has just come, and is to be recorded
        self._due_s = -math.inf
        self._heard_s = -math.inf
        self._said_s = -math.inf
        self._silent_s: Final = max(SILENT_S, 3.0 * spec.period_s)

    def take_value(self, value: float | None, since_s: float, now_s: float) -> str | None:
        """None: none has come. Returns what is to be said of it. `since_s`: in the air since then."""
        self.is_due = False
        if value is not None and abs(value) <= VALUE_MAX:  # false for NaN
            self.value, self._heard_s = value, now_s
            self.is_due = now_s >= self._due_s
            return None
        if now_s - self._said_s < AGAIN_S:
            return None
        if value is not None:
            self._said_s = now_s
            return "no number: not recorded"
        if now_s - max(self._heard_s, since_s) <= self._silent_s:
            return None
        self._said_s = now_s
        return "not heard: not recorded"

    def note_recorded(self, now_s: float) -> None:
        """The next is due a period after this one was, or after now where it is late by more than that."""
        period_s = self.spec.period_s
        self._due_s = self._due_s + period_s if now_s - self._due_s < period_s else now_s + period_s


def payload_of(mission: Mission, vehicle_id: int) -> PayloadRecorder | None:
    """One vehicle's; None: the mission has no [[payload]]."""
    return PayloadRecorder(mission, vehicle_id) if mission.payload else None
