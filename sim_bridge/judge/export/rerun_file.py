"""One Rerun recording (.rrd) of a flight: the messages of its MCAP file, as Rerun's archetypes, by the rerun-sdk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import rerun as rr

from sim_bridge.judge.export import foxglove
from sim_bridge.judge.export.flown import Flown
from sim_bridge.judge.export.messages import Message, messages

TIMELINE: Final = "flight"  # Unix time
LEVELS: Final = ("TRACE", "DEBUG", "INFO", "WARN", "ERROR", "CRITICAL")  # by foxglove.LogLevel
Log = Callable[..., None]


def recorded(flight: Flown) -> tuple[bytes, int]:
    """The file's bytes, and how many of the flight's messages are in it.

    Scans are left to the MCAP file.
    """
    stream = rr.RecordingStream("understory")
    out = stream.binary_stream()
    stream.send_recording_name(flight.title)
    count = 0
    for message in sorted(messages(flight), key=lambda message: message.time_ns):
        draw = _DRAWN.get(message.schema)
        if draw is not None:
            stream.set_time(TIMELINE, timestamp=message.time_ns / 1e9)
            draw(message, stream.log)
            count += 1
    packed = out.read()
    if packed is None:
        raise OSError("rerun-sdk did not give the recording")
    return packed, count


def _poses(message: Message, log: Log) -> None:
    for transform in message.body["transforms"]:
        turn = rr.Quaternion(xyzw=[transform["rotation"][axis] for axis in "xyzw"])
        pose = rr.Transform3D(translation=_point(transform["translation"]), quaternion=turn)
        log(f"map/{transform['child_frame_id']}", pose)


def _scene(message: Message, log: Log) -> None:
    """Trunks and crowns, places, links, setpoints, vehicles: what does not change, once."""
    still = message.topic == "/forest"
    for entity in message.body["entities"]:
        path = f"map/{entity['id']}"
        cylinders, texts, spheres = entity["cylinders"], entity["texts"], entity["spheres"]
        if cylinders:
            drawn = rr.Cylinders3D(
                centers=[_point(one["pose"]["position"]) for one in cylinders],
                lengths=[one["size"]["z"] for one in cylinders],
                radii=[one["size"]["x"] / 2.0 for one in cylinders],
                colors=[_color(one) for one in cylinders],
            )
            log(path, drawn, static=still)
        if texts:
            where = [_point(one["pose"]["position"]) for one in texts]
            log(f"{path}/places", rr.Points3D(where, labels=[one["text"] for one in texts], radii=0.2), static=still)
        if spheres:
            drawn = rr.Points3D(
                [_point(one["pose"]["position"]) for one in spheres],
                radii=[one["size"]["x"] / 2.0 for one in spheres],
                colors=[_color(one) for one in spheres],
                labels=[str(number) for number in range(1, len(spheres) + 1)],
            )
            log(f"{path}/vehicles", drawn)
        for number, lines in enumerate(entity["lines"]):
            points = [_point(point) for point in lines["points"]]
            # Foxglove's type 1 is a ring, 2 a line between each two points
            ring = [[*points, points[0]]] if points else []
            strips = ring if lines["type"] == 1 else [points[k : k + 2] for k in range(0, len(points), 2)]
            log(f"{path}/lines_{number}", rr.LineStrips3D(strips, colors=[_color(lines)] * len(strips)), static=still)


def _state(message: Message, log: Log) -> None:
    log("swarm/leader", rr.Scalars(message.body["leader"]))
    log("swarm/links", rr.Scalars(message.body["links"]))


def _fix(message: Message, log: Log) -> None:
    lat_lon_deg = [message.body["latitude"], message.body["longitude"]]
    log(message.topic.removeprefix("/"), rr.GeoPoints(lat_lon=[lat_lon_deg]))


def _text(message: Message, log: Log) -> None:
    body = message.body
    log("log", rr.TextLog(f"{body['name']}: {body['message']}", level=LEVELS[body["level"]]))


def _point(vector: dict[str, float]) -> list[float]:
    return [vector[axis] for axis in "xyz"]


def _color(primitive: dict[str, Any]) -> list[int]:
    return [round(255 * primitive["color"][channel]) for channel in "rgba"]


_DRAWN: Final[dict[str, Callable[[Message, Log], None]]] = {
    foxglove.TF: _poses,
    foxglove.SCENE: _scene,
    foxglove.SWARM: _state,
    foxglove.FIX: _fix,
    foxglove.LOG: _text,
}
