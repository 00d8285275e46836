"""Draws whether a mission surveys its stand, how, and what may strike its records: the base station, and disks."""

from __future__ import annotations

import math
from typing import Any, Final

from numpy.random import Generator

from mission.schema.kinds import RAW_LIDARS, FaultKind, SensorClass

SALT: Final = 0x5E0BED
SURVEYED_SHARE: Final = 0.5  # of missions whose lidar tells every ray
HANGING_SHARE: Final = 0.5  # of multi-layer lidars, surveying or not
SHAPED_SHARE: Final = 0.5  # of surveyed stands, whose trunks lean, taper and fork
LANES_SHARE: Final = 0.3
UNTIL_SHARE: Final = 0.4
RISE_SHARE: Final = 0.5  # of surveys by a multi-layer lidar that stands, on a ring, with satellites for all
BASE_LOST_SHARE: Final = 0.4
DISK_FULL_SHARE: Final = 0.3
ENDING_SHARE: Final = 0.7  # of these faults
PHASES: Final = ("gather", "transit", "coverage")
AT_S: Final = (0.0, 30.0)
FOR_S: Final = (5.0, 90.0)
AREA_M: Final = (20.0, 50.0)  # each way
PRECISION_PCT: Final = (10.0, 20.0, 40.0)
ABOVE_FENCE_M: Final = (4.0, 15.0)  # to which the leader may rise
RISER_RANGE_M: Final = 30.0  # of its lidar, which must see the column

Tables = dict[str, Any]


def draw_survey(rng: Generator, tables: Tables) -> None:
    """Of `tables`' mission: a survey, or none, and its faults, besides what is there."""
    if "sensing" not in tables or SensorClass(tables["sensing"]["sensor"]) not in RAW_LIDARS:
        return
    is_multi_layer = tables["sensing"]["sensor"] == SensorClass.MULTI_LAYER.value
    if is_multi_layer:
        tables["sensing"]["upside_down"] = bool(rng.random() < HANGING_SHARE)
    if rng.random() >= SURVEYED_SHARE:
        return
    survey: Tables = {}
    if "stops" not in tables["route"] and rng.random() < LANES_SHARE:
        survey["area_enu_m"] = _area(rng, tables["route"]["d2_enu_m"])
    ends = "area_enu_m" in survey or tables["route"]["at_end"] != "hold"
    if ends and rng.random() < UNTIL_SHARE:
        survey["until"] = {"basal_area_pct": float(rng.choice(PRECISION_PCT)), "confidence": 0.95, "after_s": 5.0}
    looks_up = is_multi_layer and not tables["sensing"]["upside_down"]
    may_rise = tables["coverage"]["shape"] == "ring" and "gnss" not in tables["swarm"]
    if looks_up and may_rise and rng.random() < RISE_SHARE:
        survey["rise_to_m"] = round(tables["fence"]["altitude_max_m"] + float(rng.uniform(*ABOVE_FENCE_M)), 1)
        tables["sensing"]["range_m"] = RISER_RANGE_M
    tables["survey"] = survey
    if "stand" in tables["forest"] and rng.random() < SHAPED_SHARE:
        tables["forest"]["shapes"] = {}
    tables["sim"]["faults"] += _faults(rng, tables["swarm"]["size"])


def _area(rng: Generator, d2: list[float]) -> list[list[float]]:
    """A rectangle about the middle of the way, turned as that is."""
    length_m = math.hypot(*d2[:2])
    along, across = (d2[0] / length_m, d2[1] / length_m), (d2[1] / length_m, -d2[0] / length_m)
    half_m = [0.5 * float(rng.uniform(*AREA_M)) for _ in range(2)]
    middle_m = 0.5 * length_m
    corners = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
    return [
        [round(along[axis] * (middle_m + u * half_m[0]) + across[axis] * v * half_m[1], 1) for axis in (0, 1)]
        for u, v in corners
    ]


def _faults(rng: Generator, n: int) -> list[Tables]:
    faults: list[Tables] = []
    if rng.random() < BASE_LOST_SHARE:  # by all: it has failed
        faults.append(_fault(rng, FaultKind.BASE_LOST, [*range(1, n + 1)]) | {"for_s": _rounded(rng, FOR_S)})
    if rng.random() < DISK_FULL_SHARE:
        fault = _fault(rng, FaultKind.DISK_FULL, [int(rng.integers(1, n + 1))])
        faults.append(fault | ({"for_s": _rounded(rng, FOR_S)} if rng.random() < ENDING_SHARE else {}))
    return faults


def _fault(rng: Generator, kind: FaultKind, vehicles: list[int]) -> Tables:
    phase = str(rng.choice(PHASES))
    return {"kind": kind.value, "vehicles": vehicles, "phase": phase, "at_s": _rounded(rng, AT_S)}


def _rounded(rng: Generator, bounds: tuple[float, float]) -> float:
    return round(float(rng.uniform(*bounds)), 1)
