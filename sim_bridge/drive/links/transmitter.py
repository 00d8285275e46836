"""The companions' way on to the air: each beacon is decoded once, here; the radio only carries bytes.

What goes with a beacon in a swarm that flies by ranges (SWARM_RELATIVE) comes in one datagram with it, and so it goes
on the air: both arrive together or not at all, and so does the manifest behind a beacon of a signed swarm. Orders,
trunks and records go on the air frame by frame, after the beacons.
"""

from __future__ import annotations

from companion.core.model.beacon import RelativeReport
from companion.mavlink.beacon import COMPONENT, WireBeacon, beacons
from companion.mavlink.framing.frames import source
from companion.mavlink.orders.order import order_payload
from companion.mavlink.peers import manifest as manifests
from companion.mavlink.relative import is_trunk_report, read_relative_report
from companion.records.frames import is_record_frame, read_record, read_vector
from companion.records.signed.messages import read_base_vector, read_signed_record
from sim_bridge.drive.links.insider import Insiders
from sim_bridge.world.radio import Radio


class Transmitter:
    """Hands the companions' beacons to the radio, and keeps what they say.

    Each radio is set to the range that its companion announces. What an insider's companion says is kept as it says it,
    and goes on the air rewritten.
    """

    def __init__(self, radio: Radio, insiders: Insiders | None = None) -> None:
        self.said: dict[int, WireBeacon] = {}  # by id: the last valid beacon of each companion
        self.said_s: dict[int, float] = {}  # by id: when that was sent
        self.words: dict[int, RelativeReport] = {}  # by id: the last that went with one
        self.refused = 0  # beacons in another's name
        self._radio = radio
        self._insiders = insiders

    def send(self, sender: int, data: bytes, now_s: float) -> tuple[bytes, ...]:
        """A datagram from `sender`'s own socket; returns the valid beacons in it. KeyError: its radio has no place."""
        sent = []
        found = _Found()
        insiders = self._insiders
        each = beacons(data, found.take_frame)
        beside, proofs = b"", self._frames_of(sender, found.proofs)
        for frame, word in found.words:
            if source(frame) == (sender, COMPONENT):
                self.words[sender] = word
                beside += frame if insiders is None else insiders.rewrite_report(sender, frame, word, now_s)
            else:
                self.refused += 1
        for system, frame, beacon in each:
            if system != sender:
                self.refused += 1
                continue
            self.said[sender], self.said_s[sender] = beacon, now_s
            self._radio.set_range(sender, beacon.range_dm / 10.0)
            told = frame
            if insiders is not None:
                told = insiders.rewrite_beacon(sender, frame, beacon, now_s, self._radio.positions)
            self._radio.send(sender, beside + told + self._proof(sender, proofs), now_s)
            beside, proofs = b"", []
            sent.append(frame)
        trunks = self._frames_of(sender, found.trunks)
        if insiders is not None:
            trunks = [insiders.rewrite_trunks(sender, frame, now_s) for frame in trunks]
        for frame in (
            self._proof(sender, proofs),
            *self._frames_of(sender, found.orders),
            *trunks,
            *self._frames_of(sender, found.records),
        ):
            if frame:
                self._radio.send(sender, frame, now_s, aside=True)
        return tuple(sent)

    def _proof(self, sender: int, frames: list[bytes]) -> bytes:
        """Manifests as they are sent, once what they name is."""
        if self._insiders is not None:
            frames = [self._insiders.rewrite_proof(sender, frame) for frame in frames]
        return b"".join(frames)

    def _frames_of(self, sender: int, frames: list[bytes]) -> list[bytes]:
        own = [frame for frame in frames if source(frame) == (sender, COMPONENT)]
        self.refused += len(frames) - len(own)
        return own


class _Found:
    """The frames of a datagram besides beacons."""

    def __init__(self) -> None:
        self.words: list[tuple[bytes, RelativeReport]] = []
        self.orders: list[bytes] = []
        self.trunks: list[bytes] = []
        self.records: list[bytes] = []
        self.proofs: list[bytes] = []

    def take_frame(self, frame: bytes) -> bool:
        """True: a valid frame of one of these."""
        if is_record_frame(frame):
            is_valid = _is_record(frame)
            if is_valid:
                self.records.append(frame)
            return is_valid
        if order_payload(frame) is not None:
            self.orders.append(frame)
            return True
        if manifests.read_manifest(frame) is not None:
            self.proofs.append(frame)
            return True
        if is_trunk_report(frame):
            self.trunks.append(frame)
            return True
        word = read_relative_report(frame)
        if word is not None:
            self.words.append((frame, word))
        return word is not None


def _is_record(frame: bytes) -> bool:
    """A valid frame of records: one, or what somebody has."""
    if read_record(frame) is not None or read_signed_record(frame) is not None:
        return True
    return read_vector(frame) is not None or read_base_vector(frame) is not None
