"""Channels of a black box, and the JSON of those that people read: docs/reference/black-box.md."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from struct import Struct
from typing import Any, Final

from companion.core.safety.setpoint import Setpoint
from companion.journal import mcap
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.outbox import Outbox
from companion.mavlink.sensor_inputs import SHARED
from mission.common.frames import Vec3

VERSION: Final = 3  # of the format
WORD_ALONE: Final = 2  # the format before, which does not tell whether a sender vouches for where it is
UNCHAINED_HEAD: Final = 1  # and the one before that, whose chain begins behind the files' header
ARRIVED: Final = Struct("<d")  # before the bytes of a datagram: when it came or went, on the companion's clock, s
CHAIN_BYTES: Final = 32  # SHA-256
DATAGRAM: Final = "x-understory-datagram"
TIME_MAX_S: Final = 1e10  # that MCAP's nanoseconds hold
ORDER: Final = "order "  # before the reason why one is refused
CHAINED: Final = b',"chain":"'  # before the link, the last value of a tick
Json = dict[str, Any]


class Channel(IntEnum):
    """Ids of the channels; sensors' links come after, in the order of their names."""

    START = 1
    TICK = 2
    GAP = 3
    END = 4
    VERDICTS = 5
    ANSWERS = 6
    AUTOPILOT_IN = 7
    PEERS_IN = 8
    AUTOPILOT_OUT = 9
    PEERS_OUT = 10
    RECORDS_OUT = 11
    SENSORS_OUT = 12
    SURROUNDINGS_IN = 13
    SENSORS_IN = 14  # the first of them


TOPICS: Final = {
    Channel.START: "/start",
    Channel.TICK: "/tick",
    Channel.GAP: "/gap",
    Channel.END: "/end",
    Channel.VERDICTS: "/verdicts",
    Channel.ANSWERS: "/answers",
    Channel.AUTOPILOT_IN: "/in/autopilot",
    Channel.PEERS_IN: "/in/peers",
    Channel.AUTOPILOT_OUT: "/out/autopilot",
    Channel.PEERS_OUT: "/out/peers",
    Channel.RECORDS_OUT: "/out/records",
    Channel.SENSORS_OUT: "/out/sensors",
    Channel.SURROUNDINGS_IN: "/in/surroundings",
}
OUTPUTS: Final = {  # in the order in which they are sent
    Channel.PEERS_OUT: "peers",
    Channel.RECORDS_OUT: "peers (records)",
    Channel.AUTOPILOT_OUT: "autopilot",
    Channel.SENSORS_OUT: "sensors",
}
ENCODINGS: Final = {Channel.VERDICTS: "x-understory-verdicts", Channel.ANSWERS: "cbor"}
SENSORS_TOPIC: Final = "/in/sensors"

_NUMBER: Final = {"type": "number"}
_INTEGER: Final = {"type": "integer"}
_TEXT: Final = {"type": "string"}
_VELOCITY: Final = {"type": "array", "items": {"type": ["number", "null"]}, "minItems": 3, "maxItems": 3}


def _object(title: str, **properties: Json) -> Json:
    return {"title": title, "type": "object", "properties": properties}


def _array(items: Json) -> Json:
    return {"type": "array", "items": items}


SCHEMAS: Final[Mapping[Channel, Json]] = {
    Channel.START: _object(
        "understory.BlackBoxStart",
        format=_INTEGER,
        version=_TEXT,
        compiled=_TEXT,
        vehicle=_INTEGER,
        started_utc=_TEXT,
        clock=_TEXT,
        mission_sha256=_TEXT,
        mission_file=_TEXT,
        mission={"type": "object"},
        sensors=_array(_TEXT),
        autopilot_is_stream={"type": "boolean"},
        sensor_streams={"type": "object"},
        has_survey={"type": "boolean"},
        has_records={"type": "boolean"},
        grounded=_TEXT,
        waived=_TEXT,
        unknown=_TEXT,
        unsigned={"type": "boolean"},
        flown_by=_TEXT,
        guard_flags={"type": ["integer", "null"]},  # of a guard with keys
        autopilot_signed={"type": "boolean"},
        orders={"type": ["object", "null"]},  # of the operator's key: its public half, and what was seen of it before
    ),
    Channel.TICK: _object(
        "understory.BlackBoxTick",
        tick=_INTEGER,
        time_s=_NUMBER,
        state=_TEXT,
        role=_TEXT,
        desired_ned_mps=_VELOCITY,
        setpoint_ned_mps=_VELOCITY,
        cuts=_array(_object("understory.Cut", reason=_TEXT, by_mps={"type": ["number", "null"]})),
        refused={"type": "object", "additionalProperties": _INTEGER},  # frames and orders, by reason
        beacons={"type": "object", "additionalProperties": _array(_INTEGER)},  # by fate: senders, one for each beacon
        said=_array(_object("understory.Said", severity=_TEXT, text=_TEXT)),
        chain=_TEXT,
    ),
    Channel.GAP: _object(
        "understory.BlackBoxGap", first_tick=_INTEGER, last_tick=_INTEGER, why=_TEXT, chain=_TEXT, ticks=_INTEGER
    ),
    Channel.END: _object("understory.BlackBoxEnd", tick=_INTEGER, time_s=_NUMBER, why=_TEXT, chain=_TEXT),
}
_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False, check_circular=False).encode


