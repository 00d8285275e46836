"""Reads what the swarm broadcasts, and when: bytes in, a picture out. No sockets and no clock: time is an argument.

Nothing here is worked out about the swarm but what stands in its beacons and in the relative reports beside them, and
how long ago they came. Every field of the picture names what it is from, by attributes of `Beacon` and
`RelativeReport`: `SOURCES` of each class. How those are sent is the schema's alone (companion/mavlink/schema).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Final

from companion.core.localisation.peer_reports import TAKEN_BACK
from companion.core.model.beacon import Beacon, RelativeReport
from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.framing.frames import source
from companion.mavlink.own_messages import decode_beacon, here_of
from companion.mavlink.relative import read_relative_report
from companion.records.frames import is_record_frame
from companion.records.signed.keys import RecordKeys
from companion.watch.harvest_heard import HarvestHeard
from companion.watch.listening_guard import ListeningGuard
from mission.common.frames import LocalFrame, Wgs84

FRESH_S: Final = 2.0  # twenty beacons: what is older is shown as last heard
SCORE_STEP_PERCENT: Final = 10  # of the battery, in a candidate's score: companion.core.swarm.swarm

Place = tuple[float, float, float]  # latitude and longitude in degrees, altitude above mean sea level in metres
Sources = dict[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A vehicle as its last beacon has it."""

    id: int
    age_s: float  # since its last beacon came
    place: Place | None  # None: not broadcast, as without GNSS
    reckoned: Place | None  # then: its leader's place when it spoke, less what it believed to be between them
    alt_m: float  # above mean sea level
    vel_ned_mps: tuple[float, float, float]
    state: str
    phase: str
    stop: int
    airborne: bool
    leader: int  # that it follows; 0: none
    acting: bool  # that one has held its lease long enough to act
    quorum: bool  # that one has the majority in its part of the swarm
    hop: int  # to the leader
    parent: int  # the neighbour that it follows; 0: none
    range_m: float  # of its radio
    abort: bool  # an operator has ordered all to land
    battery_percent: tuple[int, int] | None  # from, to; broadcast only while it proposes itself as a successor
    to_leader_ne_m: tuple[float, float] | None  # where it believes the leader to be, in a GNSS-denied swarm
    leader_sd_m: float | None  # standard deviation of that
    unproven_s: float | None  # since it vouched for what it says; None: no signature is looked at

    SOURCES: ClassVar[Sources] = {
        "id": ("sender",),
        "age_s": ("arrival",),
        "place": ("here",),
        "reckoned": ("to_leader_ne_m", "lease.leader", "here"),
        "alt_m": ("here",),
        "vel_ned_mps": ("vel_ned_mps",),
        "state": ("state",),
        "phase": ("phase",),
        "stop": ("stop",),
        "airborne": ("airborne",),
        "leader": ("lease.leader",),
        "acting": ("lease.established",),
        "quorum": ("lease.quorum",),
        "hop": ("hop",),
        "parent": ("parent",),
        "range_m": ("range_m",),
        "abort": ("abort",),
        "battery_percent": ("candidate.vehicle", "candidate.score"),
        "to_leader_ne_m": ("to_leader_ne_m",),
        "leader_sd_m": ("leader_sd_m",),
        "unproven_s": ("arrival",),
    }


@dataclass(frozen=True, slots=True)
class Told:
    """A vehicle that another one reports: it fell silent in the air, or is heard though somebody calls it silent."""

    id: int
    by: int  # which vehicle reports it
    age_s: float  # since it was heard there
    place: Place | None  # where it was then; None: the reporter does not broadcast its own
    silent: bool

    SOURCES: ClassVar[Sources] = {
        "id": ("sighting.vehicle",),
        "by": ("sender",),
        "age_s": ("sighting.age_s", "arrival"),
        "place": ("sighting.rel_ned_m", "here"),
        "silent": ("sighting.silent",),
    }


