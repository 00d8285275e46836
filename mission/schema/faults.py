"""`[[sim.faults]]`: what goes wrong on the way, for the simulator to do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Self

from pydantic import Field, field_validator, model_validator

from mission.schema.fields import MAX_VEHICLES, Number, Table, VehicleId
from mission.schema.kinds import FaultKind as FaultKind
from mission.schema.kinds import FaultPhase as FaultPhase

MAX_FAULTS = 64
LATEST_S = 604_800.0  # as sim.time_limit_s
LATE_MAX_S = 10.0  # bounds what is under way
WIND_MAX_MPS = 30.0  # of a component, as of sim.wind_mps
WindComponent = Annotated[Number, Field(ge=-WIND_MAX_MPS, le=WIND_MAX_MPS)]


# Whether a kind of fault has a duration; those that are not here may
_HAS_FOR_S = {FaultKind.KILL: False, FaultKind.RESTART: True, FaultKind.STOP: True, FaultKind.PARTITION: True}


class Fault(Table):
    """One fault: what, to which vehicles, when, for how long."""

    kind: Annotated[
        FaultKind,
        Field(
            description="kill: the companion ends without a word. restart: the same, and "
            "another one is started for_s later. stop: it stands still; what comes meanwhile waits in "
            "its sockets. partition: these vehicles and the others do not hear one another. late: what the autopilot "
            "tells its companion comes late_s later, in order. blind: the obstacle sensor tells its companion "
            "nothing; of a mission with [sensing]. wind: the air about these vehicles moves with wind_mps, instead of "
            "as sim.wind_mps says."
        ),
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
            description="How long: of a restart, a stop and a partition; of `late`, `blind` and `wind`, left out: to "
            "the end. A kill has none.",
        ),
    ] = None
    late_s: Annotated[
        Number | None, Field(gt=0.0, le=LATE_MAX_S, description="The delay of `late`; the others have none.")
    ] = None
    wind_mps: Annotated[
        tuple[WindComponent, WindComponent] | None,
        Field(description="Of `wind`: east, north, where the air moves to; the others have none."),
    ] = None

    @field_validator("vehicles")
    @classmethod
    def _ids_listed_once(cls, ids: tuple[int, ...] | None) -> tuple[int, ...] | None:
        if ids is not None and len(set(ids)) != len(ids):
            raise ValueError("each id at most once")
        return ids

    @model_validator(mode="after")
    def _complete(self) -> Self:
        kind = self.kind
        lasts, wants = self.for_s is not None, _HAS_FOR_S.get(kind)
        if wants is not None and lasts is not wants:
            raise ValueError(f"{kind.value}: needs for_s" if wants else f"{kind.value}: has no for_s")
        for name, owner in (("late_s", FaultKind.LATE), ("wind_mps", FaultKind.WIND)):
            wants = kind is owner
            if (getattr(self, name) is not None) is not wants:
                raise ValueError(f"{kind.value}: needs {name}" if wants else f"{kind.value}: has no {name}")
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
