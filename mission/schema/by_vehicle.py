"""Tables of a mission that hold a value for single vehicles, by id."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

from pydantic import ValidatorFunctionWrapHandler

from mission.schema.fields import MAX_VEHICLES


def as_vehicle_id(key: object) -> object:
    """A key of TOML is text; of a mission in memory, a number."""
    number = int(key) if isinstance(key, str) and key.isascii() and key.isdecimal() and len(key) <= 3 else key
    if not (isinstance(number, int) and 1 <= number <= MAX_VEHICLES):
        raise ValueError(f"must be a vehicle id, 1 to {MAX_VEHICLES}")
    return number


def each_id_once(table: object, validate: ValidatorFunctionWrapHandler) -> object:
    """`3` and `03` are two keys of TOML and one vehicle."""
    checked = validate(table)
    seen: dict[object, object] = {}
    for key in table if isinstance(table, Mapping) else ():
        first = seen.setdefault(as_vehicle_id(key), key)
        if first != key:
            raise ValueError(f"must name each vehicle once: {first} and {key} are the same")
    return checked


class FrozenTable(dict[int, Any]):
    """Cannot be changed, and so has a hash, as the mission that holds it."""

    def __hash__(self) -> int:  # type: ignore[override]  # a dict has none
        return hash(frozenset(self.items()))

    def __reduce__(self) -> tuple[type[FrozenTable], tuple[dict[int, Any]]]:
        """Pickled whole: key by key, as other dicts, it could not be filled again in a process of a study."""
        return FrozenTable, (dict(self),)

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError("a mission cannot be changed")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse
