"""The JSON Schema of a mission file (draft 2020-12), and what it says of a key in words.

Editors complete and check against it, the reference is generated from it, and refusals quote it, so that the
three never differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from mission.common.problems import Path

Node = Mapping[str, Any]
"""A part of a JSON Schema: what is allowed at one place."""


class _TomlSchema(GenerateJsonSchema):
    """TOML has no null: what is optional is left out. Titles would repeat the keys."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def field_title_should_be_set(self, schema: object) -> bool:  # noqa: ARG002
        return False

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        if schema.get("default") is None or isinstance(schema["default"], BaseModel):
            return self.generate_inner(schema["schema"])  # a table's defaults are those of its keys
        return super().default_schema(schema)


@cache
def json_schema(model: type[BaseModel]) -> dict[str, Any]:
    """The schema of files that validate as `model`, by the names in the file. Treat it as read-only."""
    schema = model.model_json_schema(by_alias=True, schema_generator=_TomlSchema)
    return {"$schema": GenerateJsonSchema.schema_dialect, **schema}


def node_at(schema: Node, path: Path) -> Node | None:
    """The part of `schema` that describes `path`, references followed; None if there is no such key."""
    node: Node = schema
    for part in path:
        match part:
            case str():
                found = node.get("properties", {}).get(part, node.get("additionalProperties"))
            case int():
                fixed = node.get("prefixItems", ())
                found = fixed[part] if part < len(fixed) else node.get("items")
        if not isinstance(found, Mapping):
            return None
        node = {**resolved(schema, found), **found}
    return node


def resolved(schema: Node, node: Node) -> Node:
    """`node`, or what its $ref points to."""
    reference = node.get("$ref")
    if reference is None:
        return node
    target: Node = schema["$defs"][str(reference).rpartition("/")[2]]
    return target


def allowed(schema: Node, node: Node) -> str:
    """The values allowed at `node`, in words: "a number from 0 to 1"."""
    node = {**resolved(schema, node), **node}
    if "enum" in node:
        return "one of " + ", ".join(f'"{v}"' if isinstance(v, str) else f"{v:g}" for v in node["enum"])
    if "anyOf" in node:
        return ", or ".join(allowed(schema, one) for one in node["anyOf"])
    if "minimum" in node and node["minimum"] == node.get("maximum"):
        return f"{node['minimum']:g}"
    match node.get("type"):
        case "number":
            return "a number" + _bounds(node)
        case "integer":
            return "an integer" + _bounds(node)
        case "boolean":
            return "true or false"
        case "string":
            return f"text of at most {node['maxLength']} characters" if "maxLength" in node else "text"
        case "array":
            return _array(schema, node)
        case _:
            return "a table"


def _bounds(node: Node) -> str:
    low, above, high = node.get("minimum"), node.get("exclusiveMinimum"), node.get("maximum")
    if low is not None and high is not None:
        return f" from {low:.10g} to {high:.10g}"
    parts = [f"above {above:.10g}"] if above is not None else []
    parts += [f"at least {low:.10g}"] if low is not None else []
    parts += [f"at most {high:.10g}"] if high is not None else []
    parts += [f"below {node['exclusiveMaximum']:.10g}"] if "exclusiveMaximum" in node else []
    return " " + ", ".join(parts) if parts else ""


def _array(schema: Node, node: Node) -> str:
    fixed = node.get("prefixItems")
    if fixed:
        return f"an array of {len(fixed)}, each {allowed(schema, fixed[0])}"
    low, high = node.get("minItems", 0), node.get("maxItems")
    count = f"{low} to {high}" if high is not None else f"at least {low}"
    return f"an array of {count}, each {allowed(schema, node.get('items', {}))}"
