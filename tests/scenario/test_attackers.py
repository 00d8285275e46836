"""Attackers of the search, in whole flights: a radio without keys changes nothing, a member that lies is believed."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.judge.verdict import Grade
from sim_bridge.lab.search.draw import draw
from sim_bridge.lab.search.flight import fly_to_row
from tests.flights import flown, short_mission

OUTSIDER = {"kind": "outsider", "vehicles": [2], "at_s": 0.5}
PUSH = {"kind": "insider", "lie": "push", "vehicles": [2], "at_s": 12.0, "for_s": 6.0}


class Noted:
    """Where all truly were, what guards refused, and how far off 1 had 2 while it lied."""

    def __init__(self) -> None:
        self.places: list[Any] = []
        self.refused: Counter[str] = Counter()
        self.off_m = 0.0

    def __call__(self, flight: Flight) -> None:
        self.places.append(flight.last.pos_ned_m)
        self.refused.clear()
        for companion in flight.lockstep.companions.values():
            assert isinstance(companion, InProcess)
            self.refused.update(companion.endpoint.peers.guard.refused)


def fly(tmp_path: Path, *faults: dict[str, Any], signed: bool = True) -> Noted:
    mission, noted = short_mission(swarm={"size": 3}, sim={"faults": list(faults)}), Noted()
    outcome, _ = flown(mission, tmp_path / "flight", watch=noted, keys=FleetKeys(mission) if signed else None)
    assert outcome.summary["grade"] == Grade.ARRIVED, outcome.summary["verdict"]
    return noted


def test_a_radio_without_keys_changes_nothing(tmp_path: Path) -> None:
    """Not a millimetre: thousands of frames repeated, changed and made up, orders among them."""
    without, attacked = fly(tmp_path / "without"), fly(tmp_path / "with", OUTSIDER)
    assert attacked.places == without.places
    refused = attacked.refused - without.refused
    assert refused["forged, or of another boot"] > 1000
    assert refused["repeated"] > 500
    assert refused["forged manifest"] > 300


def test_an_insider_has_its_keys(tmp_path: Path) -> None:
    """Its lies are signed and proven: nobody disowns them, and they make the others move as without keys."""
    without, attacked = fly(tmp_path / "without"), fly(tmp_path / "with", PUSH)
    assert attacked.refused == without.refused
    lies_s = slice(round(12.0 / 0.05), round(18.0 / 0.05))
    assert attacked.places[lies_s] != without.places[lies_s]


@pytest.mark.parametrize("seed", [37017, 37002])
def test_an_attacked_flight_of_the_search(seed: int) -> None:
    """An insider of a signed swarm, and one of an unsigned swarm."""
    drawn = draw(seed)
    assert drawn.attacker == "insider"
    row = fly_to_row(drawn.mission, on_jsbsim=False, signed=drawn.signed)
    assert row["grade"] in (Grade.ARRIVED, Grade.DEGRADED), row["verdict"]
