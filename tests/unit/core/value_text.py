"""Values of the core as text, and back: exact, and short, as each says only what is not as in the last of its kind.

`Neighbour(2, age_s=0.05)` is the one last written of vehicle 2, with another age; `'=Obstacle.rel_ned_m'`
is the vector that stands there. Floats are as `repr` has them. What is read back has the same fields, also where a
class keeps them to itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from enum import Enum
from itertools import groupby
from typing import Any

from companion.core.guidance import formation, guidance_input
from companion.core.localisation import peer_table, predicted_corridors
from companion.core.model import actions, beacon, events, neighbour, states
from companion.core.perception import obstacle_cloud
from companion.core.safety import bounds, response_model, setpoint, surroundings
from companion.core.safety.bounds import Bound
from companion.core.swarm import orders, picture
from companion.core.vehicle import failsafe

MODULES = (
    *(actions, beacon, bounds, events, failsafe, formation, guidance_input, neighbour, obstacle_cloud, orders),
    *(peer_table, picture, predicted_corridors, response_model, setpoint, states, surroundings),
)
CLASSES = {name: value for module in MODULES for name, value in vars(module).items() if isinstance(value, type)}
# Where the code asks whether it is this one.
CONSTANTS = {"CALM": response_model.CALM, "LEADER_ROUTE": formation.LEADER_ROUTE, "NOWHERE": formation.NOWHERE}

# The last turns of a sensor, some thousand numbers each: None when they are read back, as if all had been looked at
UNWRITTEN = ("sight",)
# Fields that transcripts before them do not have, as they were then
LATER = {"free_up_m": -math.inf, "error_m": 0.0, "is_vouched": True, "doubted": ()}
SHORT = 8  # a longer tuple is written as runs of what is the same


def fields(value: Any) -> tuple[str, ...]:
    """Names of what a value holds."""
    kind = type(value)
    if hasattr(kind, "_fields"):
        return tuple(kind._fields)
    return tuple(name for name in kind.__slots__ if name not in UNWRITTEN)


def of_vehicle(value: Any) -> int:
    """The vehicle that it is about: there is a last one of each; 0: of no other."""
    for name in ("said", "beacon"):
        value = getattr(value, name, value)
    return getattr(value, "sender", 0) or getattr(value, "vehicle", 0) or 0


class Writer:
    """Makes text of values, one after the other."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, int], Any] = {}
        self._holders: dict[str, tuple[str, int, str, Any]] = {}  # by vector: class, vehicle, field, object

    def text(self, value: Any) -> str:
        """Python, to be read by a Reader that has read all before it."""
        for name, constant in CONSTANTS.items():
            if value is constant:
                return name
        if value is None or (isinstance(value, bool | int | float | str) and not isinstance(value, Enum)):
            return repr(value)
        if isinstance(value, Enum):
            return f"{type(value).__name__}.{value.name}"
        if isinstance(value, tuple) and not hasattr(value, "_fields"):
            return self._tuple(value)
        if isinstance(value, list):
            if value and all(isinstance(part, bool) for part in value):
                return f"bits('{''.join('01'[part] for part in value)}')"
            texts = [self._object(v, k) if isinstance(v, Bound) else self.text(v) for k, v in enumerate(value)]
            return f"[{', '.join(texts)}]"
        if isinstance(value, Mapping):
            return f"{{{', '.join(f'{key!r}: {self.text(part)}' for key, part in value.items())}}}"
        return self._object(value)

    def _tuple(self, value: tuple[Any, ...]) -> str:
        texts = [self.text(part) for part in value]
        if len(value) <= SHORT:
            return f"({', '.join(texts)}{',' if len(texts) == 1 else ''})"
        runs = [(text, len(list(same))) for text, same in groupby(texts)]
        return " + ".join(f"({text},)" + (f" * {times}" if times > 1 else "") for text, times in runs)

    def _object(self, value: Any, place: int = 0) -> str:
        name, vehicle = type(value).__name__, of_vehicle(value) or place
        if CLASSES.get(name) is not type(value):
            raise TypeError(f"{name}: of no module in MODULES")
        last, said = self._last.get((name, vehicle)), {}
        before = {field: getattr(last, field) for field in fields(value)} if last is not None else LATER
        new = [
            field for field in fields(value) if field not in before or not same(before[field], getattr(value, field))
        ]
        for field in new:
            if not _is_vector(getattr(value, field)):
                said[field] = self.text(getattr(value, field))
        own: dict[str, str] = {}  # by vector, the field that has it
        for field in fields(value):  # when all that is in it has been written
            part = getattr(value, field)
            if _is_vector(part):
                first = own.setdefault(repr(part), field)
                if field in new:
                    said[field] = repr(f"={first}") if first != field else self._vector(part)
        for vector, field in own.items():
            self._holders[vector] = (name, vehicle, field, value)
        self._last[name, vehicle] = value
        return f"{name}({', '.join([str(vehicle)] * bool(vehicle) + [f'{k}={text}' for k, text in said.items()])})"

    def _vector(self, value: Any) -> str:
        """The one who has it, if that is the last of its kind; else its components."""
        holder = self._holders.get(repr(value))
        if holder is None or self._last.get(holder[:2]) is not holder[3]:
            return repr(value)
        name, vehicle, field, _ = holder
        return repr(f"={name}{f' {vehicle}' if vehicle else ''}.{field}")


