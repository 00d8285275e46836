"""Satellites of one vehicle led astray under the open sky, with range radios and without: see `spoofing --open-sky`."""

from __future__ import annotations

import io
import math
import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mission.document.model import Mission
from sim_bridge.drive import fly as bridge
from sim_bridge.judge.progress import Progress
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.table import spread
from tests.flights import point_masses

SALT = 0x5B0A7
RATES_MPS = (0.1, 0.5)
LASTS_S = 60.0
SAID = re.compile(r"([\d.]+) s  vehicle (\d+): position doubted: GNSS led astray")

BEGAN = re.compile(r"([\d.]+) s  fault: GNSS of \D*(\d+) drifts")


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight."""

    drawn: str
    n: int
    radios: bool
    grade: str
    separation_m: float
    outside_m: float
    off_m: float | None  # of the one that is led astray, when it was noticed
    alarms: int  # of others


def draw_tables(seed: int, *, radios: bool) -> tuple[dict[str, Any], str]:
    """The mission of a seed, and what was drawn, in words."""
    rng = np.random.default_rng([SALT, seed])
    n, struck_leader = int(rng.integers(4, 11)), bool(rng.random() < 0.5)
    struck = 0 if struck_leader else int(rng.integers(1, n + 1))
    rate_mps = math.exp(rng.uniform(math.log(RATES_MPS[0]), math.log(RATES_MPS[1])))
    bearing, at_s = float(rng.uniform(0.0, math.tau)), round(float(rng.uniform(0.0, 20.0)), 1)
    wind_mps, blows = float(rng.uniform(0.0, 4.0)), float(rng.uniform(0.0, math.tau))
    loss = round(float(rng.uniform(0.0, 0.3)), 2)
    fault: dict[str, Any] = {
        "kind": "gnss-drift",
        "phase": "transit",
        "at_s": at_s,
        "for_s": LASTS_S,
        "drift_mps": [rate_mps * math.sin(bearing), rate_mps * math.cos(bearing)],
    }
    if struck:
        fault["vehicles"] = [struck]
    tables: dict[str, Any] = {
        "schema": 1,
        "name": f"open sky {seed}",
        "route": {"d1_enu_m": [0.0, 0.0, 8.0], "d2_enu_m": [120.0, 0.0, 8.0], "vel_leader_mps": 3.0},
        "fence": {
            "altitude_min_m": 2.0,
            "altitude_max_m": 14.0,
            "polygon_enu_m": [[-40.0, -35.0], [160.0, -35.0], [160.0, 35.0], [-40.0, 35.0]],
        },
        "swarm": {"size": n},
        "coverage": {"radius_m": 14.0, "duration_s": 30.0},
        "sim": {
            "seed": seed,
            "estimates": "recorded",
            "radio_loss": loss,
            "wind_mps": [wind_mps * math.sin(blows), wind_mps * math.cos(blows), 0.0],
            "time_limit_s": 300.0,
            "faults": [fault],
        },
    }
    if radios:
        tables["ranging"] = {"reach_m": 35.0}
    who = f"vehicle {struck}" if struck else "the leader"
    return tables, f"seed {seed}, n {n}, {who} by {rate_mps:.2f} m/s from {at_s} s, loss {loss:.0%}, {wind_mps:.1f} m/s"


def fly_one(seed: int, *, radios: bool) -> Flown:
    """On point masses."""
    tables, drawn = draw_tables(seed, radios=radios)
    mission, shown = Mission.model_validate(tables).with_origin(DEFAULT_ORIGIN), io.StringIO()
    with tempfile.TemporaryDirectory() as folder, Progress(shown) as progress:
        outcome = bridge.fly(mission, Path(folder), progress, in_process=True, airframes=point_masses)
    text = shown.getvalue()
    began = BEGAN.search(text)
    began_s, struck = (float(began[1]), int(began[2])) if began else (math.inf, 0)
    rate_mps = math.hypot(*tables["sim"]["faults"][0]["drift_mps"])
    said = [(float(at_s), int(vehicle)) for at_s, vehicle in SAID.findall(text)]
    found = [rate_mps * min(LASTS_S, at_s - began_s) for at_s, vehicle in said if vehicle == struck]
    metrics = outcome.metrics
    return Flown(
        drawn,
        mission.swarm.size,
        radios,
        str(outcome.summary["grade"]),
        metrics.min_separation_m or math.inf,
        metrics.fence_exceeded_m,
        found[0] if found else None,
        sum(vehicle != struck for _, vehicle in said),
    )


def report_open_sky(flights: int, first_seed: int) -> None:
    """A line for each flight, then a row with radios and one without."""
    rows: list[Flown] = []
    for seed in range(first_seed, first_seed + flights):
        for radios in (True, False):
            row = fly_one(seed, radios=radios)
            rows.append(row)
            off = "not noticed" if row.off_m is None else f"noticed at {row.off_m:.1f} m"
            print(
                f"{row.drawn}, {'radios' if radios else 'none'}: {row.grade}, {row.separation_m:.2f} m, outside "
                f"{row.outside_m:.2f} m, {off}, {row.alarms} others",
                flush=True,
            )
    print("\n| range radios | flights | grades | noticed | off then, m | separation, m | outside, m | others' alarms |")
    print("|---|---|---|---|---|---|---|---|")
    for radios in (True, False):
        print(f"| {'each' if radios else 'none'} | {_cells([row for row in rows if row.radios is radios])} |")


def _cells(rows: Sequence[Flown]) -> str:
    grades = ", ".join(
        f"{sum(row.grade == grade for row in rows)} {grade}" for grade in sorted({r.grade for r in rows})
    )
    found = [row.off_m for row in rows if row.off_m is not None]
    off, apart = spread(found, "") if found else "-", spread([row.separation_m for row in rows], "")
    outside = spread([row.outside_m for row in rows], "")
    return f"{len(rows)} | {grades} | {len(found)} | {off} | {apart} | {outside} | {sum(row.alarms for row in rows)}"
