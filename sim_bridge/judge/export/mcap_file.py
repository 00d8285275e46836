"""One MCAP file of a flight, for Foxglove, Lichtblick and whatever reads MCAP."""

from __future__ import annotations

import json
from collections import Counter
from typing import IO

from mcap.writer import CompressionType, Writer

from mission import __version__
from sim_bridge.judge.export import foxglove
from sim_bridge.judge.export.flown import Flown
from sim_bridge.judge.export.messages import messages
from sim_bridge.judge.run_folder import MISSION_NAME


def write(flight: Flown, file: IO[bytes]) -> Counter[str]:
    """Write `flight` into `file`; how many messages each topic has. OSError as of `file`."""
    writer = Writer(file, compression=CompressionType.ZSTD)
    writer.start(library=f"understory {__version__}")
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    counts: Counter[str] = Counter()
    encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False, check_circular=False).encode
    for message in sorted(messages(flight), key=lambda message: message.time_ns):
        if message.topic not in channels:
            name = message.schema
            if name not in schemas:
                schemas[name] = writer.register_schema(name, "jsonschema", foxglove.encoded(name))
            channels[message.topic] = writer.register_channel(message.topic, "json", schemas[name])
        time_ns = message.time_ns
        writer.add_message(
            channels[message.topic], time_ns, encode(message.body).encode(), time_ns, counts[message.topic]
        )
        counts[message.topic] += 1
    start_ns = flight.start_us * 1000
    mission = (flight.folder / MISSION_NAME).read_bytes()
    writer.add_attachment(start_ns, start_ns, MISSION_NAME, "application/toml", mission)
    about = {"name": flight.title, "seed": str(flight.mission.sim.seed), "vehicles": str(len(flight.ids))}
    writer.add_metadata("understory", {"version": __version__, **about})
    writer.finish()
    return counts
