"""Draws whether a mission is flown signed, and its attacker: an insider, an outsider, or a spoofer of one vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from numpy.random import Generator

from mission.schema.kinds import RAW_LIDARS, FaultKind, Lie, SensorClass

SALT: Final = 0xA77AC4
ATTACKED_SHARE: Final = 0.5
SIGNED_SHARE: Final = 0.5
OUTSIDER_SHARE: Final = 0.25  # of attackers of signed flights: unsigned, whoever is in range is as good as a member
SPOOFER_SHARE: Final = 0.4  # of the other attackers
LEADER_SHARE: Final = 0.35  # of attackers that strike, or are, whoever leads then
ENDING_SHARE: Final = 0.5  # of attacks that end before the flight does
FOR_S: Final = (10.0, 60.0)
AT_S: Final = (0.0, 20.0)  # after the phase has begun
PHASES: Final = ("gather", "transit", "transit", "transit", "coverage")
INSIDE, OUTSIDE, SPOOFED = "insider", "outsider", "spoofer"

Tables = dict[str, Any]

# Of a vehicle that has a position of its own to be led astray from, and with range radios
SPOOFS: Final = (
    FaultKind.GNSS_DRIFT,
    FaultKind.POSITION_JUMP,
    FaultKind.POSITION_FREEZE,
    FaultKind.POSITION_DRIFT,
    FaultKind.HEIGHT_ERROR,
)
RANGED_SPOOFS: Final = (*SPOOFS, FaultKind.RANGE_ERRORS)
ATTACKERS: Final = {
    FaultKind.INSIDER: INSIDE,
    FaultKind.OUTSIDER: OUTSIDE,
    **dict.fromkeys(RANGED_SPOOFS, SPOOFED),
}
DRIFT_MPS: Final = (0.05, 0.5)
JUMP_M: Final = (2.0, 20.0)
HEIGHT_M: Final = (-10.0, 10.0)
BIAS_M: Final = (-3.0, 3.0)
NOISE_M: Final = (0.0, 1.0)


def draw_signed(rng: Generator) -> bool:
    """The flight has keys."""
    return bool(rng.random() < SIGNED_SHARE)


def draw_attack(rng: Generator, tables: Mapping[str, Any], *, signed: bool) -> Tables:
    """A fault of `tables`' mission, as in [[sim.faults]]."""
    n, only_leader = tables["swarm"]["size"], "ranging" in tables
    fault: Tables = {"phase": str(rng.choice(PHASES)), "at_s": _rounded(rng, AT_S)}
    if rng.random() < ENDING_SHARE:
        fault["for_s"] = _rounded(rng, FOR_S)
    if rng.random() > LEADER_SHARE:
        fault["vehicles"] = [int(rng.integers(1, n + 1))]
    if signed and rng.random() < OUTSIDER_SHARE:
        return fault | {"kind": FaultKind.OUTSIDER.value}
    if rng.random() >= SPOOFER_SHARE:
        there = {Lie.RANGES: only_leader, Lie.TRUNKS: only_leader and _tells_every_ray(tables)}
        lies = [lie.value for lie in Lie if there.get(lie, True)]
        return fault | {"kind": FaultKind.INSIDER.value, "lie": str(rng.choice(lies))}
    kind = FaultKind(str(rng.choice([kind.value for kind in (RANGED_SPOOFS if only_leader else SPOOFS)])))
    if only_leader and kind is not FaultKind.RANGE_ERRORS:  # no other has a position that it may be led from
        fault["vehicles"] = [1]
    return fault | {"kind": kind.value} | _numbers(rng, kind)


def _tells_every_ray(tables: Mapping[str, Any]) -> bool:
    return "sensing" in tables and SensorClass(tables["sensing"]["sensor"]) in RAW_LIDARS


def _numbers(rng: Generator, kind: FaultKind) -> Tables:
    match kind:
        case FaultKind.GNSS_DRIFT | FaultKind.POSITION_DRIFT:
            return {"drift_mps": _level(rng, DRIFT_MPS, 2)}
        case FaultKind.POSITION_JUMP:
            return {"jump_m": _level(rng, JUMP_M, 1)}
        case FaultKind.HEIGHT_ERROR:
            return {"height_m": _rounded(rng, HEIGHT_M)}
        case FaultKind.RANGE_ERRORS:
            return {"bias_m": _rounded(rng, BIAS_M), "noise_m": _rounded(rng, NOISE_M)}
    return {}


def _level(rng: Generator, size: tuple[float, float], digits: int) -> list[float]:
    """East and north, in any direction."""
    bearing, length = float(rng.uniform(0.0, math.tau)), float(rng.uniform(*size))
    return [round(length * math.sin(bearing), digits), round(length * math.cos(bearing), digits)]


def _rounded(rng: Generator, bounds: tuple[float, float]) -> float:
    return round(float(rng.uniform(*bounds)), 1)
