"""The loop: one thread waits on its links, feeds the endpoint, ticks it, sends what it returns.

Nothing beside this loop sends anything, so a companion that hangs or ends leaves the autopilot to its own offboard-loss
failsafe (rule 3 of CONTRIBUTING.md).
"""

from __future__ import annotations

import math
import select
import signal
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import starmap
from types import FrameType, TracebackType
from typing import Any, Self

from companion.cloud.returns_log import ReturnsLog
from companion.core.agent import TICK_S
from companion.journal.recorder import Recorder
from companion.mavlink import dialect
from companion.mavlink.codec import TIME_LIMIT_NS
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.frames import Incoming
from companion.shell.flight_log import ChangeLogger
from companion.shell.links import Link
from companion.shell.service import Service

DRAIN_MAX = 4096  # datagrams at a time: more than the kernel queues
DRAIN_S = 0.01  # a flood of any link delays a setpoint by this much at most
FLOOD_HZ = 1280.0  # datagrams of one link, more than a swarm of 50 sends: then it is read sooner again,
FLOOD_WAIT_S = 0.002  # before the kernel's queue is full and genuine ones are lost with the rest,
FLOOD_OVER_S = 0.9 * TICK_S  # until so long few came: a flood comes in bursts, and a pause of 2 ms is not its end
HELLO_S = 1.0
LEAP_NS = 600_000_000_000  # a vehicle's time may leap ahead by this much, as a simulator's does that was paused
BELIEVED_AFTER = 3  # requests in a row, else
SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """SIGINT and SIGTERM end the loop at its next turn; `fileno` wakes it."""

    def __init__(self) -> None:
        self.reason = ""
        self._before: list[tuple[signal.Signals, Any]] = []
        self._waker, self._woken = socket.socketpair()

    def __enter__(self) -> Self:
        self._waker.setblocking(False)
        self._wakeup_before = signal.set_wakeup_fd(self._waker.fileno(), warn_on_full_buffer=False)
        self._before = [(number, signal.signal(number, self._note_signal)) for number in SIGNALS]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before:
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._wakeup_before)
        self._waker.close()
        self._woken.close()

    def fileno(self) -> int:
        """For `select`: readable once a signal has come."""
        return self._woken.fileno()

    def _note_signal(self, number: int, _frame: FrameType | None) -> None:
        self.reason = signal.Signals(number).name


