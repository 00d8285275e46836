"""Tune the movement laws fairly: `python -m sim_bridge.lab.laws.tune`. Same flights, objective and budget for each.

Training: CMA-ES over the logarithms of a law's parameters, from their published values (ours: the flight software's),
TRIALS trials of the flights with TRAINING seeds. Then the start and the best trial, to three digits, fly the HELD_OUT
seeds, and the paired difference of their objectives decides: the tuned set wins if the 95 % interval of start minus
tuned is above 0. How the leader brakes before its goal is the same for all and is not tuned.

Objective of a flight, to be small: overhead of the last, or 1 if not all arrive; 0.1 for each m/s2 of acceleration,
mean over the vehicles and the time in transit; 0.1 for each metre by which the least separation falls short of 6 m; 10
times the share of transit in which the swarm was not connected; and 1 for each contact.

Flights: 130 m at 3 m/s on point masses (lag 0.3 s, 3 m/s2, 5 m/s). Half way the leader is sent elsewhere: it turns by
an angle of TURN_DEG to either side. Beacons are one period of 100 ms old, and every tick loses 10 % on each link.
Positions and velocities are as wrong as PX4's were seen to be, and each vehicle flies by its own. Among trees:
`tune_forest`.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Protocol

import cma
import numpy as np

from companion.core.guidance import formation
from mission.document.model import Mission, Personality
from sim_bridge.lab.study.law import Floats, Law, View, law_module
from sim_bridge.lab.study.point_mass import Figures, Swarm, starts
from sim_bridge.lab.study.summary import spread
from sim_bridge.world.autopilot.estimator import POSITION_MEMORY_S, RECORDED, VELOCITY_MEMORY_S, VERTICAL_SHARE

TRAINING = range(1000, 1003)
HELD_OUT = range(1, 11)
TRAINING_SIZES = (4, 12)
SIZES = (4, 8, 12, 20)
TRIALS = 32
LOSS = 0.1
TURN_DEG = (45.0, 120.0)
ERRORS = RECORDED[Personality.PX4]
SEPARATION_WANTED_M = 6.0
EFFORT_COST = 0.1  # for each m/s2: one that is always at its limit of 3 pays for 30 % of overhead
COLUMNS = (
    *("law", "n", "values", "cost", "gain", "arrived", "overhead of last, %"),
    *("mean acceleration, m/s2", "worst separation, m", "least connected, %", "contacts"),
)
MISSION: dict[str, Any] = {
    "schema": 1,
    "coverage": {"radius_m": 25.0, "shape": "sphere"},
    "fence": {"altitude_max_m": 80.0},
    "route": {"d1_enu_m": (0.0, 0.0, 40.0), "d2_enu_m": (130.0, 0.0, 40.0), "vel_leader_mps": 3.0},
}
TUNED: dict[str, tuple[str, ...]] = {
    "ours": (
        "SEPARATION_GAIN_PER_S",
        "COHESION_GAIN_PER_S",
        "COHESION_START",
        "LEVEL_GAIN_PER_S",
    ),
    "olfati-saber": ("d_m", "epsilon", "a", "b_over_a", "consensus", "c1", "c2"),
    "vasarhelyi": (
        "r0_rep_m",
        "p_rep_per_s",
        "r0_frict_m",
        "c_frict",
        "v_frict_mps",
        "p_frict_per_s",
        "a_frict_mps2",
    ),
}
NOT_BELOW_START = ("b_over_a",)  # starts at the least that its paper allows


class HardSwarm(Swarm):
    """Point masses with lost beacons, wrong estimates and a leader that turns. The same for each law and seed.

    A neighbour whose beacon is lost is not there in that tick: harsher than agents, which remember it for a while.
    """

    def __init__(self, mission: Mission, seeds: Sequence[int]) -> None:
        pos_enu_m = starts(mission, seeds)
        self._rngs = [np.random.default_rng([seed, 0x1055]) for seed in seeds]
        self._turns = [rng.choice((-1.0, 1.0)) * math.radians(rng.uniform(*TURN_DEG)) for rng in self._rngs]
        self._pos_error, self._vel_error = (
            self._drawn(pos_enu_m.shape[1], sd) for sd in (ERRORS.position_noise_m, ERRORS.velocity_noise_mps)
        )
        super().__init__(mission, pos_enu_m)

    def tick(self, law: Law) -> None:
        """One beacon period."""
        super().tick(law)
        self._pos_error = self._wander(self._pos_error, ERRORS.position_noise_m, POSITION_MEMORY_S)
        self._vel_error = self._wander(self._vel_error, ERRORS.velocity_noise_mps, VELOCITY_MEMORY_S)
        half_m = self.mission.route.length_m / 2.0
        flown_m = np.linalg.norm(self.pos_enu_m[:, 0] - self._d1, axis=1)
        straight = np.array([route is self.mission for route in self._routes])
        for b in np.flatnonzero(straight & (self.departed_tick >= 0) & (flown_m >= half_m)):
            self._turn(int(b), half_m)

    def _turn(self, b: int, left_m: float) -> None:
        """The leader of flight `b` has a new goal, so far from where it is."""
        course = self._d2[b] - self._d1[b]
        angle = math.atan2(course[1], course[0]) + self._turns[b]
        here = self.pos_enu_m[b, 0]
        self._d2[b] = here + left_m * np.array((math.cos(angle), math.sin(angle), 0.0))
        d1, d2 = (tuple(place.tolist()) for place in (here, self._d2[b]))
        route = self.mission.route.model_copy(update={"d1_enu_m": d1, "d2_enu_m": d2})
        self._routes[b] = self.mission.model_copy(update={"route": route})

    def _told(self) -> tuple[Floats, Floats]:
        return self.pos_enu_m + self._pos_error, self.vel_enu_mps + self._vel_error

    def _move(self, command: Floats) -> None:
        super()._move(command - self._vel_error)  # an autopilot controls what it believes

    def _view(self, pos_enu_m: Floats, vel_enu_mps: Floats) -> View:
        view = super()._view(pos_enu_m, vel_enu_mps)
        shape = view.heard.shape[1:]
        kept = np.stack([rng.random(shape) >= LOSS for rng in self._rngs])
        return replace(view, heard=view.heard & kept)

    def _wander(self, error: Floats, sd: float, memory_s: float) -> Floats:
        """A step of an Ornstein-Uhlenbeck process, as `autopilot.estimator` has it."""
        kept = math.exp(-self.dt_s / memory_s)
        return kept * error + self._drawn(error.shape[1], sd * math.sqrt(1.0 - kept * kept))

    def _drawn(self, n: int, sd: float) -> Floats:
        scale = sd * np.array((1.0, 1.0, VERTICAL_SHARE))
        return np.stack([rng.standard_normal((n, 3)) for rng in self._rngs]) * scale


def main(argv: Sequence[str] | None = None) -> int:
    """A table of each law before and after, and what was found."""
    args = asked(argv, "tune", __doc__, tuple(TUNED), TRIALS)
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    found = []
    for name in args.laws:
        start = values_of(name)
        tuned = tune(name, start, args.trials)
        found.append((name, start, tuned))
        for n in SIZES:
            before, after = (fly(name, n, values, HELD_OUT) for values in (start, tuned))
            print(row(name, n, "start", before, ""))
            print(row(name, n, "tuned", after, interval(gains(before, after), ".4f", "+")), flush=True)
    for name, start, tuned in found:
        print(f"\n{name}: " + ", ".join(f"{key} {start[key]:.3g} -> {tuned[key]:.3g}" for key in start))
    return 0


def asked(argv: Sequence[str] | None, module: str, text: str, laws: Sequence[str], trials: int) -> argparse.Namespace:
    """The command line of a tuner: which of `laws`, and `trials` of each."""
    parser = argparse.ArgumentParser(prog=f"python -m sim_bridge.lab.laws.{module}", description=text.splitlines()[0])
    parser.add_argument("laws", nargs="*", metavar="LAW", help=f"which: {', '.join(laws)} (default: all)")
    parser.add_argument("--trials", type=int, default=trials, metavar="K", help="for each law (default: %(default)s)")
    args = parser.parse_args(argv)
    unknown = [name for name in args.laws if name not in laws]
    if unknown:
        parser.error(f"{', '.join(unknown)}: must be of {', '.join(laws)}")
    args.laws = args.laws or list(laws)
    return args


def tune(name: str, start: Mapping[str, float], trials: int) -> dict[str, float]:
    """The best values of `trials`, to three digits; the start itself if none is better."""

    def cost(values: Mapping[str, float]) -> float:
        flights = [objective(f) for n in TRAINING_SIZES for f in fly(name, n, values, TRAINING)]
        return float(np.mean(flights))

    return search(start, cost, trials)


def search(
    start: Mapping[str, float], cost: Callable[[Mapping[str, float]], float], trials: int, population: int = 8
) -> dict[str, float]:
    """CMA-ES over the logarithms of `start`; the values of least `cost` in `trials`, to three digits, or the start."""

    def values(x: Sequence[float]) -> dict[str, float]:
        changed = {key: value * float(np.exp(change)) for (key, value), change in zip(start.items(), x, strict=True)}
        return {key: float(f"{value:.3g}") for key, value in changed.items()}

    least = [0.0 if key in NOT_BELOW_START else None for key in start]
    options = {"maxfevals": trials, "seed": 1, "popsize": population, "verbose": -9, "bounds": [least, None]}
    strategy = cma.CMAEvolutionStrategy([0.0] * len(start), 0.3, options)
    best_cost, best = cost(start), dict(start)
    while not strategy.stop():
        asked = strategy.ask()
        costs = [cost(values(x)) for x in asked]
        strategy.tell(asked, costs)
        if min(costs) < best_cost:
            best_cost, best = min(costs), values(asked[costs.index(min(costs))])
    return best


def row(name: str, n: int, values: str, flights: Sequence[Figures], gain: str) -> str:
    """Held-out figures, as of COLUMNS."""
    overheads = [100.0 * f.overhead_last for f in flights if f.overhead_last is not None]
    cells = [name, str(n), values, interval([objective(f) for f in flights], ".4f"), gain]
    cells.append(str(sum(f.arrived for f in flights)))
    cells.append(interval(overheads, ".2f") if overheads else "-")
    return f"| {' | '.join([*cells, *cells_of(flights)])} |"


class Flown(Protocol):
    """What figures of a flight tell, in the open and among trees."""

    @property
    def acceleration_mean_mps2(self) -> float | None:
        """Over the vehicles and the time in transit."""

    @property
    def min_separation_m(self) -> float | None:
        """Of all pairs in the air."""

    @property
    def connected_fraction_transit(self) -> float | None:
        """Share of transit in which the swarm was whole."""

    @property
    def contacts(self) -> int:
        """With vehicles and trunks."""


def cells_of(flights: Sequence[Flown]) -> list[str]:
    """The last of COLUMNS: mean acceleration, worst separation, worst connection, contacts."""
    return [
        f"{np.mean([f.acceleration_mean_mps2 or 0.0 for f in flights]):.2f}",
        f"{min(f.min_separation_m or 0.0 for f in flights):.2f}",
        f"{100.0 * min(f.connected_fraction_transit or 0.0 for f in flights):.1f}",
        str(sum(f.contacts for f in flights)),
    ]


def gains(before: Sequence[Figures], after: Sequence[Figures]) -> list[float]:
    """By how much each flight's objective is smaller, the same seed in both."""
    return [objective(was) - objective(now) for was, now in zip(before, after, strict=True)]


