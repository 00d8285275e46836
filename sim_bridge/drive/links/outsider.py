"""A radio without keys: it repeats what it hears, changes it, and makes up frames in others' names."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Final

import numpy as np

from companion.mavlink import dialect
from companion.mavlink.beacon import COMPONENT, beacons
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import SIGNATURE_BYTES, source, whole
from companion.mavlink.peers.frame_mac import TIMESTAMP_MAX, is_signed, timestamp_of
from mission.common.frames import Vec3
from mission.document.model import Mission
from mission.schema.kinds import Lie
from sim_bridge.drive.links.insider import Insider
from sim_bridge.world.radio import Radio

OUTSIDER_ID: Final = 252  # of its radio in the air; its frames bear others' names
SALT: Final = 0x0D51DE
REMEMBERED: Final = 512  # frames that it can send again
FRAMES_MAX: Final = 6  # of one tick
LIES: Final = tuple(lie for lie in Lie if lie not in (Lie.RANGES, Lie.TRUNKS))  # that a beacon tells


class Outsider:
    """A `RadioNode` beside a vehicle, in the range of all that it may be heard by. Draws from the mission's seed."""

    def __init__(self, mission: Mission, radio: Radio) -> None:
        """`radio`: the air, where it is told that its range has no limit."""
        self.beside = 0  # the vehicle; 0: it is silent
        self._mission, self._radio = mission, radio
        self._rng = np.random.default_rng([mission.sim.seed, SALT])
        self._heard: deque[bytes] = deque(maxlen=REMEMBERED)
        self._frames = int(self._rng.integers(1, FRAMES_MAX, endpoint=True))
        self._forgers: dict[int, Insider] = {}  # by the id in whose name
        self._place: Vec3 = (0.0, 0.0, 0.0)
        radio.set_range(OUTSIDER_ID, math.inf)

    @property
    def id(self) -> int:
        """Its system id in the air."""
        return OUTSIDER_ID

    @property
    def pos_ned_m(self) -> Vec3:
        """Position of the vehicle that it is beside, a tick ago; its own last one, when it is silent."""
        self._place = self._radio.positions.get(self.beside, self._place)
        return self._place

    def receive(self, data: bytes, now_s: float) -> None:  # noqa: ARG002
        """Keeps the frames that it hears."""
        for start, end, _ in whole(data):
            self._heard.append(data[start:end])

    def tick(self, now_s: float) -> list[bytes]:
        """Frames that it sends now."""
        if not self.beside or not self._heard:
            return []
        return [self._frame(now_s) for _ in range(self._frames)]

    def _frame(self, now_s: float) -> bytes:
        heard = self._heard[int(self._rng.integers(len(self._heard)))]
        what = self._rng.random()
        if what < 0.3:
            return heard
        if what < 0.6:
            return self._signed_anyhow(self._changed(heard), heard)
        return self._signed_anyhow(self._made_up(heard, now_s, self._radio.positions), heard)

    def _changed(self, heard: bytes) -> bytes:
        """Its payload with one byte that is another, and a checksum that is right; without a signature."""
        payload = bytearray(heard[wire.HEADER_BYTES : wire.HEADER_BYTES + heard[1]])
        payload[int(self._rng.integers(len(payload)))] ^= int(self._rng.integers(1, 256))
        return _framed(heard, bytes(payload))

    def _made_up(self, heard: bytes, now_s: float, places_ned_m: Mapping[int, Vec3]) -> bytes:
        """A beacon in the name of whose it was, with a lie; what is no beacon, changed."""
        for sender, _, fields in beacons(heard):
            forger = self._forgers.get(sender)
            if forger is None:
                lie = LIES[int(self._rng.integers(len(LIES)))]
                forger = self._forgers[sender] = Insider(self._mission, sender, lie)
            lying = forger.rewrite_beacon(heard, fields, now_s, places_ned_m)
            return _framed(heard, lying[wire.HEADER_BYTES : wire.HEADER_BYTES + lying[1]])
        return self._changed(heard)

    def _signed_anyhow(self, frame: bytes, heard: bytes) -> bytes:
        """Behind one that must be signed: the link id of the frame that was heard, a later time, a drawn MAC."""
        if not is_signed(frame):
            return frame
        later = int(self._rng.choice([1, 10_000, 5_000_000, TIMESTAMP_MAX]))
        timestamp = min(timestamp_of(heard) + later, TIMESTAMP_MAX)
        return (
            frame + heard[-SIGNATURE_BYTES : 1 - SIGNATURE_BYTES] + timestamp.to_bytes(6, "little") + self._rng.bytes(6)
        )


def _framed(heard: bytes, payload: bytes) -> bytes:
    """The frame of another payload with the same header, but for its count: without its signature."""
    message_id = heard[7] | heard[8] << 8 | heard[9] << 16
    if message_id not in dialect.mavlink_map:
        return heard[: wire.HEADER_BYTES + heard[1] + wire.CRC_BYTES]
    system, component = source(heard)
    return wire.frame(
        message_id, payload, seq=heard[4] + 1 & 0xFF, system=system, component=component or COMPONENT, flags=heard[2]
    )
