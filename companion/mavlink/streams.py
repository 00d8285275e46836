"""Messages that a companion needs of its autopilot, and requests for those that do not come."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any, Final

from companion.core.agent import TICK_HZ
from companion.core.model.actions import Say
from companion.core.model.states import Severity
from companion.mavlink import dialect
from companion.mavlink.codec import Codec
from companion.mavlink.makes.make import Make
from mission.document.model import Mission

STREAMS_RETRY_S: Final = 2.0
STEERED_BY_HZ: Final = 10.0  # streams wanted at less tell states, which may be a second old
RATE_MIN_SHARE: Final = 0.8  # of what is asked for; one message more is the window's edge
RATE_WINDOW_S: Final = 5.0  # in which the messages of a stream are counted, at least
SLOW_TOLD: Final = 3  # windows in a row in which one is too slow although it was asked for: the operator is told
ROUNDING_S: Final = 1e-6  # more than that of seconds
STREAMS_HZ: Final[Mapping[int, float]] = {
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: TICK_HZ,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1,
}
FRAME_MESSAGES = (dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, dialect.MAVLINK_MSG_ID_HOME_POSITION)
FRAME_TRIES: Final = 5  # for one of them when the other is known: an autopilot may have but one to tell
NONE: Final[Mapping[int, float]] = MappingProxyType({})
FIX_HZ: Final[Mapping[int, float]] = MappingProxyType({dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 5})


def fastest_hz(*tables: Mapping[int, float]) -> dict[int, float]:
    """Message id -> the highest of the rates that any of `tables` has for it."""
    found: dict[int, float] = {}
    for table in tables:
        for message_id, rate_hz in table.items():
            found[message_id] = max(rate_hz, found.get(message_id, 0.0))
    return found


def streams_hz(
    make: Make | None, *, sensors_hz: Mapping[int, float] = NONE, reception: bool = False
) -> dict[int, float]:
    """Message id -> rate: what a companion asks this make of autopilot for.

    `sensors_hz`: what its sensors need of the autopilot. `reception`: of a vehicle with GNSS in a swarm of which
    not all have them.
    """
    own = () if make is None else (make.streams_hz, make.reception_hz if reception else NONE)
    return fastest_hz(STREAMS_HZ, sensors_hz, *own)


def receiver_hz(mission: Mission, vehicle_id: int) -> Mapping[int, float]:
    """Rates of what says whether this vehicle's receiver has a fix, where all go by GNSS."""
    return NONE if mission.flies_by_ranges or not mission.has_satellites(vehicle_id) else FIX_HZ


def reception_counts(mission: Mission, vehicle_id: int) -> bool:
    """True if this companion goes by how well its autopilot receives GNSS."""
    return mission.flies_by_ranges and mission.has_satellites(vehicle_id)


class StreamRequests:
    """Requests of one companion for streams, and for what ties its frames. Times are the local clock's, s.

    A stream that comes may come at another's rate: that of the autopilot's parameters, or as a ground station on the
    same port has asked last. One that a vehicle is steered by is asked for again for as long as it is slow.
    """

    def __init__(
        self, codec: Codec, needed_hz: Iterable[Mapping[int, float]], tell: Callable[[Say], None], *, reception: bool
    ) -> None:
        """`needed_hz`: what is needed beside what all need; `tell`: takes a word for the operator."""
        self._codec: Final = codec
        self._sensors_hz: Final = fastest_hz(*needed_hz)
        self._tell: Final = tell
        self._reception: Final = reception
        self._asked_s: float | None = None
        self._complete_s = -1e9  # all that is to be streamed came; before this time none of it is missed
        self._heard_s: Final = dict[int, float]()  # when each message was heard last
        self._counts: Final = dict[int, int]()  # of each message
        self._windows: Final = dict[int, tuple[float, int]]()  # of each stream that comes: since when, its count then
        self._slow: Final = dict[int, int]()  # windows in a row in which it was too slow
        self._frame_tries = 0
        self._reboots = 0  # of the autopilot, that are known here

    def note_message(self, message_id: int, now_s: float) -> None:
        """The own autopilot has sent it."""
        self._heard_s[message_id] = now_s
        self._counts[message_id] = self._counts.get(message_id, 0) + 1

    def change_make(self, make: Make | None) -> None:
        """The autopilot proves to be of another make."""
        self._complete_s = -1e9
        if make is not None and make.streams_hz:
            self._asked_s = None  # ask at once for what only this make has

    def missing(self, now_s: float) -> list[Any]:
        """SET_MESSAGE_INTERVAL for streams that come too slowly or not at all, and what ties the frames if unknown."""
        if self._codec.reboots != self._reboots:  # what was asked for is forgotten, its frame is another
            self._reboots, self._frame_tries = self._codec.reboots, 0
            self._asked_s, self._complete_s = None, -1e9
        if now_s < self._complete_s or (self._asked_s is not None and now_s - self._asked_s < STREAMS_RETRY_S):
            return []
        wanted_hz = streams_hz(self._codec.make, sensors_hz=self._sensors_hz, reception=self._reception)
        asks = [
            self._codec.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / rate_hz)
            for message_id, rate_hz in wanted_hz.items()
            if self._is_silent(message_id, now_s) or self._is_slow(message_id, rate_hz, now_s)
        ]
        asks += self._frame_requests()
        if asks:
            self._asked_s = now_s
        else:  # what was heard by now is not missed before
            oldest_s = min([self._heard_s[message_id] for message_id in wanted_hz], default=now_s)
            self._complete_s = oldest_s + STREAMS_RETRY_S - ROUNDING_S
        return asks

    def _is_silent(self, message_id: int, now_s: float) -> bool:
        if now_s - self._heard_s.get(message_id, -1e9) < STREAMS_RETRY_S:
            return False
        self._windows.pop(message_id, None)
        return True

    def _is_slow(self, message_id: int, rate_hz: float, now_s: float) -> bool:
        """At the end of a window, of a stream that comes and that the vehicle is steered by."""
        if rate_hz < STEERED_BY_HZ:
            return False
        count = self._counts[message_id]
        began_s, count_then = self._windows.setdefault(message_id, (now_s, count))
        window_s = now_s - began_s
        if window_s < RATE_WINDOW_S:
            return False
        self._windows[message_id] = (now_s, count)
        if count - count_then + 1 >= RATE_MIN_SHARE * rate_hz * window_s:
            self._slow[message_id] = 0
            return False
        slow = self._slow[message_id] = self._slow.get(message_id, 0) + 1
        if slow == SLOW_TOLD:
            name, heard_hz = dialect.mavlink_map[message_id].msgname, (count - count_then) / window_s
            self._tell(Say(Severity.WARNING, f"{name} comes at {heard_hz:.2g} Hz, not {rate_hz:g}, though asked for"))
        return True

    def _frame_requests(self) -> list[Any]:
        if self._codec.is_anchored:
            return []
        known = (self._codec.origin_known and not self._codec.origin_doubted, self._codec.home_known)
        missing = [message_id for message_id, is_known in zip(FRAME_MESSAGES, known, strict=True) if not is_known]
        if not missing:
            self._frame_tries = 0
            return []
        if self._codec.frame_known:
            if self._frame_tries >= FRAME_TRIES:
                return []
            self._frame_tries += 1
        asks = [self._codec.command(dialect.MAV_CMD_REQUEST_MESSAGE, message_id) for message_id in missing]
        if dialect.MAVLINK_MSG_ID_HOME_POSITION in missing:
            home = dialect.MAVLINK_MSG_ID_HOME_POSITION
            asks.append(self._codec.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, home, 2e6))
        return asks
