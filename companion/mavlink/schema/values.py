"""companion/core/model/beacon.py: the core's values that messages carry, as classes that mypyc compiles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from companion.mavlink.schema.attributes import Attribute, Class, classes
from companion.mavlink.schema.rows import Message

HERE = "companion.core.model.beacon"
WIDTH = 120
NOTE = "# Generated from companion/mavlink/schema by `make dialect`; do not edit."


def values(messages: Sequence[Message], aliases: Mapping[str, tuple[str, str]], imports: Mapping[str, str]) -> str:
    """Text of the module."""
    made = [one for message in messages if message.value for one in classes(message)]
    body = [line for one in made for line in ("", "", *_class(one))]
    used = "\n".join(body)
    return "\n".join(
        [
            '"""Values that vehicles broadcast to one another: SWARM_BEACON, SWARM_RELATIVE, SWARM_TRUNKS, parts."""',
            "",
            NOTE,
            "",
            "from __future__ import annotations",
            "",
            "from dataclasses import dataclass",
            "from typing import Final",
            "",
            *import_lines(used, {name: module for name, module in imports.items() if module != HERE}),
            "",
            "NO_ROUTE: Final = 1e6  # route cost of a vehicle that knows no way to the leader",
            *(f"{name} = {kind}  # {meaning}" for name, (kind, meaning) in aliases.items()),
            *body,
            "",
        ]
    )


def import_lines(text: str, imports: Mapping[str, str]) -> Iterator[str]:
    """An import of each name that a text uses, module by module."""
    words = set("".join(c if c.isalnum() or c == "_" else " " for c in text).split())
    by_module: dict[str, list[str]] = {}
    for name, module in imports.items():
        if name in words:
            by_module.setdefault(module, []).append(name)
    for module, names in sorted(by_module.items()):
        names.sort(key=lambda name: (not name.isupper(), name[0].islower(), name))
        line = f"from {module} import {', '.join(names)}"
        if len(line) <= WIDTH:
            yield line
        else:
            yield from (f"from {module} import (", *(f"    {name}," for name in names), ")")


def _class(one: Class) -> Iterator[str]:
    yield "@dataclass(slots=True, init=False, unsafe_hash=True)"
    yield f"class {one.name}:"
    yield f'    """{one.about}"""'
    yield ""
    yield from (f"    {_declared(attribute)}" for attribute in one.attributes)
    yield ""
    yield "    def __init__("
    yield "        self,"
    for attribute in one.attributes:
        default = f" = {attribute.default}" if attribute.default else ""
        yield f"        {attribute.name}: {attribute.kind}{default},"
    yield "    ) -> None:"
    yield from (f"        self.{attribute.name} = {attribute.name}" for attribute in one.attributes)


def _declared(attribute: Attribute) -> str:
    line = f"{attribute.name}: Final[{attribute.kind}]"
    return f"{line}  # {attribute.note}" if attribute.note else line
