"""Signing of the autopilot's link, seen and not assumed: signed frames come, and who has no key gets no answer.

An autopilot may be set to sign and take everything all the same: PX4 of 2025 and 2026 did while its key was missing,
ArduPilot does on its first port. So it is asked three times for a harmless message: unsigned, by another key, by its
key.
"""

from __future__ import annotations

import os
import select
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Final, Self

from companion.mavlink import dialect
from companion.mavlink.autopilot_link.signing import LinkSigning
from companion.mavlink.endpoint import COMPONENT, heartbeat
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import MAGIC_V2, find_frame, source, whole
from companion.mavlink.peers.frame_mac import is_signed
from companion.preflight.report import Check, Verdict
from companion.shell.links import Link
from companion.shell.urls import Scheme, Url

LISTEN_S: Final = 3.0  # an autopilot sends a heartbeat a second
ANSWER_S: Final = 1.5
ASK_S: Final = 0.4  # asked again, as a datagram may be lost
HELLO_S: Final = 0.5
SETTLE_S: Final = 0.5  # after the key was given
SETUPS: Final = 2  # as ground stations do: there is no acknowledgement
AUTOPILOT: Final = 1  # MAV_COMP_ID_AUTOPILOT1
ASKED: Final = dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION
WANTED: Final = "it signs by this vehicle's key, and answers nobody without"
GIVE_FIX: Final = "give it the key: `companion preflight --sign-autopilot --apply`, by a wire that nobody else hears"
NO_KEY_FIX: Final = "with --sign-autopilot, here and of `companion run`: without, nothing of it is read, set or flown"
TAKES_ALL_FIX: Final = (
    "who reaches that port commands it. PX4: is its key there (SD card)? ArduPilot: its first port (USB) takes all: "
    "fly by another one"
)


class FrameStream:
    """Whole frames of one link, of any message. `is_stream`: bytes may break anywhere (serial)."""

    def __init__(self, *, is_stream: bool) -> None:
        self._is_stream = is_stream
        self._tail = b""

    def split_frames(self, data: bytes) -> list[bytes]:
        """Possible frames: only a signature says that one is."""
        data, self._tail = self._tail + data, b""
        found: list[bytes] = []
        at = 0
        while at < len(data):
            start, end, _ = find_frame(data, at)
            if end > len(data):
                self._tail = data[start:] if self._is_stream else b""
                break
            if start < end:
                found.append(data[start:end])
            at = end
        return found


@dataclass(slots=True)
class Heard:
    """Frames of the autopilot in a time: by the key, and not; its last HEARTBEAT's mode; its answers."""

    signed: int = 0
    others: int = 0
    sealed: int = 0  # of those, by another key
    armed: bool = False
    answers: int = 0


