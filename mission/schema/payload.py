"""`[[payload]]`: measurements of other sensors that vehicles carry, which are recorded along their way."""

from __future__ import annotations

import re
from types import MappingProxyType
from typing import Annotated, Final

from pydantic import Field, field_validator

from mission.schema.fields import Number, Table

NAMED: Final = "NAMED_VALUE_FLOAT."  # and the name that its sender gives it, of 10 characters at most in MAVLink
HEALTH: Final = "SYS_STATUS.health"
SOURCES: Final = MappingProxyType(  # a message's field -> its unit; of NAMED_VALUE_FLOAT its sender alone knows it
    {"HYGROMETER_SENSOR.temperature": "degC", "HYGROMETER_SENSOR.humidity": "%", HEALTH: "1"}
)
PAYLOADS_MAX: Final = 8
PERIOD_MIN_S: Final = 0.5
_NAMED_SOURCE: Final = re.compile(re.escape(NAMED) + r"[!-~]{1,10}")


class Payload(Table):
    """One quantity that every vehicle records along its way."""

    name: Annotated[
        str,
        Field(
            pattern=r"^[a-z][a-z0-9_]{0,15}$",
            description="Of the quantity: it heads the columns of the base station's files.",
            examples=["light"],
        ),
    ]
    unit: Annotated[
        str,
        Field(
            pattern=r"^[A-Za-z0-9%][A-Za-z0-9%/._-]{0,11}$",
            description="Its unit. Of HYGROMETER_SENSOR degC or %, of SYS_STATUS.health 1 (a flag), of "
            "NAMED_VALUE_FLOAT that in which its sensor sends.",
            examples=["lx"],
        ),
    ]
    period_s: Annotated[
        Number, Field(ge=PERIOD_MIN_S, le=3_600.0, description="How often it is recorded, once in the air.")
    ] = 2.0
    source: Annotated[
        str,
        Field(
            max_length=40,
            description="What tells it, by MAVLink's names, from a driver on a sensor's link or from the autopilot: "
            f"{', '.join(SOURCES)}, or {NAMED} and the name in the message, at most 10 characters.",
            examples=[f"{NAMED}light"],
        ),
    ]

    @field_validator("source")
    @classmethod
    def _known(cls, source: str) -> str:
        if source not in SOURCES and not _NAMED_SOURCE.fullmatch(source):
            raise ValueError(f"must be one of {', '.join(SOURCES)}, or {NAMED}NAME, NAME of 1 to 10 characters")
        return source

    @property
    def heading(self) -> str:
        """Of its column, with the unit."""
        return heading_of(self.name, self.unit)


def heading_of(name: str, unit: str) -> str:
    """Of a column of values: `temperature_degc`, `humidity_pct`; a flag, of unit 1, has none."""
    if unit == "1":
        return name
    slug = re.sub(r"[^a-z0-9]+", "_", unit.replace("%", "pct").replace("/", "_per_").lower()).strip("_")
    return f"{name}_{slug}" if slug else name
