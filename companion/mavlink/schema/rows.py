"""Rows of the schema of a message: one for each field."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

SIZES: Final = {"uint8_t": 1, "uint16_t": 2, "uint32_t": 4, "int32_t": 4, "uint64_t": 8, "float": 4}
CODES: Final = {"uint8_t": "B", "uint16_t": "H", "uint32_t": "I", "int32_t": "i", "uint64_t": "Q", "float": "f"}


@dataclass(frozen=True, slots=True)
class Value:
    """An attribute of the core's value, or one component of it."""

    path: str  # "hop", "lease.seq" (of a part), "vel_ned_mps[0]" (of a vector)
    kind: str = "int"  # its Python type; of a vector: of the whole, on its first component
    note: str = ""  # its comment in the core; of a vector: on its first component
    default: str = ""  # of the argument; "": required
    absent: str = ""  # what is sent while the part or the vector that it belongs to is None; "": zero
    when: str = ""  # of a vector that may be None, on its first component: true on the wire while it is there

    @property
    def part(self) -> str:
        """The attribute that it is inside of; "": the message's value itself."""
        return self.path.rpartition(".")[0]

    @property
    def name(self) -> str:
        """Of the attribute, without its component."""
        return self.path.rpartition(".")[2].partition("[")[0]


@dataclass(frozen=True, slots=True)
class Bits:
    """Some bits of a field, above those before it."""

    name: str  # in MAVLink's enumeration; of more than one bit: how WireBeacon has it
    meaning: str = ""
    value: Value | None = None
    width: int = 1
    is_there: str = ""  # set while this attribute is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One field of a message: how it is sent, what it means, what it becomes, and what a receiver believes."""

    name: str  # on the wire
    type: str  # MAVLink's
    meaning: str
    unit: str = ""
    values: tuple[Value, ...] = ()  # what it carries
    bits: tuple[Bits, ...] = ()  # the same, of a field that is made of bits
    pack: str = "{}"  # from its values to the wire; the beacon itself is `value`
    unpack: str = "{}"  # and back; of several values: to a tuple of them
    least: float = (
        -math.inf
    )  # what is believed, both included. Of numbers outside, or NaN, the whole message is dropped
    most: float = math.inf
    enum: str = ""  # MAVLink's, of its bits or of its values

    @property
    def is_checked(self) -> bool:
        """Some values, or NaN, are not believed."""
        return self.type == "float" or self.least > -math.inf or self.most < math.inf

    @property
    def count(self) -> int:
        """Number of elements of an array; 0: it is none."""
        return int(self.type.partition("[")[2].rstrip("]") or 0)

    @property
    def element(self) -> str:
        """Its type, or that of one element."""
        return self.type.partition("[")[0]

    @property
    def code(self) -> str:
        """Its type for struct: of bytes, all of them as one."""
        if self.element == "uint8_t" and self.count:
            return f"{self.count}s"
        return f"{self.count or ''}{CODES[self.element]}"

    @property
    def python(self) -> str:
        """Its type as it comes from struct."""
        return "bytes" if self.count else "float" if self.type == "float" else "int"

    def carried(self) -> Iterator[Value]:
        """Every value in it."""
        yield from self.values
        yield from (bits.value for bits in self.bits if bits.value is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A value inside the message's own, which may be None."""

    attribute: str  # of the message's value
    name: str  # of its class
    about: str  # docstring
    when: str  # true on the wire while it is there
    note: str = ""
    by_place: tuple[str, ...] = ()  # arguments that callers give by their places, in this order; others follow
    local: tuple[Value, ...] = ()  # not on the wire
    default: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Message:
    """One message of ours. Fields are sent as MAVLink orders them: by size, then as they stand here."""

    id: int
    name: str  # MAVLink's
    meaning: str
    fields: tuple[Field, ...]
    see: str = ""  # link of its page, for the reference
    value: str = ""  # class of the core; "": it has none
    about: str = ""  # docstring of that
    by_place: tuple[str, ...] = ()  # as in Part
    header: tuple[Value, ...] = ()  # what the frame's header carries
    parts: tuple[Part, ...] = ()
    beside: tuple[tuple[str, str], ...] = ()  # attribute, type: carried beside the value, as where the sender is
    derived: tuple[tuple[str, str, str], ...] = ()  # name, expression, docstring: properties of the fields as sent

    @property
    def on_wire(self) -> tuple[Field, ...]:
        """Its fields in the order of the wire."""
        return tuple(sorted(self.fields, key=lambda field: -SIZES[field.element]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Enumeration:
    """An enumeration of MAVLink's: name, value, meaning of each entry."""

    name: str
    meaning: str
    entries: tuple[tuple[str, int, str], ...]
    is_mask: bool = False


def field(
    name: str,
    type: str,
    meaning: str,
    *values: Value,
    unit: str = "",
    bits: tuple[Bits, ...] = (),
    pack: str = "{}",
    unpack: str = "{}",
    least: float = -math.inf,
    most: float = math.inf,
    enum: str = "",
) -> Field:
    """A row of the table."""
    return Field(
        name=name,
        type=type,
        meaning=meaning,
        unit=unit,
        values=values,
        bits=bits,
        pack=pack,
        unpack=unpack,
        least=least,
        most=most,
        enum=enum,
    )


def vector(
    names: tuple[str, str, str],
    attribute: str,
    meanings: tuple[str, str, str],
    *,
    unit: str,
    most: float,
    note: str = "",
    when: str = "",
) -> tuple[Field, ...]:
    """Three floats, north, east and down, each of at most `most` in size."""
    kind = "Vec3 | None" if when else "Vec3"
    return tuple(
        field(
            name,
            "float",
            meaning,
            Value(f"{attribute}[0]", kind=kind, note=note, when=when) if axis == 0 else Value(f"{attribute}[{axis}]"),
            unit=unit,
            least=-most,
            most=most,
        )
        for axis, (name, meaning) in enumerate(zip(names, meanings, strict=True))
    )
