"""Log of a flight for people: a line for each change, none for a tick.

Losing lines never stops a flight.
"""

from __future__ import annotations

import math
import os
import select
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from companion.core.model.actions import Say, brief
from companion.core.model.states import Severity
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.signing import Gate
from companion.mavlink.sensor_source import SensorSource
from companion.shell.floods import FloodLog
from companion.shell.links import Link
from mission.common.problems import printable

COUNTERS_S = 10.0  # counters that grow are shown this often at most
RECORDS_S = 60.0  # and how far the records are, which grow all the time
MAX_TEXT_CHARS = 300
UNANSWERED_S = 3.0  # it is asked for its time several times a second
UNSIGNED = "the autopilot signs, and answers nothing that is not signed: fly with --sign-autopilot"
FEW = 0.9  # of a neighbour's beacons: fewer in a flood, and the operator is told
UNSEEN_S: Final = 10.0  # nothing tells it for so long, though there is something to see: the operator is told
AGAIN_S: Final = 5.0  # and it is told for so long, until that is said
LOOKS_S: Final = 1.0  # so often it is asked whether there is something to see
CORRECTED: Final = "own motion: corrected by trunks in sight"
UNSEEN: Final = Say(Severity.WARNING, "own motion as reported: too few trunks in sight")
NO_LINKS: Mapping[str, Link] = MappingProxyType({})


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
        self._write(now_s, f"internal error: the companion ends\n{traceback.rstrip()}")

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


class MotionLog:
    """One vehicle's: `update` with each tick."""

    __slots__ = ("_line", "_looked_s", "_report", "_seen_since_s", "_told", "_unseen_s")

    def __init__(self, line: Callable[[float, str], None], report: Callable[[Say], None]) -> None:
        """`line`: takes what goes into the log; `report`: what the operator is told."""
        self._line: Final = line
        self._report: Final = report
        self._told: bool | None = None  # that it is corrected; None: nothing yet
        self._seen_since_s: float | None = None
        self._unseen_s = 0.0  # with something to see
        self._looked_s = -math.inf

    def update(self, now_s: float, *, is_corrected: bool, is_airborne: bool, sees_several: Callable[[], bool]) -> None:
        """`sees_several`: things are within the sensor's range; not asked in each tick."""
        if is_corrected:
            self._unseen_s = 0.0
            if self._seen_since_s is None:
                self._seen_since_s = now_s
            if self._told is None or (self._told is False and now_s - self._seen_since_s >= AGAIN_S):
                self._told = True
                self._line(now_s, CORRECTED)
            return
        self._seen_since_s = None
        if not is_airborne:
            self._unseen_s = 0.0
        elif now_s - self._looked_s >= LOOKS_S:
            self._looked_s = now_s
            self._unseen_s += LOOKS_S if sees_several() else 0.0
            if self._unseen_s >= UNSEEN_S and self._told is not False:
                self._told = False
                self._report(UNSEEN)


