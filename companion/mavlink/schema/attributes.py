"""The classes that messages become in the core, worked out of the rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from companion.mavlink.schema.rows import Field, Message, Value


@dataclass(slots=True)
class Attribute:
    """One attribute of a class, and which values of which fields it is made of: three for a vector."""

    name: str
    kind: str
    note: str = ""
    default: str = ""
    when: str = ""
    sources: list[tuple[Field, Value]] = field(default_factory=list)
    part: Class | None = None  # it is a value with attributes of its own


@dataclass(frozen=True, slots=True)
class Class:
    """A class, its attributes in the order of its arguments."""

    name: str
    about: str
    attributes: Sequence[Attribute]
    when: str = ""


def classes(message: Message) -> Iterator[Class]:
    """Classes of a message, each before the one that holds it."""
    whole = class_of(message)
    yield from (attribute.part for attribute in whole.attributes if attribute.part is not None)
    yield whole


def class_of(message: Message) -> Class:
    """The message's own."""
    top = {value.name: Attribute(value.name, value.kind, value.note) for value in message.header}
    inner: dict[str, dict[str, Attribute]] = {part.attribute: {} for part in message.parts}
    parts = {part.attribute: part for part in message.parts}
    for row in message.on_wire:
        for value in row.carried():
            if value.part in parts:
                part = parts[value.part]
                top.setdefault(
                    part.attribute, Attribute(part.attribute, f"{part.name} | None", part.note, part.default)
                )
                _add(inner[value.part], row, value)
            elif not value.part:
                _add(top, row, value)
    for part in message.parts:
        for value in part.local:
            inner[part.attribute][value.name] = Attribute(value.name, value.kind, value.note, value.default)
        ordered = _ordered(inner[part.attribute], part.by_place)
        top[part.attribute].part = Class(part.name, part.about, ordered, part.when)
    return Class(message.value, message.about, _ordered(top, message.by_place))


def _add(attributes: dict[str, Attribute], row: Field, value: Value) -> None:
    first = Attribute(value.name, value.kind, value.note, value.default, value.when)
    attributes.setdefault(value.name, first).sources.append((row, value))


def _ordered(attributes: dict[str, Attribute], by_place: Sequence[str]) -> list[Attribute]:
    """First those given by place, then those required, then those with a default."""
    rest = [attribute for name, attribute in attributes.items() if name not in by_place]
    rest.sort(key=lambda attribute: bool(attribute.default))
    return [*(attributes[name] for name in by_place), *rest]