def interval(values: Sequence[float], form: str, sign: str = "") -> str:
    """Mean ± half the 95 % interval of the mean, Student's t."""
    found = spread(values)
    if found is None or found.high is None:
        return "-"
    return f"{found.mean:{sign}{form}} ± {found.high - found.mean:{form}}"


def objective(f: Figures) -> float:
    """Of one flight; see above."""
    late = 1.0 if f.overhead_last is None else f.overhead_last
    close = 0.1 * max(0.0, SEPARATION_WANTED_M - (f.min_separation_m or 0.0))
    apart = 10.0 * (1.0 - (f.connected_fraction_transit or 0.0))
    effort = EFFORT_COST * (f.acceleration_mean_mps2 or 0.0)
    return late + effort + close + apart + f.contacts


def values_of(name: str) -> dict[str, float]:
    """Where tuning starts."""
    source = formation if name == "ours" else law_module(name).Params()
    return {key: float(getattr(source, key)) for key in TUNED[name]}


def fly(name: str, n: int, values: Mapping[str, float], seeds: Sequence[int]) -> list[Figures]:
    """Flights of n vehicles with these values."""
    mission = Mission.model_validate({**MISSION, "swarm": {"size": n}})
    module = law_module(name)
    with formation_set(values if name == "ours" else {}):
        swarm = HardSwarm(mission, seeds)
        law = module.make(mission, len(seeds), module.Params(**({} if name == "ours" else values)))
        while not swarm.over:
            swarm.tick(law)
    return swarm.figures()


@contextmanager
def formation_set(values: Mapping[str, float]) -> Iterator[None]:
    """The flight software's gains are constants, not options: they are changed for the time of a trial only."""
    before = {key: getattr(formation, key) for key in values}
    try:
        for key, value in values.items():
            setattr(formation, key, value)
        yield
    finally:
        for key, value in before.items():
            setattr(formation, key, value)


if __name__ == "__main__":
    sys.exit(main())
