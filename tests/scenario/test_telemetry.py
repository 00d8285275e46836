"""The leader's telemetry gets late or stops, in lockstep: it brakes and says so, and another leads."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink import dialect
from companion.mavlink.framing.frames import Framing, frames
from companion.mavlink.framing.texts import Reader
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep.lockstep import Companion, InProcess
from tests.flights import flown, short_mission

POSITION = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
SETPOINT = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
WAY_S = 3.0  # in transit, before anything happens
FAULT_S = 8.0
MISSION = short_mission(swarm={"size": 3}, route={"d2_enu_m": (60, 0, 4)})


@dataclass
class Relay:
    """Hands an autopilot's telemetry on to its companion late, in order; or not at all."""

    companion: Companion
    only_positions: bool = False
    late_s: float = 0.0
    cut: bool = False
    under_way: deque[tuple[float, bytes]] = field(default_factory=deque)

    @property
    def id(self) -> int:
        return self.companion.id

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes = b"") -> None:
        kept = b""
        for start, end, message_id in frames(from_autopilot):
            frame = from_autopilot[start:end]
            if self.cut:
                continue
            if self.only_positions and message_id != POSITION:
                kept += frame
            else:
                self.under_way.append((now_s + self.late_s, frame))
        while self.under_way and self.under_way[0][0] <= now_s + 1e-9:
            kept += self.under_way.popleft()[1]
        self.companion.send(from_peers, kept, now_s, from_sensor)

    def receive(self) -> tuple[bytes, bytes]:
        return self.companion.receive()

    def close(self) -> None:
        self.companion.close()


@dataclass
class Watch:
    """Puts the relay before the leader in transit, makes its fault, and ends it after FAULT_S."""

    how: str
    relay: Relay | None = None
    began_s: float = 0.0
    transit_s: float | None = None
    texts: Reader = field(default_factory=Reader)
    said: list[str] = field(default_factory=list)
    moving_s: list[float] = field(default_factory=list)  # setpoints that are not zero, since the fault began
    setpoint_s: list[float] = field(default_factory=list)
    leaders: set[int] = field(default_factory=set)
    states: list[FlightState] = field(default_factory=list)

    def __call__(self, flight: Flight) -> None:
        now_s = flight.world.now_s
        if self.relay is None:
            if flight.phase() is SwarmPhase.TRANSIT:
                self.transit_s = self.transit_s or now_s
                if now_s - self.transit_s >= WAY_S:
                    leader = flight.leader()
                    assert leader is not None
                    relay = Relay(flight.lockstep.companions[leader], self.how == "positions")
                    flight.lockstep.companions[leader] = self.relay = relay
                    self.began_s = now_s
            return
        since_s = now_s - self.began_s
        self._fault(self.relay, since_s)
        for m in Framing().parse(flight.lockstep.from_companion.get(self.relay.id, b"")):
            if m.get_msgId() == SETPOINT:
                self.setpoint_s.append(since_s)
                if any((m.vx, m.vy, m.vz)):
                    self.moving_s.append(since_s)
            elif m.get_msgId() == dialect.MAVLINK_MSG_ID_STATUSTEXT:
                text = self.texts.read_text(m)
                self.said += [text] if text is not None else []
        if 4.0 < since_s < FAULT_S:
            self.leaders.add(flight.leader() or 0)
        companion = self.relay.companion
        assert isinstance(companion, InProcess)
        self.states.append(companion.endpoint.agent.flight.state)

    def _fault(self, relay: Relay, since_s: float) -> None:
        on = since_s < FAULT_S
        if self.how == "silence":
            relay.cut = on
        elif self.how == "backlog":
            relay.late_s = min(1.5, 0.5 * since_s) if on else 0.0
        else:
            relay.late_s = 1.5 if on else 0.0


@pytest.mark.parametrize("how", ["backlog", "all", "positions"])
def test_leader_whose_telemetry_gets_late_brakes_says_so_and_hands_the_lead_on(how: str, tmp_path: Path) -> None:
    watch = Watch(how)
    outcome, shown = flown(MISSION, tmp_path, watch=watch)
    assert outcome.succeeded, shown
    assert outcome.metrics.contacts == 0
    # What arrives t after the fault began is t / 3 late in the backlog: above 0.4 s from 1.2 s on. A gap of 1.5 s is
    # noticed after 0.5 s, before the first late frame is there.
    noticed_s = 1.2 + 0.2 if how == "backlog" else 0.5 + 0.1
    assert not [s for s in watch.moving_s if noticed_s < s < FAULT_S]
    assert watch.relay is not None
    assert watch.relay.id not in watch.leaders
    assert any(text.startswith("telemetry ") for text in watch.said)
    assert any(text.startswith("autopilot link lost") for text in watch.said) is (how == "all")  # 1.5 s without any
    assert FlightState.COVERAGE in watch.states


def test_leader_whose_autopilot_falls_silent_sends_nothing_after_a_second_and_comes_back(tmp_path: Path) -> None:
    watch = Watch("silence")
    outcome, shown = flown(MISSION, tmp_path, watch=watch)
    assert outcome.succeeded, shown
    assert outcome.metrics.contacts == 0
    assert not [s for s in watch.setpoint_s if 1.1 < s < FAULT_S]
    assert watch.relay is not None
    assert watch.relay.id not in watch.leaders
    assert any(text.startswith("autopilot link lost 1.") for text in watch.said)
    assert [s for s in watch.setpoint_s if s > FAULT_S]
