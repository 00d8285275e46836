"""companion/mavlink/own_messages.py: encoder, decoder and bounds of each message, in straight lines."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator, Mapping, Sequence

from companion.core.model import states
from companion.mavlink.schema.attributes import Attribute, Class, class_of
from companion.mavlink.schema.rows import Bits, Field, Message, Value
from companion.mavlink.schema.values import HERE, NOTE, WIDTH, import_lines

FEW = 3  # terms in one line
ZEROS = {"int": "0", "float": "0.0", "bool": "False", "Vec3": "(0.0, 0.0, 0.0)"}


def codec(messages: Sequence[Message], constants: Mapping[str, tuple[float, str]], imports: Mapping[str, str]) -> str:
    """Text of the module."""
    carriers = [message for message in messages if message.value]
    body = [line for message in carriers for line in _message(message)]
    kinds = sorted({value.kind for message in carriers for row in message.fields for value in row.carried()})
    tables = [f"{_table(kind)}: Final = tuple({kind})" for kind in kinds if _entries(kind)]
    classes = {name: HERE for message in carriers for name in (message.value, *(part.name for part in message.parts))}
    return "\n".join(
        [
            '"""Our own messages: the fields as they are sent, encoders, decoders, and what a receiver believes."""',
            "",
            NOTE,
            "",
            "from __future__ import annotations",
            "",
            "import struct",
            "from collections.abc import Callable",
            "from functools import partial",
            "from typing import Final, NamedTuple",
            "",
            *import_lines("\n".join([*tables, *body]), {**imports, **classes}),
            "",
            *(f"{name}: Final = {value}  # {reason}" for name, (value, reason) in constants.items()),
            *(line for message in carriers for line in _masks(message)),
            *tables,
            *body,
            "",
        ]
    )


def _masks(message: Message) -> Iterator[str]:
    """The bits of its flags."""
    for row in message.fields:
        for at, bits in _at(row):
            if bits.width == 1:
                yield f"{bits.name}: Final = {1 << at}  # {message.name}.{row.name}"


def _message(message: Message) -> Iterator[str]:
    one = class_of(message)
    name = "".join(f"_{c.lower()}" if c.isupper() else c for c in one.name).strip("_")
    yield from _wire(message, name)
    yield from _encoder(message, one, name)
    yield from _decoder(message, one, name)
    for attribute, kind in message.beside:
        yield from ("", "", f"def {attribute}_of(fields: Wire{one.name}) -> {kind}:")
        yield f'    """Carried by a {name.replace("_", " ")} beside its value."""'
        yield f"    return {kind}("
        for row in message.on_wire:
            if any(value.part == attribute for value in row.values):
                yield f"        {row.unpack.format(f'fields.{row.name}')},"
        yield "    )"


def _wire(message: Message, name: str) -> Iterator[str]:
    """The fields as they are sent."""
    rows = message.on_wire
    yield from ("", "")
    yield f"class Wire{message.value}(NamedTuple):"
    yield f'    """{message.name}: the fields as they are sent, in that order; units as in docs/reference/beacon.md."""'
    yield ""
    yield from (f"    {row.name}: {row.python}" for row in rows)
    for row in rows:
        for at, bits in _at(row):
            if bits.width > 1:
                yield from _property(bits.name, _bits_of(f"self.{row.name}", at, bits, row), bits.meaning)
    for derived in message.derived:
        yield from _property(*derived)
    yield from ("", "")
    yield f'{name.upper()}_PAYLOAD: Final = struct.Struct("<{"".join(row.code for row in rows)}")'
    yield "# `_make`, without its frame."
    kind = f"Wire{message.value}"
    yield f"_wire_{name}: Final[Callable[..., {kind}]] = partial(tuple.__new__, {kind})"
    yield from ("", "", f"def unpack_{name}(payload: bytes) -> Wire{message.value}:")
    yield '    """A payload, whole -> its fields."""'
    yield f"    return _wire_{name}({name.upper()}_PAYLOAD.unpack(payload))"


def _property(name: str, expression: str, about: str) -> Iterator[str]:
    yield from ("", "    @property", f"    def {name}(self) -> int:")
    yield from (f'        """{about}"""', f"        return {expression}")


# --- out ---


def _encoder(message: Message, one: Class, name: str) -> Iterator[str]:
    parts = [attribute for attribute in one.attributes if attribute.part is not None]
    for attribute in parts:
        assert attribute.part is not None
        yield from ("", "", f"_NO_{attribute.name.upper()}: Final = {attribute.part.name}(")
        yield from (f"    {inner.name}={_absent(inner)}," for inner in attribute.part.attributes if inner.sources)
        yield ")"
    beside = "".join(f", {attribute}: {kind}" for attribute, kind in message.beside)
    yield from ("", "", f"def encode_{name}(value: {one.name}{beside}) -> bytes:")
    yield f'    """The payload of {message.name}, with its trailing zeros.'
    yield ""
    yield "    struct.error when a number does not fit its field: the core keeps them in bounds."
    yield '    """'
    for attribute in parts:
        yield f"    {attribute.name} = value.{attribute.name}"
        yield f"    if {attribute.name} is None:"
        yield f"        {attribute.name} = _NO_{attribute.name.upper()}"
    local = {attribute.name for attribute in parts} | {attribute for attribute, _ in message.beside}
    for attribute in one.attributes:
        if attribute.when:
            zeros = ", ".join(["0.0"] * len(attribute.sources))
            yield f"    {attribute.name} = value.{attribute.name} or ({zeros})"
            local.add(attribute.name)
    yield f"    return {name.upper()}_PAYLOAD.pack("
    yield from (f"        {_packed(row, local)}," for row in message.on_wire)
    yield "    )"


