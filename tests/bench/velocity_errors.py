"""Open-loop runs of positions that leave their velocities, or not, by the errors of each make: see `spoofing`.

A vehicle flies straight for 60 s, then its position is led aside for LED_S while its velocity is right.
"""

from __future__ import annotations

import math

import numpy as np

from companion.core.localisation.integrity.fix_monitor import FixMonitor
from companion.core.localisation.integrity.own_position import BY_VELOCITY
from companion.core.localisation.integrity.velocity_way import VelocityWay
from companion.core.model.events import Position
from mission.document.model import Personality
from sim_bridge.world.autopilot.estimates.errors import PX4_SEEN, RECORDED_2026_11
from sim_bridge.world.autopilot.estimates.noise import Noise, Swinging, Wandering

SALT = 0x7E1
DT_S = 0.1
EAST_MPS = 2.0
QUIET_S = 60.0
LED_S = 100.0
CLEAN_S = 300.0
RATES_MPS = (0.1, 0.2, 0.3, 0.5, 1.0)
MAKES = {"PX4, 0.21 to 0.27 m/s": Personality.PX4, "ArduPilot, 0.03 m/s": Personality.ARDUPILOT}


def errors_of_make(make: Personality, rng: np.random.Generator) -> tuple[Noise, tuple[float, float]]:
    """Errors as recorded, and a bias of the velocity, north and east."""
    if make is Personality.PX4:
        seen = PX4_SEEN.draw(rng)
        swinging = Swinging(
            velocity_sd_mps=seen.velocity_noise_mps,
            climb_sd_mps=seen.climb_noise_mps,
            position_sd_m=seen.position_noise_m,
            height_sd_m=seen.height_noise_m,
            yaw_sd_rad=seen.yaw_noise_rad,
            rng=rng,
        )
        return swinging, (0.0, 0.0)
    sizes, bearing = RECORDED_2026_11[make], float(rng.uniform(0.0, math.tau))
    wandering = Wandering(
        velocity_sd_mps=sizes.velocity_noise_mps,
        climb_sd_mps=sizes.climb_noise_mps,
        position_sd_m=sizes.position_noise_m,
        height_sd_m=sizes.height_noise_m,
        rng=rng,
    )
    bias_mps = sizes.velocity_bias_mps
    return wandering, (bias_mps * math.cos(bearing), bias_mps * math.sin(bearing))


def led_until_noticed(seed: int, make: Personality, rate_mps: float) -> float | None:
    """Metres by which it is led when it is noticed; None: it was not. Of a rate of 0 within CLEAN_S: 0.0 or None."""
    rng = np.random.default_rng([SALT, seed])
    noise, bias = errors_of_make(make, rng)
    bearing = float(rng.uniform(0.0, math.tau))
    way, monitor = VelocityWay(), FixMonitor(BY_VELOCITY)
    for k in range(round((CLEAN_S if rate_mps == 0.0 else QUIET_S + LED_S) / DT_S)):
        now_s = k * DT_S
        noise.step(DT_S)
        led_m = rate_mps * max(0.0, now_s - QUIET_S)
        off, wrong = noise.pos_ned_m, noise.velocity_ned_mps
        fix = (led_m * math.cos(bearing) + off[0], EAST_MPS * now_s + led_m * math.sin(bearing) + off[1])
        vel = (wrong[0] + bias[0], EAST_MPS + wrong[1] + bias[1], 0.0)
        if not way.update(Position((fix[0], fix[1], -5.0), vel, now_s), now_s):
            continue
        if monitor.update(fix, way.ne_m, now_s, walk_since=way.walk_since) is not None:
            return led_m
    return None


def report_velocities(runs: int, first_seed: int) -> None:
    """A row for each make: metres when noticed, median (most), and how many of the runs."""
    print(f"| velocities | {' | '.join(f'{rate_mps:g} m/s' for rate_mps in RATES_MPS)} | false alarms |")
    print(f"|---|{'---|' * len(RATES_MPS)}---|")
    for name, make in MAKES.items():
        cells = []
        for rate_mps in RATES_MPS:
            led = [led_until_noticed(seed, make, rate_mps) for seed in range(first_seed, first_seed + runs)]
            found = [led_m for led_m in led if led_m is not None]
            median = f"{np.median(found):.1f} ({max(found):.1f}) m, " if found else ""
            cells.append(f"{median}{len(found)} of {runs}")
        false = sum(led_until_noticed(seed, make, 0.0) is not None for seed in range(first_seed, first_seed + runs))
        cells.append(f"{false} in {runs * CLEAN_S / 3600.0:.1f} h")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
