"""Numbers as people and their programs write them: decimal points and commas, thousands separated or not.

`1.234,5` and `0,5` say themselves which sign is the decimal one. `1.234` does not: the other numbers of the file may.
If they do not either, it is no number: nothing is guessed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple

_NUMBER: Final = re.compile(r"[+-]?(?:[0-9]{1,12}(?:\.[0-9]{0,20})?|\.[0-9]{1,20})(?:[eE][+-]?[0-9]{1,2})?")
# Grouped by spaces or apostrophes, which no decimal sign is: 1 234,5 and 1'234.5
_SPACED: Final = re.compile(
    r"[+-]?[0-9]{1,3}([ \u00a0\u2009\u202f'\u2019])[0-9]{3}(?:\1[0-9]{3}){0,3}(?:[.,][0-9]{0,20})?"
)
_GROUPED: Final = re.compile(r"[+-]?[1-9][0-9]{0,2}([.,])[0-9]{3}(?:\1[0-9]{3}){0,3}")
_SPACES: Final = re.compile("[ \u00a0\u2009\u202f'\u2019]")
MOST_CHARS: Final = 50  # none is longer


@dataclass(frozen=True, slots=True)
class Signs:
    """Uses of `.` and `,` in the numbers of a file."""

    decimals: frozenset[str]
    thousands: frozenset[str]


POINT: Final = Signs(frozenset("."), frozenset(","))
COMMA: Final = Signs(frozenset(","), frozenset("."))


class _Form(NamedTuple):
    """A text that may be a number, and the use of its signs."""

    text: str
    decimal: str = ""
    thousands: str = ""
    unsure: str = ""  # one of both


def signs_of(values: Iterable[object], usual: str) -> Signs:
    """The uses that the numbers among `values` show by themselves; usual: decimal sign that the format has, or ""."""
    decimals: set[str] = set(usual)
    thousands: set[str] = set()
    for value in values:
        form = _form(value) if isinstance(value, str) else None
        if form is not None:
            decimals.update(form.decimal)
            thousands.update(form.thousands)
    return Signs(frozenset(decimals), frozenset(thousands))


def number(value: object, signs: Signs = POINT) -> float | None:
    """A number as the file has it, or as text; None: it is none, or not surely which. NaN and infinity are none."""
    match value:
        case bool():
            return None
        case int() | float():
            if isinstance(value, int) and value.bit_length() > 64:
                return None
            return float(value) if abs(value) < 1e15 else None
        case str():
            form = _form(value)
            return None if form is None else _value(form, signs)
        case _:
            return None


def is_ambiguous(value: object, signs: Signs) -> bool:
    """True if it is a number, but which one the file does not say."""
    form = _form(value) if isinstance(value, str) else None
    return form is not None and bool(form.unsure) and _value(form, signs) is None


def _value(form: _Form, signs: Signs) -> float | None:
    decimal, thousands = form.decimal, form.thousands
    if form.unsure:
        may = form.unsure in signs.decimals, form.unsure in signs.thousands
        if may == (True, False):
            decimal = form.unsure
        elif may == (False, True):
            thousands = form.unsure
        else:
            return None
    if not (signs.decimals.issuperset(decimal) and signs.thousands.issuperset(thousands)):
        return None
    text = form.text.replace(thousands, "") if thousands else form.text
    text = text.replace(decimal, ".") if decimal else text
    return float(text) if _NUMBER.fullmatch(text) else None


def _form(value: str) -> _Form | None:
    text = value.strip()
    if len(text) > MOST_CHARS:
        return None
    if _SPACED.fullmatch(text):
        text = _SPACES.sub("", text)
    points, commas = text.count("."), text.count(",")
    if points and commas:
        head, decimal = (
            (text.rpartition(".")[0], ".") if text.rfind(".") > text.rfind(",") else (text.rpartition(",")[0], ",")
        )
        return _Form(text, decimal, "," if decimal == "." else ".") if _GROUPED.fullmatch(head) else None
    if not points and not commas:
        return _Form(text)
    sign = "." if points else ","
    if _GROUPED.fullmatch(text):
        return _Form(text, thousands=sign) if points + commas > 1 else _Form(text, unsure=sign)
    return _Form(text, decimal=sign) if points + commas == 1 and _NUMBER.fullmatch(text.replace(",", ".")) else None
