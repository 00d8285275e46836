"""What a flight leaves behind for people: a line for each change, none for a tick.

Losing lines never stops a flight.
"""

from __future__ import annotations

import os
import select
from collections.abc import Iterable, Sequence

from companion.core.model.actions import Say
from companion.mavlink.endpoint import Endpoint
from companion.shell.links import Link
from mission.common.problems import printable

COUNTERS_S = 10.0  # counters that grow are shown this often at most
MAX_TEXT_CHARS = 300


class FlightLog:
    """Lines to a file descriptor, at once and unbuffered; what cannot be written is counted in `lost`."""

    __slots__ = ("_fd", "_unreported", "lost")

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self.lost = 0
        self._unreported = 0

    def line(self, now_s: float | None, text: str) -> None:
        """`now_s`: of the flight's clock; None before it runs. Text is made printable and short."""
        if self._unreported:
            text = f"{text} ({self._unreported} lines before this one were lost)"
        if self._write(now_s, printable(text, MAX_TEXT_CHARS)):
            self._unreported = 0
        else:
            self.lost += 1
            self._unreported += 1

    def broken(self, now_s: float | None, traceback: str) -> None:
        """A broken invariant, in full."""
        self._write(now_s, f"broken invariant, the companion ends\n{traceback.rstrip()}")

    def _write(self, now_s: float | None, text: str) -> bool:
        clock = "         -" if now_s is None else f"{now_s:10.3f}"
        data = f"[{clock}] {text}\n".encode(errors="backslashreplace")
        try:
            # A pipe that nobody empties would stop the loop. Writable: at least 4 KiB go without waiting.
            if not select.select([], [self._fd], [], 0.0)[1]:
                return False
            return os.write(self._fd, data) == len(data)
        except OSError:  # a full disk, a closed pipe
            return False


class ChangeLogger:
    """Notices changes of one companion, and logs them."""

    def __init__(
        self, log: FlightLog, endpoint: Endpoint, autopilot: Link, peers: Link, sensor: Link | None = None
    ) -> None:
        self._log = log
        self._endpoint = endpoint
        self._autopilot = autopilot
        self._peers = peers
        self._sensor = sensor
        self._status = endpoint.agent.status(0.0)  # of the last tick
        self._leader: int | None = None
        self._foreign: frozenset[int] = frozenset()
        self._foreign_sensors: frozenset[int] = frozenset()
        self._foreign_radios: frozenset[int] = frozenset()
        self._sensors: dict[int, bool] = {}  # that were heard -> whether what they told last is fresh
        self._up = autopilot.up
        self._sensor_up = sensor is None or sensor.up
        self._counters = self.counters()
        self._counters_s = float("-inf")

    def tick(self, now_s: float, said: Sequence[Say]) -> None:
        """After each tick."""
        for say in said:
            self._log.line(now_s, f"{say.severity.name.lower()}: {say.text}")
        before, self._status = self._status, self._endpoint.agent.status(now_s)
        if self._status.state is not before.state:
            self._log.line(now_s, f"state {before.state.name.lower()} -> {self._status.state.name.lower()}")
        self._watch_leader(now_s)
        self._watch_foreign(now_s)
        if self._endpoint.scans is not None:
            self._watch_sensors(now_s)
        self._watch_drivers(now_s)
        self.links(now_s)
        if now_s - self._counters_s >= COUNTERS_S:
            self._watch_counters(now_s)

    def links(self, now_s: float | None) -> None:
        """Also where there are no ticks."""
        up = self._autopilot.up
        if up is not self._up:
            self._log.line(
                now_s, "autopilot link is there" if up else "autopilot link lost: reopening until it is there"
            )
            self._up = up
        if self._sensor is not None and self._sensor.up is not self._sensor_up:
            self._sensor_up = self._sensor.up
            how = "is there" if self._sensor_up else "lost: reopening until it is there"
            self._log.line(now_s, f"obstacle sensor's link {how}")

    def status(self) -> str:
        """The flight at a glance. The installer reads the state: no upgrade of a vehicle in the air."""
        leader = "none" if self._leader is None else f"vehicle {self._leader}"
        link = "" if self._up else ", no autopilot link"
        link += "" if self._sensor_up else ", no obstacle sensor's link"
        grounded = f", GROUNDED: {self._status.grounded}" if self._status.grounded else ""
        cuts = "; ".join(f"{cut.reason.value} {cut.by_mps:.1f} m/s" for cut in self._endpoint.agent.setpoint.cuts())
        state = f"state {self._status.state.name.lower()}, leader {leader}{link}{grounded}"
        return f"vehicle {self._endpoint.id}: {state}" + (f", setpoint cut by: {cuts}" if cuts else "")

    def counters(self) -> dict[str, int]:
        """What was bad so far."""
        endpoint = self._endpoint
        found = {
            "bad frames of the autopilot": endpoint.autopilot.bad,
            "datagrams of the peers without a beacon": endpoint.datagrams_without_beacon,
            "signed beacons refused": endpoint.peers_gate.refused,
            "contents refused": endpoint.codec.dropped,
            "beacons of another version": endpoint.codec.other_versions,
            "errors of the autopilot link": self._autopilot.errors,
            "of the peers' link": self._peers.errors,
        }
        if endpoint.scans is not None:
            found["scans refused"] = endpoint.scans.refused
            found["scans without attitude"] = endpoint.scans.without_attitude
        if self._sensor is not None:
            found["bad frames of the obstacle sensor"] = endpoint.sensor.bad
            found["errors of its link"] = self._sensor.errors
        return found

    def _watch_leader(self, now_s: float) -> None:
        leader = self._status.leader or None
        if leader is None and self._leader is not None:  # a new one is said by the agent
            self._log.line(now_s, f"leader: none any more (it was vehicle {self._leader})")
        self._leader = leader

    def _watch_foreign(self, now_s: float) -> None:
        foreign = self._endpoint.foreign_autopilots
        for system in sorted(foreign - self._foreign):
            self._log.line(
                now_s,
                f"the autopilot of vehicle {system} is on this link of vehicle {self._endpoint.id}: wrong --id?",
            )
        self._foreign = foreign

    def _watch_sensors(self, now_s: float) -> None:
        before, self._sensors = self._sensors, self._endpoint.agent.sensors.sensors(now_s)
        for sensor, fresh in self._sensors.items():
            if before.get(sensor) is not fresh:
                how = ("heard again" if sensor in before else "heard") if fresh else "lost: no scan that is fresh"
                self._log.line(now_s, f"obstacle sensor {sensor} (component): {how}")

    def _watch_drivers(self, now_s: float) -> None:
        sensors, radios = self._endpoint.foreign_sensors, self._endpoint.foreign_radios
        self._tell_foreign("an obstacle sensor", sensors - self._foreign_sensors, now_s)
        self._tell_foreign("a range radio", radios - self._foreign_radios, now_s)
        self._foreign_sensors, self._foreign_radios = sensors, radios

    def _tell_foreign(self, what: str, systems: Iterable[int], now_s: float) -> None:
        for system in sorted(systems):
            self._log.line(
                now_s,
                f"{what} of system {system} is on a link of vehicle {self._endpoint.id}, and is not heard: "
                f"its driver's system id must be {self._endpoint.id}",
            )

    def _watch_counters(self, now_s: float) -> None:
        counters = self.counters()
        if counters != self._counters:
            self._log.line(now_s, summary(counters))
        self._counters, self._counters_s = counters, now_s


def summary(counters: dict[str, int]) -> str:
    """As one line."""
    return ", ".join(f"{name} {count}" for name, count in counters.items())
