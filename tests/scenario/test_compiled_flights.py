"""Compiled and pure Python fly the same, to the bit: what the vehicles did, and every byte on their links."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.mavlink.framing.frames import find_frame
from mission.common.compiled import SWITCH, why_pure
from mission.document.load import dump_mission
from tests.flights import short_mission

WHY_PURE = why_pure()
TESTS = Path(__file__).parents[1]
FLY = """
import json, sys
from pathlib import Path
from tests.flights import flown
from mission.common.compiled import STATE
from mission.document.load import load_mission
outcome, _ = flown(load_mission(sys.argv[1]), Path(sys.argv[2]), point_mass=False)
print(json.dumps([STATE, outcome.ended, outcome.summary["trace_hash"]]))
"""
SAFETY_FILTER = """
import hashlib, random
from tests.unit.core.core_promises import any_inputs, restless_inputs
from tests.unit.core.core_surroundings import applied
from tests.unit.core.core_surroundings import applied

from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from mission.common.compiled import STATE
rng, told = random.Random(1), hashlib.sha256()
for inputs in (restless_inputs, any_inputs):
    for (safety_filter, trunks, wish, last, own, around, silent, drift), _ in inputs(rng, 1500):
        points = LocalObstacleCloud(7.35, [False] * 72)
        found = [(rng.uniform(-3, 3), rng.uniform(-3, 3)) for _ in range(rng.randrange(6))]
        points.add_points([n for n, _ in found], [e for _, e in found], 0.65)
        given = (safety_filter, wish, last, own, around, silent)
        v = applied(*given, dt_s=0.05, drift=drift, trunks=trunks, points=points)
        told.update(repr(v).encode())
print(STATE.split()[0], told.hexdigest())
"""
MISSIONS: dict[str, dict[str, Any]] = {
    "PX4 in the wind": {"sim": {"seed": 1, "wind_mps": (3.0, 2.0, 0.0), "turbulence_mps": 1.0}},
    "PX4 and ArduPilot": {"sim": {"seed": 2, "personalities": {"2": "ardupilot", "4": "ardupilot"}}},
    "a leader lost, beacons lost and late": {
        "sim": {
            "seed": 3,
            "radio_loss": 0.1,
            "radio_delay_s": 0.05,
            "faults": [{"kind": "kill", "at_s": 30.0}],
        }
    },
    "scans, and trunks in the air, on a slope": {
        "route": {"d2_enu_m": (40, 0, 5)},
        "sensing": {},
        "forest": {"grade": (0.025, 0.0), "stand": {"density_per_ha": 300.0}},
        "sim": {"seed": 4, "radio_trunks": "attenuated"},
    },
}


def traffic(log: bytes) -> Iterator[tuple[int, bytes]]:
    """Each frame of a tlog, with its time in us from the first."""
    at, began_us = 0, int.from_bytes(log[:8], "big")
    while at < len(log):
        start, end, _ = find_frame(log, at + 8)
        yield int.from_bytes(log[at:start], "big") - began_us, log[start:end]
        at = end


@pytest.mark.skipif(WHY_PURE is not None, reason=f"pure Python: {WHY_PURE}")
@pytest.mark.parametrize("name", MISSIONS)
def test_compiled_and_pure_fly_the_same_to_the_bit(name: str, tmp_path: Path) -> None:
    mission = tmp_path / "mission.toml"
    mission.write_text(dump_mission(short_mission(**MISSIONS[name])), encoding="utf-8")
    paths = {"PYTHONPATH": str(TESTS.parent)}
    flown = {}
    for how, switch in (("compiled", {}), ("pure", {SWITCH: "1"})):
        command = [sys.executable, "-c", FLY, str(mission), str(tmp_path / how)]
        environment = {**os.environ, **paths, **switch}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        state, ended, trace_hash = json.loads(done.stdout)
        assert state.startswith(how)
        logs = {log.name: list(traffic(log.read_bytes())) for log in (tmp_path / how).rglob("*.tlog")}
        assert len(logs) == 4
        flown[how] = (ended, trace_hash, logs)
    assert flown["compiled"] == flown["pure"]


@pytest.mark.skipif(WHY_PURE is not None, reason=f"pure Python: {WHY_PURE}")
def test_compiled_and_pure_safety_filter_say_the_same_of_any_input_among_trunks() -> None:
    """Flights in calm air seldom come to where no setpoint is verified, gusts do."""
    paths = {"PYTHONPATH": str(TESTS.parent)}
    said = {}
    for how, switch in (("compiled", {}), ("pure", {SWITCH: "1"})):
        command, environment = [sys.executable, "-c", SAFETY_FILTER], {**os.environ, **paths, **switch}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        state, said[how] = done.stdout.split()
        assert state.startswith(how)
    assert said["compiled"] == said["pure"]
