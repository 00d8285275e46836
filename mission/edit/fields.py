"""Numbers and choices beside the map: which keys of a mission, under which names. What each means is the schema's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from mission.common.problems import lookup
from mission.document.model import Mission
from mission.schema.json_schema import json_schema, node_at

_MISSING: Final = object()


@dataclass(frozen=True, slots=True)
class Field:
    """A field of the page: `key` as in refusals, `step` of its arrows."""

    key: str
    label: str
    unit: str = ""
    step: float = 1.0

    @property
    def path(self) -> tuple[str, ...]:
        """`key` as a path of the document."""
        return tuple(self.key.split("."))


GROUPS: Final[Mapping[str, tuple[Field, ...]]] = {
    "Flight": (
        Field("name", "Name"),
        Field("swarm.size", "Vehicles"),
        Field("route.vel_leader_mps", "Speed", "m/s", 0.5),
        Field("route.at_end", "At the end"),
        Field("fence.altitude_min_m", "Lowest height", "m", 0.1),
        Field("fence.altitude_max_m", "Greatest height", "m", 0.1),
    ),
    "At d2 and the stops": (
        Field("coverage.shape", "Shape"),
        Field("coverage.radius_m", "Radius", "m", 1.0),
        Field("coverage.duration_s", "Time there", "s", 5.0),
        Field("coverage.keep_out_m", "Never closer than", "m", 0.1),
        Field("route.arrival_distance_m", "Arrived within", "m", 0.5),
    ),
    "Spacing and radio": (
        Field("separation.hard_m", "Least distance", "m", 0.5),
        Field("separation.soft_m", "Repulsion from", "m", 0.5),
        Field("radio.transit_range_m", "Radio on the way", "m", 1.0),
        Field("radio.full_range_m", "Radio at d2", "m", 1.0),
        Field("sim.placement", "Start in a"),
        Field("sim.placement_spacing_m", "Start spacing", "m", 0.5),
    ),
    "Obstacle sensor": (
        Field("sensing.range_m", "Sees", "m", 1.0),
        Field("sensing.rate_hz", "Scans", "1/s", 1.0),
        Field("sensing.margin_m", "Margin", "m", 0.1),
    ),
}


def describe_fields() -> list[dict[str, Any]]:
    """Groups with their fields, for the page: names, and from the schema what each means and may be."""
    return [{"name": name, "fields": [_describe(field) for field in fields]} for name, fields in GROUPS.items()]


def _describe(field: Field) -> dict[str, Any]:
    schema = json_schema(Mission)
    node = node_at(schema, field.path)
    assert node is not None, field.key
    kind = "choice" if "enum" in node else str(node["type"])
    return {
        "key": field.key,
        "label": field.label,
        "unit": field.unit,
        "step": field.step,
        "kind": kind,
        "choices": list(node.get("enum", ())),
        "about": str(node.get("description", "")),
    }


def values_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Value of each field: as the document has it, else its default; None: neither, as of a table that is not there."""
    found: dict[str, Any] = {}
    for fields in GROUPS.values():
        for field in fields:
            table = values.get(field.path[0])
            is_optional = field.path[0] == "sensing" and not isinstance(table, Mapping)
            value = _lookup(values, field.path)
            if value is _MISSING:
                value = None if is_optional else (node_at(json_schema(Mission), field.path) or {}).get("default")
            found[field.key] = value
    return found


def _lookup(values: Mapping[str, Any], path: tuple[str, ...]) -> Any:
    try:
        return lookup(values, path)
    except KeyError:
        return _MISSING
