"""A table of parameters and its wire forms: bytewise as PX4, or by value as ArduPilot."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Final

from companion.mavlink import dialect

INT8, INT16 = dialect.MAV_PARAM_TYPE_INT8, dialect.MAV_PARAM_TYPE_INT16
INT32, REAL32 = dialect.MAV_PARAM_TYPE_INT32, dialect.MAV_PARAM_TYPE_REAL32
BITS = {INT8: 8, INT16: 16, INT32: 32}
BY_NAME: Final = 65535  # PARAM_VALUE.param_index, when it was not asked for by its place in the list


class ParameterError(ValueError):
    """Presets that the autopilot does not have, every one of them named."""


class ParameterTable:
    """Named values in a fixed order (as autopilots: alphabetical). A value never changes its type.

    An int is INT32 unless `types` has another type for it; a float is REAL32.
    """

    def __init__(
        self,
        defaults: Mapping[str, int | float],
        presets: Mapping[str, float] | None = None,
        *,
        types: Mapping[str, int] | None = None,
        by_value: bool = False,
    ) -> None:
        """Raises ParameterError naming every preset that is unknown or not a finite number of its type.

        `by_value`: every number travels as a float, and is told by name without its place in the list.
        """
        self._types = types or {}
        self._by_value = by_value
        self._values: dict[str, int | float] = {name: defaults[name] for name in sorted(defaults)}
        self.names = tuple(self._values)
        self._index = {name: index for index, name in enumerate(self.names)}
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
        bits = BITS.get(self.type_of(name))
        if bits:
            if value != int(value) or not -(2 ** (bits - 1)) <= value < 2 ** (bits - 1):
                return False
            self._values[name] = int(value)
        else:
            self._values[name] = float(value)
        return True

    def set_from_wire(self, name: str, wire: float, param_type: int) -> bool:
        """As PARAM_SET has it. Bytewise, an INT32 travels in the bytes of the float; by value, any type will do."""
        if self._by_value:
            return self.set(name, float(round(wire)) if self.type_of(name) in BITS and math.isfinite(wire) else wire)
        if param_type != self.type_of(name):
            return False
        return self.set(name, _int_of_bytes(wire) if param_type == INT32 else wire)

    def type_of(self, name: str) -> int:
        """MAV_PARAM_TYPE."""
        return int(self._types.get(name, INT32) if isinstance(self._values[name], int) else REAL32)

    def message(self, name: str, *, in_list: bool = True) -> dialect.MAVLink_param_value_message:
        """PARAM_VALUE of `name`; `in_list`: asked for by its place, or with all."""
        value = self._values[name]
        wire = _bytes_of_int(value) if isinstance(value, int) and not self._by_value else value
        index = self._index[name] if in_list or not self._by_value else BY_NAME
        return dialect.MAVLink_param_value_message(
            name.encode("ascii"), wire, self.type_of(name), len(self.names), index
        )


def _bytes_of_int(value: int) -> float:
    """The float whose bytes are those of an int32."""
    result: float = struct.unpack("<f", struct.pack("<i", value))[0]
    return result


def _int_of_bytes(wire: float) -> int:
    """The int32 in a float's bytes."""
    result: int = struct.unpack("<i", struct.pack("<f", wire))[0]
    return result
