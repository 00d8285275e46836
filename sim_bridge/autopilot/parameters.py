"""A table of parameters and its wire form. Any personality's; an int is INT32, a float REAL32."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

from companion.mavlink import dialect

INT32, REAL32 = dialect.MAV_PARAM_TYPE_INT32, dialect.MAV_PARAM_TYPE_REAL32


class ParameterError(ValueError):
    """Presets that the autopilot does not have, every one of them named."""


class ParameterTable:
    """Named values in a fixed order (as autopilots: alphabetical). A value never changes its type."""

    def __init__(self, defaults: Mapping[str, int | float], presets: Mapping[str, float] | None = None) -> None:
        """Raises ParameterError naming every preset that is unknown or not a finite number of its type."""
        self._values: dict[str, int | float] = {name: defaults[name] for name in sorted(defaults)}
        self.names = tuple(self._values)
        self._index = {name: place for place, name in enumerate(self.names)}
        problems = []
        for name, value in (presets or {}).items():
            if name not in self._values:
                problems.append(f"{name}: no such parameter")
            elif not self.set(name, value):
                kind = "a whole number" if isinstance(self._values[name], int) else "a finite number"
                problems.append(f"{name} = {value}: must be {kind}")
        if problems:
            raise ParameterError("parameters: " + "; ".join(problems))

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def set(self, name: str, value: float) -> bool:
        """True when `value` fits the parameter's type and is now its value."""
        if not math.isfinite(value):
            return False
        if self.type_of(name) == INT32:
            if value != int(value) or not -(2**31) <= value < 2**31:
                return False
            self._values[name] = int(value)
        else:
            self._values[name] = float(value)
        return True

    def set_from_wire(self, name: str, wire: float, param_type: int) -> bool:
        """As PARAM_SET has it, bytewise: an INT32 travels in the bytes of the float."""
        if param_type != self.type_of(name):
            return False
        return self.set(name, _int_of_bytes(wire) if param_type == INT32 else wire)

    def type_of(self, name: str) -> int:
        """MAV_PARAM_TYPE."""
        return int(INT32 if isinstance(self._values[name], int) else REAL32)

    def message(self, name: str) -> dialect.MAVLink_param_value_message:
        """PARAM_VALUE of `name`, bytewise."""
        value = self._values[name]
        wire = _bytes_of_int(value) if isinstance(value, int) else value
        return dialect.MAVLink_param_value_message(
            name.encode("ascii"), wire, self.type_of(name), len(self.names), self._index[name]
        )


def _bytes_of_int(value: int) -> float:
    """The float whose bytes are those of an int32."""
    result: float = struct.unpack("<f", struct.pack("<i", value))[0]
    return result


def _int_of_bytes(wire: float) -> int:
    """The int32 in a float's bytes."""
    result: int = struct.unpack("<i", struct.pack("<f", wire))[0]
    return result
