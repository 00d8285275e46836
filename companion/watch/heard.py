"""What the swarm's radio has said, and when: bytes in, a picture out. No sockets and no clock: time is an argument.

Nothing here is worked out about the swarm but what stands in its beacons and in the words beside them, and how long ago
they came. Every field of the picture names what it is from: `SOURCES` of each class.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Final

from companion.core.model.beacon import Beacon, RelativeReport
from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.frames import source
from companion.mavlink.relative import read_relative_report
from companion.mavlink.signing import Gate
from mission.common.frames import LocalFrame, Wgs84

FRESH_S: Final = 2.0  # twenty beacons: what is older is shown as last heard
SCORE_STEP_PERCENT: Final = 10  # of the battery, in a candidate's score: companion.core.swarm.swarm
_ANYWHERE: Final = LocalFrame(Wgs84(0.0, 0.0, 0.0))  # `decode` wants one; what it is for is not used

Place = tuple[float, float, float]  # latitude and longitude in degrees, altitude above mean sea level in metres
Sources = dict[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class Vehicle:
    """What one vehicle said last of itself."""

    id: int
    age_s: float  # since its last beacon came
    place: Place | None  # None: it does not tell, as without satellites
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
    battery_percent: tuple[int, int] | None  # from, to; told only while it proposes itself as a successor
    to_leader_ne_m: tuple[float, float] | None  # where it believes the leader to be, in a swarm that flies by ranges
    leader_sd_m: float | None  # standard deviation of that

    SOURCES: ClassVar[Sources] = {
        "id": ("sender",),
        "age_s": ("arrival",),
        "place": ("lat", "lon", "alt"),
        "reckoned": ("leader_n", "leader_e", "leader", "lat", "lon", "alt"),
        "alt_m": ("alt",),
        "vel_ned_mps": ("vx", "vy", "vz"),
        "state": ("flight_state",),
        "phase": ("phase",),
        "stop": ("phase",),
        "airborne": ("flags",),
        "leader": ("leader",),
        "acting": ("flags",),
        "quorum": ("flags",),
        "hop": ("hop",),
        "parent": ("parent",),
        "range_m": ("range_dm",),
        "abort": ("flags",),
        "battery_percent": ("candidate", "candidate_score"),
        "to_leader_ne_m": ("leader_n", "leader_e", "leader_sd"),
        "leader_sd_m": ("leader_sd",),
    }


@dataclass(frozen=True, slots=True)
class Told:
    """A vehicle that another one tells of: it fell silent in the air, or is heard though somebody calls it silent."""

    id: int
    by: int  # which vehicle says so
    age_s: float  # since it was heard there
    place: Place | None  # where it was then; None: the one that says so does not tell its own
    silent: bool

    SOURCES: ClassVar[Sources] = {
        "id": ("seen",),
        "by": ("sender",),
        "age_s": ("seen_age", "arrival"),
        "place": ("seen_x", "seen_y", "seen_z", "lat", "lon", "alt"),
        "silent": ("flags",),
    }


@dataclass(frozen=True, slots=True)
class Picture:
    """All that the radio has said, as it stands at a time."""

    vehicles: tuple[Vehicle, ...]  # by id
    told: tuple[Told, ...]  # by id
    not_heard: tuple[int, ...]  # that others name as being in the swarm, and that were never heard here
    silence_s: float | None  # since anything was heard; None: nothing ever was
    led_s: float | None  # since a vehicle in the air named a leader that acts; None: none is in the air
    apart_s: float | None  # since all in the air that name an acting leader named the same; None: they do
    other_versions: tuple[int, ...]  # vehicles whose beacons cannot be read
    refused: int  # beacons that cannot be believed: wrong fields, or a signature that nobody can check

    SOURCES: ClassVar[Sources] = {
        "not_heard": ("members",),
        "silence_s": ("arrival",),
        "led_s": ("flags", "leader", "arrival"),
        "apart_s": ("flags", "leader", "arrival"),
        "other_versions": ("sender", "version"),
        "refused": ("arrival",),
    }


@dataclass(frozen=True, slots=True)
class _Last:
    """The last beacon of a vehicle, the word that came with it, and when."""

    said: Beacon
    word: RelativeReport | None
    place: Place | None
    reckoned: Place | None
    alt_m: float
    heard_s: float


class Heard:
    """One swarm's radio. `take` each datagram; `picture` whenever somebody looks. Bounded: one entry a system id."""

    def __init__(self) -> None:
        self._last: dict[int, _Last] = {}
        self._words: dict[
            int, RelativeReport
        ] = {}  # the last of each vehicle: what comes before the beacon of the same time
        self._told: dict[int, tuple[Told, float]] = {}
        self._other_versions: set[int] = set()
        self._gate = Gate(takes_signed=False)
        self._refused = 0
        self._heard_s: float | None = None
        self._agreed_s = 0.0
        self._led_s: float | None = None  # when one in the air last named an acting leader, or the first took off

    def take(self, data: bytes, now_s: float) -> None:
        """A datagram that came at `now_s`. Whatever it is, nothing raises."""
        words: list[RelativeReport] = []
        found = swarm_beacon.beacons(data, self._beside(words))
        self._words.update((word.sender, word) for word in words)
        for sender, frame, fields in found:
            if not self._gate.admits(frame):
                self._refused += 1
                continue
            said = swarm_beacon.decode(sender, fields, _ANYWHERE).said
            if fields.version != swarm_beacon.VERSION:
                self._other_versions.add(sender)
            elif said is None or not sender:
                self._refused += 1
            else:
                self._other_versions.discard(sender)
                self._beacon(said, fields, now_s)

    def _beside(self, words: list[RelativeReport]) -> Callable[[bytes], bool]:
        def take(frame: bytes) -> bool:
            word = read_relative_report(frame)
            if word is None:
                return False
            if source(frame)[1] == swarm_beacon.COMPONENT and self._gate.admits(frame):
                words.append(word)
            return True

        return take

    def _beacon(self, said: Beacon, fields: swarm_beacon.WireBeacon, now_s: float) -> None:
        self._heard_s = now_s
        place, alt_m = _place(fields), fields.alt / 1e3
        word = self._words.get(said.sender)
        if word is not None and word.time_ms != said.time_ms:
            word = None  # of another beacon
        reckoned = self._reckoned(said, word, alt_m, now_s) if place is None and word is not None else None
        self._last[said.sender] = _Last(said, word, place, reckoned, alt_m, now_s)
        if said.airborne and (self._led_s is None or (said.lease is not None and said.lease.established)):
            self._led_s = now_s
        if len(self._leaders(now_s)) <= 1:
            self._agreed_s = now_s
        seen = said.sighting
        if seen is not None:
            there = None if place is None else _moved(place, seen.rel_ned_m)
            self._told[seen.vehicle] = (Told(seen.vehicle, said.sender, seen.age_s, there, seen.silent), now_s)

    def _leaders(self, now_s: float) -> set[int]:
        """Those that act, as vehicles in the air name them."""
        return {
            last.said.lease.leader
            for last in self._last.values()
            if now_s - last.heard_s < FRESH_S
            and last.said.airborne
            and last.said.lease is not None
            and last.said.lease.established
        }

    def _reckoned(self, said: Beacon, word: RelativeReport, alt_m: float, now_s: float) -> Place | None:
        """By where its leader was last heard, if that was now."""
        leads = None if said.lease is None else self._last.get(said.lease.leader)
        if word.to_leader_ne_m is None or leads is None or leads.place is None or now_s - leads.heard_s >= FRESH_S:
            return None
        north_m, east_m = word.to_leader_ne_m
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
        )

    def _vehicle(self, last: _Last, now_s: float) -> Vehicle:
        said, lease, word = last.said, last.said.lease, last.word
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
            battery_percent=None if said.sender in self._words else _battery(said),
            to_leader_ne_m=None if word is None else word.to_leader_ne_m,
            leader_sd_m=None if word is None or word.to_leader_ne_m is None else word.leader_sd_m,
        )


def _place(fields: swarm_beacon.WireBeacon) -> Place | None:
    lat_deg, lon_deg = fields.lat / 1e7, fields.lon / 1e7
    return (lat_deg, lon_deg, fields.alt / 1e3) if abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 else None


def _moved(place: Place, by_ned_m: tuple[float, float, float]) -> Place:
    there = LocalFrame(Wgs84(*place)).to_wgs84(by_ned_m)
    return (there.lat_deg, there.lon_deg, there.alt_m)


def _battery(said: Beacon) -> tuple[int, int] | None:
    """A score counts steps of the charge; that of a vehicle without satellites is divided, and says nothing."""
    if said.candidate is None or said.candidate.vehicle != said.sender:
        return None
    least = said.candidate.score * SCORE_STEP_PERCENT
    return (least, min(100, least + SCORE_STEP_PERCENT - 1)) if least <= 100 else None
