"""Field types of a mission file's tables."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from mission.schema.kinds import MAX_VEHICLES as MAX_VEHICLES

COORDINATE_MAX_M = 20_000.0  # the plane of frames.LocalFrame is not the Earth any more beyond this

# Strict: "3" and true are not numbers, "false" and 0 are not booleans. An integer is accepted where a float is wanted.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Integer = Annotated[int, Field(strict=True)]
Boolean = Annotated[bool, Field(strict=True)]
Text = Annotated[str, Field(strict=True)]
Coordinate = Annotated[Number, Field(ge=-COORDINATE_MAX_M, le=COORDINATE_MAX_M)]
VehicleId = Annotated[Integer, Field(ge=1, le=MAX_VEHICLES)]


class Table(BaseModel):
    """A table of the file: frozen, and no key that it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)