@dataclass(frozen=True, slots=True)
class Picture:
    """The swarm as its broadcasts have it, at a time."""

    vehicles: tuple[Vehicle, ...]  # by id
    told: tuple[Told, ...]  # by id
    not_heard: tuple[int, ...]  # that others name as being in the swarm, and that were never heard here
    silence_s: float | None  # since anything was heard; None: nothing ever was
    led_s: float | None  # since a vehicle in the air named a leader that acts; None: none is in the air
    apart_s: float | None  # since all in the air that name an acting leader named the same; None: they do
    other_versions: tuple[int, ...]  # vehicles whose beacons cannot be read
    refused: int  # beacons that cannot be believed: of wrong fields, or not of the swarm's key
    strangers: tuple[tuple[int, str], ...] = ()  # system id, and what is wrong with frames of that name

    SOURCES: ClassVar[Sources] = {
        "not_heard": ("present", "flown"),
        "silence_s": ("arrival",),
        "led_s": ("airborne", "lease.leader", "lease.established", "arrival"),
        "apart_s": ("airborne", "lease.leader", "lease.established", "arrival"),
        "other_versions": ("sender", "version"),
        "refused": ("arrival",),
        "strangers": ("sender", "arrival"),
    }


@dataclass(frozen=True, slots=True)
class _Last:
    """The last beacon of a vehicle, the relative report that came with it, and when."""

    said: Beacon
    report: RelativeReport | None
    place: Place | None
    reckoned: Place | None
    alt_m: float
    heard_s: float


