"""Whole flights of a swarm with keys: as without them, and not as whoever has none would have it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from companion.core.model.states import SwarmPhase
from companion.core.vehicle.accepted import UNSIGNED
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.framing import wire
from mission.document.model import Mission
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from tests.flights import flown, short_mission
from tests.scenario.test_record_flights import surveying
from tests.unit.core.core_kit import beacon, lease
from tests.unit.mavlink.signing_kit import HERE

KILLED = [{"kind": "kill", "phase": "transit", "at_s": 3.0}]
RESTARTED = [{"kind": "restart", "vehicles": [3], "phase": "transit", "at_s": 4.0, "for_s": 2.0}]


def refused(flight: Flight) -> dict[str, int]:
    """Frames, by reason, of all companions."""
    found: dict[str, int] = {}
    for companion in flight.lockstep.companions.values():
        for why, n in companion.endpoint.peers.guard.refused.items():  # type: ignore[attr-defined]
            found[why] = found.get(why, 0) + n
    return found


@pytest.mark.parametrize(
    ("loss", "faults"),
    [(0.0, []), (0.3, KILLED), (0.0, RESTARTED)],
    ids=["calm", "leader-killed-at-30%-loss", "restart"],
)
def test_signed_swarm_flies_as_an_unsigned_one(tmp_path: Path, loss: float, faults: list[dict[str, Any]]) -> None:
    mission = short_mission(swarm={"size": 5}, sim={"radio_loss": loss, "faults": faults})
    flights: list[Flight] = []
    signed, shown = flown(mission, tmp_path, watch=flights.append, keys=FleetKeys(mission))
    assert signed.succeeded, shown
    assert not {"forged manifest", "disowned", "twice", "unsigned", "repeated"} & set(refused(flights[-1]))
    plain, _ = flown(mission, tmp_path / "plain")
    assert signed.metrics.arrival_last_s == pytest.approx(plain.metrics.arrival_last_s, abs=5.0)
    assert signed.metrics.min_separation_m == pytest.approx(plain.metrics.min_separation_m, abs=1.0)


@pytest.mark.parametrize("faults", [[], RESTARTED], ids=["calm", "restart"])
def test_companions_that_are_processes_fly_by_their_key_files_as_those_in_process(
    tmp_path: Path, faults: list[dict[str, Any]]
) -> None:
    mission = short_mission(swarm={"size": 3}, sim={"faults": faults})
    outside, shown = flown(mission, tmp_path / "outside", in_process=False, keys=FleetKeys(mission))
    assert outside.succeeded, shown
    inside, _ = flown(mission, tmp_path / "inside", keys=FleetKeys(mission))
    assert outside.metrics == inside.metrics
    log = (tmp_path / "outside" / "companions" / "companion-3.log").read_text()
    assert "radio signed: vehicle 3" in log
    assert "UNSIGNED" not in log + shown


def test_ground_is_told_of_a_swarm_that_flies_unsigned(tmp_path: Path) -> None:
    _, shown = flown(short_mission(swarm={"size": 2}), tmp_path)
    assert UNSIGNED in shown


class Attacker:
    """Without a key: sends unsigned beacons that launch, lead and land, and every recorded frame again, each period."""

    def __init__(self, mission: Mission) -> None:
        self.recorded: list[bytes] = []
        self.flight: Flight | None = None
        says: list[dict[str, Any]] = [
            {"start": True, "lease": lease(1, 9), "phase": SwarmPhase.GATHER},
            {"abort": True, "lease": lease(1, 10_000), "phase": SwarmPhase.LAND},
        ]
        self.frames = [
            wire.frame(
                swarm_beacon.MESSAGE_ID, swarm_beacon.encode(beacon(1, **say), HERE), seq=0, system=k, component=191
            )
            for say in says
            for k in range(1, mission.swarm.size + 1)
        ]

    def __call__(self, flight: Flight) -> None:
        self.flight = flight
        for frames in flight.lockstep.beacons.values():
            self.recorded += frames
        attack = [*self.frames, *self.recorded[-400:-200], *self.recorded[:40]]  # a second old, and the first
        for companion in flight.lockstep.companions.values():
            companion.endpoint.from_peers(b"".join(attack), flight.world.now_s)  # type: ignore[attr-defined]


def test_whoever_has_no_key_neither_launches_nor_lands_a_swarm(tmp_path: Path) -> None:
    mission = short_mission(swarm={"size": 4})
    attacker = Attacker(mission)
    attacked, shown = flown(mission, tmp_path, watch=attacker, keys=FleetKeys(mission))
    assert attacker.flight is not None
    found = refused(attacker.flight)
    assert found["unsigned"] > 1000
    assert found["repeated"] > 1000
    assert attacked.succeeded, shown
    calm, _ = flown(mission, tmp_path / "calm", keys=FleetKeys(mission))
    assert attacked.metrics == calm.metrics  # all that was flown; only what is said of the attack is more


def test_records_reach_the_base_station_of_a_signed_swarm(tmp_path: Path) -> None:
    mission = surveying()
    outcome, shown = flown(mission, tmp_path, keys=FleetKeys(mission))
    made = outcome.summary["records_made"]
    assert outcome.succeeded, shown
    assert made > 20
    assert outcome.summary["records_delivered"] == made
