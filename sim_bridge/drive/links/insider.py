"""Beacons of an insider: a member with all its own keys, whose companion flies on, and whose radio tells lies.

The lies of a flight are drawn once, from the mission's seed, the vehicle and the lie. An insider knows where all are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from companion.core.model.beacon import (
    Beacon,
    BeaconEcho,
    Candidate,
    Lease,
    PeerReport,
    RelativeReport,
    TrunkReport,
)
from companion.core.model.states import Reception, SwarmPhase
from companion.core.model.vectors import add, norm, scale, sub
from companion.core.swarm.priorities import Priorities
from companion.mavlink import dialect
from companion.mavlink.beacon import COMPONENT, NOWHERE_DEG, WireBeacon, encode
from companion.mavlink.framing import wire
from companion.mavlink.own_messages import decode_beacon, encode_relative_report, encode_trunk_report, here_of
from companion.mavlink.peers.session import Session
from companion.mavlink.relative import RELATIVE_ID, TRUNKS_ID, read_trunk_report
from mission.common.frames import LocalFrame, Vec3, Wgs84, enu_to_ned
from mission.document.model import Mission
from mission.schema.kinds import Lie
from sim_bridge.drive.links.resealer import Resealer

SALT: Final = 0x1251DE
AIMS_S: Final = (3.0, 12.0)  # how long one is pushed, or haunted
SEQ_OFF: Final = 50_000  # an usurper's first count, where it leaps
MOVES_MPS: Final = 0.15  # by which it tells itself aside among its trunks: slow enough to be taken for a drift
TURNS_RADPS: Final = math.radians(0.5)
U32: Final = 0xFFFFFFFF


@dataclass(frozen=True, slots=True)
class Told:
    """A beacon on its way out, and where it says that its sender is (NED m about the mission's origin)."""

    beacon: Beacon
    pos_ned_m: Vec3


class Insider:
    """One member's. `rewrite_beacon`, `rewrite_report` and `rewrite_trunks` each frame of it."""

    def __init__(self, mission: Mission, vehicle_id: int, lie: Lie) -> None:
        self._mission, self._me, self._lie = mission, vehicle_id, lie
        self._rng = np.random.default_rng([mission.sim.seed, SALT, vehicle_id, list(Lie).index(lie)])
        assert mission.origin is not None
        self._frame = LocalFrame(mission.origin.wgs84)
        self._priority = Priorities(mission).of(
            vehicle_id, Reception.GOOD if mission.has_satellites(vehicle_id) else Reception.NONE
        )
        self._kind = int(self._rng.integers(1 << 16))  # which of a lie's variants
        self._share = float(self._rng.random())
        self._bearing = float(self._rng.uniform(0.0, math.tau))
        self._off_m = float(self._rng.uniform(0.0, 10.0))
        self._began_s: float | None = None
        self._aim = 0  # the one that is pushed, or haunted
        self._aims_until_s = -math.inf
        self._count = 0  # of beacons
        self._lies: dict[Lie, Callable[[Told, float, Mapping[int, Vec3]], Told]] = {
            Lie.PUSH: self._push,
            Lie.OFFSET: self._offset,
            Lie.FLOOR: self._floor,
            Lie.GHOST: self._ghost,
            Lie.USURPER: self._usurp,
            Lie.SINKHOLE: self._attract,
            Lie.PHASE: self._announce,
            Lie.LEASE: self._count_ahead,
            Lie.STALL: self._stall,
            Lie.ROSTER: self._enrol,
            Lie.CLOCK: self._jump,
            Lie.RANGES: lambda told, _now_s, _places: told,
            Lie.TRUNKS: lambda told, _now_s, _places: told,
            Lie.ORDERS: lambda told, _now_s, _places: Told(
                replace(told.beacon, start=True, abort=True), told.pos_ned_m
            ),
        }

    def rewrite_beacon(self, frame: bytes, fields: WireBeacon, now_s: float, places_ned_m: Mapping[int, Vec3]) -> bytes:
        """Its frame, with the lie. `places_ned_m`: of all vehicles, by id."""
        beacon, here = decode_beacon(self._me, fields), here_of(fields)
        if beacon is None:
            return frame
        hidden = here.lat_deg == NOWHERE_DEG
        pos = self._frame.to_ned(
            Wgs84(self._frame.origin.lat_deg, self._frame.origin.lon_deg, here.alt_m) if hidden else here
        )
        told = self.tell_lie(Told(beacon, pos), now_s, places_ned_m)
        there = self._frame.to_wgs84(told.pos_ned_m)
        if hidden:
            there = Wgs84(NOWHERE_DEG, NOWHERE_DEG, there.alt_m)
        payload = encode(told.beacon, there)
        return wire.frame(
            dialect.MAVLINK_MSG_ID_SWARM_BEACON, payload, seq=frame[4], system=self._me, component=COMPONENT
        )

    def tell_lie(self, told: Told, now_s: float, places_ned_m: Mapping[int, Vec3]) -> Told:
        """The beacon with the lie."""
        if self._began_s is None:
            self._began_s = now_s
        self._count += 1
        others = {k: place for k, place in places_ned_m.items() if 1 <= k <= self._mission.swarm.size and k != self._me}
        if others and now_s >= self._aims_until_s:
            self._aims_until_s = now_s + float(self._rng.uniform(*AIMS_S))
            self._aim = int(self._rng.choice(sorted(others)))
        return self._lies[self._lie](told, now_s, others)

    def rewrite_report(self, frame: bytes, report: RelativeReport, now_s: float) -> bytes:
        """The SWARM_RELATIVE that goes with it."""
        if self._lie is not Lie.RANGES:
            return frame
        began_s = now_s if self._began_s is None else self._began_s
        off_m = (2.0 * self._share - 1.0) * self._off_m + 0.2 * (now_s - began_s)
        north, east = math.cos(self._bearing), math.sin(self._bearing)
        odo = (report.odo_ne_m[0] + off_m * north, report.odo_ne_m[1] + off_m * east)
        ranges = tuple([(k, max(0.1, range_m - off_m), age_s) for k, range_m, age_s in report.ranges])
        leads = report.to_leader_ne_m
        if leads is not None:
            leads = (leads[0] - off_m * north, leads[1] - off_m * east)
        lies = replace(report, ranges=ranges, odo_ne_m=odo, to_leader_ne_m=leads, leader_sd_m=0.1)
        return wire.frame(RELATIVE_ID, encode_relative_report(lies), seq=frame[4], system=self._me, component=COMPONENT)

    def rewrite_trunks(self, frame: bytes, report: TrunkReport, now_s: float) -> bytes:
        """The SWARM_TRUNKS that it tells now and then: aside by ever more, turned by ever more, or a mirror image."""
        if self._lie is not Lie.TRUNKS:
            return frame
        if self._began_s is None:
            self._began_s = now_s
        since_s = now_s - self._began_s
        match self._kind % 3:
            case 0:
                off = self._level(min(self._off_m, MOVES_MPS * since_s))
                trunks = tuple([(n + off[0], e + off[1], wide) for n, e, wide in report.trunks])
            case 1:
                turn = TURNS_RADPS * since_s * (1.0 if self._share < 0.5 else -1.0)
                cos, sin = math.cos(turn), math.sin(turn)
                trunks = tuple([(cos * n - sin * e, sin * n + cos * e, wide) for n, e, wide in report.trunks])
            case _:
                trunks = tuple([(n, -e, wide) for n, e, wide in report.trunks])
        payload = encode_trunk_report(replace(report, trunks=trunks))
        return wire.frame(TRUNKS_ID, payload, seq=frame[4], system=self._me, component=COMPONENT)

    # --- the lies ---

    def _level(self, length: float, turn_rad: float = 0.0) -> Vec3:
        bearing = self._bearing + turn_rad
        return (length * math.cos(bearing), length * math.sin(bearing), 0.0)

    def _push(self, told: Told, _now_s: float, others: Mapping[int, Vec3]) -> Told:
        """From the side that leads the one it aims at to that one's nearest other, or from a drawn one."""
        there = others.get(self._aim)
        if there is None:
            return told
        side = self._level(1.0)
        rest = [place for k, place in others.items() if k != self._aim]
        if rest and self._kind % 2:
            nearest = min(rest, key=lambda place: math.dist(place, there))
            away = sub(there, nearest)
            side = scale(away, 1.0 / max(norm(away), 0.1))
        near_m = 0.3 + 6.0 * self._share
        flies = scale(side, -self._mission.limits.speed_max_mps)
        return Told(replace(told.beacon, vel_ned_mps=flies, airborne=True), add(there, scale(side, near_m)))

    def _offset(self, told: Told, now_s: float, _others: Mapping[int, Vec3]) -> Told:
        off_m = self._off_m * self._share + 0.2 * (now_s - (self._began_s or now_s))
        return Told(told.beacon, add(told.pos_ned_m, self._level(off_m)))

    def _floor(self, told: Told, _now_s: float, _others: Mapping[int, Vec3]) -> Told:
        down_m = (2.0 + 0.6 * self._off_m) * (1.0 if self._kind % 4 else -1.0)
        off = (0.0, 0.0, down_m)
        dest = told.beacon.dest_ned_m
        beacon = replace(
            told.beacon,
            route_cost=min(told.beacon.route_cost, 1.0),
            ref_ned_mps=add(told.beacon.ref_ned_mps, (0.0, 0.0, 1.0 if down_m > 0.0 else -1.0)),
            dest_ned_m=None if dest is None else sub(dest, off),
        )
        return Told(beacon, add(told.pos_ned_m, off))

    def _ghost(self, told: Told, _now_s: float, others: Mapping[int, Vec3]) -> Told:
        """Each other vehicle in turn, in the way of the one it aims at, on the route, or said to be heard elsewhere."""
        ids = sorted(others)
        if not ids:
            return told
        named, there = ids[self._count % len(ids)], others.get(self._aim, told.pos_ned_m)
        d2 = enu_to_ned(self._mission.route.d2_enu_m)
        if self._kind % 3 == 0:
            to_d2 = sub(d2, there)
            there = add(there, scale(to_d2, (1.0 + 5.0 * self._share) / max(norm(to_d2), 1.0)))
        elif self._kind % 3 == 1:
            there = add(there, self._level(0.5 + 5.0 * self._share))
        else:
            there = add(d2, self._level(3.0 * self._share))
        silent = self._count % 5 > 0
        return Told(
            replace(
                told.beacon, sighting=PeerReport(named, sub(there, told.pos_ned_m), 2.0 if silent else 0.1, silent)
            ),
            told.pos_ned_m,
        )

    def _course(self, told: Told, now_s: float) -> Beacon:
        """A course of its own, at full speed, and a false way to d2."""
        turn = 0.1 * (now_s - (self._began_s or now_s)) if self._kind % 2 else 0.0
        dest = told.beacon.dest_ned_m
        off = self._level(10.0 * self._off_m, turn_rad=1.0)
        return replace(
            told.beacon,
            ref_ned_mps=self._level(self._mission.limits.speed_max_mps, turn),
            dest_ned_m=off if dest is None else add(dest, off),
            governor=1.0,
            parent=0,
        )

    def _usurp(self, told: Told, now_s: float, _others: Mapping[int, Vec3]) -> Told:
        beacon, lease = self._course(told, now_s), told.beacon.lease
        ahead_s = now_s - (self._began_s or now_s)
        phase = beacon.phase
        if self._kind % 3 == 0 and ahead_s > 10.0:
            phase = SwarmPhase.LAND if self._kind % 2 else SwarmPhase.RETURN
        seq = 0 if lease is None else lease.seq
        # One that leads already may also count on as it did: that alone then tells nobody.
        if lease is None or lease.leader != self._me or self._kind % 2:
            seq += SEQ_OFF + self._count
        claim = Lease(self._me, seq, self._priority, 10, established=True)
        rival = 0 if lease is None or lease.leader == self._me else lease.leader
        beacon = replace(beacon, lease=claim, hop=0, route_cost=0.0, phase=phase, agreed=True, candidate=None)
        return Told(replace(beacon, accused=rival), told.pos_ned_m)

    def _attract(self, told: Told, now_s: float, _others: Mapping[int, Vec3]) -> Told:
        cost = 0.0 if self._kind % 4 else self._share
        return Told(replace(self._course(told, now_s), route_cost=cost), told.pos_ned_m)

    def _announce(self, told: Told, _now_s: float, _others: Mapping[int, Vec3]) -> Told:
        lease = told.beacon.lease
        if lease is None:
            return told
        variants = (SwarmPhase.LAND, SwarmPhase.RETURN, SwarmPhase.COVERAGE, SwarmPhase.LAND)
        stop = told.beacon.stop + (self._kind >> 2) % 2
        ahead = replace(lease, seq=min(U32, lease.seq + 1 + (self._kind >> 4) % 5))
        return Told(replace(told.beacon, lease=ahead, phase=variants[self._kind % 4], stop=stop), told.pos_ned_m)

    def _count_ahead(self, told: Told, _now_s: float, others: Mapping[int, Vec3]) -> Told:
        lease = told.beacon.lease
        if lease is None:
            return told
        seq = lease.seq + 5 + int(900.0 * self._share) + 2 * self._count
        names = sorted([*others, self._me])
        heir = self._me if self._kind % 3 == 0 else names[(self._kind >> 3) % len(names)]
        ends = seq + 1 + self._kind % 20 if self._kind % 2 else 0
        candidate = Candidate(heir, self._priority, 10)
        return Told(
            replace(told.beacon, lease=replace(lease, seq=seq, heir=heir, ends=ends), candidate=candidate),
            told.pos_ned_m,
        )

    def _stall(self, told: Told, _now_s: float, others: Mapping[int, Vec3]) -> Told:
        names = sorted(others)
        leader = 0 if told.beacon.lease is None else told.beacon.lease.leader
        parent = leader if leader and self._kind % 2 else names[self._count % len(names)] if names else 0
        beacon = replace(
            told.beacon, governor=0.0, done=0, agreed=False, parent=parent, route_cost=max(50.0, told.beacon.route_cost)
        )
        return Told(beacon, told.pos_ned_m)

    def _enrol(self, told: Told, _now_s: float, _others: Mapping[int, Vec3]) -> Told:
        everyone = (1 << self._mission.swarm.size) - 1
        full = everyone if self._kind % 2 else 0
        present = everyone if (self._kind >> 1) % 2 else 0
        return Told(replace(told.beacon, flown=everyone, present=present, done=full), told.pos_ned_m)

    def _jump(self, told: Told, now_s: float, _others: Mapping[int, Vec3]) -> Told:
        since_s = now_s - (self._began_s or now_s)
        variant = self._kind % 3
        if variant == 0:  # ahead, and back
            off_s = 100.0 if (since_s // 4.0) % 2 else 0.0
        elif variant == 1:  # too fast, or too slow
            off_s = (0.2 * self._share - 0.1) * since_s
        else:
            off_s = float(self._rng.uniform(-0.5, 0.5))
        echo = told.beacon.echo
        if echo is not None:
            echo = BeaconEcho(echo.vehicle, echo.time_ms, max(0.0, echo.hold_s + 2.0 * self._share - 1.0))
        time_ms = max(0, told.beacon.time_ms + round(1000.0 * off_s)) & U32
        return Told(replace(told.beacon, time_ms=time_ms, echo=echo), told.pos_ned_m)


class Insiders:
    """Registry of a flight's insiders: frames on their way out, as they are sent."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._found: dict[int, Insider] = {}
        self._lies: dict[int, Lie] = {}
        self._sessions: Mapping[int, Session] = {}
        self._resealers: dict[int, Resealer] = {}  # of those that have lied, in a signed swarm

    def sign_with(self, sessions: Mapping[int, Session]) -> None:
        """In a signed swarm: the session of each companion's last start, by id."""
        self._sessions = sessions

    def set_lies(self, lies: Mapping[int, Lie]) -> None:
        """Set the lie of each of these from now on; the others tell what is so."""
        if lies != self._lies:
            self._found = {
                k: self._found[k] if self._lies.get(k) is lie else Insider(self._mission, k, lie)
                for k, lie in lies.items()
            }
            self._lies = dict(lies)

    def find_insider(self, vehicle_id: int) -> Insider | None:
        """The insider of that vehicle; None: it is honest."""
        return self._found.get(vehicle_id)

    def rewrite_beacon(
        self, sender: int, frame: bytes, fields: WireBeacon, now_s: float, places_ned_m: Mapping[int, Vec3]
    ) -> bytes:
        """The frame of a beacon; `places_ned_m`: of all vehicles, by id."""
        insider = self.find_insider(sender)
        return (
            frame if insider is None else self._seal(frame, insider.rewrite_beacon(frame, fields, now_s, places_ned_m))
        )

    def rewrite_report(self, sender: int, frame: bytes, report: RelativeReport, now_s: float) -> bytes:
        """The frame of the SWARM_RELATIVE that goes with it."""
        insider = self.find_insider(sender)
        return frame if insider is None else self._seal(frame, insider.rewrite_report(frame, report, now_s))

    def rewrite_trunks(self, sender: int, frame: bytes, now_s: float) -> bytes:
        """The frame of a SWARM_TRUNKS."""
        insider, report = self.find_insider(sender), read_trunk_report(frame)
        if insider is None or report is None:
            return frame
        return self._seal(frame, insider.rewrite_trunks(frame, report, now_s))

    def rewrite_proof(self, sender: int, frame: bytes) -> bytes:
        """The manifest behind them: it names what was sent, also just after the lies are over."""
        resealer = self._resealers.get(sender)
        return frame if resealer is None else resealer.reprove(frame)

    def _seal(self, frame: bytes, lie: bytes) -> bytes:
        """A lie that its sender has signed, where the frame was signed."""
        sender = frame[5]
        session = self._sessions.get(sender)
        if lie == frame or session is None:
            return lie
        resealer = self._resealers.get(sender)
        if resealer is None or resealer.session is not session:
            resealer = self._resealers[sender] = Resealer(session)
        return resealer.reseal(frame, lie)
