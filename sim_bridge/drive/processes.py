"""Companions as programs of their own: `companion run`, one process each, over UDP on loopback."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import FrameType, MappingProxyType
from typing import IO

from companion.mavlink import dialect
from companion.mavlink.endpoint import COMPONENT
from companion.mavlink.framing import frames
from sim_bridge.drive.lockstep import CompanionLostError
from sim_bridge.drive.ports import LOOPBACK

PROGRAM = (sys.executable, "-m", "companion.cli")  # `companion`, whether it is on the path or not
DATAGRAM_BYTES = 65536
BUFFER_BYTES = 1 << 20
POLL_S = 0.1  # how often a silent process is looked at
ANSWER_LIMIT_S = 5.0  # wall time; a tick takes a companion less than a millisecond
HELLO_LIMIT_S = 30.0  # wall time from start to first word, on a busy machine
END_LIMIT_S = 3.0
END_POLL_S = 0.01
PR_SET_PDEATHSIG = 1  # linux/prctl.h
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # how a person, a service manager or a terminal ends a program
_TIMESYNC = struct.Struct("<qq")


class RadioSocket:
    """The hub's one socket. An address belongs to the vehicle whose companion spoke from it first."""

    def __init__(self) -> None:
        self._socket = _bound_socket()
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self._owner: dict[tuple[str, int], int] = {}
        self._address: dict[int, tuple[str, int]] = {}
        self._arrived: dict[int, list[bytes]] = {}

    def knows(self, vehicle_id: int) -> bool:
        """This vehicle's companion has spoken."""
        self._drain()
        return vehicle_id in self._address

    def send(self, vehicle_id: int, data: bytes) -> None:
        """To this vehicle's companion."""
        if data:
            _send(self._socket, data, self._address[vehicle_id])

    def receive(self, vehicle_id: int) -> bytes:
        """All that this vehicle's companion has sent since last asked."""
        self._drain()
        return b"".join(self._arrived.pop(vehicle_id, ()))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _drain(self) -> None:
        while True:
            try:
                data, address = self._socket.recvfrom(DATAGRAM_BYTES)
            except BlockingIOError:
                return
            except ConnectionError:
                continue
            owner = self._owner.get(address)
            if owner is None:
                owner = _speaker(data)
                if owner is None or owner in self._address:
                    continue
                self._owner[address] = owner
                self._address[owner] = address
            else:
                self._arrived.setdefault(owner, []).append(data)


def start_companion(
    vehicle_id: int,
    mission_file: Path,
    log_file: Path,
    *,
    autopilot_port: int,
    radio_port: int,
    clock: str,
    program: Sequence[str] = PROGRAM,
) -> subprocess.Popen[bytes]:
    """`companion run` with both links on loopback; its stderr beside `log_file`."""
    command = [
        *(*program, "run"),
        *("--mission", str(mission_file)),
        *("--id", str(vehicle_id)),
        *("--autopilot", f"udpout://{LOOPBACK}:{autopilot_port}"),
        *("--peers", f"udpout://{LOOPBACK}:{radio_port}"),
        *("--clock", clock, "--waive", "all"),
        *("--log", str(log_file)),
    ]
    with log_file.with_suffix(".err").open("wb") as errors:
        return start(command, stdout=subprocess.DEVNULL, stderr=errors)


def start(
    command: Sequence[str], *, stdout: int | IO[bytes], stderr: int | IO[bytes], folder: Path | None = None
) -> subprocess.Popen[bytes]:
    """A child in a process group of its own, which ends with this process. `folder`: where it works, if not here.

    OSError when there is no such program.
    """
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=stderr,
        cwd=folder,
        start_new_session=True,  # Ctrl-C is for the launcher, which ends its children itself
        preexec_fn=_end_with(os.getpid()) if sys.platform == "linux" else None,
    )


def fate(process: subprocess.Popen[bytes]) -> str | None:
    """How a child has ended, or None; it is not reaped, so that its process group stays its own."""
    if process.returncode is not None:
        return _fate(process.returncode)
    ended = os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    if ended is None:
        return None
    return _fate(ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status)


def end(children: Sequence[subprocess.Popen[bytes]]) -> None:
    """End children of `start` and all of their groups, by force if need be."""
    living = [child for child in children if child.returncode is None]
    for child in living:
        signal_group(child, signal.SIGTERM)
        signal_group(child, signal.SIGCONT)  # a stopped process does not see SIGTERM
    deadline_s = time.monotonic() + END_LIMIT_S
    for child in living:
        while fate(child) is None and time.monotonic() < deadline_s:
            time.sleep(END_POLL_S)
        signal_group(child, signal.SIGKILL)  # what is left of the group, too
        child.wait()


def interrupt_once() -> None:
    """The next Ctrl-C, SIGTERM or SIGHUP is a KeyboardInterrupt; more of them must not end the report of the flight."""
    # Even where a shell has set them to be ignored, as for a command in the background; not so with nohup
    for number in ENDING:
        if number is not signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def no_more_interrupts() -> None:
    """Where `interrupt_once` has been called, Ctrl-C, SIGTERM and SIGHUP have no effect from now on."""
    for number in ENDING:
        if signal.getsignal(number) is _interrupt:
            signal.signal(number, signal.SIG_IGN)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    no_more_interrupts()
    raise KeyboardInterrupt


