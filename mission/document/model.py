"""The mission: what to fly, checked, frozen, with the units in the names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Self

from pydantic import ConfigDict, model_validator

from mission.document import height_layers
from mission.rules import (
    fence_rules,
    flight_rules,
    forest_rules,
    payload_rules,
    rise_rules,
    satellite_rules,
    survey_rules,
)
from mission.schema.check import validated
from mission.schema.conflict import ConflictError
from mission.schema.faults import within
from mission.schema.forest import MAX_TREES, Box, Forest, StandSpec, Tree
from mission.schema.payload import Payload
from mission.schema.sim import (
    Drag,
    Estimates,
    Lidar,
    OdometryErrors,
    Personality,
    Placement,
    RadioTrunks,
    RangeTrunks,
    RangingErrors,
    SatelliteErrors,
    ScansVia,
    Sim,
    Sky,
)
from mission.schema.tables import (
    RANGE_MAX_M,
    VEHICLE_RADIUS_M,
    AtEnd,
    Coverage,
    CoverageShape,
    Fence,
    Gnss,
    Limits,
    MissionTables,
    Origin,
    PositionUncertain,
    Radio,
    Ranging,
    Route,
    Sensing,
    Separation,
    Stop,
    Survey,
    Swarm,
    Visit,
)

__all__ = [
    "MAX_TREES",
    "RANGE_MAX_M",
    "VEHICLE_RADIUS_M",
    "AtEnd",
    "Box",
    "Coverage",
    "CoverageShape",
    "Drag",
    "Estimates",
    "Fence",
    "Forest",
    "Gnss",
    "Lidar",
    "Limits",
    "Mission",
    "OdometryErrors",
    "Origin",
    "Payload",
    "Personality",
    "Placement",
    "PositionUncertain",
    "Radio",
    "RadioTrunks",
    "RangeTrunks",
    "Ranging",
    "RangingErrors",
    "Route",
    "SatelliteErrors",
    "ScansVia",
    "Sensing",
    "Separation",
    "Sim",
    "Sky",
    "StandSpec",
    "Stop",
    "Survey",
    "Swarm",
    "Tree",
    "Visit",
]


class Mission(MissionTables):
    """Everything there is to know about one flight of the swarm."""

    model_config = ConfigDict(title="Understory mission")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        conflicts = tuple(
            c
            for laws in (
                flight_rules,
                satellite_rules,
                fence_rules,
                forest_rules,
                survey_rules,
                rise_rules,
                payload_rules,
                height_layers,
            )
            for c in laws.conflicts(self)
        )
        if conflicts:
            raise ConflictError(conflicts)
        return self

    @property
    def flies_blind(self) -> bool:
        """A stand grows on the way, or boxes stand there, and vehicles do not see it: a forest without `[sensing]`."""
        forest = self.forest
        return self.sensing is None and (forest.stand is not None or forest.file is not None or bool(forest.boxes))

    @property
    def vehicle_radius_m(self) -> float:
        """From a vehicle's centre to the tips of its propellers: how near it comes to what it touches."""
        return VEHICLE_RADIUS_M if self.sensing is None else self.sensing.vehicle_radius_m

    @property
    def placement_radius_m(self) -> float:
        """Radius of the disc about d1 that holds the simulator's starting points: it fits in the fence."""
        return flight_rules.placement_radius_m(self)

    @property
    def start_link_m(self) -> float:
        """The longest link that joins the swarm at the start: below the range in transit."""
        return flight_rules.start_link_m(self)

    def with_size(self, size: int, *, place: str = "--n") -> Mission:
        """A copy for `size` vehicles, checked anew: of what names vehicles in `sim`, that which it has.

        MissionError names `place` instead of a line.
        """
        sim = self.sim.model_dump()
        for table in ("personalities", "battery_mah"):
            sim[table] = {k: value for k, value in sim[table].items() if k <= size}
        sim["faults"] = [fault.model_dump() for fault in within(self.sim.faults, size)]
        return self._with({"swarm": {**self.swarm.model_dump(), "size": size}, "sim": sim}, place)

    def with_seed(self, seed: int, *, place: str = "--seed") -> Mission:
        """A copy with another seed, checked anew. MissionError names `place` instead of a line."""
        return self._with({"sim": {**self.sim.model_dump(), "seed": seed}}, place)

    def with_personality(self, personality: str, *, place: str = "--personality") -> Mission:
        """A copy in which every autopilot behaves alike, checked anew. MissionError names `place`."""
        sim = {**self.sim.model_dump(), "personality": personality, "personalities": {}}
        return self._with({"sim": sim}, place)

    def with_estimates(self, estimates: str, *, place: str = "--estimates") -> Mission:
        """A copy in which autopilots know so much of their vehicles, checked anew. MissionError names `place`."""
        return self._with({"sim": {**self.sim.model_dump(), "estimates": estimates}}, place)

    def with_faults(self, faults: Iterable[Mapping[str, Any]], *, place: str = "--faults") -> Mission:
        """A copy with `faults`, as in `[[sim.faults]]`, besides its own, checked anew. MissionError names `place`."""
        sim = self.sim.model_dump()
        return self._with({"sim": {**sim, "faults": [*sim["faults"], *faults]}}, place)

    def with_origin(self, origin: Origin, *, place: str = "--origin") -> Mission:
        """A copy anchored at `origin`, checked anew. MissionError names `place` instead of a line."""
        return self._with({"origin": origin.model_dump()}, place)

    def _with(self, changes: dict[str, Any], place: str) -> Mission:
        return validated(Mission, {**self.model_dump(by_alias=True), **changes}, place)
