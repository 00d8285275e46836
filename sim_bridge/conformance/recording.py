"""A flight recorded from an autopilot: what the client sent, what it heard, each at the autopilot's own time."""

from __future__ import annotations

import lzma
import struct
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from companion.mavlink import dialect as mav
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import find_frame, source
from mission.document.model import Personality

AUTOPILOT = (1, 1)  # system and component of every recorded one
PERSONALITIES = {  # by HEARTBEAT.autopilot
    mav.MAV_AUTOPILOT_PX4: Personality.PX4,
    mav.MAV_AUTOPILOT_ARDUPILOTMEGA: Personality.ARDUPILOT,
}
ANCHOR_S = 1.0  # one pair of clocks each second: the recorded simulators lag up to 1.4 % behind real time
_STAMP = struct.Struct(">Q")


class RecordingError(ValueError):
    """A file that is no recorded flight; the text names it."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame on the wire. `at_s`: since the autopilot's boot, by its own clock."""

    at_s: float
    id: int
    system: int
    component: int
    data: bytes
    message: Any  # None: of a message that our dialect does not have


@dataclass(frozen=True, slots=True)
class Recording:
    """One flight, in order of time."""

    name: str
    personality: Personality
    sent: tuple[Frame, ...]  # by the client
    heard: tuple[Frame, ...]  # from the autopilot

    @property
    def end_s(self) -> float:
        """The last frame, in seconds since boot."""
        return max(frames[-1].at_s for frames in (self.sent, self.heard) if frames)


def load(path: Path) -> Recording:
    """A telemetry log, xz or plain. RecordingError when it is none, OSError when it cannot be read."""
    try:
        data = lzma.decompress(path.read_bytes()) if path.suffix == ".xz" else path.read_bytes()
        stamped = [(stamp, frame_of(frame)) for stamp, frame in _split(data)]
    except (lzma.LZMAError, struct.error, mav.MAVError) as error:
        raise RecordingError(f"{path}: not a telemetry log: {error}") from error
    ours = [(stamp, frame) for stamp, frame in stamped if (frame.system, frame.component) == AUTOPILOT]
    clock = _Clock(ours)
    timed = [_at(frame, clock.boot_s(stamp)) for stamp, frame in stamped]
    heard = tuple(frame for frame in timed if (frame.system, frame.component) == AUTOPILOT)
    sent = tuple(frame for frame in timed if (frame.system, frame.component) != AUTOPILOT)
    heartbeat = next((frame.message for frame in heard if frame.id == mav.MAVLINK_MSG_ID_HEARTBEAT), None)
    if heartbeat is None or heartbeat.autopilot not in PERSONALITIES or not sent:
        raise RecordingError(f"{path}: no PX4 or ArduPilot as {AUTOPILOT[0]}/{AUTOPILOT[1]}, or no client")
    return Recording(
        path.name.removesuffix(".xz").removesuffix(".tlog"), PERSONALITIES[heartbeat.autopilot], sent, heard
    )


def frame_of(data: bytes, at_s: float = 0.0) -> Frame:
    """A frame that is whole. MAVError when its checksum does not hold."""
    _, _, message_id = find_frame(data)
    message = wire.decode(data) if message_id in mav.mavlink_map else None
    system, component = source(data)
    return Frame(at_s, message_id, system, component, data, message)


def _at(frame: Frame, at_s: float) -> Frame:
    return Frame(at_s, frame.id, frame.system, frame.component, frame.data, frame.message)


def _split(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Microseconds of the log's clock, and the frame. struct.error where the log is cut."""
    at = 0
    while at < len(data):
        (stamp,) = _STAMP.unpack_from(data, at)
        at += _STAMP.size
        start, end, _ = find_frame(data, at)
        if start != at or end > len(data):
            raise struct.error(f"no frame at byte {at}")
        yield stamp, data[start:end]
        at = end


class _Clock:
    """From the log's clock to the autopilot's: straight between the promptest stamps of each second."""

    def __init__(self, stamped: Sequence[tuple[int, Frame]]) -> None:
        best: dict[int, tuple[float, float]] = {}
        for stamp, frame in stamped:
            boot_ms = getattr(frame.message, "time_boot_ms", 0)
            if not boot_ms:
                continue
            log_s, boot_s = stamp / 1e6, boot_ms / 1e3
            slot = int(log_s / ANCHOR_S)
            if slot not in best or log_s - boot_s < best[slot][0] - best[slot][1]:
                best[slot] = (log_s, boot_s)
        pairs = sorted(best.values())
        if not pairs:
            raise RecordingError("no message with time_boot_ms")
        self._log_s = [log_s for log_s, _ in pairs]
        self._boot_s = [boot_s for _, boot_s in pairs]

    def boot_s(self, stamp: int) -> float:
        """Seconds since boot; before the first and after the last pair the clocks run alike."""
        log_s = stamp / 1e6
        index = bisect_right(self._log_s, log_s)
        if index == 0:
            return self._boot_s[0] + log_s - self._log_s[0]
        low_log, low_boot = self._log_s[index - 1], self._boot_s[index - 1]
        if index == len(self._log_s):
            return low_boot + log_s - low_log
        share = (log_s - low_log) / (self._log_s[index] - low_log)
        return low_boot + share * (self._boot_s[index] - low_boot)
