"""MAVLink's mission protocol, for the one kind of plan that is kept here: the fence. Any personality's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from companion.mavlink import dialect as mav
from companion.mavlink.framing.frames import Incoming
from mission.common.frames import LocalFrame
from sim_bridge.world.autopilot.fence import Fence, FenceError, fence_of
from sim_bridge.world.autopilot.protocols.links import Port

ITEMS_MAX: Final = 120  # ArduPilot counts them in an int8
RETRY_S: Final = 1.0  # after which an item is asked for again
RETRIES: Final = 5
ALL_TYPES: Final = 255
FENCE = mav.MAV_MISSION_TYPE_FENCE


@dataclass(slots=True)
class _Upload:
    """A plan that is coming in, and its sender."""

    port: Port
    system: int
    component: int
    count: int
    asked_s: float
    items: list[Any] = field(default_factory=list)
    retries: int = 0


class Plans:
    """Keeps the last whole fence that was uploaded; `changed` is told of each, and of its clearing."""

    def __init__(self, frame: LocalFrame, changed: Callable[[Fence], None]) -> None:
        self.items: tuple[Any, ...] = ()  # MISSION_ITEM_INT, as they came
        self._frame = frame
        self._changed = changed
        self._upload: _Upload | None = None
        self._handlers: dict[int, Callable[[Port, Incoming, float], None]] = {
            mav.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._on_list,
            mav.MAVLINK_MSG_ID_MISSION_REQUEST_INT: self._on_request,
            mav.MAVLINK_MSG_ID_MISSION_REQUEST: self._on_request,
            mav.MAVLINK_MSG_ID_MISSION_COUNT: self._on_count,
            mav.MAVLINK_MSG_ID_MISSION_ITEM_INT: self._on_item,
            mav.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: self._on_clear,
        }
        self.message_ids = frozenset(self._handlers)

    def receive(self, port: Port, incoming: Incoming, now_s: float) -> None:
        """One of `message_ids`."""
        self._handlers[incoming.message_id](port, incoming, now_s)

    def retry(self, now_s: float) -> None:
        """Ask again for an item that has not come; give up after RETRIES."""
        upload = self._upload
        if upload is None or now_s - upload.asked_s < RETRY_S:
            return
        upload.retries += 1
        if upload.retries > RETRIES:
            self._end(upload, mav.MAV_MISSION_OPERATION_CANCELLED)
        else:
            self._request_item(upload, now_s)

    # Down

    def _on_list(self, port: Port, incoming: Incoming, now_s: float) -> None:
        del now_s
        kind = incoming.message.mission_type
        count = len(self.items) if kind == FENCE else 0
        port.send(mav.MAVLink_mission_count_message(incoming.system, incoming.component, count, kind))

    def _on_request(self, port: Port, incoming: Incoming, now_s: float) -> None:
        del now_s
        message = incoming.message
        if message.mission_type != FENCE or message.seq >= len(self.items):
            _acknowledge(port, incoming, mav.MAV_MISSION_INVALID_SEQUENCE)
            return
        item = self.items[message.seq]
        port.send(
            mav.MAVLink_mission_item_int_message(
                incoming.system,
                incoming.component,
                message.seq,
                item.frame,
                item.command,
                item.current,
                item.autocontinue,
                item.param1,
                item.param2,
                item.param3,
                item.param4,
                item.x,
                item.y,
                item.z,
                FENCE,
            )
        )

    # Up

    def _on_count(self, port: Port, incoming: Incoming, now_s: float) -> None:
        """Nothing here flies missions, nor knows rally points: of those only none are accepted."""
        count = incoming.message.count
        if count == 0:
            self._on_clear(port, incoming, now_s)
        elif incoming.message.mission_type != FENCE:
            _acknowledge(port, incoming, mav.MAV_MISSION_UNSUPPORTED)
        elif count > ITEMS_MAX:
            _acknowledge(port, incoming, mav.MAV_MISSION_NO_SPACE)
        else:
            self._upload = _Upload(port, incoming.system, incoming.component, count, now_s)
            self._request_item(self._upload, now_s)

    def _on_item(self, port: Port, incoming: Incoming, now_s: float) -> None:
        """Items come in order; one that does not is asked for anew."""
        upload, message = self._upload, incoming.message
        if upload is None or (upload.system, upload.component) != (incoming.system, incoming.component):
            return
        if message.mission_type != FENCE or port is not upload.port:
            return
        if message.seq == len(upload.items):
            upload.items.append(message)
            upload.retries = 0
        if len(upload.items) < upload.count:
            self._request_item(upload, now_s)
            return
        try:
            fence = fence_of(upload.items, self._frame)
        except FenceError:
            self._end(upload, mav.MAV_MISSION_INVALID)
            return
        self.items = tuple(upload.items)
        self._end(upload, mav.MAV_MISSION_ACCEPTED)
        self._changed(fence)

    def _on_clear(self, port: Port, incoming: Incoming, now_s: float) -> None:
        del now_s
        if incoming.message.mission_type in (FENCE, ALL_TYPES):
            self.items = ()
            self._upload = None
            self._changed(Fence())
        _acknowledge(port, incoming, mav.MAV_MISSION_ACCEPTED)

    def _request_item(self, upload: _Upload, now_s: float) -> None:
        upload.asked_s = now_s
        upload.port.send(
            mav.MAVLink_mission_request_int_message(upload.system, upload.component, len(upload.items), FENCE)
        )

    def _end(self, upload: _Upload, result: int) -> None:
        self._upload = None
        upload.port.send(mav.MAVLink_mission_ack_message(upload.system, upload.component, result, FENCE))


def _acknowledge(port: Port, incoming: Incoming, result: int) -> None:
    port.send(
        mav.MAVLink_mission_ack_message(incoming.system, incoming.component, result, incoming.message.mission_type)
    )