def head(sensor_links: Sequence[str], about: Mapping[str, str]) -> bytes:
    """The beginning of every segment. `sensor_links`: their names, sorted; `about`: for people."""
    parts = [mcap.begin("understory", "understory black box"), mcap.metadata("understory", about)]
    for channel, schema in SCHEMAS.items():
        parts.append(mcap.schema(channel, schema["title"], encode(schema)))
    for channel, topic in TOPICS.items():
        is_json = channel in SCHEMAS
        encoding = "json" if is_json else ENCODINGS.get(channel, DATAGRAM)
        parts.append(mcap.channel(channel, channel if is_json else 0, topic, encoding))
    for k, name in enumerate(sensor_links):
        parts.append(mcap.channel(Channel.SENSORS_IN + k, 0, f"{SENSORS_TOPIC}/{name}".rstrip("/"), DATAGRAM))
    return b"".join(parts)


def sensor_links(start: Json) -> list[str]:
    """Names of the links of sensors' drivers, in the order of their channels."""
    return sorted({SHARED, *start["sensor_streams"]})


def encode(body: Mapping[str, Any]) -> bytes:
    """As JSON, every float with all of its digits."""
    return _encode(body).encode()


def sealed(body: bytes, chain: bytes) -> bytes:
    """A JSON object with the chain's link as its last value."""
    return body[:-1] + CHAINED + chain.hex().encode() + b'"}'


def unsealed(data: bytes) -> tuple[bytes, bytes]:
    """The object without it, and the link. ValueError: it has none."""
    body, mark, link = data.rpartition(CHAINED)
    if not mark or len(link) != 2 * CHAIN_BYTES + 2 or link[-2:] != b'"}':
        raise ValueError("has no link of the chain")
    return body + b"}", bytes.fromhex(link[:-2].decode("ascii", "replace"))


def tick_text(number: int, now_s: float, endpoint: Endpoint, out: Outbox, refused: Mapping[str, int]) -> bytes:
    """A tick as JSON, for people. `refused`: how many frames and orders were refused since the last, by reason.

    Written out: an encoder and the objects that it asks for take four times as long, in every tick.
    """
    agent = endpoint.agent
    setpoint: Setpoint = agent.setpoint
    cuts = ",".join([f'{{"reason":"{cut.reason._name_}","by_mps":{_number(cut.by_mps)}}}' for cut in setpoint.cuts()])
    heard: dict[str, list[int]] = {}
    for (sender, fate), count in out.heard.items():
        senders = heard.setdefault(fate._name_, [])
        senders += (sender,) * count
    beacons = ",".join([f'"{fate}":{senders}' for fate, senders in heard.items()])
    refusals = encode(refused).decode() if refused else "{}"
    said = ",".join([encode({"severity": say.severity.name, "text": say.text}).decode() for say in out.said])
    return (
        f'{{"tick":{number},"time_s":{_number(now_s)},"state":"{agent.flight.state._name_}"'
        f',"role":"{agent.swarm.election.role._name_}","desired_ned_mps":{_velocity(setpoint.desired_ned_mps)}'
        f',"setpoint_ned_mps":{_velocity(setpoint.vel_ned_mps)}'
        f',"cuts":[{cuts}],"beacons":{{{beacons}}},"refused":{refusals},"said":[{said}]}}'
    ).encode()


class Refusals:
    """Frames that the guard of the peers' link refuses, and orders, from tick to tick."""

    def __init__(self) -> None:
        self._frames: dict[str, int] = {}  # before
        self._orders: dict[str, int] = {}

    def take_refused(self, endpoint: Endpoint) -> dict[str, int]:
        """Their numbers since last asked, by reason; of an order it begins with ORDER."""
        frames, orders = endpoint.peers.guard.refused, endpoint.orders.refused
        found: dict[str, int] = {}
        if frames and frames != self._frames:
            found = _since(self._frames, frames)
            self._frames = dict(frames)
        if orders and orders != self._orders:
            found |= {ORDER + why: count for why, count in _since(self._orders, orders).items()}
            self._orders = dict(orders)
        return found


def _since(before: Mapping[str, int], now: Mapping[str, int]) -> dict[str, int]:
    return {why: count - before.get(why, 0) for why, count in now.items() if count != before.get(why, 0)}


def outputs(out: Outbox) -> Iterable[tuple[Channel, bytes]]:
    """Datagrams of a tick, in the order in which they are sent."""
    if out.peers:
        yield Channel.PEERS_OUT, out.peers
    for data in out.records:
        yield Channel.RECORDS_OUT, data
    if out.autopilot:
        yield Channel.AUTOPILOT_OUT, out.autopilot
    if out.sensor:
        yield Channel.SENSORS_OUT, out.sensor


def to_ns(now_s: float) -> int:
    """For MCAP's times, which count nothing in a replay."""
    return int(now_s * 1e9) if 0.0 <= now_s < TIME_MAX_S else 0


def _velocity(vel_ned_mps: Vec3) -> str:
    north, east, down = vel_ned_mps
    total = north + east + down
    if total - total == 0.0:
        return f"[{north!r},{east!r},{down!r}]"
    return f"[{_number(north)},{_number(east)},{_number(down)}]"


def _number(value: float) -> str:
    """All of its digits; JSON has no infinity."""
    return repr(value) if value - value == 0.0 else "null"
