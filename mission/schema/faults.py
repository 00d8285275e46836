"""`[[sim.faults]]`: what goes wrong on the way, for the simulator to do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Self

from pydantic import Field, field_validator, model_validator
from pydantic.fields import FieldInfo

from mission.schema.fault_kinds import FORMS, PARAMETERS, Lasts
from mission.schema.fields import MAX_VEHICLES, Number, Table, VehicleId
from mission.schema.kinds import FaultKind as FaultKind
from mission.schema.kinds import FaultPhase as FaultPhase
from mission.schema.kinds import Lie as Lie

MAX_FAULTS = 64
LATEST_S = 604_800.0  # as sim.time_limit_s


def _bounded(name: str) -> FieldInfo:
    """The bounds of a parameter's row."""
    row = PARAMETERS[name]
    bounds: FieldInfo = Field(ge=None if row.above else row.least, gt=row.least if row.above else None, le=row.most)
    return bounds


def _describe_parameter(name: str) -> FieldInfo:
    """Its meaning, for the reference."""
    words: FieldInfo = Field(description=PARAMETERS[name].what)
    return words


def _named(lasts: Lasts) -> str:
    kinds = [f"`{kind.value}`" for kind, form in FORMS.items() if form.lasts is lasts]
    return f"{', '.join(kinds[:-1])} and {kinds[-1]}"


WindComponent = Annotated[Number, _bounded("wind_mps")]
DriftComponent = Annotated[Number, _bounded("drift_mps")]
JumpComponent = Annotated[Number, _bounded("jump_m")]


class Fault(Table):
    """One fault: what, to which vehicles, when, for how long."""

    kind: Annotated[
        FaultKind,
        Field(description=" ".join([f"{kind.value}: {form.what}." for kind, form in FORMS.items()])),
    ]
    vehicles: Annotated[
        tuple[VehicleId, ...] | None,
        Field(
            min_length=1,
            max_length=MAX_VEHICLES,
            description="Ids of those that it happens to. Left out: the vehicle that acts as leader then, or the first "
            "to do so after.",
        ),
    ] = None
    at_s: Annotated[
        Number,
        Field(ge=0.0, le=LATEST_S, description="Simulated time; with `phase`, counted from when that begins."),
    ]
    phase: Annotated[
        FaultPhase | None,
        Field(description="Optional: the swarm's phase that `at_s` counts from."),
    ] = None
    for_s: Annotated[
        Number | None,
        Field(
            gt=0.0,
            le=LATEST_S,
            description=f"How long. {_named(Lasts.ALWAYS)} need it; {_named(Lasts.NEVER)} have none; the others last "
            "to the end without.",
        ),
    ] = None
    late_s: Annotated[Annotated[Number, _bounded("late_s")] | None, _describe_parameter("late_s")] = None
    wind_mps: Annotated[tuple[WindComponent, WindComponent] | None, _describe_parameter("wind_mps")] = None
    drift_mps: Annotated[tuple[DriftComponent, DriftComponent] | None, _describe_parameter("drift_mps")] = None
    jump_m: Annotated[tuple[JumpComponent, JumpComponent] | None, _describe_parameter("jump_m")] = None
    height_m: Annotated[Annotated[Number, _bounded("height_m")] | None, _describe_parameter("height_m")] = None
    bias_m: Annotated[Annotated[Number, _bounded("bias_m")] | None, _describe_parameter("bias_m")] = None
    noise_m: Annotated[Annotated[Number, _bounded("noise_m")] | None, _describe_parameter("noise_m")] = None
    delay_s: Annotated[Annotated[Number, _bounded("delay_s")] | None, _describe_parameter("delay_s")] = None

    lie: Annotated[Lie | None, Field(description="Of `insider`: what its beacons tell.")] = None

    @field_validator("vehicles")
    @classmethod
    def _ids_listed_once(cls, ids: tuple[int, ...] | None) -> tuple[int, ...] | None:
        if ids is not None and len(set(ids)) != len(ids):
            raise ValueError("each id at most once")
        return ids

    @model_validator(mode="after")
    def _complete(self) -> Self:
        kind, form = self.kind.value, FORMS[self.kind]
        lasts = self.for_s is not None
        if form.lasts is not Lasts.OPTIONAL and lasts is not (form.lasts is Lasts.ALWAYS):
            raise ValueError(f"{kind}: has no for_s" if lasts else f"{kind}: needs for_s")
        for name in PARAMETERS:
            wants = name in form.parameters
            if (getattr(self, name) is not None) is not wants:
                raise ValueError(f"{kind}: needs {name}" if wants else f"{kind}: has no {name}")
        if (self.lie is not None) is not form.lies:
            raise ValueError(f"{kind}: needs lie" if form.lies else f"{kind}: has no lie")
        return self


def within(faults: Sequence[Fault], size: int) -> Iterator[Fault]:
    """The faults that can happen to a swarm of `size`: without the vehicles that it has not, and not to nobody."""
    for fault in faults:
        if fault.vehicles is None:
            yield fault
            continue
        there = tuple(k for k in fault.vehicles if k <= size)
        cuts_nobody_off = fault.kind is FaultKind.PARTITION and len(there) == size
        if there and not cuts_nobody_off:
            yield fault.model_copy(update={"vehicles": there})
