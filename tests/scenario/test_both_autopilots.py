"""The same companions on PX4 and on ArduPilot, in lockstep: flights, restarts, hangs, pilots."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from companion.core.model.states import STEERED, FlightState, SwarmPhase
from companion.mavlink import dialect
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import Framing
from mission.document.model import Mission
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.drive.operator import operator_order
from sim_bridge.world.autopilot import Link
from tests.flights import flown, short_mission

BOTH = pytest.mark.parametrize("make", ["px4", "ardupilot"])
SETPOINT = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
PILOT = (255, 190)
VEHICLE = 2
# DO_SET_MODE's parameters, after "custom mode": modes that the companion never asks for but may leave, and others.
HOLDS = {"px4": (4, 3), "ardupilot": (17,)}
STICKS = {"px4": (3,), "ardupilot": (5,)}


def both(make: str, **tables: dict[str, Any]) -> Mission:
    return short_mission(swarm={"size": 3}, **{**tables, "sim": {"personality": make, **tables.get("sim", {})}})


def moving(data: bytes) -> list[str]:
    """What of a companion's messages would move its vehicle."""
    found = []
    for m in Framing().parse(data):
        if m.get_msgId() == SETPOINT:
            found.append("setpoint")
        elif m.get_msgId() == dialect.MAVLINK_MSG_ID_COMMAND_LONG and m.command in (400, 176, 22, 21):
            found.append(str(m.command))
    return found


class Watch:
    """Calls `at` once, when vehicle 2 has been in transit for three seconds; then `after` each tick."""

    def __init__(self, at: Callable[[Flight], None], after: Callable[[Flight, float, list[str]], None]) -> None:
        self._at, self._after = at, after
        self._transit_s: float | None = None
        self.at_s: float | None = None

    def __call__(self, flight: Flight) -> None:
        now_s = flight.world.now_s
        if self.at_s is not None:
            sent = moving(flight.lockstep.from_companion.get(VEHICLE, b""))
            self._after(flight, now_s - self.at_s, sent)
        elif flight.phase() is SwarmPhase.TRANSIT:
            self._transit_s = self._transit_s or now_s
            if now_s - self._transit_s >= 3.0:
                self.at_s = now_s
                self._at(flight)


def state(flight: Flight) -> FlightState:
    companion = flight.lockstep.companions[VEHICLE]
    assert isinstance(companion, InProcess)
    return companion.endpoint.agent.flight.state


def command(flight: Flight, number: int, *parameters: float) -> None:
    """A pilot's command to the vehicle's autopilot."""
    message = dialect.MAVLink_command_long_message(VEHICLE, 1, number, 0, *parameters, *(0.0,) * (7 - len(parameters)))
    data = wire.pack(message, seq=0, system=PILOT[0], component=PILOT[1])
    flight.world.vehicles[VEHICLE].autopilot.receive(Link.GROUND, data, flight.world.now_s)


@BOTH
def test_swarm_arrives_and_lands_without_a_refusal(make: str, tmp_path: Path) -> None:
    outcome, shown = flown(both(make, route={"at_end": "land"}), tmp_path, point_mass=False)
    assert outcome.ended == "all landed", shown
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.acting_leaders_max == 1
    logs = "".join(path.read_text() for path in tmp_path.glob("companions/*"))
    for word in ("refused", "not answered", "without effect", "released"):
        assert word not in shown + logs


def test_vehicles_of_both_makes_fly_together(tmp_path: Path) -> None:
    mission = both("px4", sim={"personalities": {"2": "ardupilot"}})
    outcome, shown = flown(mission, tmp_path)
    assert outcome.succeeded, shown
    assert outcome.metrics.contacts == 0


@BOTH
def test_companion_restarted_in_flight_listens_and_is_steering_within_five_seconds(make: str, tmp_path: Path) -> None:
    first_s: list[float] = []
    steered_s: list[float] = []

    def restart(flight: Flight) -> None:
        flight.lockstep.companions[VEHICLE] = InProcess(flight.mission, VEHICLE)

    def after(flight: Flight, since_s: float, sent: list[str]) -> None:
        companion = flight.lockstep.companions[VEHICLE]
        assert isinstance(companion, InProcess)
        if sent:
            lease = companion.endpoint.agent.swarm.election.lease
            assert lease is not None
            assert lease.established
            first_s.append(since_s)
        if state(flight) is FlightState.TRANSIT:
            steered_s.append(since_s)

    mission = both(make, route={"d2_enu_m": (60, 0, 4)})
    outcome, shown = flown(mission, tmp_path, watch=Watch(restart, after))
    assert outcome.succeeded, shown
    assert first_s[0] > 0.1
    assert steered_s[0] <= 5.0
    assert outcome.metrics.contacts == 0


@BOTH
def test_companion_that_hung_listens_before_it_steers(make: str, tmp_path: Path) -> None:
    hung: list[Any] = []
    sent_s: list[float] = []

    class Hung:
        """Takes what it is handed and does not answer."""

        id = VEHICLE

        def send(self, *_: object) -> None: ...
        def receive(self) -> tuple[bytes, bytes]:
            return b"", b""

        def close(self) -> None: ...

    def hang(flight: Flight) -> None:
        hung.append(flight.lockstep.companions[VEHICLE])
        flight.lockstep.companions[VEHICLE] = Hung()

    def after(flight: Flight, since_s: float, sent: list[str]) -> None:
        if hung and since_s >= 4.0:
            flight.lockstep.companions[VEHICLE] = hung.pop()
        elif not hung and sent:
            sent_s.append(since_s)

    mission = both(make, route={"d2_enu_m": (60, 0, 4)})
    outcome, shown = flown(mission, tmp_path, watch=Watch(hang, after))
    assert outcome.succeeded, shown
    assert 4.0 < sent_s[0] <= 9.0
    assert outcome.metrics.contacts == 0


@BOTH
@pytest.mark.parametrize("where", ["holds", "sticks"])
def test_pilot_who_takes_over_keeps_the_vehicle_until_it_is_handed_back(make: str, where: str, tmp_path: Path) -> None:
    """PX4 shows the mode up to 1 s late; from then on nothing is sent."""
    quiet_from_s, handed_back_s = 1.3, 4.0
    done: set[str] = set()
    states: list[FlightState] = []

    def take(flight: Flight) -> None:
        command(flight, 176, 1, *(HOLDS if where == "holds" else STICKS)[make])

    def after(flight: Flight, since_s: float, sent: list[str]) -> None:
        now_s = flight.world.now_s
        if quiet_from_s < since_s < handed_back_s:
            assert state(flight) is FlightState.RELEASED
            assert sent == []
        if since_s >= handed_back_s and "held" not in done:
            done.add("held")
            command(flight, 176, 1, *HOLDS[make])
        if since_s >= handed_back_s + 1.5 and "back" not in done:
            assert state(flight) is FlightState.RELEASED
            done.add("back")
            order = operator_order(VEHICLE, dialect.MAV_CMD_MISSION_START)
            flight.world.vehicles[VEHICLE].autopilot.receive(Link.GROUND, order, now_s)
        if since_s >= handed_back_s + 5.0:
            states.append(state(flight))

    mission = both(make, route={"d1_enu_m": (0, 0, 18), "d2_enu_m": (60, 0, 18)})  # LOITER sinks: nobody at the sticks
    outcome, shown = flown(mission, tmp_path, watch=Watch(take, after))
    assert outcome.metrics.contacts == 0, shown
    assert states
    assert set(states) <= STEERED
