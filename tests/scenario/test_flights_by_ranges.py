"""Flights in which only the leader has GNSS: the others find one another by odometry and ranges."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.core.agent import Agent
from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.model.states import FlightState, SwarmPhase
from companion.core.vehicle.failsafe import Cause
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import whole
from companion.mavlink.own_messages import BEACON_PAYLOAD
from companion.sensors.table import sensors_of
from mission.common.frames import Vec3
from mission.document.model import Mission, Origin, Personality
from sim_bridge.drive import fly
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.world.autopilot.estimates.odometry import Odometer
from sim_bridge.world.sensors.ranging import RangeRadios
from tests.flights import flown
from tests.unit.core.ranging_kit import STARTS, ranging_mission

ELSEWHERE = Origin(lat_deg=-33.0, lon_deg=151.5, alt_m=488.0)  # the height stays: beacons tell it


def by_ranges(**tables: dict[str, object]) -> Mission:
    return ranging_mission(**({"swarm": {"leader_priority": [1]}} | tables))


@pytest.mark.parametrize("personality", list(Personality))
def test_a_swarm_of_which_only_the_leader_has_satellites_arrives(tmp_path: Path, personality: Personality) -> None:
    mission = by_ranges(sim={"personality": personality, "seed": 1000})
    outcome, shown = flown(mission, tmp_path)
    figures = outcome.metrics
    assert outcome.summary["verdict"] == "ARRIVED", shown
    assert figures.contacts == 0
    assert figures.min_separation_m >= 4.5
    assert figures.overhead_leader is not None
    assert figures.overhead_leader <= 0.06
    assert figures.coverage_gap_deg is not None
    assert figures.coverage_gap_deg <= 1.3 * 90.0


def test_a_swarm_flies_on_with_a_radio_that_is_late(tmp_path: Path) -> None:
    """Each beacon by its own delay, up to 0.4 s: before ages were measured, all landed."""
    mission = by_ranges(sim={"radio_delay_s": 0.2, "radio_loss": 0.1, "seed": 1000})
    outcome, shown = flown(mission, tmp_path)
    figures = outcome.metrics
    assert outcome.summary["verdict"] == "ARRIVED", shown
    assert figures.contacts == 0
    assert figures.min_separation_m >= 4.5
    assert figures.overhead_leader is not None
    assert figures.overhead_leader <= 0.08


def test_companions_that_are_processes_fly_alike(tmp_path: Path) -> None:
    """The range radio's link goes through sockets."""
    mission = by_ranges(coverage={"duration_s": 2.0})
    here, _ = flown(mission, tmp_path / "here")
    there, shown = flown(mission, tmp_path / "there", in_process=False)
    assert here.summary["trace_hash"] == there.summary["trace_hash"], shown


class Recorded:
    """What one companion was handed in a flight, and what it answered."""

    def __init__(self, vehicle_id: int) -> None:
        self.vehicle_id = vehicle_id
        self.handed: list[tuple[bytes, bytes, bytes, float]] = []
        self.answers: list[tuple[bytes, bytes]] = []

    def watch(self) -> Callable[[fly.Flight], None]:
        began = []

        def listen(flight: fly.Flight) -> None:
            if began:
                return
            began.append(True)
            one = flight.lockstep.companions[self.vehicle_id]
            assert isinstance(one, InProcess)
            send, receive = one.send, one.receive

            def sent(peers: bytes, autopilot: bytes, now_s: float, sensor: bytes = b"") -> None:
                self.handed.append((peers, autopilot, sensor, now_s))
                send(peers, autopilot, now_s, sensor)

            def received() -> tuple[bytes, bytes]:
                self.answers.append(receive())
                return self.answers[-1]

            one.send, one.receive = sent, received  # type: ignore[method-assign]

        return listen