class Runner:
    """Drives one endpoint until `stop` has a reason."""

    def __init__(
        self,
        endpoint: Endpoint,
        autopilot: Link,
        peers: Link,
        changes: ChangeLogger,
        stop: Stop,
        service: Service,
        sensors: Mapping[str, Link],
        recorder: Recorder | None = None,
        returns: ReturnsLog | None = None,
    ) -> None:
        """`sensors`: links to drivers, by the sensor's name. `recorder`: stands before the endpoint.

        `returns`: keeps those of a survey.
        """
        self.endpoint = endpoint
        self._recorder = recorder
        self._returns = returns
        self._inputs: Endpoint | Recorder = recorder or endpoint  # takes what comes, and ticks
        self.now_s: float | None = None  # of the clock in use, at the last tick
        self.ticks = 0
        self.missed = 0  # ticks that were skipped
        self._is_flooded = False  # by a link
        self._counted_s = float("-inf")  # since then,
        self._count = 0  # so many datagrams of one link
        self._autopilot = autopilot
        self._peers = peers
        self._sensors = sensors
        self._changes = changes
        self._stop = stop
        self._service = service

    def by_monotonic(self) -> None:
        """20 Hz by this computer's monotonic clock.

        What comes between two ticks is taken in with the next, as in lockstep: to wake for each message costs more than
        the tick itself. What a flood has left over is taken in at once, before the next sleep.
        """
        deadline_s = time.monotonic()
        wait_s = math.inf
        while not self._stop.reason:
            self._wait(min(wait_s, deadline_s - time.monotonic()))
            now_s = time.monotonic()
            wait_s = self._drain(now_s, max(deadline_s, now_s + DRAIN_S))
            if now_s >= deadline_s:
                self._tick(now_s)
                periods = math.floor((now_s - deadline_s) / TICK_S) + 1
                self.missed += periods - 1
                deadline_s += periods * TICK_S
                self._service.alive(now_s, self._changes.status_line)

    def by_vehicle(self, hello: bytes) -> None:
        """One tick for each TIMESYNC request of the autopilot, whose time is the clock.

        `hello` goes out on all links once a second until the first request, so that the other ends learn this address.
        The output is a function of the datagrams alone.
        """
        clock = VehicleClock(self.endpoint)
        hello_s = time.monotonic()
        while not self._stop.reason:
            turn_s = time.monotonic()
            self._service.alive(turn_s, self._changes.status_line)
            wait_s = min(HELLO_S, self._service.period_s)
            if self.now_s is None:
                if turn_s >= hello_s:
                    self._say_hello(hello)
                    hello_s += HELLO_S
                wait_s = min(wait_s, hello_s - time.monotonic())
            self._wait(wait_s, self._autopilot.fileno())
            data = self._autopilot.recv()  # one at a time: in lockstep there is no second, and to look costs a call
            if data is not None:
                self._from_vehicle(data, clock)
            self._changes.log_links(self.now_s)

    def _from_vehicle(self, data: bytes, clock: VehicleClock) -> None:
        """Neighbours and sensor, then the autopilot, all at the time of the request in `data`: as in one process."""
        messages = self._inputs.read_autopilot(data)
        has_request = clock.peek(messages)
        if has_request:
            self._drain_others(clock.now_s)
        self._inputs.autopilot_says(messages, clock.now_s)
        if clock.advanced():
            if not has_request:
                self._drain_others(clock.now_s)
            self._tick(clock.now_s)

    def _say_hello(self, hello: bytes) -> None:
        for link, _ in self._others():  # what is from before there is a time is too old to be of use when there is one
            for _ in range(DRAIN_MAX):
                if link.recv() is None:
                    break
            link.send(hello)
        self._autopilot.send(hello)

    def _wait(self, wait_s: float, fd: int = -1) -> None:
        """Not `selectors`: a serial port that is opened again has another descriptor."""
        waiting = (self._stop.fileno(),) if fd < 0 else (fd, self._stop.fileno())
        select.select(waiting, (), (), max(0.0, wait_s))

    def _drain(self, now_s: float, until_s: float) -> float:
        """The links by turns, of equal time: a flood of one starves neither others nor ticks. How long it can wait, s.

        Not of equal datagrams: the autopilot's would wait for as many of the dearest that a radio can be sent.
        """
        turns = [_Turns(self._autopilot, self._inputs.from_autopilot), *starmap(_Turns, self._others())]
        most = 0  # datagrams of one link
        began_s = time.monotonic()
        while turns:
            one = min(turns, key=_Turns.order)
            data = one.link.recv()
            if data is None:
                turns.remove(one)
                continue
            one.receive(data, now_s)
            ended_s = time.monotonic()
            one.count += 1
            one.spent_s, began_s = one.spent_s + ended_s - began_s, ended_s
            most = max(most, one.count)
            if ended_s >= until_s or most >= DRAIN_MAX:
                return 0.0
        self._count += most
        is_over = now_s - self._counted_s >= FLOOD_OVER_S
        if self._count > FLOOD_HZ * TICK_S:
            self._is_flooded = True
        elif is_over:
            self._is_flooded = False
        if is_over:
            self._count, self._counted_s = 0, now_s
        return FLOOD_WAIT_S if self._is_flooded else math.inf

    def _others(self) -> list[tuple[Link, Callable[[bytes, float], None]]]:
        """The links but the autopilot's, and what takes the bytes of each."""
        sensors = [(link, partial(self._inputs.from_sensor, link=name)) for name, link in self._sensors.items()]
        return [(self._peers, self._inputs.from_peers), *sensors]

    def _drain_others(self, now_s: float) -> None:
        for link, receive in self._others():
            for _ in range(DRAIN_MAX):
                data = link.recv()
                if data is None:
                    break
                receive(data, now_s)

    def _tick(self, now_s: float) -> None:
        out = self._inputs.tick(now_s)
        if out.peers:
            self._peers.send(out.peers)
        for datagram in out.records:
            self._peers.send(datagram)
        if out.autopilot:
            self._autopilot.send(out.autopilot)
        for link in self._sensors.values() if out.sensor else ():
            link.send(out.sensor)
        self.now_s = now_s
        self.ticks += 1
        self._changes.log_changes(now_s, out.said)
        if self._recorder is not None:
            self._changes.log_lines(now_s, self._recorder.take_lines())
        if self._returns is not None:
            self._returns.append(self.endpoint.take_returns())
            self._changes.log_lines(now_s, self._returns.take_lines())


