"""A simulated autopilot on the wire, with a client on each link: the base of the flights in its tests."""

from __future__ import annotations

import math
from typing import Any

from companion.mavlink import dialect as mav
from mission.common.frames import Wgs84
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.autopilot import Autopilot, Link

ORIGIN = Wgs84(47.3977, 8.5456, 488.0)
STEP_S = 0.05
NAN = math.nan


class Wire:
    """An autopilot on its body, which whoever inherits brings along, and a client on each link."""

    autopilot: Autopilot
    body: Airframe

    def __init__(self, onboard_system: int) -> None:
        self.steps = 0
        self.reader = mav.MAVLink(None)
        self.codecs = {
            Link.ONBOARD: mav.MAVLink(None, srcSystem=onboard_system, srcComponent=191),
            Link.GROUND: mav.MAVLink(None, srcSystem=255, srcComponent=190),
        }

    @property
    def now_s(self) -> float:
        return self.steps * STEP_S

    @property
    def mode(self) -> str:
        return self.autopilot.snapshot.mode

    def send(self, message: Any, link: Link = Link.ONBOARD) -> bytes:
        frame: bytes = message.pack(self.codecs[link])
        self.autopilot.receive(link, frame, self.now_s)
        return frame

    def listen(self, link: Link = Link.ONBOARD) -> list[Any]:
        """What the autopilot sends on `link` now."""
        datagrams = self.autopilot.transmit(link, self.now_s)
        return [message for datagram in datagrams for message in self.reader.parse_buffer(datagram) or []]

    def step(self, *repeated: Any) -> None:
        """Send, and fly on for STEP_S."""
        for message in repeated:
            self.send(message)
        self.autopilot.update(self.now_s)
        self.body.step(STEP_S)
        self.steps += 1

    def ask(self, message: Any, link: Link = Link.ONBOARD) -> list[Any]:
        """The answers to one message."""
        self.listen(link)
        self.send(message, link)
        return self.listen(link)

    def command(self, number: int, *params: float, link: Link = Link.ONBOARD) -> int:
        """The result in the acknowledgement."""
        (ack,) = (m for m in self.ask(long(number, *params), link) if m.get_type() == "COMMAND_ACK")
        assert ack.command == number
        return int(ack.result)


def long(number: int, *params: float, system: int = 1, component: int = 1) -> Any:
    return mav.MAVLink_command_long_message(system, component, number, 0, *params, *[0.0] * (7 - len(params)))