def moved(data: bytes) -> bytes:
    """The same beacons, of senders that say they are elsewhere on Earth."""
    out = b""
    for start, end, message_id in whole(data):
        frame = data[start:end]
        if message_id == swarm_beacon.MESSAGE_ID:
            fields = swarm_beacon.unpack(frame)
            assert fields is not None
            if fields.lat != 2**31 - 1:
                fields = fields._replace(lat=fields.lat - 700_000_000, lon=fields.lon + 900_000_000)
            payload = BEACON_PAYLOAD.pack(*fields)
            frame = wire.frame(message_id, payload, seq=frame[4], system=frame[5], component=frame[6])
        out += frame
    return out


@pytest.mark.sources
def test_not_a_byte_of_a_follower_depends_on_where_on_earth_the_swarm_is(tmp_path: Path) -> None:
    """It hears the same flight again, with a mission and a leader elsewhere, and answers the same to the bit.

    tests/unit/world/autopilot/estimates/test_odometry.py has the other half: nothing else that a follower hears tells
    where it is.
    """
    mission, follower = by_ranges(), Recorded(3)
    flown(mission, tmp_path, watch=follower.watch())
    there = Endpoint(mission.with_origin(ELSEWHERE), 3, sensors=sensors_of(mission))
    there.agent.waive("all")
    # The first tick of the flight was not recorded: a companion that starts a tick later is handed the rest.
    here = Endpoint(mission, 3, sensors=sensors_of(mission))
    here.agent.waive("all")
    leader_told = 0
    for peers, autopilot, sensor, now_s in follower.handed:
        answers = []
        for endpoint, heard in ((here, peers), (there, moved(peers))):
            endpoint.from_peers(heard, now_s)
            endpoint.from_sensor(sensor, now_s)
            endpoint.from_autopilot(autopilot, now_s)
            out = endpoint.tick(now_s)
            answers.append((out.peers, out.autopilot))
        assert answers[0] == answers[1]
        leader_told += moved(peers) != peers
    assert leader_told > 100  # the leader tells where it is
    setpoints = sum(
        message_id == dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
        for _, to_autopilot in follower.answers
        for _, _, message_id in whole(to_autopilot)
    )
    assert setpoints > 500


def test_vehicles_that_are_unsure_of_a_near_one_hold_until_ranges_have_found_it_again(tmp_path: Path) -> None:
    """On the way a vehicle's odometer begins anew, and anew, while all range radios are silent for 3 s."""
    mission = by_ranges(coverage={"duration_s": 2.0})
    kept: list[RangeRadios] = []
    began_s: list[float] = []
    held: dict[int, list[float]] = {}

    def upset(flight: fly.Flight) -> None:
        world, now_s = flight.world, flight.world.now_s
        if not began_s and flight.phase() is SwarmPhase.TRANSIT:
            began_s.append(now_s + 5.0)
        since_s = now_s - began_s[0] if began_s else -1.0
        if since_s >= 0.0 and not kept:
            kept.extend(sensor for sensor in world.sensors if isinstance(sensor, RangeRadios))
            world.sensors = tuple(sensor for sensor in world.sensors if sensor not in kept)
        if since_s >= 3.0 and kept[0] not in world.sensors:
            world.sensors = (*world.sensors, kept[0])
        odometer = world.vehicles[2].believed
        assert isinstance(odometer, Odometer)
        for at_s in (0.0, 0.3, 0.6, 0.9, 1.2):
            if abs(since_s - at_s) < 0.02:
                odometer._odo = (odometer._odo[0] + 300.0, odometer._odo[1])
        for k, companion in flight.lockstep.companions.items():
            assert isinstance(companion, InProcess)
            if since_s >= 0.0 and companion.endpoint.agent.status(now_s).cause is Cause.PEER_UNCERTAIN:
                held.setdefault(k, []).append(since_s)

    outcome, shown = flown(mission, tmp_path, watch=upset)
    figures = outcome.metrics
    assert "hold: vehicle 2 position uncertain" in shown
    assert set(held) >= {1, 2}  # vehicle 3 is far enough away
    for moments in held.values():
        assert moments[0] < 3.0 < moments[-1] < 8.0
    assert figures.arrived, shown
    assert figures.contacts == 0
    assert figures.min_separation_m >= 4.5


