"""docs/reference/beacon.md: our own messages, field by field."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence

from companion.core.model.states import FlightState
from companion.mavlink import dialect
from companion.mavlink.schema.definition import enumerations_of
from companion.mavlink.schema.messages import ENUMERATIONS, OWN
from companion.mavlink.schema.rows import Field, Message
from companion.mavlink.schema.tables.beacon import FURTHEST_M, VERSION


def page(note: str) -> Iterator[str]:
    """Its lines; `note`: that it is generated."""
    beacon, *others = OWN
    size = struct.calcsize("<" + "".join(row.code for row in beacon.fields))
    yield from (f"# {beacon.name}", "", note, "", beacon.meaning, "")
    yield "A MAVLink 2 message of the dialect `companion/mavlink/swarm.xml`, sent with the vehicle's own system id"
    yield f"and component {dialect.MAV_COMP_ID_ONBOARD_COMPUTER} (MAV_COMP_ID_ONBOARD_COMPUTER)."
    yield f"Message id {beacon.id}, CRC extra {_crc_extra(beacon)}, payload {size} bytes"
    yield f"(MAVLink 2 cuts trailing zeros off), version {VERSION}."
    yield ""
    yield "Fields in the order of the wire. A receiver drops a beacon, and counts it, when a field is outside what is"
    yield "believed (a float that is NaN always is), or when its sender is farther off than"
    yield f"{FURTHEST_M / 1e3:g} km along any axis. *in the core*: the attributes of `Beacon` that it carries."
    yield from _fields(beacon)
    for enumeration in enumerations_of(OWN, ENUMERATIONS):
        yield from ("", f"## {enumeration.name}", "", enumeration.meaning, "")
        yield from ("| value | name | meaning |", "|---|---|---|")
        yield from (_row(str(value), f"`{name}`", meaning) for name, value, meaning in enumeration.entries)
    yield from ("", "## flight_state", "", "Where the sender's own flight is.", "", "| value | name |", "|---|---|")
    yield from (_row(str(state.value), f"`{state.name}`") for state in FlightState)
    for message in sorted(others, key=lambda message: -message.id):
        yield from ("", f"## {message.name}", "", message.meaning, "")
        yield f"Message id {message.id}, CRC extra {_crc_extra(message)}. See"
        yield f"{message.see}."
        yield from _fields(message)


def _crc_extra(message: Message) -> int:
    return dialect.mavlink_map[message.id].crc_extra


def _fields(message: Message) -> Iterator[str]:
    yield from ("", "| field | type | unit | believed | in the core | meaning |", "|---|---|---|---|---|---|")
    for row in message.on_wire:
        meaning = f"{row.meaning} See {row.enum}." if row.enum else row.meaning
        paths = _unique([*(value.path for value in row.carried()), *(bits.is_there for bits in row.bits)])
        carried = ", ".join(f"`{path}`" for path in paths)
        yield _row(f"`{row.name}`", row.type, row.unit, _believed(row), carried, meaning)


def _unique(paths: Sequence[str]) -> list[str]:
    return [path for path in dict.fromkeys(paths) if path]


def _believed(row: Field) -> str:
    if not row.is_checked:
        return ""
    if row.least == row.most:
        return f"{row.least:g}"
    return f"{row.least:g}.." + (f"{row.most:g}" if row.most < math.inf else "")


def _row(*cells: str) -> str:
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"
