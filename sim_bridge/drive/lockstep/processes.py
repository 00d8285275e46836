"""Companions as programs of their own: `companion run`, one process each, over UDP on loopback."""

from __future__ import annotations

import contextlib
import resource
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from types import MappingProxyType

from companion.mavlink import dialect
from companion.mavlink.endpoint import COMPONENT
from companion.mavlink.framing.frames import source, whole
from sim_bridge.drive import children
from sim_bridge.drive.children import Child, ForkClient
from sim_bridge.drive.links.ports import LOOPBACK
from sim_bridge.drive.lockstep.lockstep import CompanionLostError

# `companion`, whether it is on the path or not; -P: a folder of that name where we work is not it
PROGRAM = (sys.executable, "-P", "-m", "companion")
DATAGRAM_BYTES = 65536
BUFFER_BYTES = 1 << 20
POLL_S = 0.1  # how often a silent process is looked at
ANSWER_LIMIT_S = 5.0  # wall time; a tick takes a companion less than a millisecond
HELLO_LIMIT_S = 30.0  # wall time from start to first word, on a busy machine
_TIMESYNC = struct.Struct("<qq")


class RadioSocket:
    """One socket for one link of all companions: their radio, or their obstacle sensors.

    An address belongs to the vehicle whose companion spoke from it first.
    """

    def __init__(self) -> None:
        self._socket = _bound_socket()
        self._socket.setblocking(False)
        self._ready = select.poll()  # asking costs a third of a read that finds nothing
        self._ready.register(self._socket, select.POLLIN)
        self.port: int = self._socket.getsockname()[1]
        self._owner: dict[tuple[str, int], int] = {}
        self._address: dict[int, tuple[str, int]] = {}
        self._arrived: dict[int, list[bytes]] = {}

    def knows(self, vehicle_id: int) -> bool:
        """This vehicle's companion has spoken."""
        self._drain()
        return vehicle_id in self._address

    def forget(self, vehicle_id: int) -> None:
        """This vehicle's companion has ended: the next that speaks as such is it."""
        self._drain()
        self._arrived.pop(vehicle_id, None)
        address = self._address.pop(vehicle_id, None)
        if address is not None:
            del self._owner[address]

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
        while self._ready.poll(0):
            try:
                data, address = self._socket.recvfrom(DATAGRAM_BYTES)
            except (BlockingIOError, ConnectionError):
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
    program: Sequence[str] | ForkClient = PROGRAM,
    sensor_ports: Mapping[str, int] = MappingProxyType({}),
    records_file: Path | None = None,
    key_file: Path | None = None,
    black_box: Path | None = None,
) -> Child:
    """`companion run` with its links on loopback; its stderr beside `log_file`. StartError, OSError.

    `program`: what to execute as `companion`, or where to fork it. `sensor_ports`: of sensors' drivers, by their names.
    `records_file`: of a mission that surveys. `key_file`: this vehicle's, in a swarm with keys; None: unsigned.
    `black_box`: folder of black boxes.
    """
    files = [] if records_file is None else ["--records", str(records_file)]
    files += [] if black_box is None else ["--black-box", str(black_box)]
    sensors = [("--sensor", f"{name}=udpout://{LOOPBACK}:{port}") for name, port in sensor_ports.items()]
    arguments = [
        *("run", "--mission", str(mission_file)),
        *("--id", str(vehicle_id)),
        *("--autopilot", f"udpout://{LOOPBACK}:{autopilot_port}"),
        *("--peers", f"udpout://{LOOPBACK}:{radio_port}"),
        *chain.from_iterable(sensors),
        *("--clock", clock, "--waive", "all"),
        *(("--unsigned",) if key_file is None else ("--key", str(key_file))),
        *("--log", str(log_file)),
        *files,
    ]
    error_file = log_file.with_suffix(".err")
    if isinstance(program, ForkClient):
        return program.fork(arguments, error_file)
    with error_file.open("wb") as errors:
        # SIGKILL: one that is stopped does not see SIGTERM
        return children.start([*program, *arguments], stdout=subprocess.DEVNULL, stderr=errors, orphaned=signal.SIGKILL)


def fill_disk(process: Child, *, full: bool) -> None:
    """Let a companion's writes to files fail as on a full disk (EFBIG for ENOSPC: by its limit of file sizes)."""
    with contextlib.suppress(ProcessLookupError):
        _, hard = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (0 if full else hard, hard))


