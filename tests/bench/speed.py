"""What a flight costs, in ratios of one run: all that is compared takes turns, stint by stint.

The yardstick is the `run()` loop of the F450 that JSBSim ships, at the bridge's 200 Hz, for as many simulated seconds
as the vehicles fly. A cost is processor time, of all processes, for a vehicle's simulated second.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from companion.mavlink import endpoint
from tests.bench.table import Row, spread
from tests.bench.turns import ROOT, StintProgram, cost_s, pure_copy, stint_command, take_turns

MISSION = "mission/examples/lone_tree.toml"
N = 8
SEEDS = range(1, 6)
STINT_S = 15.0  # simulated: with 8 vehicles, some tenths of a processor's second for the yardstick
SIZES = (8, 20, 50, 100)
IN_FLIGHT_STINTS, IN_FLIGHT_STINT_S = 5, 3.0
WIDE_MISSION = "mission/examples/paper.toml"
WIDE: dict[str, dict[str, Any]] = {  # 130 m at 3 m/s and room for 100, as in sim_bridge/lab/study/examples/scale.toml
    "route": {"d1_enu_m": [0.0, 0.0, 40.0], "d2_enu_m": [130.0, 0.0, 40.0], "vel_leader_mps": 3.0},
    "coverage": {"radius_m": 25.0},
}
LOW_START = WIDE | {"route": WIDE["route"] | {"d1_enu_m": [0.0, 0.0, 8.0]}}  # where only the transit is of interest
COMPILED = not str(endpoint.__file__).endswith(".py")
IN_PROCESS, PROCESSES, PURE, BARE = "in process", "agents as processes", "in process, pure Python", "bare F450"
BESIDE = "the other checkout, "


def speed(beside: Path | None) -> Iterator[Row]:
    """`beside`: another checkout, which flies the same in turn."""
    yield from ratios(beside)
    yield from growth(beside)


def ratios(beside: Path | None) -> Iterator[Row]:
    """Whole flights, n = 8, from the start of the companions to the figures."""
    costs: dict[str, list[float]] = {}
    factors: list[float] = []
    hashes: list[set[str]] = []
    with ExitStack() as stack:
        pure = stack.enter_context(pure_copy(ROOT)) if COMPILED else None
        for seed in SEEDS:
            flown = whole_flights(seed, pure, beside)
            for name, program in flown.items():
                costs.setdefault(name, []).append(cost_s(program.stints))
            stints = flown[PROCESSES].stints
            factors.append(sum(s.vehicle_s for s in stints) / N / sum(s.wall_s for s in stints))
            ends = [program.end for name, program in flown.items() if program.end and not name.startswith(BESIDE)]
            hashes.append({end["trace_hash"] for end in ends})
    yield from ratio_rows(costs, factors)
    same = sum(len(of_seed) == 1 for of_seed in hashes)
    yield Row(
        "- trace_hash equal in all of these ways",
        f"{len(SEEDS)} of {len(SEEDS)}",
        f"{same} of {len(hashes)}",
        same == len(SEEDS),
    )


def whole_flights(seed: int, pure: Path | None, beside: Path | None) -> dict[str, StintProgram]:
    """The yardstick and every way of flying, flown out."""
    ways = {IN_PROCESS: ((), ROOT), PROCESSES: (("--processes",), ROOT)}
    if pure is not None:
        ways[PURE] = ((), pure)
    if beside is not None:
        ways |= {BESIDE + IN_PROCESS: ((), beside), BESIDE + PROCESSES: (("--processes",), beside)}
    with ExitStack() as stack:
        bare = stack.enter_context(StintProgram(stint_command("bare")))
        programs = {
            name: stack.enter_context(
                StintProgram(stint_command(MISSION, "--seed", str(seed), *options), checkout=checkout)
            )
            for name, (options, checkout) in ways.items()
        }
        take_turns(programs.values(), bare, STINT_S)
    return {BARE: bare, **programs}


def ratio_rows(costs: dict[str, list[float]], factors: Sequence[float]) -> Iterator[Row]:
    """The costs of five flights each, in their order."""

    def ratio(name: str, other: str = BARE) -> list[float]:
        return [one / two for one, two in zip(costs[name], costs[other], strict=True)]

    what = f"full stack / bare F450 run(), n = {N}, whole flights to the lone tree, seeds 1-5"
    for name, most, stretch in ((IN_PROCESS, 2.5, 1.8), (PROCESSES, 4.0, 3.0)):
        seen = spread(ratio(name), "x")
        yield Row(
            f"{what}: {name}",
            f"<= {most:g}x (stretch {stretch:g}x)",
            seen,
            statistics.median(ratio(name)) <= most,
        )
    load = f"load average {os.getloadavg()[0]:.1f} on {psutil.cpu_count()} cores"
    yield Row(
        f"- real-time factor, {PROCESSES}, wall time, start of the companions included",
        ">= 35x",
        f"{spread(factors, 'x')} ({load})",
        statistics.median(factors) >= 35.0,
    )
    for name, of_seeds in costs.items():
        yield Row(
            f"- vehicle-seconds for a processor's second: {name}", "told", spread([1 / c for c in of_seeds], ""), True
        )
    if PURE in costs:
        yield Row("- pure Python / compiled", "told", spread(ratio(PURE, IN_PROCESS), "x"), True)
    for name in (IN_PROCESS, PROCESSES):
        if BESIDE + name in costs:
            yield Row(f"- {BESIDE}{name} / this one", "told", spread(ratio(BESIDE + name, name), "x"), True)


def growth(beside: Path | None) -> Iterator[Row]:
    """Processor time of a simulated second in transit over n, agents in process."""
    yield from growth_rows("", in_flight(ROOT))
    if beside is not None:
        yield from growth_rows(BESIDE, in_flight(beside))


def in_flight(checkout: Path) -> dict[int, list[float]]:
    """Seconds of CPU for a vehicle's simulated second in transit, stint by stint in turn, of each size."""
    with ExitStack() as stack:
        programs = {}
        for n in SIZES:
            command = stint_command(WIDE_MISSION, "--n", str(n), "--set", json.dumps(LOW_START))
            programs[n] = stack.enter_context(StintProgram(command, checkout=checkout))
            programs[n].fly("transit")
        for _ in range(IN_FLIGHT_STINTS):
            for program in programs.values():
                program.fly(IN_FLIGHT_STINT_S)
    return {n: [cost_s([stint]) for stint in program.stints[1:]] for n, program in programs.items()}