def test_an_heir_without_satellites_takes_the_swarm_to_d2(tmp_path: Path) -> None:
    """The only vehicle that knows where it is falls silent in the middle of the way."""
    mission = by_ranges(
        route={"d2_enu_m": (80, 0, 4)},
        sim={"seed": 1001, "faults": [{"kind": "kill", "phase": "transit", "at_s": 10.0}]},
    )
    worst, off_m = [0.0], [0.0]
    before: dict[int, tuple[float, float]] = {}

    def steps(flight: fly.Flight) -> None:
        places = flight.world.positions()
        for k, companion in flight.lockstep.companions.items():
            assert isinstance(companion, InProcess)
            agent = companion.endpoint.agent
            v, dest = agent.setpoint.vel_ned_mps, agent.localiser.destination.ned_m
            if k in before:
                worst[0] = max(worst[0], math.hypot(v[0] - before[k][0], v[1] - before[k][1]))
            before[k] = (v[0], v[1])
            if companion.endpoint.agent.swarm.election.acts and dest is not None:
                off_m[0] = math.hypot(places[k][0] + dest[0], places[k][1] + dest[1] - 80.0)

    outcome, shown = flown(mission, tmp_path, watch=steps)
    figures = outcome.metrics
    assert figures.arrived, shown
    assert figures.contacts == 0
    assert figures.leader_changes == 1
    assert figures.leaderless_max_s <= 3.5
    assert worst[0] <= 0.3
    assert off_m[0] <= 3.0  # of where d2 is


class Restarted:
    """A companion that is killed in flight and started again `away_s` later, and how well all know their places."""

    def __init__(self, vehicle_id: int, away_s: float, *, odometer_anew: bool = False) -> None:
        self.vehicle_id, self.away_s, self.odometer_anew = vehicle_id, away_s, odometer_anew
        self.gone_s: float | None = None
        self.back_s: float | None = None
        self.steers_s: float | None = None
        self.states: list[FlightState] = []
        self.worst_m = 0.0  # of where it has the others, while it is steered
        self.others_worst_m = 0.0  # of where the others have it, from 5 s after it came back

    def watch(self, flight: fly.Flight) -> None:
        now_s, lockstep = flight.world.now_s, flight.lockstep
        if self.gone_s is None and self.vehicle_id in lockstep.lost:
            self.gone_s = now_s
        if self.gone_s is not None and self.back_s is None and now_s >= self.gone_s + self.away_s:
            self.back_s = now_s
            del lockstep.lost[self.vehicle_id]
            lockstep.companions[self.vehicle_id] = InProcess(flight.mission, self.vehicle_id)
            believed = flight.world.vehicles[self.vehicle_id].believed
            if self.odometer_anew:
                believed._odo = (0.0, 0.0)  # type: ignore[attr-defined]
        elif self.back_s is not None:
            self.judge(flight, now_s)

    def judge(self, flight: fly.Flight, now_s: float) -> None:
        places = flight.world.positions()
        assert self.back_s is not None
        for k, companion in flight.lockstep.companions.items():
            assert isinstance(companion, InProcess)
            agent = companion.endpoint.agent
            if k == self.vehicle_id and (not self.states or self.states[-1] is not agent.flight.state):
                self.states.append(agent.flight.state)
            if k == self.vehicle_id and agent.flight.steers:
                self.steers_s = self.steers_s or now_s
                self.worst_m = max(self.worst_m, *[off_m(agent, places, other) for other in places if other != k])
            elif k != self.vehicle_id and now_s >= self.back_s + 5.0:
                self.others_worst_m = max(self.others_worst_m, off_m(agent, places, self.vehicle_id))


def off_m(agent: Agent, places: dict[int, Vec3], other: int) -> float:
    """By how much an agent is wrong about where another is, level."""
    here, there = places[agent.id], places[other]
    assert isinstance(agent.localiser, GnssDeniedLocaliser)
    found = agent.localiser.ranging.filter.relative(other)
    assert found is not None
    return math.hypot(found.ne_m[0] - there[0] + here[0], found.ne_m[1] - there[1] + here[1])


@pytest.mark.parametrize(
    ("vehicle_id", "seed", "anew"), [(3, 1000, False), (1, 1003, False), (2, 1001, True)], ids=["", "leader", "anew"]
)
def test_a_companion_that_starts_again_in_flight_finds_the_others_anew(
    tmp_path: Path, vehicle_id: int, seed: int, anew: bool
) -> None:
    """The leader's, too; and where the odometer begins anew with it, which the others survive."""
    mission = by_ranges(
        route={"d2_enu_m": (80, 0, 4)},
        sim={"seed": seed, "faults": [{"kind": "kill", "vehicles": [vehicle_id], "phase": "transit", "at_s": 8.0}]},
    )
    restarted = Restarted(vehicle_id, 5.0, odometer_anew=anew)
    outcome, shown = flown(mission, tmp_path, watch=restarted.watch)
    figures = outcome.metrics
    assert figures.arrived, shown
    assert figures.contacts == 0
    assert figures.min_separation_m >= 4.5
    assert restarted.states[:2] == [FlightState.WAITING, FlightState.HOLD]
    assert restarted.back_s is not None
    assert restarted.steers_s is not None
    assert restarted.steers_s - restarted.back_s <= 6.0
    assert restarted.worst_m <= 2.0
    assert restarted.others_worst_m <= 2.0


@pytest.mark.parametrize(
    ("seed", "starts"),
    [
        (1000, [STARTS[0], STARTS[2], STARTS[1], STARTS[3]]),  # east and north confused: a mirror image
        (1001, [STARTS[0], STARTS[2], (-12.0, -4.0, 0.0), (-12.0, 4.0, 0.0)]),  # turned by 90 degrees about the leader
    ],
    ids=["mirrored", "turned"],
)
def test_starts_that_no_distance_shows_to_be_wrong_are_found_by_a_small_motion(
    tmp_path: Path, seed: int, starts: list[tuple[float, float, float]]
) -> None:
    """Companions have another mission than the world."""
    mission = by_ranges(sim={"seed": seed})
    told = by_ranges(ranging={"start_enu_m": starts})
    begun: list[bool] = []

    def watch(flight: fly.Flight) -> None:
        if not begun:
            begun.append(True)
            for k in flight.lockstep.companions:
                flight.lockstep.companions[k] = InProcess(told, k)

    outcome, shown = flown(mission, tmp_path, watch=watch)
    figures = outcome.metrics
    assert figures.arrived, shown
    assert figures.contacts == 0
    assert figures.min_separation_m >= 4.5
    assert "start positions wrong: vehicle 1 found elsewhere" in shown


def test_a_swarm_that_does_not_stand_where_its_mission_says_stays_on_the_ground(tmp_path: Path) -> None:
    """Companions have another mission than the world: vehicles 3 and 4 have changed places."""
    mission = by_ranges(coverage={"duration_s": 2.0}, sim={"time_limit_s": 60.0})
    assert mission.ranging is not None
    one, two, three, four = mission.ranging.start_enu_m
    told = by_ranges(ranging={"start_enu_m": [one, two, four, three]})
    flew: set[int] = set()
    waits: set[str] = set()

    def watch(flight: fly.Flight) -> None:
        if flight.world.now_s < 0.1:
            for k in flight.lockstep.companions:
                flight.lockstep.companions[k] = InProcess(told, k)
        for k, companion in flight.lockstep.companions.items():
            assert isinstance(companion, InProcess)
            waits.add(companion.endpoint.agent.flight.waits_for)
            if not flight.world.vehicles[k].airframe.state.on_ground:
                flew.add(k)

    flown(mission, tmp_path, watch=watch)
    assert not flew
    assert any("m apart, not" in text for text in waits)


@pytest.mark.sources
def test_a_swarm_whose_range_radios_measure_nothing_stays_on_the_ground_and_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RangeRadios, "measure", lambda *_, **__: {})
    outcome, shown = flown(by_ranges(sim={"time_limit_s": 60.0}), tmp_path)
    assert not outcome.metrics.arrived
    assert "waiting: no ranges from range radio" in shown
    assert "taking off" not in shown
