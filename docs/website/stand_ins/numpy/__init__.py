"""What a flight of point masses takes of numpy: its random numbers, to the bit. Of all else only the names.

numpy has no build for a browser that comes with Python packages. What is only named (a type, an alias) is an `Absent`;
what is called says so.
"""

from __future__ import annotations

from numpy import random as random


class Absent:
    """A name of numpy that is not here."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Absent:
        return Absent(f"{self._name}.{name}")

    def __or__(self, other: object) -> Absent:
        return self

    def __call__(self, *_: object, **__: object) -> None:
        raise NotImplementedError(f"{self._name}: the page has no arrays, its flights are of point masses")


def __getattr__(name: str) -> Absent:
    if name.startswith("__"):
        raise AttributeError(name)
    return Absent(f"numpy.{name}")