class Reader:
    """Makes values of text."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, int], Any] = {}
        self._names: dict[str, Any] = {"inf": math.inf, "nan": math.nan, "bits": lambda text: [c == "1" for c in text]}
        for name, kind in CLASSES.items():
            self._names[name] = kind if issubclass(kind, Enum) else self._maker(name, kind)
        self._names |= CONSTANTS

    def value(self, text: str) -> Any:
        """Of a Writer's text."""
        return eval(text, {"__builtins__": {}}, self._names)  # a file of this repository

    def _refer(self, made: Any, text: str) -> Any:
        """`field` of the same object, or `Class.field` or `Class 2.field` of the last."""
        holder, _, field = text.rpartition(".")
        name, _, vehicle = holder.partition(" ")
        return getattr(self._last[name, int(vehicle or 0)] if name else made, field)

    def _maker(self, name: str, kind: Any) -> Any:
        def make(vehicle: int = 0, /, **changes: Any) -> Any:
            last = self._last.get((name, vehicle))
            if last is not None and not changes:
                return last
            if hasattr(kind, "_fields"):
                made = kind(**({} if last is None else last._asdict()) | changes)
            else:
                made = kind.__new__(kind)
                for field in UNWRITTEN:
                    if field in kind.__slots__:
                        object.__setattr__(made, field, None)
                for field in fields(made):
                    if field in changes:
                        part = changes[field]
                    else:
                        part = LATER[field] if last is None and field in LATER else getattr(last, field)
                    if isinstance(part, str) and part.startswith("="):
                        part = self._refer(made, part[1:])
                    object.__setattr__(made, field, part)
            self._last[name, vehicle] = made
            return made

        return make


def _is_vector(value: Any) -> bool:
    return type(value) is tuple and len(value) == 3 and all(isinstance(part, float) for part in value)


def same(one: Any, other: Any) -> bool:
    """To the bit."""
    return next(differences(one, other), None) is None


def differences(one: Any, other: Any, path: str = "") -> Iterator[str]:
    """Where two values are not the same to the bit, as `own.pos_ned_m[0]: 1.0 -> 1.5`."""
    if one is other:
        return
    if type(one) is not type(other):
        yield f"{path}: {type(one).__name__} -> {type(other).__name__}"
    elif isinstance(one, float | int | str):
        if repr(one) != repr(other):
            yield f"{path}: {one!r} -> {other!r}"
    elif isinstance(one, Mapping):
        yield from differences(list(one), list(other), f"{path}.keys")
        for key in one.keys() & other.keys():
            yield from differences(one[key], other[key], f"{path}[{key}]")
    elif isinstance(one, tuple | list) and not hasattr(one, "_fields"):
        if len(one) != len(other):
            yield f"{path}: {len(one)} -> {len(other)} of them"
        for k, (part, its) in enumerate(zip(one, other, strict=False)):
            yield from differences(part, its, f"{path}[{k}]")
    elif isinstance(one, Enum):
        yield f"{path}: {one.name} -> {other.name}"
    else:
        for field in fields(one):
            yield from differences(getattr(one, field), getattr(other, field), f"{path}.{field}".lstrip("."))