class Heard:
    """One swarm's radio. `receive_datagram`; `picture` whenever somebody looks. Bounded: one entry a system id."""

    def __init__(self, guard: ListeningGuard | None = None, keys: RecordKeys | None = None) -> None:
        """`guard`, `keys` (of its records): of a swarm with keys; None: whoever is in range is shown."""
        self._guard = guard
        self._last: dict[int, _Last] = {}
        self._reports: dict[int, RelativeReport] = {}  # the last of each vehicle: it comes before its beacon
        self._told: dict[int, tuple[Told, float]] = {}
        self._other_versions: set[int] = set()
        self.harvest: Final = HarvestHeard(keys)
        self._refused = 0
        self._heard_s: float | None = None
        self._agreed_s = 0.0
        self._led_s: float | None = None  # when one in the air last named an acting leader, or the first took off

    def receive_datagram(self, data: bytes, now_s: float) -> None:
        """A datagram that came at `now_s`. Whatever it is, nothing raises."""
        reports: list[RelativeReport] = []
        found = swarm_beacon.beacons(data, self._beside(reports, now_s))
        self._reports.update((report.sender, report) for report in reports)
        for sender, frame, fields in found:
            said = decode_beacon(sender, fields)
            if self._guard is not None and not self._guard.admits(frame, now_s, said):
                self._refused += 1
                continue
            if fields.version != swarm_beacon.VERSION:
                self._other_versions.add(sender)
            elif said is None or not sender:
                self._refused += 1
            else:
                self._other_versions.discard(sender)
                shown = said if self._guard is None else self._guard.believe(said, now_s)
                self._keep_beacon(shown, here_of(fields), now_s)

    def _beside(self, reports: list[RelativeReport], now_s: float) -> Callable[[bytes], bool]:
        """Collects the relative reports among the frames of a datagram, and takes manifests and what is of records."""
        guard = self._guard

        def collect_report(frame: bytes) -> bool:
            if guard is not None and guard.take_manifest(frame, now_s):
                return True
            if is_record_frame(frame):
                is_ours = guard is None or guard.admits(frame, now_s, named=False)
                return is_ours and self.harvest.take_frame(frame, now_s)
            report = read_relative_report(frame)
            if report is None:
                return False
            if source(frame)[1] == swarm_beacon.COMPONENT and (guard is None or guard.admits(frame, now_s)):
                reports.append(report)
            return True

        return collect_report

    def _keep_beacon(self, said: Beacon, here: Wgs84, now_s: float) -> None:
        self._heard_s = now_s
        position, alt_m = _position(here), here.alt_m
        report = self._reports.get(said.sender)
        if report is not None and report.time_ms != said.time_ms:
            report = None  # of another beacon
        reckoned = self._reckoned(said, report, alt_m, now_s) if position is None and report is not None else None
        self._last[said.sender] = _Last(said, report, position, reckoned, alt_m, now_s)
        if said.airborne and (self._led_s is None or (said.lease is not None and said.lease.established)):
            self._led_s = now_s
        if len(self._leaders(now_s)) <= 1:
            self._agreed_s = now_s
        seen = said.sighting
        if seen is not None and (seen.silent or seen.relays != TAKEN_BACK):
            there = None if position is None else _moved(position, seen.rel_ned_m)
            self._told[seen.vehicle] = (Told(seen.vehicle, said.sender, seen.age_s, there, seen.silent), now_s)

    def _leaders(self, now_s: float) -> set[int]:
        """Acting leaders, as vehicles in the air name them."""
        return {
            last.said.lease.leader
            for last in self._last.values()
            if now_s - last.heard_s < FRESH_S
            and last.said.airborne
            and last.said.lease is not None
            and last.said.lease.established
        }

    def _reckoned(self, said: Beacon, report: RelativeReport, alt_m: float, now_s: float) -> Place | None:
        """By where its leader was last heard, if that was now."""
        leads = None if said.lease is None else self._last.get(said.lease.leader)
        if report.to_leader_ne_m is None or leads is None or leads.place is None or now_s - leads.heard_s >= FRESH_S:
            return None
        north_m, east_m = report.to_leader_ne_m
        lat_deg, lon_deg, _ = _moved(leads.place, (-north_m, -east_m, 0.0))
        return (lat_deg, lon_deg, alt_m)

    def picture(self, now_s: float) -> Picture:
        """As it stands at `now_s`."""
        vehicles = tuple(self._vehicle(self._last[k], now_s) for k in sorted(self._last))
        fresh = [last.said for last in self._last.values() if now_s - last.heard_s < FRESH_S]
        named = 0
        for said in fresh:
            named |= said.present | said.flown
        named_ids = {k for k in range(1, 256) if named >> (k - 1) & 1}
        told = [(one, at_s) for one, at_s in self._told.values() if now_s - at_s < FRESH_S]
        return Picture(
            vehicles,
            tuple(
                Told(one.id, one.by, one.age_s + now_s - at_s, one.place, one.silent)
                for one, at_s in sorted(told, key=lambda entry: entry[0].id)
            ),
            tuple(sorted(named_ids - self._last.keys())),
            None if self._heard_s is None else now_s - self._heard_s,
            now_s - self._led_s if self._led_s is not None and any(said.airborne for said in fresh) else None,
            now_s - self._agreed_s if len(self._leaders(now_s)) > 1 else None,
            tuple(sorted(self._other_versions)),
            self._refused,
            () if self._guard is None else tuple(self._guard.strangers(now_s).items()),
        )

    def _vehicle(self, last: _Last, now_s: float) -> Vehicle:
        said, lease, report = last.said, last.said.lease, last.report
        return Vehicle(
            id=said.sender,
            age_s=now_s - last.heard_s,
            place=last.place,
            reckoned=last.reckoned,
            alt_m=last.alt_m,
            vel_ned_mps=said.vel_ned_mps,
            state=FlightState(said.state).name.lower().replace("_", " "),
            phase=SwarmPhase(said.phase).name.lower(),
            stop=said.stop,
            airborne=said.airborne,
            leader=0 if lease is None else lease.leader,
            acting=lease is not None and lease.established,
            quorum=lease is not None and lease.quorum,
            hop=said.hop,
            parent=said.parent,
            range_m=said.range_m,
            abort=said.abort,
            battery_percent=None if said.sender in self._reports else _battery(said),
            to_leader_ne_m=None if report is None else report.to_leader_ne_m,
            leader_sd_m=None if report is None or report.to_leader_ne_m is None else report.leader_sd_m,
            unproven_s=None if self._guard is None else self._guard.unproven_s(said.sender, now_s),
        )


def _position(here: Wgs84) -> Place | None:
    is_on_earth = abs(here.lat_deg) <= 90.0 and abs(here.lon_deg) <= 180.0
    return (here.lat_deg, here.lon_deg, here.alt_m) if is_on_earth else None


def _moved(position: Place, by_ned_m: tuple[float, float, float]) -> Place:
    there = LocalFrame(Wgs84(*position)).to_wgs84(by_ned_m)
    return (there.lat_deg, there.lon_deg, there.alt_m)


def _battery(said: Beacon) -> tuple[int, int] | None:
    """A score counts steps of the charge; that of a vehicle without GNSS is divided, and says nothing."""
    if said.candidate is None or said.candidate.vehicle != said.sender:
        return None
    least = said.candidate.score * SCORE_STEP_PERCENT
    return (least, min(100, least + SCORE_STEP_PERCENT - 1)) if least <= 100 else None
