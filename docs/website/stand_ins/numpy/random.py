"""numpy's random numbers in plain Python: `default_rng` and the draws of its Generator that a world makes.

SeedSequence, and PCG64, with XSL-RR as its output (O'Neill 2014, HMC-CS-2014-0905); normal ones by a ziggurat of 256
layers (Marsaglia & Tsang 2000, Journal of Statistical Software 5 (8)). `tests/site` holds each draw to numpy's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from decimal import Decimal, localcontext
from itertools import cycle, islice
from typing import Final, NamedTuple

_32: Final = (1 << 32) - 1
_64: Final = (1 << 64) - 1
_128: Final = (1 << 128) - 1
_MULTIPLIER: Final = 0x2360ED051FC65DA44385DF649FCCF645  # of PCG64
_UNIT: Final = 2.0**-53
_FRACTION: Final = (1 << 52) - 1

# The ziggurat's last edge, and the area of each of its layers, which close at 0
_EDGE: Final = Decimal("3.654152885361008771645429720399515762974854599746")
_AREA: Final = Decimal("0.0049286732339746553473617754023360280691353847")
# By how many units in the last place numpy's widths of the layers are off: each draw is a product with one of them
_WIDTHS_OFF: Final = """
-9 -60 -18 -16 -14 -15 -16 -13 -13 -7 -7 -6 -5 -5 -5 -5 -5 -6 -5 -6 -7 -7 -6 -7 -7 -6 -6 -5 -6 -6 -7 -5 -6 -6 -6
-6 -6 -7 -5 -5 -4 -3 -4 -5 -3 -4 -4 -4 -4 -4 -4 -5 -2 -3 -3 -4 -4 -3 -4 -4 -3 -3 -2 -2 -3 -3 -4 -3 -4 -3 -3 -3
-2 -2 -1 -2 -2 -3 -3 -3 -2 -2 -3 -3 -3 -2 -2 -2 -2 -1 -2 -1 -1 -1 -1 -1 -2 -1 -1 -1 -1 -1 -2 -1 -1 -2 -2 -2 -2
-2 -2 -2 -2 -2 -1 -1 -1 -1 -1 -1 -1 -1 0 0 -1 -1 -1 -2 -1 -1 -1 -1 -2 -2 -2 -1 -1 -2 -2 -2 -3 -3 -4 -3 -3 -3 -2
-2 -1 -2 -1 -1 -1 -1 -1 -1 0 0 1 0 0 -1 0 0 0 0 0 0 0 0 0 1 2 2 3 3 3 2 2 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 -1 -1
-1 -1 -1 -2 -1 -2 -2 -2 -2 -2 -2 -1 -1 -1 -1 0 0 -1 -1 0 0 0 0 -1 0 0 0 0 0 0 0 0 0 0 -1 0 -1 -1 -1 -1 -1 -1 -1
0 0 1 0 1 1 1 1 1 1 0 0 1 1 1 0
"""


class Draws(list[float]):
    """Numbers where numpy has an array."""

    def tolist(self) -> list[float]:
        """As a list."""
        return list(self)


class Ziggurat(NamedTuple):
    """Of each layer: below which fraction a draw is inside for sure, its width, its height."""

    inside: list[int]
    width: list[float]
    height: list[float]


def _ziggurat() -> Ziggurat:
    with localcontext() as context:
        context.prec = 40
        unit = Decimal(1 << 52)
        inside, widths, heights = [0] * 256, [0.0] * 256, [1.0] * 256
        edge = below = _EDGE
        base = _AREA / _density(_EDGE)
        inside[0], widths[0] = int(_EDGE / base * unit), float(base / unit)
        widths[255], heights[255] = float(_EDGE / unit), float(_density(_EDGE))
        for layer in range(254, 0, -1):
            edge = (-2 * (_AREA / below + _density(below)).ln()).sqrt()
            inside[layer + 1] = int(edge / below * unit)
            widths[layer], heights[layer] = float(edge / unit), float(_density(edge))
            below = edge
    widths = [width + int(off) * math.ulp(width) for width, off in zip(widths, _WIDTHS_OFF.split(), strict=True)]
    return Ziggurat(inside, widths, heights)


def _density(x: Decimal) -> Decimal:
    return (-x * x / 2).exp()


_INSIDE, _WIDTH, _HEIGHT = _ziggurat()
_TAIL: Final = float(_EDGE)


class Generator:
    """Of the state that `entropy` seeds."""

    def __init__(self, entropy: Iterable[int]) -> None:
        high, low, stream_high, stream_low = _seeded(entropy)
        self._step = ((stream_high << 64 | stream_low) << 1 | 1) & _128
        self._state = ((self._step + (high << 64 | low)) * _MULTIPLIER + self._step) & _128

    def _bits(self) -> int:
        """The next 64."""
        self._state = state = (self._state * _MULTIPLIER + self._step) & _128
        turn = state >> 122
        folded = (state >> 64 ^ state) & _64
        return (folded >> turn | folded << 64 - turn) & _64

    def _unit(self) -> float:
        return (self._bits() >> 11) * _UNIT

    def random(self, size: int | None = None) -> float | Draws:
        """Even over 0..1."""
        return self._unit() if size is None else Draws([self._unit() for _ in range(size)])

    def uniform(self, low: float = 0.0, high: float = 1.0) -> float:
        """Even over `low`..`high`."""
        return low + (high - low) * self._unit()

    def standard_normal(self, size: int | None = None) -> float | Draws:
        """Normal, of mean 0 and deviation 1."""
        return self._normal() if size is None else Draws([self._normal() for _ in range(size)])

    def _normal(self) -> float:
        while True:
            bits = self._bits()
            layer, fraction = bits & 255, bits >> 9 & _FRACTION
            x = fraction * _WIDTH[layer]
            if bits & 256:
                x = -x
            if fraction < _INSIDE[layer]:
                return x
            if layer == 0:
                return self._in_tail(negative=bool(fraction >> 8 & 1))
            lower, upper = _HEIGHT[layer], _HEIGHT[layer - 1]
            if (upper - lower) * self._unit() + lower < math.exp(-0.5 * x * x):
                return x

    def _in_tail(self, *, negative: bool) -> float:
        while True:
            beyond = -1.0 / _TAIL * math.log1p(-self._unit())
            if -2.0 * math.log1p(-self._unit()) > beyond * beyond:
                return -(_TAIL + beyond) if negative else _TAIL + beyond


def default_rng(seed: int | Iterable[int]) -> Generator:
    """A Generator, as numpy makes one of these numbers."""
    return Generator([seed] if isinstance(seed, int) else seed)


def _seeded(entropy: Iterable[int]) -> list[int]:
    """Four words of 64 bits, as SeedSequence has them."""
    words = [word for number in entropy for word in _words(number)]
    hashed = _hash(0x43B0D7E5, 0x931E8875)
    pool = [hashed(word) for word in (words + [0] * 4)[:4]]
    for source in range(4):
        for to in range(4):
            if to != source:
                pool[to] = _mixed(pool[to], hashed(pool[source]))
    for word in words[4:]:
        for to in range(4):
            pool[to] = _mixed(pool[to], hashed(word))
    out = [*map(_hash(0x8B51F9DD, 0x58F38DED), islice(cycle(pool), 8))]
    return [low | high << 32 for low, high in zip(out[::2], out[1::2], strict=True)]


def _words(number: int) -> list[int]:
    """Of 32 bits, the lowest first; one of 0."""
    found = [number & _32]
    while number := number >> 32:
        found.append(number & _32)
    return found


def _hash(key: int, factor: int) -> Callable[[int], int]:
    """A hash that is another at each call."""

    def hashed(value: int) -> int:
        nonlocal key
        value ^= key
        key = key * factor & _32
        value = value * key & _32
        return value ^ value >> 16

    return hashed


def _mixed(x: int, y: int) -> int:
    found = 0xCA01F9DD * x - 0x4973F715 * y & _32
    return found ^ found >> 16