def signal_group(child: subprocess.Popen[bytes], number: signal.Signals) -> None:
    """To a child of `start` and all that it has started; nothing where none of them lives."""
    with contextlib.suppress(ProcessLookupError, PermissionError):  # macOS refuses for a group of dead ones
        os.killpg(child.pid, number)


class CompanionProcess:
    """One `companion run --clock vehicle` and the two sockets it talks to."""

    def __init__(
        self, vehicle_id: int, mission_file: Path, log_file: Path, radio: RadioSocket, program: Sequence[str] = PROGRAM
    ) -> None:
        self._id = vehicle_id
        self._radio = radio
        self._socket = _bound_socket()
        self._address: tuple[str, int] | None = None
        self._time_ns = -1
        # The kernel wakes a blocked recv after POLL_S: one system call a datagram, and no hang on a dead process.
        seconds, fraction = divmod(POLL_S, 1.0)
        self._socket.setsockopt(
            socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", int(seconds), int(fraction * 1e6))
        )
        self.process = start_companion(
            vehicle_id,
            mission_file,
            log_file,
            autopilot_port=self._socket.getsockname()[1],
            radio_port=radio.port,
            clock="vehicle",
            program=program,
        )

    @property
    def id(self) -> int:
        """The vehicle's system id."""
        return self._id

    def meet(self, deadline_s: float) -> None:
        """Wait until it has spoken on both links; CompanionLostError when it does not by `deadline_s` (monotonic)."""
        while self._address is None or not self._radio.knows(self._id):
            data, address = self._wait(deadline_s, "never answered")
            if _speaker(data) == self._id:
                self._address = address

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float) -> None:
        """The radio's datagram first: when the autopilot's tick arrives, the other is already there."""
        assert self._address is not None
        self._time_ns = round(now_s * 1e9)
        self._radio.send(self._id, from_peers)
        _send(self._socket, from_autopilot, self._address)

    def receive(self) -> tuple[bytes, bytes]:
        """Its answer to the last tick."""
        deadline_s = time.monotonic() + ANSWER_LIMIT_S
        while True:
            answer, address = self._wait(deadline_s, f"did not answer for {ANSWER_LIMIT_S:g} s of wall time")
            # Not a late greeting: what the flight is made of must not depend on the wall clock.
            if address == self._address and _answers_timesync(answer, self._time_ns):
                return self._radio.receive(self._id), answer

    def kill(self) -> None:
        """SIGKILL."""
        signal_group(self.process, signal.SIGKILL)

    def close(self) -> None:
        """End the process, by force if need be."""
        self._socket.close()
        end([self.process])

    def _wait(self, deadline_s: float, why: str) -> tuple[bytes, tuple[str, int]]:
        while True:
            try:
                return self._socket.recvfrom(DATAGRAM_BYTES)
            except BlockingIOError:
                code = self.process.poll()
                if code is not None:
                    raise CompanionLostError(self._id, _fate(code)) from None
                if time.monotonic() > deadline_s:
                    raise CompanionLostError(self._id, why) from None
            except ConnectionError:
                continue


def launch(
    ids: Sequence[int],
    mission_file: Path,
    log_folder: Path,
    radio: RadioSocket,
    lost: Callable[[CompanionLostError], None],
    programs: Mapping[int, Sequence[str]] = MappingProxyType({}),
) -> list[CompanionProcess]:
    """Start one companion for each id and wait until each has spoken; those that never do are handed to `lost`.

    `programs`: what to start as `companion` for an id that is in it.
    """
    started: list[CompanionProcess] = []
    met = []
    try:
        for k in ids:
            log_file = log_folder / f"companion-{k}.log"
            started.append(CompanionProcess(k, mission_file, log_file, radio, programs.get(k, PROGRAM)))
        deadline_s = time.monotonic() + HELLO_LIMIT_S
        for companion in started:
            try:
                companion.meet(deadline_s)
                met.append(companion)
            except CompanionLostError as error:
                companion.close()
                lost(error)
    except BaseException:  # Ctrl-C above all: nobody is left behind
        for companion in started:
            companion.close()
        raise
    return met


def _fate(code: int) -> str:
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"


def _bound_socket() -> socket.socket:
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    bound.bind((LOOPBACK, 0))
    return bound


def _send(sender: socket.socket, data: bytes, address: tuple[str, int]) -> None:
    with contextlib.suppress(ConnectionError):  # the process at the other end has just died: `receive` finds out
        sender.sendto(data, address)


def _speaker(data: bytes) -> int | None:
    """The vehicle whose companion sent this: system id of a frame of component 191."""
    for start, end, _ in frames(data):
        if end <= len(data) and data[start + 6] == COMPONENT:
            return data[start + 5]
    return None


def _answers_timesync(data: bytes, time_ns: int) -> bool:
    for start, end, message_id in frames(data):
        if message_id == dialect.MAVLINK_MSG_ID_TIMESYNC and end <= len(data):
            payload = data[start + 10 : end - 2].ljust(_TIMESYNC.size, b"\0")
            if _TIMESYNC.unpack_from(payload)[1] == time_ns:
                return True
    return False


def _end_with(parent: int) -> Callable[[], None]:
    """To run in the child: a launcher that is killed leaves no companion behind."""

    def ask_kernel() -> None:
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:
            os._exit(1)

    return ask_kernel
