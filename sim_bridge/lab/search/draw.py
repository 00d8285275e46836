"""Draws a mission of a seed: size, route, stand, air, radio, makes, sensors, estimates, and a schedule of faults."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from mission.common.problems import MissionError
from mission.document import simulator
from mission.document.barometer import find_lacking_room
from mission.document.model import Mission
from mission.schema.conflict import ConflictError
from mission.schema.fault_kinds import FORMS, PARAMETERS, Needs
from mission.schema.kinds import RAW_LIDARS, FaultKind, SensorClass
from sim_bridge.lab.search.attackers import ATTACKED_SHARE, ATTACKERS, draw_attack, draw_signed
from sim_bridge.lab.search.attackers import SALT as ATTACKERS_SALT
from sim_bridge.lab.search.surveys import SALT as SURVEYS_SALT
from sim_bridge.lab.search.surveys import draw_survey
from sim_bridge.world.world import DEFAULT_ORIGIN

SALT: Final = 0x5EA7C4
MOST_TRIES: Final = 200  # of one seed, until a mission is drawn that `mission check` has nothing against
SIZES: Final = (3, 12)
MOST_FAULTS: Final = 3
TOGETHER: Final = 0.6  # share of further faults that begin while, or just after, the one before is in force
LEADER_SHARE: Final = 0.35  # of faults that strike whoever leads then
PHASES: Final = ("gather", "transit", "transit", "transit", "coverage", "coverage")

RAW_SHARE: Final = 0.5  # of missions with an obstacle sensor, whose lidar tells every ray
# Share of missions with a downward range finder: most that fly under crowns, on level ground: it holds a height over
# the ground, and fences count from the origin
RANGE_FINDER_SHARES: Final = {True: 0.85, False: 0.2}  # by whether they fly among trees
ODOMETRY_SHARE: Final = 0.7  # of missions with an obstacle sensor: the autopilot is told of the own motion
RADIOS_SHARE: Final = 0.3  # of missions in which all have satellites, that hold positions against ranges
RADIOS_SALT: Final = 0x4AD105
RADIO_REACHES_M: Final = (20.0, 25.0, 35.0)
LAYERED_SHARE: Final = 0.8  # of missions with a range finder and an obstacle sensor: `mission check` asks for layers

# Of what a seed draws: 2 has the faults of satellites, motors and sensors, 3 pilots, 4 raw scans and range finders,
# 5 layers of height, 6 odometry for the autopilot, and no crowns where a height by a barometer may be, 7 an attacker in
# half of the flights, and keys in half: without attackers it is what 6 draws, 8 range radios where all have satellites,
# 9 surveys, the base station lost, and full disks, 10 insiders that tell false trunks
VERSION: Final = 10


@dataclass(frozen=True, slots=True)
class _Row:
    """Distribution of a kind of fault. `downs`: it may take a vehicle away, so never the majority at once."""

    weight: float = 1.0
    for_s: tuple[float, float] | None = None
    numbers: tuple[tuple[str, float, float], ...] = ()  # of its parameters, least and most
    downs: bool = False


# What spoofs more than this, and who lies, is an attacker's; what strikes records is a survey's.
DRAWN: Final = {
    FaultKind.KILL: _Row(downs=True),
    FaultKind.RESTART: _Row(for_s=(0.5, 20.0)),
    FaultKind.STOP: _Row(for_s=(0.5, 20.0), downs=True),
    FaultKind.PARTITION: _Row(for_s=(1.0, 30.0)),
    FaultKind.LATE: _Row(for_s=(1.0, 20.0), numbers=(("late_s", 0.2, 3.0),)),
    FaultKind.BLIND: _Row(for_s=(0.5, 15.0)),
    FaultKind.WIND: _Row(for_s=(3.0, 20.0), numbers=(("wind_mps", -6.0, 6.0),)),
    FaultKind.GNSS_OUTAGE: _Row(for_s=(1.0, 30.0), downs=True),
    FaultKind.GNSS_DRIFT: _Row(0.3, for_s=(5.0, 20.0), numbers=(("drift_mps", -0.2, 0.2),)),
    FaultKind.MOTOR: _Row(0.5, downs=True),
    FaultKind.PILOT: _Row(0.3, downs=True),
    FaultKind.SCAN_ERRORS: _Row(for_s=(2.0, 20.0), numbers=(("noise_m", 0.0, 1.0), ("delay_s", 0.0, 0.4))),
    FaultKind.RANGE_ERRORS: _Row(for_s=(2.0, 20.0), numbers=(("bias_m", -2.0, 2.0), ("noise_m", 0.0, 1.0))),
}

Tables = dict[str, Any]


class DrawError(Exception):
    """No possible mission was found for a seed."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """A mission, and how many were drawn before it that a check refuses, or whose heights have no room to be wrong."""

    mission: Mission
    refused: int
    signed: bool = False  # its radio has keys
    attacker: str = ""  # insider, outsider or spoofer: its last fault is theirs; empty: there is none


def draw(seed: int, attacked_share: float = ATTACKED_SHARE) -> Drawn:
    """The mission of this seed, which is also its sim.seed. DrawError. `attacked_share`: of seeds with an attacker."""
    for tried in range(MOST_TRIES):
        tables = _tables(np.random.default_rng([SALT, seed, tried]), seed)
        draw_survey(np.random.default_rng([SURVEYS_SALT, seed, tried]), tables)
        rng = np.random.default_rng([ATTACKERS_SALT, seed, tried])
        signed = draw_signed(rng)
        attacker = ""
        if rng.random() < attacked_share:
            attack = draw_attack(rng, tables, signed=signed)
            tables["sim"]["faults"].append(attack)
            attacker = ATTACKERS[FaultKind(attack["kind"])]
        radios = np.random.default_rng([RADIOS_SALT, seed, tried])  # apart: the rest of a seed stays as it was
        if "ranging" not in tables and radios.random() < RADIOS_SHARE:
            tables["ranging"] = {"reach_m": float(radios.choice(RADIO_REACHES_M))}
        try:
            mission = _validated(tables)
            simulator.check(mission, f"seed {seed}")
            if not find_lacking_room(mission):
                return Drawn(mission, tried, signed, attacker)
        except (ValueError, ConflictError, MissionError):
            continue
    raise DrawError(f"seed {seed}: none of {MOST_TRIES} random missions is possible")


def _validated(tables: Tables) -> Mission:
    """The mission; without layers of height where only these are refused, as among crowns. ValueError."""
    try:
        return Mission.model_validate(tables)
    except ValueError:
        if tables.pop("separation", None) is None:
            raise
        return Mission.model_validate(tables)


def _tables(rng: Generator, seed: int) -> Tables:
    n = int(rng.integers(SIZES[0], SIZES[1], endpoint=True))
    only_leader = bool(rng.random() < 0.2)
    density_per_ha = _density(rng)
    height_m = round(float(rng.uniform(3.5, 5.0) if density_per_ha else rng.uniform(5.0, 15.0)), 1)
    route = _route(rng, height_m, with_stops=not only_leader)
    d2 = route["d2_enu_m"]
    far_m = max([math.hypot(*d2[:2]), *(math.hypot(*stop["pos_enu_m"][:2]) for stop in route.get("stops", ()))])
    coverage = _coverage(rng, n)
    tables: Tables = {
        "schema": 1,
        "name": f"search {seed}",
        "origin": DEFAULT_ORIGIN.model_dump(),
        "route": route,
        "swarm": _swarm(rng, n, only_leader=only_leader),
        "coverage": coverage,
        "fence": _fence(rng, far_m, height_m, coverage["radius_m"], among_trees=density_per_ha > 0.0),
        "forest": _forest(rng, density_per_ha, d2, slope=not only_leader),
        "sim": _sim(rng, n, seed, among_trees=density_per_ha > 0.0),
    }
    if density_per_ha or rng.random() < 0.4:
        tables["sensing"] = _sensing(rng)
    if only_leader:
        tables["ranging"] = {"start_enu_m": _starts(rng, n), "reach_m": float(rng.choice(RADIO_REACHES_M))}
    is_level = "grade" not in tables["forest"]
    tables["sim"]["range_finder"] = is_level and bool(rng.random() < RANGE_FINDER_SHARES[density_per_ha > 0.0])
    tables["sim"]["faults"] = _faults(rng, n, sensing="sensing" in tables, ranging=only_leader)
    if tables["sim"]["range_finder"] and "sensing" in tables and rng.random() < LAYERED_SHARE:
        tables["separation"] = {"height_layers": True}
    if "sensing" in tables and not only_leader:
        tables["sensing"]["sends_odometry"] = bool(rng.random() < ODOMETRY_SHARE)
    return tables


def _density(rng: Generator) -> float:
    return 0.0 if rng.random() < 0.4 else round(float(rng.uniform(50.0, 500.0)), 0)


def _route(rng: Generator, height_m: float, *, with_stops: bool) -> Tables:
    bearing = float(rng.uniform(0.0, math.tau))
    length_m = float(rng.uniform(40.0, 130.0))
    d2 = [round(length_m * math.sin(bearing), 1), round(length_m * math.cos(bearing), 1), height_m]
    route: Tables = {
        "d1_enu_m": [0.0, 0.0, height_m],
        "d2_enu_m": d2,
        "vel_leader_mps": round(float(rng.uniform(1.0, 4.0)), 1),
        "at_end": str(rng.choice(["hold", "land", "return"])),
    }
    if with_stops and rng.random() < 0.2:
        turn = bearing + float(rng.uniform(-0.8, 0.8))
        half_m = 0.5 * length_m
        stop = [round(half_m * math.sin(turn), 1), round(half_m * math.cos(turn), 1), height_m]
        route["stops"] = [{"pos_enu_m": stop, "duration_s": float(rng.integers(5, 20))}]
    return route


def _swarm(rng: Generator, n: int, *, only_leader: bool) -> Tables:
    swarm: Tables = {"size": n}
    if only_leader:
        return swarm | {"gnss": "leader", "leader_priority": [1]}
    if rng.random() < 0.4:
        first = rng.permutation(n)[: int(rng.integers(1, n + 1))] + 1
        swarm["leader_priority"] = [int(k) for k in first]
    if rng.random() < 0.3:
        swarm["reelection_period_s"] = float(rng.choice([0.0, 10.0, 20.0]))
    return swarm


def _coverage(rng: Generator, n: int) -> Tables:
    radius_m = max(8.0, 6.5 * n / math.tau) * float(rng.uniform(1.1, 1.6))
    shape = "sphere" if rng.random() < 0.1 else "ring"
    return {"radius_m": round(radius_m, 1), "shape": shape, "duration_s": float(rng.integers(30, 60))}


def _fence(rng: Generator, far_m: float, height_m: float, radius_m: float, *, among_trees: bool) -> Tables:
    top_m = height_m + float(rng.uniform(1.5, 3.0) if among_trees else rng.uniform(4.0, 20.0))
    fence: Tables = {"altitude_min_m": 2.0, "altitude_max_m": round(top_m, 1)}
    if rng.random() < 0.8:
        tight = rng.random() < 0.5  # hardly more room than the ring takes
        side_m = round(
            far_m + (radius_m + float(rng.uniform(5.1, 8.0)) if tight else float(rng.uniform(35.0, 60.0))), 1
        )
        fence["polygon_enu_m"] = [[-side_m, -side_m], [side_m, -side_m], [side_m, side_m], [-side_m, side_m]]
    return fence


def _forest(rng: Generator, density_per_ha: float, d2: list[float], *, slope: bool) -> Tables:
    forest: Tables = {}
    if slope and rng.random() < 0.15:
        forest["grade"] = [round(float(rng.uniform(-0.02, 0.02)), 3), round(float(rng.uniform(-0.02, 0.02)), 3)]
    if density_per_ha:
        natural = bool(rng.random() < 0.5)
        forest["stand"] = {
            "density_per_ha": density_per_ha,
            "margin_m": 45.0,
            "dbh_min_m": 0.12,
            "dbh_mean_m": 0.28,
            "dbh_max_m": 0.8 if natural else 0.5,
            "dbh_shape": 1.2 if natural else 3.6,
            "undergrowth_per_ha": float(rng.choice([0.0, 400.0, 800.0])),
            "undergrowth_height_m": 1.5,
        }
    elif rng.random() < 0.5:
        forest["trees"] = [{"base_enu_m": d2[:2], "trunk_radius_m": round(float(rng.uniform(0.2, 0.6)), 2)}]
        forest["trees"][0]["height_m"] = 28.0
    return forest


def _sim(rng: Generator, n: int, seed: int, *, among_trees: bool) -> Tables:
    bearing, wind_mps = float(rng.uniform(0.0, math.tau)), float(rng.uniform(0.0, 3.0 if among_trees else 7.0))
    windy = rng.random() < 0.6
    sim: Tables = {
        "seed": seed,
        "estimates": str(rng.choice(["exact", "recorded"], p=[0.3, 0.7])),
        "wind_mps": [wind_mps * math.sin(bearing), wind_mps * math.cos(bearing), 0.0] if windy else [0.0, 0.0, 0.0],
        "turbulence_mps": round(float(rng.uniform(0.0, 5.0)), 1) if rng.random() < 0.3 else 0.0,
        "radio_loss": round(float(rng.uniform(0.0, 0.4)), 2) if rng.random() < 0.6 else 0.0,
        "radio_delay_s": round(float(rng.uniform(0.0, 0.1)), 3) if rng.random() < 0.4 else 0.0,
        "radio_trunks": str(rng.choice(["disc", "attenuated", "cut"], p=[0.4, 0.4, 0.2])),
        "placement": str(rng.choice(["random", "grid", "ring"])),
        "personality": str(rng.choice(["px4", "ardupilot"])),
        "drag": str(rng.choice(["low", "sih"], p=[0.8, 0.2])),
    }
    if rng.random() < 0.4:
        others = [int(k) + 1 for k in rng.permutation(n)[: n // 2]]
        sim["personalities"] = {str(k): "ardupilot" if sim["personality"] == "px4" else "px4" for k in others}
    if rng.random() < 0.1:
        sim["battery_mah"] = {str(int(rng.integers(1, n + 1))): float(rng.integers(400, 1500))}
    return sim


def _sensing(rng: Generator) -> Tables:
    rate_hz = float(rng.choice([5.0, 10.0]))
    sensor = SensorClass(str(rng.choice(list(RAW_LIDARS)))) if rng.random() < RAW_SHARE else SensorClass.SECTORS
    sensing: Tables = {"range_m": float(rng.choice([8.0, 12.0])), "rate_hz": rate_hz, "stale_s": 3.0 / rate_hz}
    return sensing | {"sensor": sensor.value}


def _starts(rng: Generator, n: int) -> list[list[float]]:
    side = math.ceil(math.sqrt(n))
    spacing_m = float(rng.uniform(7.0, 9.0))
    middle_m = (side - 1) / 2.0
    starts_enu_m = [((k % side - middle_m) * spacing_m, (k // side - middle_m) * spacing_m) for k in range(n)]
    return [[round(x, 1), round(y, 1), 0.0] for x, y in starts_enu_m]


def _faults(rng: Generator, n: int, *, sensing: bool, ranging: bool) -> list[Tables]:
    there = {Needs.SENSING: sensing, Needs.RANGING: ranging}
    kinds = [kind for kind in DRAWN if there.get(FORMS[kind].needs, True)]
    weights = np.array([DRAWN[kind].weight for kind in kinds])
    faults: list[Tables] = []
    for _ in range(int(rng.integers(0, MOST_FAULTS, endpoint=True))):
        before = faults[-1] if faults and rng.random() < TOGETHER else None
        kind = FaultKind(str(rng.choice(kinds, p=weights / weights.sum())))
        faults.append(_fault(rng, kind, n, before, only_leader=ranging))
    return faults


def _fault(rng: Generator, kind: FaultKind, n: int, before: Mapping[str, Any] | None, *, only_leader: bool) -> Tables:
    """`before`: a fault that it is to interact with: it begins while that is in force, or just after."""
    if before is None:
        fault: Tables = {"kind": kind.value, "phase": str(rng.choice(PHASES)), "at_s": _rounded(rng, 0.0, 30.0)}
    else:
        at_s = before["at_s"] + float(rng.uniform(0.0, before.get("for_s", 5.0) + 5.0))
        fault = {"kind": kind.value, "phase": before["phase"], "at_s": round(at_s, 1)}
    row = DRAWN[kind]
    if only_leader and FORMS[kind].needs is Needs.SATELLITES:
        fault["vehicles"] = [1]
    elif before is not None and "vehicles" in before and rng.random() < 0.3:
        fault["vehicles"] = before["vehicles"]
    elif rng.random() > LEADER_SHARE:
        most = max(1, (n - 1) // 2) if row.downs else n - 1
        struck = rng.permutation(n)[: int(rng.integers(1, min(3, most), endpoint=True))] + 1
        fault["vehicles"] = sorted(int(k) for k in struck)
    for name, least, greatest in row.numbers:
        count = PARAMETERS[name].count
        values = [_rounded(rng, least, greatest) for _ in range(count)]
        fault[name] = values if PARAMETERS[name].level else values[0]
    if row.for_s is not None:
        fault["for_s"] = _rounded(rng, *row.for_s)
    return fault


def _rounded(rng: Generator, least: float, most: float) -> float:
    return max(round(float(rng.uniform(least, most)), 1), 0.1 if least > 0.0 else least)