class ChangeLogger:
    """Notices changes of one companion, and logs them."""

    def __init__(
        self,
        log: FlightLog,
        endpoint: Endpoint,
        autopilot: Link,
        peers: Link,
        sensors: Mapping[str, Link] = NO_LINKS,
        report: Callable[[Say], None] | None = None,
    ) -> None:
        """`sensors`: links to drivers, by the sensor's name. `report`: takes what is to be told, else the endpoint."""
        self._recorded = report
        self._log = log
        self._endpoint = endpoint
        self._autopilot = autopilot
        self._peers = peers
        titles = {source.NAME: source.TITLE for source in endpoint.sensors.sources}
        self._sensors = {titles[name]: (name, link) for name, link in sensors.items()}
        self._links = {"autopilot link": autopilot} | {f"{of}'s link": link for of, (_, link) in self._sensors.items()}
        self._motion = MotionLog(log.line, self._tell_operator)
        self._floods = FloodLog({**self._links, "peers' link": peers}, self._tell_flood)
        self._up = {of: link.up for of, link in self._links.items()}
        self._status = endpoint.agent.status(0.0)  # of the last tick
        self._ended: set[str] = set()  # of what steers nothing
        self._leader: int | None = None
        self._foreign: frozenset[int] = frozenset()
        self._signs_since_s: float | None = None  # the autopilot, and this companion has no key for it
        self._signs_told = False
        self._foreign_drivers: dict[str, frozenset[int]] = {}  # by the sensor's name
        self._losses = {source.NAME: 0 for source in endpoint.sensors.sources}  # times that a driver was lost
        self._fresh: dict[str, dict[int, bool]] = {}  # by the sensor's name: drivers heard -> whether fresh
        self._counters = self.counters()
        self._counters_s = self._records_s = float("-inf")

    def log_changes(self, now_s: float, said: Sequence[Say]) -> None:
        """After each tick."""
        for say in said:
            self._log.line(now_s, f"{say.severity.name.lower()}: {say.text}")
        for name, guarded in (("survey", self._endpoint.survey), ("payload", self._endpoint.payload)):
            if guarded is not None and guarded.error and name not in self._ended:
                self._ended.add(name)
                self._log.line(now_s, f"{name} stopped, the flight goes on: {guarded.error}")
        before, self._status = self._status, self._endpoint.agent.status(now_s)
        if self._status.state is not before.state:
            self._log.line(now_s, f"state {before.state.name.lower()} -> {self._status.state.name.lower()}")
        self._motion.update(
            now_s,
            is_corrected=self._status.motion_seen,
            is_airborne=self._status.airborne,
            sees_several=self._sees_several,
        )
        self._log_leader(now_s)
        self._log_foreign_autopilots(now_s)
        self._log_signatures(now_s)
        for source in self._endpoint.sensors.sources:
            self._log_sensor(source, now_s)
        self.log_links(now_s)
        self._floods.update(now_s)
        if now_s - self._counters_s >= COUNTERS_S:
            self._log_counters(now_s)
        if now_s - self._records_s >= RECORDS_S:
            self._records_s = now_s
            self.log_records(now_s)

    def log_links(self, now_s: float | None) -> None:
        """Log links that came or went; also where there are no ticks."""
        for of, link in self._links.items():
            up = link.up
            if up is not self._up[of]:
                self._log.line(now_s, f"{of} connected" if up else f"{of} lost: retrying")
                self._up[of] = up

    def log_lines(self, now_s: float | None, lines: Sequence[str]) -> None:
        """Log what others have to say."""
        for line in lines:
            self._log.line(now_s, line)

    def status_line(self) -> str:
        """The flight at a glance. The installer reads the state: no upgrade of a vehicle in the air."""
        leader = "none" if self._leader is None else f"vehicle {self._leader}"
        missing = "".join(f", no {of}" for of, up in self._up.items() if not up)
        grounded = f", GROUNDED: {self._status.grounded}" if self._status.grounded else ""
        unsigned = "" if self._endpoint.peers.guard.flags else ", UNSIGNED"
        cuts = "; ".join(f"{cut.reason.value} {cut.by_mps:.1f} m/s" for cut in self._endpoint.agent.setpoint.cuts())
        state = f"state {self._status.state.name.lower()}, leader {leader}{missing}{unsigned}{grounded}"
        return f"vehicle {self._endpoint.id}: {state}" + (f", setpoint cut by: {cuts}" if cuts else "")

    def counters(self) -> dict[str, int]:
        """Counts of what was bad so far."""
        endpoint = self._endpoint
        found = {
            "bad frames of the autopilot": endpoint.autopilot.bad,
            **endpoint.autopilot_gate.counters(),
            "datagrams of the peers without a beacon": endpoint.peers.without_beacon,
            **{f"frames of the peers refused, {why}": n for why, n in sorted(endpoint.peers.guard.refused.items())},
            **endpoint.orders.counters(),
            "messages with invalid values": endpoint.codec.dropped,
            "beacons of another version": endpoint.codec.other_versions,
            "errors of the autopilot link": self._autopilot.errors,
            "of the peers' link": self._peers.errors,
        }
        for source in endpoint.sensors.sources:
            found |= source.counters()
            found[f"times {source.TITLE} lost"] = self._losses[source.NAME]
        for title, (name, link) in self._sensors.items():
            found[f"bad frames of the {title}"] = endpoint.sensors.bad(name)
            found[f"errors of the {title}'s link"] = link.errors
        return found | self._floods.counters()

    def _sees_several(self) -> bool:
        return self._endpoint.agent.perception.sees_several(self._status.position)

    def _tell_operator(self, say: Say) -> None:
        """To the operator, and so with the next tick to this log."""
        (self._recorded or self._endpoint.report_surroundings)(say)

    def _tell_flood(self, now_s: float, text: str, is_over: bool) -> None:
        """Besides, which beacons arrive, at once."""
        self._tell_operator(Say(Severity.NOTICE if is_over else Severity.WARNING, brief(text)))
        shares = {one.beacon.sender: one.share for one in self._endpoint.agent.localiser.neighbours}
        if is_over or not shares:
            return
        share, vehicle = min((share, vehicle) for vehicle, share in shares.items())
        if share < FEW:
            lost = f"vehicle {vehicle}'s beacons: {100.0 * (1.0 - share):.0f} % lost"
            self._tell_operator(Say(Severity.WARNING, lost))
        each = ", ".join(f"{vehicle} {100.0 * share:.0f} %" for vehicle, share in sorted(shares.items()))
        self._log.line(now_s, f"beacons that arrive: {each}")

    def log_records(self, now_s: float | None) -> None:
        """Log how far the records are, where the mission has any."""
        if self._endpoint.records is not None:
            self._log.line(now_s, summary(self._endpoint.records.counters()))

    def _log_leader(self, now_s: float) -> None:
        leader = self._status.leader or None
        if leader is None and self._leader is not None:  # a new one is said by the agent
            self._log.line(now_s, f"leader lost (it was vehicle {self._leader})")
        self._leader = leader

    def _log_foreign_autopilots(self, now_s: float) -> None:
        foreign = self._endpoint.foreign_autopilots
        for system in sorted(foreign - self._foreign):
            self._log.line(
                now_s,
                f"the autopilot of vehicle {system} is on this link of vehicle {self._endpoint.id}: wrong --id?",
            )
        self._foreign = foreign

    def _log_signatures(self, now_s: float) -> None:
        """Once: the autopilot signs, this companion does not, and is not answered."""
        gate = self._endpoint.autopilot_gate
        if self._signs_told or type(gate) is not Gate or not gate.signed or self._endpoint.codec.has_answered:
            return
        if self._signs_since_s is None:
            self._signs_since_s = now_s
        if now_s - self._signs_since_s >= UNANSWERED_S:
            self._signs_told = True
            self._log.line(now_s, UNSIGNED)

    def _log_sensor(self, source: SensorSource, now_s: float) -> None:
        """Drivers that are heard, lost, heard again, or not heard for their system id."""
        before, fresh = self._fresh.get(source.NAME, {}), source.freshness(now_s)
        for component, is_fresh in fresh.items():
            if before.get(component) is not is_fresh:
                how = ("heard again" if component in before else "heard") if is_fresh else f"lost: {source.STALE}"
                self._log.line(now_s, f"{source.TITLE} {component} (component): {how}")
                self._losses[source.NAME] += not is_fresh
        self._fresh[source.NAME] = fresh
        foreign = self._endpoint.sensors.foreign(source.NAME)
        for system in sorted(foreign - self._foreign_drivers.get(source.NAME, frozenset())):
            self._log.line(
                now_s,
                f"{source.TITLE} of system {system} is on a link of vehicle {self._endpoint.id}, and is not heard: "
                f"its driver's system id must be {self._endpoint.id}",
            )
        self._foreign_drivers[source.NAME] = foreign

    def _log_counters(self, now_s: float) -> None:
        counters = self.counters()
        if counters != self._counters:
            self._log.line(now_s, summary(counters))
        self._counters, self._counters_s = counters, now_s


def summary(counters: dict[str, int]) -> str:
    """As one line."""
    return ", ".join(f"{name} {count}" for name, count in counters.items())