class _Turns:
    """One link's, while all are drained."""

    __slots__ = ("count", "link", "receive", "spent_s")

    def __init__(self, link: Link, receive: Callable[[bytes, float], None]) -> None:
        self.link = link
        self.receive = receive
        self.count = 0  # datagrams
        self.spent_s = 0.0  # on them

    def order(self) -> tuple[float, int]:
        """The least is next."""
        return self.spent_s, self.count


class VehicleClock:
    """The time in seconds, as the autopilot's TIMESYNC requests tell it; it never goes back.

    `peek` finds the time of a request before its datagram is heard, so that the events in front of it count as of that
    time; `advanced` tells whether the endpoint has heard one.
    A time that is not just ahead of the last one is no tick, unless a few requests in a row go on from it: then the
    vehicle has started again, and its time goes on from here.
    """

    __slots__ = ("_ahead_ns", "_doubted_count", "_doubted_ns", "_endpoint", "_last_ns", "now_s")

    def __init__(self, endpoint: Endpoint) -> None:
        self.now_s = 0.0
        self._endpoint = endpoint
        self._last_ns: int | None = None  # of the vehicle, at the last tick; a vehicle's time may start at 0
        self._ahead_ns = 0  # `now_s` is ahead of the vehicle's time by this, once that has started again
        self._doubted_ns: int | None = None
        self._doubted_count = 0

    def peek(self, messages: Sequence[Incoming]) -> bool:
        """True if there is a newer request among `messages`; `now_s` is then its time."""
        newest_ns = None
        for said in reversed(messages):  # the last counts, as for the endpoint
            if said.message_id != dialect.MAVLINK_MSG_ID_TIMESYNC or said.message.tc1 != 0:
                continue
            if said.system == self._endpoint.id and said.component == dialect.MAV_COMP_ID_AUTOPILOT1:
                newest_ns = said.message.ts1
                break
        if newest_ns is None or not self._goes_on(self._last_ns, newest_ns):
            return False
        self.now_s = (newest_ns + self._ahead_ns) / 1e9
        return True

    def advanced(self) -> bool:
        """True if the endpoint has seen a newer request; `now_s` is then its time."""
        time_ns, self._endpoint.requested_ns = self._endpoint.requested_ns, None
        if time_ns is None:
            return False
        if not self._goes_on(self._last_ns, time_ns):
            if not self._has_started_again(time_ns):
                return False
            self._ahead_ns = round(self.now_s * 1e9) + round(TICK_S * 1e9) - time_ns
        self._last_ns, self._doubted_ns = time_ns, None
        self.now_s = (time_ns + self._ahead_ns) / 1e9
        return True

    @staticmethod
    def _goes_on(last_ns: int | None, time_ns: int) -> bool:
        if not 0 <= time_ns < TIME_LIMIT_NS:
            return False
        return last_ns is None or 0 < time_ns - last_ns <= LEAP_NS

    def _has_started_again(self, time_ns: int) -> bool:
        """Count the requests that do not go on from the last tick's, but from one another."""
        in_a_row = self._doubted_ns is not None and self._goes_on(self._doubted_ns, time_ns)
        self._doubted_count = self._doubted_count + 1 if in_a_row else 1
        self._doubted_ns = time_ns if 0 <= time_ns < TIME_LIMIT_NS else None
        return self._doubted_count >= BELIEVED_AFTER