def _absent(attribute: Attribute) -> str:
    """The value that is sent of it while the part that it is in is None."""
    given = attribute.sources[0][1].absent
    return given or ZEROS[attribute.kind]


def _packed(row: Field, local: set[str]) -> str:
    """From the core's value to the wire."""
    if not row.bits:
        return row.pack.format(*(_access(value.path, local) for value in row.values))
    terms = []
    for at, bits in _at(row):
        if bits.is_there:
            terms.append(f"({bits.name} if value.{bits.is_there} is not None else 0)")
        elif bits.value is not None and bits.width == 1:
            terms.append(f"({bits.name} if {_access(bits.value.path, local)} else 0)")
        elif bits.value is not None:
            access = _access(bits.value.path, local)
            terms.append(access if at == 0 else f"{access} << {at}")
    return (" | " if len(terms) <= FEW else "\n        | ").join(terms)


def _access(path: str, local: set[str]) -> str:
    first = path.partition(".")[0].partition("[")[0]
    return path if first in local else f"value.{path}"


# --- in ---


def _decoder(message: Message, one: Class, name: str) -> Iterator[str]:
    rows = message.on_wire
    header = "".join(f"{value.name}: {value.kind}, " for value in message.header)
    yield from ("", "", f"def decode_{name}({header}fields: Wire{one.name}) -> {one.name} | None:")
    yield '    """Fields -> the value; None: one of them is not believed."""'
    yield "    ("  # all of them at once: by its name, each is looked up in the class of the tuple
    beside = {attribute for attribute, _ in message.beside}
    used = {row.name for row in rows if row.is_checked or any(value.part not in beside for value in row.carried())}
    yield from (f"        {row.name if row.name in used else '_' + row.name}," for row in rows)
    yield "    ) = fields"
    checks = [check for row in rows for check in _checks(row)]
    if checks:
        line = f"    if not ({' and '.join(checks)}):"
        if len(line) <= WIDTH:
            yield line
        else:
            yield "    if not ("
            yield f"        {checks[0]}"
            yield from (f"        and {check}" for check in checks[1:])
            yield "    ):"
        yield "        return None"
    for row in rows:
        if len(row.values) > 1:
            yield f"    {', '.join(value.name for value in row.values)} = {row.unpack.format(row.name)}"
    yield f"    return {one.name}("
    for attribute in one.attributes:
        yield from (f"        {line}" for line in _argument(attribute))
    yield "    )"


def _checks(row: Field) -> Iterator[str]:
    """Conditions that hold for what is believed; false for NaN."""
    unsigned = row.type.startswith("u")
    low = "" if row.least == -math.inf or (unsigned and row.least == 0) else _number(row, row.least)
    high = "" if row.most == math.inf else _number(row, row.most)
    if low and low == high:
        yield f"{row.name} == {low}"
    elif low and high:
        yield f"{low} <= {row.name} <= {high}"
    elif low:
        yield f"{row.name} >= {low}"
    elif high:
        yield f"{row.name} <= {high}"
    elif row.type == "float":
        yield f"{row.name} == {row.name}"  # not NaN
    for at, bits in _at(row):
        if bits.value is not None and _entries(bits.value.kind):
            yield f"{_bits_of(row.name, at, bits, row)} < {_entries(bits.value.kind)}"


def _number(row: Field, bound: float) -> str:
    return repr(float(bound)) if row.type == "float" else str(int(bound))


def _argument(attribute: Attribute) -> Iterator[str]:
    if attribute.part is not None:
        yield f"{attribute.part.name}("
        for inner in attribute.part.attributes:
            if inner.sources:
                yield from (f"    {line}" for line in _argument(inner))
        yield ")"
        yield f"if {attribute.part.when}"
        yield "else None,"
        return
    if len(attribute.sources) > 1:
        parts = ", ".join(_unpacked(row, value) for row, value in attribute.sources)
        yield f"({parts}) if {attribute.when} else None," if attribute.when else f"({parts}),"
    elif attribute.sources:
        yield f"{_unpacked(*attribute.sources[0])},"
    else:
        yield f"{attribute.name},"  # of the header


def _unpacked(row: Field, value: Value) -> str:
    """From the wire to the core's value."""
    if len(row.values) > 1:
        return value.name
    if not row.bits:
        raw = row.unpack.format(row.name)
    else:
        at, bits = next((at, bits) for at, bits in _at(row) if bits.value is value)
        raw = _bits_of(row.name, at, bits, row)
        if bits.width == 1:
            return f"({raw}) != 0"
    return f"{_table(value.kind)}[{raw}]" if _entries(value.kind) else raw


# --- bits ---


def _at(row: Field) -> Iterator[tuple[int, Bits]]:
    """Its bits, each with the number of those below."""
    at = 0
    for bits in row.bits:
        yield at, bits
        at += bits.width


def _bits_of(name: str, at: int, bits: Bits, row: Field) -> str:
    if bits.width == 1:
        return f"{name} & {bits.name}"
    if bits is row.bits[-1]:
        return f"{name} >> {at}"
    return f"{name} >> {at} & {(1 << bits.width) - 1}" if at else f"{name} & {(1 << bits.width) - 1}"


def _entries(kind: str) -> int:
    """Number of entries of an enumeration of the core, counted from 0; 0: the type is none."""
    found = getattr(states, kind, None)
    return len(found) if isinstance(found, enum.EnumMeta) else 0


def _table(kind: str) -> str:
    return "_" + "".join(f"_{c}" if c.isupper() else c.upper() for c in kind).strip("_") + "S"