class CompanionProcess:
    """One `companion run --clock vehicle` and the sockets it talks to."""

    def __init__(
        self,
        vehicle_id: int,
        mission_file: Path,
        log_file: Path,
        radio: RadioSocket,
        program: Sequence[str] | ForkClient,
        drivers: RadioSocket | None = None,
        sensor: str = "",
        records_file: Path | None = None,
        key_file: Path | None = None,
        black_box: Path | None = None,
    ) -> None:
        """`drivers`: where all its sensors' drivers send from, on the link of `sensor`; None: it has none.

        `records_file`: of a mission that surveys; `key_file`: of a swarm with keys. `black_box`: folder of black boxes.
        """
        self._id = vehicle_id
        self._radio = radio
        self._drivers = drivers
        self._socket = _bound_socket()
        self._connected = False
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
            sensor_ports={} if drivers is None else {sensor: drivers.port},
            records_file=records_file,
            key_file=key_file,
            black_box=black_box,
        )

    @property
    def id(self) -> int:
        """The vehicle's system id."""
        return self._id

    def fileno(self) -> int:
        """Of the socket that stands for its autopilot."""
        return self._socket.fileno()

    def meet(self, deadline_s: float) -> None:
        """Wait until it has spoken on all links; CompanionLostError when it does not by `deadline_s` (monotonic)."""
        others = [shared for shared in (self._radio, self._drivers) if shared is not None]
        while not self._connected or not all(shared.knows(self._id) for shared in others):
            data, address = self._wait(deadline_s, "never answered")
            if _speaker(data) == self._id and not self._connected:
                self._socket.connect(address)  # from now on nobody else is heard, and a send finds its way at once
                self._connected = True

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes = b"") -> None:
        """The autopilot's datagram last: when its tick arrives, the others are already there."""
        self._time_ns = round(now_s * 1e9)
        self._radio.send(self._id, from_peers)
        if self._drivers is not None:
            self._drivers.send(self._id, from_sensor)
        _send(self._socket, from_autopilot)

    def receive(self) -> tuple[bytes, bytes]:
        """Its answer to the last tick."""
        deadline_s = time.monotonic() + ANSWER_LIMIT_S
        while True:
            answer, _ = self._wait(deadline_s)
            # Not a late greeting: what the flight is made of must not depend on the wall clock.
            if _answers_timesync(answer, self._time_ns):
                return self._radio.receive(self._id), answer

    def kill(self) -> None:
        """SIGKILL."""
        children.signal_group(self.process, signal.SIGKILL)

    def fill_disk(self, *, full: bool) -> None:
        """Its writes fail."""
        fill_disk(self.process, full=full)

    def close(self) -> None:
        """End the process, by force if need be."""
        self._socket.close()
        children.end([self.process])

    def _wait(self, deadline_s: float, why: str = "") -> tuple[bytes, tuple[str, int]]:
        while True:
            try:
                return self._socket.recvfrom(DATAGRAM_BYTES)
            except BlockingIOError:
                how = children.fate(self.process)
                if how is not None:
                    raise CompanionLostError(self._id, how) from None
                if time.monotonic() > deadline_s:
                    why = why or f"did not answer for {ANSWER_LIMIT_S:g} s of wall time"
                    raise CompanionLostError(self._id, why) from None
            except ConnectionError:
                continue


@dataclass(frozen=True, slots=True)
class Launcher:
    """Starts companions, and tells each of its links.

    They are forked from `forks`; `programs`: what to execute as `companion` for an id that is in it; `drivers`: of
    their sensors, where there are any, on the link of `sensor`; `records_file`: of one vehicle, where the mission has
    records, the same when its companion starts again; `key_file`: of one vehicle, where the swarm has keys.
    """

    mission_file: Path
    log_folder: Path
    radio: RadioSocket
    forks: ForkClient
    programs: Mapping[int, Sequence[str]] = field(default_factory=dict)
    drivers: RadioSocket | None = None
    sensor: str = ""
    records_file: Callable[[int], Path | None] = lambda _vehicle_id: None
    key_file: Callable[[int], Path | None] = lambda _vehicle_id: None
    black_box: Path | None = None  # folder of black boxes

    def launch(
        self,
        ids: Sequence[int],
        lost: Callable[[CompanionLostError], None],
        met_so_far: Callable[[int], None] = lambda _count: None,
    ) -> list[CompanionProcess]:
        """Start one for each id and wait until each has spoken; those that never do are handed to `lost`."""
        started: list[CompanionProcess] = []
        met = []
        try:
            for k in ids:
                started.append(self._start(k, self.log_folder / f"companion-{k}.log"))
            deadline_s = time.monotonic() + HELLO_LIMIT_S
            for companion in started:
                try:
                    companion.meet(deadline_s)
                    met.append(companion)
                    met_so_far(len(met))
                except CompanionLostError as error:
                    companion.close()
                    lost(error)
        except BaseException:  # Ctrl-C above all: nobody is left behind
            for companion in started:
                companion.close()
            raise
        return met

    def start_again(self, vehicle_id: int) -> CompanionProcess:
        """Another one for a vehicle whose companion has ended. CompanionLostError when it never speaks."""
        for shared in (self.radio, self.drivers):
            if shared is not None:
                shared.forget(vehicle_id)
        count = len(list(self.log_folder.glob(f"companion-{vehicle_id}*.log")))
        companion = self._start(vehicle_id, self.log_folder / f"companion-{vehicle_id}-{count + 1}.log")
        try:
            companion.meet(time.monotonic() + HELLO_LIMIT_S)
        except BaseException:
            companion.close()
            raise
        return companion

    def _start(self, vehicle_id: int, log_file: Path) -> CompanionProcess:
        program = self.programs.get(vehicle_id, self.forks)
        return CompanionProcess(
            vehicle_id,
            self.mission_file,
            log_file,
            self.radio,
            program,
            self.drivers,
            self.sensor,
            self.records_file(vehicle_id),
            self.key_file(vehicle_id),
            self.black_box,
        )


def _bound_socket() -> socket.socket:
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    bound.bind((LOOPBACK, 0))
    return bound


def _send(sender: socket.socket, data: bytes, address: tuple[str, int] | None = None) -> None:
    """`address` None: to where it is connected."""
    try:
        if address is None:
            sender.send(data)
        else:
            sender.sendto(data, address)
    except ConnectionError:
        pass  # the process at the other end has just died: `receive` finds out


def _speaker(data: bytes) -> int | None:
    """The vehicle whose companion sent this: system id of a frame of component 191."""
    for start, _, _ in whole(data):
        system, component = source(data, start)
        if component == COMPONENT:
            return system
    return None


def _answers_timesync(data: bytes, time_ns: int) -> bool:
    for start, _, message_id in whole(data):
        if message_id == dialect.MAVLINK_MSG_ID_TIMESYNC:
            payload = data[start + 10 : start + 10 + data[start + 1]].ljust(_TIMESYNC.size, b"\0")
            if _TIMESYNC.unpack_from(payload)[1] == time_ns:
                return True
    return False
