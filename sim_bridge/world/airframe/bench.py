"""CPU time of the quad with its control loops against the F450 that JSBSim ships, which has none to speak of.

python -m sim_bridge.world.airframe.bench [--json] [--rate-hz 200]
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from typing import Any

from mission.common.frames import LocalFrame, Wgs84
from sim_bridge.world.airframe.jsbsim_quad import RATES_HZ, JsbsimQuad, quiet_jsbsim

TICK_S = 0.05  # the companion's: one command in, one state out
TICKS = 100  # per repetition: long against the clock's resolution, short against other load on the machine
REPETITIONS = 21
FLEET = 50
FRAME = LocalFrame(Wgs84(45.0, 9.0, 0.0))


def main(argv: list[str] | None = None) -> int:
    """Measure and print; the exit code."""
    parser = argparse.ArgumentParser(prog="sim_bridge.world.airframe.bench", description=__doc__, allow_abbrev=False)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--rate-hz", type=int, choices=RATES_HZ, default=RATES_HZ[0])
    args = parser.parse_args(argv)
    result = measure(args.rate_hz)
    print(json.dumps(result) if args.json else _table(result))
    return 0


def measure(rate_hz: int) -> dict[str, float]:
    """Interleaved repetitions of both, so that the load on the machine falls on both."""
    steps = round(TICK_S * rate_hz) * TICKS
    fly_f450, fly_quad = _f450(rate_hz, steps), _fleet(1, rate_hz)
    f450_us: list[float] = []
    quad_us: list[float] = []
    for _ in range(REPETITIONS):
        f450_us.append(_cpu_us(fly_f450) / steps)
        quad_us.append(_cpu_us(fly_quad) / steps)
    ratios = sorted(quad / f450 for quad, f450 in zip(quad_us, f450_us, strict=True))
    fly_fleet = _fleet(FLEET, rate_hz, ticks=TICKS // 10)
    fleet_us = [_cpu_us(fly_fleet) / (steps // 10 * FLEET) for _ in range(REPETITIONS // 4)]
    return {
        "rate_hz": rate_hz,
        "f450_us_per_step": statistics.median(f450_us),
        "quad_us_per_step": statistics.median(quad_us),
        "ratio_median": statistics.median(ratios),
        "ratio_lower_quartile": ratios[REPETITIONS // 4],
        "ratio_upper_quartile": ratios[-1 - REPETITIONS // 4],
        "fleet_vehicles": FLEET,
        "fleet_us_per_step": statistics.median(fleet_us),
    }


def _table(result: dict[str, float]) -> str:
    return (
        f"{result['rate_hz']} Hz, CPU time per physics step\n"
        f"  bare F450                    {result['f450_us_per_step']:6.2f} us\n"
        f"  quad, its loops, Python      {result['quad_us_per_step']:6.2f} us\n"
        f"  ratio                        {result['ratio_median']:6.2f}"
        f" (quartiles {result['ratio_lower_quartile']:.2f} .. {result['ratio_upper_quartile']:.2f})\n"
        f"  {result['fleet_vehicles']} quads, {TICK_S} s each in turn  {result['fleet_us_per_step']:6.2f} us"
    )


def _cpu_us(fly: Callable[[], None]) -> float:
    begin_s = time.process_time()
    fly()
    return (time.process_time() - begin_s) * 1e6


def _f450(rate_hz: int, steps: int) -> Callable[[], None]:
    """In the air with its rotors turning about as fast as in hover."""
    fdm: Any = quiet_jsbsim().FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.set_dt(1.0 / rate_hz)
    fdm.load_model("F450")
    fdm["ic/lat-geod-deg"] = FRAME.origin.lat_deg
    fdm["ic/h-agl-ft"] = 300.0
    fdm["fcs/throttle-cmd-norm"] = 0.41

    def fly() -> None:
        fdm.run_ic()
        for _ in range(steps):
            fdm.run()

    return fly


def _fleet(size: int, rate_hz: int, ticks: int = TICKS) -> Callable[[], None]:
    """Vehicles in the air; in each tick, each takes a command, makes all its steps, and gives its state."""
    quads = [JsbsimQuad(FRAME, (0.0, 10.0 * i, -100.0), 0.0, rate_hz=rate_hz) for i in range(size)]
    for quad in quads:
        quad.set_armed(True)

    def fly() -> None:
        for tick in range(ticks):
            for quad in quads:
                quad.command((3.0 if tick < ticks // 2 else -3.0, 0.0, 0.0), 0.0)
                quad.step(TICK_S)
                assert not quad.state.on_ground

    return fly


if __name__ == "__main__":
    raise SystemExit(main())
