"""SwarmFuzz's attack (arXiv 2606.00904; its code: DependableSystemsLab/SwarmFuzz): one member's satellites are spoofed.

Theirs looks for the attack under which another vehicle collides: whom, which way, when. Ours draws a few for each
mission, and counts the missions in which one of them does. The geometry is theirs: the swarm starts about 75 m before
one obstacle 37.5 m wide and flies to a place 205 m off. Their obstacle is a cylinder that each knows the place of; ours
is a box, as no trunk is so thick, and is seen by the obstacle sensor.
"""

from __future__ import annotations

import random
from typing import Any, Final

from mission.document.model import Mission
from sim_bridge.drive.fly import Flight
from sim_bridge.lab.study.backends.agents import fly_stack
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.referees.referee import Case, Row

SIZES: Final = (5, 10, 15)
SPOOFED_M: Final = (5.0, 10.0)
MISSIONS: Final = range(1, 4)
ATTACKS: Final = (1, 2)  # of each mission, size and distance
ESTIMATES: Final = "exact"  # so that what goes wrong is the attack's
UNATTACKED: Final = "no attack"
RADIOS: Final = ", range radios"  # at the end of a case's name: each vehicle measures how far its neighbours are
DRIFT_MPS: Final = 0.5  # how fast the position is led astray
BEGINS_S: Final = (0.0, 20.0)  # after the swarm has left d1: before or beside the obstacle
TABLES: Final[dict[str, Any]] = {
    "schema": 1,
    "name": "swarmfuzz",
    "route": {"d1_enu_m": (0.0, 0.0, 8.0), "d2_enu_m": (205.0, 14.5, 8.0), "vel_leader_mps": 3.0},
    "coverage": {"radius_m": 30.0, "duration_s": 0.0},  # over on arrival
    "sensing": {"range_m": 12.0},
    "forest": {"boxes": ({"centre_enu_m": (75.0, 0.0), "length_m": 37.5, "width_m": 37.5, "height_m": 100.0},)},
}


def cases() -> list[Case]:
    """Of each size and mission one flight without an attack and the attacks, `5 m, attack 1`; with range radios too."""
    attacks = [f"{spoofed_m:g} m, attack {number}" for number in ATTACKS for spoofed_m in SPOOFED_M]
    names = [name + radios for radios in ("", RADIOS) for name in (UNATTACKED, *attacks)]
    return [Case(name, n, seed, ESTIMATES) for seed in MISSIONS for n in SIZES for name in names]


def attack_of(case: Case) -> tuple[int, list[dict[str, Any]]]:
    """The vehicle that is attacked, and its faults: it is led to a side, and kept there."""
    name = case.name.removesuffix(RADIOS)
    if name == UNATTACKED:
        return 0, []
    spoofed_m, number = float(name.split()[0]), int(name.split()[-1])
    rng = random.Random(f"{case.seed} {case.n} {number}")  # the same attack by 5 and by 10 m, with radios and without
    target, side, at_s = rng.randint(1, case.n), rng.choice((-1.0, 1.0)), rng.uniform(*BEGINS_S)
    fault = {"kind": "gnss-drift", "vehicles": [target], "phase": "transit"}
    led = {**fault, "at_s": at_s, "drift_mps": (0.0, side * DRIFT_MPS)}
    kept = {**fault, "at_s": at_s + spoofed_m / DRIFT_MPS, "drift_mps": (0.0, 0.0)}
    return target, [led, kept]


def mission_of(case: Case) -> Mission:
    """What it flies."""
    tables = {**TABLES, "ranging": {}} if case.name.endswith(RADIOS) else TABLES
    sim = {"seed": case.seed, "estimates": case.estimates, "time_limit_s": 300.0, "faults": attack_of(case)[1]}
    return Mission.model_validate({**tables, "swarm": {"size": case.n}, "sim": sim}).with_origin(DEFAULT_ORIGIN)


def fly_attack(case: Case) -> Row:
    """Its grade: others (another vehicle collided, with whatever), own (the attacked one alone did) or clear."""
    target, touched = attack_of(case)[0], dict[int, str]()

    def look(flight: Flight) -> None:
        for k, what in enumerate(flight.last.touched, start=1):
            if what:
                touched[k] = what

    outcome = fly_stack(mission_of(case), None, on_jsbsim=False, watch=look)
    others = {k: what for k, what in touched.items() if k != target}
    grade = "others" if others else "own" if touched else "clear"
    return case.row(
        grade,
        target=target,
        touched={str(k): what for k, what in touched.items()},
        min_separation_m=outcome.metrics.min_separation_m,
        verdict=outcome.summary["verdict"],
        trace_hash=outcome.summary["trace_hash"],
    )
