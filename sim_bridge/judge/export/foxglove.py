"""JSON Schemas of the messages in an MCAP file: Foxglove's well-known ones by name and field, and one of our own.

Names, fields, types and enumerations: docs.foxglove.dev/docs/visualization/message-schemas, encoding "jsonschema".
"""

from __future__ import annotations

import json
from typing import Any, Final

Schema = dict[str, Any]

TF: Final = "foxglove.FrameTransforms"
SCENE: Final = "foxglove.SceneUpdate"
FIX: Final = "foxglove.LocationFix"
SCAN: Final = "foxglove.LaserScan"
LOG: Final = "foxglove.Log"
SWARM: Final = "understory.Swarm"  # ours: roles, phases and states have no schema there

NUMBER: Final[Schema] = {"type": "number"}
INTEGER: Final[Schema] = {"type": "integer"}
TEXT: Final[Schema] = {"type": "string"}
BOOLEAN: Final[Schema] = {"type": "boolean"}


def _object(title: str, **properties: Schema) -> Schema:
    return {"title": title, "type": "object", "properties": properties}


def _array(items: Schema) -> Schema:
    return {"type": "array", "items": items}


def _one_of(title: str, *names: str) -> Schema:
    return {"title": title, "oneOf": [{"title": name, "const": value} for value, name in enumerate(names)]}


_TIME: Final = _object("time", sec=INTEGER, nsec=INTEGER)
_DURATION: Final = _object("duration", sec=INTEGER, nsec=INTEGER)
_VECTOR: Final = _object("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
_POINT: Final = _object("foxglove.Point3", x=NUMBER, y=NUMBER, z=NUMBER)
_QUATERNION: Final = _object("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
_POSE: Final = _object("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)
_COLOR: Final = _object("foxglove.Color", r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)
_BYTES: Final[Schema] = {"type": "string", "contentEncoding": "base64"}

_TRANSFORM: Final = _object(
    "foxglove.FrameTransform",
    timestamp=_TIME,
    parent_frame_id=TEXT,
    child_frame_id=TEXT,
    translation=_VECTOR,
    rotation=_QUATERNION,
)
_ENTITY: Final = _object(
    "foxglove.SceneEntity",
    timestamp=_TIME,
    frame_id=TEXT,
    id=TEXT,
    lifetime=_DURATION,
    frame_locked=BOOLEAN,
    metadata=_array(_object("foxglove.KeyValuePair", key=TEXT, value=TEXT)),
    arrows=_array(
        _object(
            "foxglove.ArrowPrimitive",
            pose=_POSE,
            shaft_length=NUMBER,
            shaft_diameter=NUMBER,
            head_length=NUMBER,
            head_diameter=NUMBER,
            color=_COLOR,
        )
    ),
    cubes=_array(_object("foxglove.CubePrimitive", pose=_POSE, size=_VECTOR, color=_COLOR)),
    spheres=_array(_object("foxglove.SpherePrimitive", pose=_POSE, size=_VECTOR, color=_COLOR)),
    cylinders=_array(
        _object(
            "foxglove.CylinderPrimitive", pose=_POSE, size=_VECTOR, bottom_scale=NUMBER, top_scale=NUMBER, color=_COLOR
        )
    ),
    lines=_array(
        _object(
            "foxglove.LinePrimitive",
            type=_one_of("foxglove.LineType", "LINE_STRIP", "LINE_LOOP", "LINE_LIST"),
            pose=_POSE,
            thickness=NUMBER,
            scale_invariant=BOOLEAN,
            points=_array(_POINT),
            color=_COLOR,
            colors=_array(_COLOR),
            indices=_array(INTEGER),
        )
    ),
    triangles=_array(
        _object(
            "foxglove.TriangleListPrimitive",
            pose=_POSE,
            points=_array(_POINT),
            color=_COLOR,
            colors=_array(_COLOR),
            indices=_array(INTEGER),
        )
    ),
    texts=_array(
        _object(
            "foxglove.TextPrimitive",
            pose=_POSE,
            billboard=BOOLEAN,
            font_size=NUMBER,
            scale_invariant=BOOLEAN,
            color=_COLOR,
            text=TEXT,
        )
    ),
    models=_array(
        _object(
            "foxglove.ModelPrimitive",
            pose=_POSE,
            scale=_VECTOR,
            color=_COLOR,
            override_color=BOOLEAN,
            url=TEXT,
            media_type=TEXT,
            data=_BYTES,
        )
    ),
)
_DELETION: Final = _object(
    "foxglove.SceneEntityDeletion",
    timestamp=_TIME,
    type=_one_of("foxglove.SceneEntityDeletionType", "MATCHING_ID", "ALL"),
    id=TEXT,
)
_MEMBER: Final = _object(
    "understory.Vehicle",
    id=INTEGER,
    role=TEXT,
    leader=INTEGER,
    phase=TEXT,
    armed=BOOLEAN,
    on_ground=BOOLEAN,
    alive=BOOLEAN,
    touched=TEXT,
    range_m=NUMBER,
    velocity_enu_mps=_VECTOR,
    setpoint_enu_mps={"oneOf": [_VECTOR, {"type": "null"}]},
)

SCHEMAS: Final[dict[str, Schema]] = {
    TF: _object(TF, transforms=_array(_TRANSFORM)),
    SCENE: _object(SCENE, deletions=_array(_DELETION), entities=_array(_ENTITY)),
    FIX: _object(
        FIX,
        timestamp=_TIME,
        frame_id=TEXT,
        latitude=NUMBER,
        longitude=NUMBER,
        altitude=NUMBER,
        position_covariance={**_array(NUMBER), "minItems": 9, "maxItems": 9},
        position_covariance_type=_one_of(
            "foxglove.PositionCovarianceType", "UNKNOWN", "APPROXIMATED", "DIAGONAL_KNOWN", "KNOWN"
        ),
    ),
    SCAN: _object(
        SCAN,
        timestamp=_TIME,
        frame_id=TEXT,
        pose=_POSE,
        start_angle=NUMBER,
        end_angle=NUMBER,
        ranges=_array(NUMBER),
        intensities=_array(NUMBER),
    ),
    LOG: _object(
        LOG,
        timestamp=_TIME,
        level=_one_of("foxglove.LogLevel", "UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"),
        message=TEXT,
        name=TEXT,
        file=TEXT,
        line=INTEGER,
    ),
    SWARM: _object(
        SWARM,
        timestamp=_TIME,
        phase=TEXT,
        leader=INTEGER,
        links=INTEGER,
        vehicles=_array(_MEMBER),
    ),
}


def encoded(name: str) -> bytes:
    """The schema as an MCAP file holds it."""
    return json.dumps(SCHEMAS[name], separators=(",", ":")).encode()
