"""Any value of a kind, drawn plainly from a seed: a thirtieth of the time that hypothesis takes for one.

Named and used as hypothesis' strategies are, as far as the tests need them. What breaks programs is drawn often: the
ends of a range, 0, powers of two, NaN, a number that was drawn before, the empty, the longest, odd letters. Nothing is
learnt from one example for the next, and nothing shrunk: `draws` can hand the same tests to hypothesis.
"""

from __future__ import annotations

import datetime
import math
import random
import struct
import unicodedata
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import Any

TRIES = 100  # of a filter, until it is given up
SIZE = 8  # at most, where nothing else is said: long enough for what goes wrong in sequences
ODD = (
    "\0\t\n\r\x0b\x1f\x7f\x85\xa0\xad\u200b\u2028\u202e\ufeff\ufffd\uffffİßée\u0301\U0001f332\U0010ffff"
    + "\"'\\#;,.=[]{}-_/"
)
WORDS = (7, 8, 15, 16, 31, 32, 53, 63, 64)  # bits
NUMBERS = (0.0, -0.0, 1.0, -1.0, 0.5, 2.0, 1e-9, -1e-9, 1e9, 5e-324, 1e-308, 3e38, 1e300, -1e300)


class Source(random.Random):
    """Where one example comes from: a generator, and the numbers that it has drawn."""

    def __init__(self, seed: str) -> None:
        super().__init__(seed)
        self.floats: list[float] = []
        self.ints: list[int] = []


class Strategy:
    """What draws a value; `|`: one of several, each as often."""

    def __init__(self, example: Callable[[Source], Any], branches: Sequence[Strategy] = ()) -> None:
        self.example = example
        self.branches = branches or (self,)

    def __or__(self, other: Strategy) -> Strategy:
        return one_of(*self.branches, *other.branches)

    def map(self, change: Callable[[Any], Any]) -> Strategy:
        return Strategy(lambda source: change(self.example(source)))

    def filter(self, holds: Callable[[Any], Any]) -> Strategy:
        def kept(source: Source) -> Any:
            for _ in range(TRIES):
                value = self.example(source)
                if holds(value):
                    return value
            raise AssertionError("what is drawn is hardly ever what the filter keeps")

        return Strategy(kept)


SearchStrategy = DrawFn = Strategy  # names of hypothesis, for annotations