def growth_rows(whose: str, costs: dict[int, list[float]]) -> Iterator[Row]:
    """The exponent a of CPU per simulated second ~ n^a."""
    medians = {n: statistics.median(of_n) for n, of_n in costs.items()}
    found = exponent({n: n * cost for n, cost in medians.items()})
    yield Row(
        f"{whose}growth exponent in transit, n = {', '.join(map(str, medians))}, in process, seed 1: "
        "CPU of a simulated second over n, least squares of the logarithms",
        "<= 1.15",
        f"{found:.2f}",
        found <= 1.15,
    )
    seen = ", ".join(f"n = {n}: {1000 * cost:.1f}" for n, cost in medians.items())
    yield Row(f"- {whose}CPU ms for a vehicle-second, median of {IN_FLIGHT_STINTS} stints", "told", seen, True)


def exponent(cpu_s: dict[int, float]) -> float:
    """Slope of log(CPU) over log(n): 1 when a vehicle costs the same in any company."""
    n, cost = np.log(list(cpu_s)), np.log(list(cpu_s.values()))
    return float(np.polynomial.Polynomial.fit(n, cost, 1).convert().coef[1])


def large_swarms() -> Iterator[Row]:
    """Whole flights of 50 and 100, agents in process, seed 1."""
    for n in (50, 100):
        with StintProgram(stint_command(WIDE_MISSION, "--n", str(n), "--set", json.dumps(WIDE))) as program:
            program.fly("end")
        end: dict[str, Any] = program.end or {}
        flown = program.stints[0]
        yield Row(
            f"a whole flight of {n}: 130 m in the open, JSBSim, in process, seed 1",
            "ARRIVED, 0 contacts",
            f"{end['verdict']}, {end['contacts']} contacts, separation {end['min_separation_m']:.2f} m",
            end["verdict"] == "ARRIVED" and end["contacts"] == 0,
        )
        cost = f"{1000 * cost_s([flown]):.1f} ms: {flown.vehicle_s / n:.0f} s flown in {flown.cpu_s:.0f} s of CPU"
        yield Row("- CPU for a vehicle-second", "told", cost, True)


def table1() -> Iterator[Row]:
    """The wall time of `make table1`, into a folder that is thrown away."""
    with tempfile.TemporaryDirectory() as folder:
        began_s = time.perf_counter()
        command = [sys.executable, "-m", "sim_bridge.lab.paper.table1", "--again", "--out", f"{folder}/rows"]
        done = subprocess.run([*command, "--docs", folder], capture_output=True, check=False)
        seconds = time.perf_counter() - began_s
    fine = done.returncode == 0 and seconds <= 90.0
    seen = f"{seconds:.0f} s, exit code {done.returncode} (load average {os.getloadavg()[0]:.1f})"
    yield Row("make table1", "<= 90 s", seen, fine)
