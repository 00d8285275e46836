"""swarm.xml: our own enumerations and messages in it, between marks. The rest are the standard ones, as they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape, quoteattr

from companion.mavlink.schema.rows import Enumeration, Field, Message

BEGIN = "<!-- Generated from companion/mavlink/schema by `make dialect`; do not edit. -->"
END = "<!-- End of what is generated. -->"


def definition(text: str, messages: Sequence[Message], enumerations: Sequence[Enumeration]) -> str:
    """swarm.xml with what stands between the marks made anew: first the enumerations, then the messages."""
    before, _, rest = text.partition(BEGIN)
    _, _, rest = rest.partition(END)
    between, _, rest = rest.partition(BEGIN)
    _, _, after = rest.partition(END)
    parts = (
        before,
        *_marked(line for enumeration in enumerations_of(messages, enumerations) for line in _enumeration(enumeration)),
        between,
        *_marked(line for message in messages for line in _message(message)),
        after,
    )
    return "".join(parts)


def enumerations_of(messages: Sequence[Message], enumerations: Sequence[Enumeration]) -> list[Enumeration]:
    """All of them: first those written out, then those of flags."""
    return [*enumerations, *(mask for message in messages for mask in _masks(message))]


def _marked(lines: Iterator[str]) -> Iterator[str]:
    yield f"{BEGIN}\n"
    yield from (f"{line}\n" for line in lines)
    yield f"    {END}"


def _masks(message: Message) -> Iterator[Enumeration]:
    """The enumeration of each field that is made of single bits."""
    for field in message.fields:
        if field.bits and all(bits.width == 1 for bits in field.bits):
            entries = tuple((bits.name, 1 << at, bits.meaning) for at, bits in enumerate(field.bits))
            yield Enumeration(name=field.enum, meaning=f"Flags of {message.name}.", entries=entries, is_mask=True)


def _enumeration(enumeration: Enumeration) -> Iterator[str]:
    mask = ' bitmask="true"' if enumeration.is_mask else ""
    yield f'    <enum name="{enumeration.name}"{mask}>'
    yield f"      <description>{escape(enumeration.meaning)}</description>"
    for name, value, meaning in enumeration.entries:
        entry = f'value="{value}" name="{enumeration.name}_{name}"'
        yield f"      <entry {entry}><description>{escape(meaning)}</description></entry>"
    yield "    </enum>"


def _message(message: Message) -> Iterator[str]:
    yield f'    <message id="{message.id}" name="{message.name}">'
    yield f"      <description>{escape(message.meaning)}</description>"
    yield from (f"      {_field(field)}" for field in message.fields)
    yield "    </message>"


def _field(field: Field) -> str:
    attributes = {"type": field.type, "name": field.name, "units": field.unit, "enum": field.enum}
    shown = "".join(f" {name}={quoteattr(value)}" for name, value in attributes.items() if value)
    return f"<field{shown}>{escape(field.meaning)}</field>"