class DataObject:
    """Draws in the middle of a test."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self.drawn: list[Any] = []

    def draw(self, strategy: Strategy) -> Any:
        self.drawn.append(strategy.example(self._source))
        return self.drawn[-1]

    def __repr__(self) -> str:
        return f"drawn in the test: {self.drawn!r}"


# One value ---------------------------------------------------------------------


def just(value: Any) -> Strategy:
    return Strategy(lambda _source: value)


def none() -> Strategy:
    return just(None)


def booleans() -> Strategy:
    return Strategy(lambda source: source.random() < 0.5)


def sampled_from(options: Iterable[Any]) -> Strategy:
    values = list(options)
    return Strategy(lambda source: values[int(source.random() * len(values))])


def one_of(*strategies: Strategy) -> Strategy:
    branches = [branch for strategy in strategies for branch in strategy.branches]
    return Strategy(lambda source: branches[int(source.random() * len(branches))].example(source), branches)


def randoms(*, use_true_random: bool = False) -> Strategy:
    assert not use_true_random
    return Strategy(lambda source: random.Random(source.getrandbits(64)))


def data() -> Strategy:
    return Strategy(DataObject)


def dates() -> Strategy:
    return integers(1, datetime.date.max.toordinal()).map(datetime.date.fromordinal)


def integers(min_value: int | None = None, max_value: int | None = None) -> Strategy:
    """Unbounded ones have up to 129 bits."""
    low = min_value if min_value is not None else -(2**128)
    high = max_value if max_value is not None else 2**128
    edges = {low, low + 1, high - 1, high, 0, 1, -1}
    edges |= {
        sign * 2**bits + off for bits in (7, 8, 15, 16, 31, 32, 53, 63, 64) for sign in (-1, 1) for off in (-1, 0)
    }
    within = sorted(edge for edge in edges if low <= edge <= high)
    near = min(max(0, low), high)
    bits_up, bits_down = (high - near).bit_length(), (near - low).bit_length()

    def example(source: Source) -> int:
        kind = source.random()
        if kind < 0.15:
            value = within[int(source.random() * len(within))]
        elif kind < 0.2 and source.ints and low <= (value := source.choice(source.ints)) <= high:
            return value
        elif kind < 0.5:  # of any size
            up = bits_up and (not bits_down or source.random() < 0.5)
            size = source.getrandbits(1 + int(source.random() * (bits_up if up else bits_down))) if low < high else 0
            value = min(near + size, high) if up else max(near - size, low)
        else:
            value = source.randint(low, high)
        source.ints.append(value)
        return value

    return Strategy(example)


def _single(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", max(-3.4e38, min(3.4e38, value))))[0])


def floats(
    min_value: float | None = None,
    max_value: float | None = None,
    *,
    width: int = 64,
    allow_nan: bool | None = None,
    allow_infinity: bool | None = None,
    exclude_max: bool = False,
) -> Strategy:
    """`width` 32: single precision."""
    bounded = min_value is not None, max_value is not None
    low = float(min_value) if min_value is not None else -math.inf
    high = float(max_value) if max_value is not None else math.inf
    if exclude_max:
        high = math.nextafter(high, -math.inf)
    with_nan = allow_nan if allow_nan is not None else not any(bounded)
    with_infinity = allow_infinity if allow_infinity is not None else not all(bounded)
    edges = [edge for edge in (low, high, *NUMBERS, 5.0, -2.0, 100.0) if low <= edge <= high and math.isfinite(edge)]
    if all(bounded) and low < high and width == 64:
        edges += [math.nextafter(low, high), math.nextafter(high, low)]
    edges += [math.inf] * (with_infinity and not bounded[1]) + [-math.inf] * (with_infinity and not bounded[0])
    edges += [math.nan] * with_nan
    most = min(max(abs(low), abs(high)), 1e300)
    decades = math.log10(most) + 9.0 if most > 1e-9 else 0.0
    code = "<d" if width == 64 else "<f"

    def example(source: Source) -> float:
        kind = source.random()
        if kind < 0.15:
            value = edges[int(source.random() * len(edges))]
        elif kind < 0.2 and source.floats and low <= (value := source.choice(source.floats)) <= high:
            pass
        elif kind < 0.35:  # of any size
            value = math.copysign(10.0 ** (source.random() * decades - 9.0), source.random() - 0.5)
        elif kind < 0.45:
            value = float(round(source.uniform(max(low, -1e4), min(high, 1e4))))
        elif all(bounded):
            share = source.random()
            value = low * (1.0 - share) + high * share
        elif kind < 0.7:
            value = struct.unpack(code, source.randbytes(width // 8))[0]
        else:
            value = max(low, -100.0) + 200.0 * source.random()
        if width == 32 and math.isfinite(value):
            value = _single(value)
        if math.isfinite(value):
            value = min(max(value, low), high)
            source.floats.append(value)
        elif not (with_nan if math.isnan(value) else with_infinity):
            value = 0.0 if low <= 0.0 <= high else (low if bounded[0] else high)
        return value

    return Strategy(example)


# Text and bytes ----------------------------------------------------------------


def characters(
    *, min_codepoint: int = 0, max_codepoint: int = 0x10FFFF, exclude_categories: Sequence[str] = ("Cs",)
) -> Strategy:
    excluded = tuple(exclude_categories)

    def example(source: Source) -> str:
        while True:
            kind = source.random()
            if kind < 0.5:
                letter = chr(32 + int(source.random() * 95))
            elif kind < 0.65:
                letter = ODD[int(source.random() * len(ODD))]
            elif kind < 0.8:
                letter = chr(int(source.random() * 256))
            else:
                letter = chr(int(source.random() * 0x110000))
            if min_codepoint <= ord(letter) <= max_codepoint and not unicodedata.category(letter).startswith(excluded):
                return letter

    return Strategy(example)


ANY_LETTER = characters()


def _size(source: Source, least: int, most: int | None) -> int:
    most = least + SIZE if most is None else most
    kind = source.random()
    if kind < 0.1:
        return least
    if kind < 0.2:
        return most
    return least + int((most - least + 1) * source.random() ** 2)


def text(alphabet: Strategy = ANY_LETTER, *, min_size: int = 0, max_size: int | None = None) -> Strategy:
    letter = alphabet.example
    return Strategy(lambda source: "".join([letter(source) for _ in range(_size(source, min_size, max_size))]))


def binary(*, min_size: int = 0, max_size: int | None = None) -> Strategy:
    """Any bytes; one in eight is of one byte again and again."""

    def example(source: Source) -> bytes:
        size = _size(source, min_size, max_size)
        if source.random() < 0.125:
            return bytes([source.choice((0, 1, 0x7F, 0x80, 0xFF))]) * size
        return source.randbytes(size)

    return Strategy(example)


# Several values ----------------------------------------------------------------


def tuples(*strategies: Strategy) -> Strategy:
    return Strategy(lambda source: tuple([strategy.example(source) for strategy in strategies]))


def lists(
    elements: Strategy,
    *,
    min_size: int = 0,
    max_size: int | None = None,
    unique: bool = False,
    unique_by: Callable[[Any], Hashable] | None = None,
) -> Strategy:
    key = unique_by or ((lambda value: value) if unique else None)

    def example(source: Source) -> list[Any]:
        size = _size(source, min_size, max_size)
        if key is None:
            return [elements.example(source) for _ in range(size)]
        found: dict[Hashable, Any] = {}
        for _ in range(size + TRIES * (min_size > 0)):
            value = elements.example(source)
            found.setdefault(key(value), value)
            if len(found) == size:
                break
        assert len(found) >= min_size
        return list(found.values())

    return Strategy(example)


def sets(elements: Strategy) -> Strategy:
    return lists(elements, unique=True).map(set)


def dictionaries(keys: Strategy, values: Strategy, *, max_size: int | None = None) -> Strategy:
    return lists(tuples(keys, values), max_size=max_size).map(dict)


def fixed_dictionaries(always: Mapping[Any, Strategy], *, optional: Mapping[Any, Strategy] | None = None) -> Strategy:
    more = optional or {}

    def example(source: Source) -> dict[Any, Any]:
        found = {key: strategy.example(source) for key, strategy in always.items()}
        return found | {key: strategy.example(source) for key, strategy in more.items() if source.random() < 0.6}

    return Strategy(example)


def recursive(base: Strategy, extend: Callable[[Strategy], Strategy], *, max_leaves: int) -> Strategy:
    """Three levels deep, the inner ones mostly leaves: about `max_leaves` of them at most."""
    assert max_leaves < 20
    inner = base
    for share in (0.3, 0.5, 0.7):
        deeper = extend(inner)

        def example(source: Source, deeper: Strategy = deeper, share: float = share) -> Any:
            return (deeper if source.random() < share else base).example(source)

        inner = Strategy(example)
    return inner


def builds(make: Callable[..., Any], *strategies: Strategy, **named: Strategy) -> Strategy:
    return Strategy(
        lambda source: make(
            *[strategy.example(source) for strategy in strategies],
            **{name: strategy.example(source) for name, strategy in named.items()},
        )
    )


def composite(make: Callable[..., Any]) -> Callable[..., Strategy]:
    def strategy(*given: Any, **named: Any) -> Strategy:
        return Strategy(lambda source: make(lambda one: one.example(source), *given, **named))

    return strategy