class SigningProbe:
    """One look at an autopilot by an open link."""

    def __init__(self, link: Link, gate: LinkSigning, vehicle_id: int, *, is_stream: bool) -> None:
        """`gate`: of the vehicle's key."""
        self._link, self._gate, self._vehicle_id = link, gate, vehicle_id
        self._frames = FrameStream(is_stream=is_stream)
        self._sender = wire.Sender(vehicle_id, COMPONENT)
        self.is_signed = False  # frames by the key have come

    def give_key(self, key: bytes) -> bool:
        """SETUP_SIGNING, to an autopilot that is heard and not armed; it is in clear text on the link."""
        heard = self._listen(LISTEN_S, lambda _heard: False)
        if heard.armed or not heard.others or heard.signed:
            return False
        setup = dialect.MAVLink_setup_signing_message(self._vehicle_id, AUTOPILOT, list(key), self._gate.timestamp)
        for _ in range(SETUPS):
            self._link.send(self._sender.pack(setup))
        self._listen(SETTLE_S, lambda _heard: False)
        return True

    def check(self) -> Check:
        """The row `signing`."""
        heard = self._listen(LISTEN_S, lambda _heard: False)
        self.is_signed = heard.signed > 0
        counts = f"{heard.signed} frames signed, {heard.others} not"
        if not heard.signed:
            why = "nothing is heard" if not heard.others else f"{counts}: by another key, or not at all"
            return _row(Verdict.FAIL, why, GIVE_FIX)
        stranger = LinkSigning(os.urandom(32), timestamp=self._gate.timestamp)
        if self._is_answered(lambda frame, _now_s: frame):
            return _row(Verdict.FAIL, f"{counts}; it answers UNSIGNED requests", TAKES_ALL_FIX)
        if self._is_answered(stranger.seal):
            return _row(Verdict.FAIL, f"{counts}; it answers requests signed by ANOTHER key", TAKES_ALL_FIX)
        if not self._is_answered(self._gate.seal):
            return _row(Verdict.FAIL, f"{counts}; it does not answer signed requests", GIVE_FIX)
        if heard.others:
            return _row(Verdict.FAIL, f"{counts}, of the autopilot: two keys, or two autopilots", GIVE_FIX)
        return _row(Verdict.PASS, f"{counts}; unsigned and wrongly signed requests are refused, signed ones answered")

    def find_signatures(self) -> Check | None:
        """The row of an autopilot that has answered nothing to one without a key; None: it does not sign."""
        heard = self._listen(LISTEN_S, lambda heard: heard.sealed > 0)
        if not heard.sealed:
            return None
        return _row(Verdict.FAIL, "its frames are signed, and it has answered nothing that was not", NO_KEY_FIX)

    def _is_answered(self, seal: Callable[[bytes, float], bytes]) -> bool:
        """A request for AUTOPILOT_VERSION, which changes nothing."""
        request = dialect.MAVLink_command_long_message(
            self._vehicle_id, AUTOPILOT, dialect.MAV_CMD_REQUEST_MESSAGE, 0, ASKED, *(0.0,) * 6
        )

        def send_request() -> None:
            self._link.send(seal(self._sender.pack(request), time.monotonic()))

        return self._listen(ANSWER_S, lambda heard: heard.answers > 0, send_request).answers > 0

    def _listen(self, seconds: float, is_done: Callable[[Heard], bool], ask: Callable[[], None] | None = None) -> Heard:
        """Counts what the autopilot sends for so long, or until `is_done`; calls `ask` each ASK_S."""
        heard = Heard()
        now_s = time.monotonic()
        end_s, hello_s, ask_s = now_s + seconds, now_s, now_s
        while now_s < end_s and not is_done(heard):
            if now_s >= hello_s:
                hello_s = now_s + HELLO_S
                self._link.send(self._gate.seal(self._sender.pack(heartbeat()), now_s))
            if ask is not None and now_s >= ask_s:
                ask_s = now_s + ASK_S
                ask()
            due_s = min(hello_s, end_s, end_s if ask is None else ask_s)
            select.select([fd for fd in (self._link.fileno(),) if fd >= 0], [], [], max(0.0, due_s - now_s))
            while (data := self._link.recv()) is not None:
                for frame in self._frames.split_frames(data):
                    self._note(frame, heard)
            now_s = time.monotonic()
        return heard

    def _note(self, frame: bytes, heard: Heard) -> None:
        if source(frame) != (self._vehicle_id, AUTOPILOT):
            return
        is_foreign = self._gate.is_foreign(frame)
        heard.signed += self._gate.admits(frame)
        try:
            message = wire.decode(frame)
        except dialect.MAVError:  # of no message that is known, or none at all
            return
        heard.others += is_foreign
        heard.sealed += is_foreign and is_signed(frame)
        message_id = message.get_msgId()  # some messages have a field named id
        if message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            heard.armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        answers = (
            message_id == dialect.MAVLINK_MSG_ID_COMMAND_ACK and message.command == dialect.MAV_CMD_REQUEST_MESSAGE
        )
        heard.answers += answers or message_id == ASKED


class SigningRelay:
    """Lets a program that cannot sign speak by a signed link: it is at `url`, on loopback, while this is entered."""

    def __init__(self, link: Link, gate: LinkSigning, *, is_stream: bool) -> None:
        self._link, self._gate = link, gate
        self._frames = FrameStream(is_stream=is_stream)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._stop, self._stopped = socket.socketpair()
        self._other_end: tuple[str, int] | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def url(self) -> Url:
        """Address for the other program to connect to."""
        return Url(Scheme.UDP_OUT, "127.0.0.1", self._socket.getsockname()[1])

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.send(b".")
        self._thread.join()
        for each in (self._stop, self._stopped, self._socket):
            each.close()

    def _run(self) -> None:
        while True:
            fds = [fd for fd in (self._link.fileno(),) if fd >= 0]
            stopped = self._stopped.fileno()
            ready, _, _ = select.select([*fds, self._socket.fileno(), stopped], [], [])
            if stopped in ready:
                return
            while (data := self._link.recv()) is not None:
                self._hand_in(data)
            self._hand_out()

    def _hand_in(self, data: bytes) -> None:
        signed = b"".join([frame for frame in self._frames.split_frames(data) if self._gate.admits(frame)])
        if signed and self._other_end is not None:
            self._socket.sendto(signed, self._other_end)

    def _hand_out(self) -> None:
        while True:
            try:
                data, self._other_end = self._socket.recvfrom(65536)
            except (BlockingIOError, ConnectionError):
                return
            for start, end, message_id in whole(data):
                if data[start] == MAGIC_V2 and message_id in dialect.mavlink_map:
                    self._link.send(self._gate.seal(data[start:end], time.monotonic()))


def _row(verdict: Verdict, found: str, fix: str = "") -> Check:
    return Check(name="signing", verdict=verdict, found=found, wanted=WANTED, fix=fix)
