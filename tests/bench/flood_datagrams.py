"""Datagrams that flood a link, drawn: garbage, cut, forged, repeated, and 64 KiB of one byte."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence

from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.framing.frames import DATAGRAM_MAX_BYTES, whole
from companion.mavlink.peers.frame_mac import MAC_BYTES, is_signed
from tests.fuzz.mutations import DATAGRAM_MAX, frame_of

Draw = Callable[[random.Random, Sequence[bytes]], bytes]  # of genuine frames of that link


def frames_of(datagrams: Sequence[bytes]) -> list[bytes]:
    """All that are in them."""
    return [data[start:end] for data in datagrams for start, end, _ in whole(data)]


def as_of(frame: bytes, system: int, number: int) -> bytes:
    """The same message, valid and unsigned, of another sender."""
    header = bytes([0, 0, number & 0xFF, system, frame[6]])
    return frame_of(int.from_bytes(frame[7:10], "little"), frame[10 : 10 + frame[1]], header)


def _filled(rng: random.Random, draw: Callable[[], bytes]) -> bytes:
    """One frame, or as many as there is room for."""
    found = [draw()]
    while rng.random() < 0.99 and sum(map(len, found)) + len(one := draw()) <= DATAGRAM_MAX_BYTES:
        found.append(one)
    return b"".join(found) if rng.random() < 0.5 else found[0]


def _garbage(rng: random.Random, _frames: Sequence[bytes]) -> bytes:
    return rng.randbytes(rng.randint(1, DATAGRAM_MAX_BYTES))


def _truncated(rng: random.Random, frames: Sequence[bytes]) -> bytes:
    def cut() -> bytes:
        frame = rng.choice(frames)
        return frame[: rng.randrange(1, len(frame))]

    return _filled(rng, cut)


def _of_others(rng: random.Random, frames: Sequence[bytes]) -> bytes:
    """Valid, and of vehicles that are not of this swarm: what those of it say is believed where nothing is signed."""
    return _filled(rng, lambda: as_of(rng.choice(frames), rng.randint(3, 250), rng.getrandbits(8)))


def _beacons(frames: Sequence[bytes]) -> list[bytes]:
    return [frame for frame in frames if int.from_bytes(frame[7:10], "little") == swarm_beacon.MESSAGE_ID]


def _unsigned(rng: random.Random, frames: Sequence[bytes]) -> bytes:
    """Valid beacons of a member, without a signature."""
    beacons = _beacons(frames)
    return _filled(rng, lambda: as_of(rng.choice(beacons), 2, rng.getrandbits(8)))


def _wrong_mac(rng: random.Random, frames: Sequence[bytes]) -> bytes:
    """A member's beacons and manifests, valid but for their MAC."""
    signed = [frame for frame in frames if is_signed(frame)]
    return _filled(rng, lambda: rng.choice(signed)[:-MAC_BYTES] + rng.randbytes(MAC_BYTES))


OPEN: Mapping[str, Draw] = {
    "garbage": _garbage,
    "truncated frames": _truncated,
    "valid frames of other vehicles": _of_others,
    "start bytes, 4 KiB": lambda _rng, _frames: b"\xfd" * DATAGRAM_MAX_BYTES,
    "start bytes, 64 KiB": lambda _rng, _frames: b"\xfd" * DATAGRAM_MAX,
    "zeros, 64 KiB": lambda _rng, _frames: bytes(DATAGRAM_MAX),
}
SIGNED: Mapping[str, Draw] = {
    "garbage": _garbage,
    "truncated frames": _truncated,
    "valid beacons of a member, unsigned": _unsigned,
    "valid frames of a member, wrong MAC": _wrong_mac,
    "start bytes, 4 KiB": OPEN["start bytes, 4 KiB"],
    "start bytes, 64 KiB": OPEN["start bytes, 64 KiB"],
    "zeros, 64 KiB": OPEN["zeros, 64 KiB"],
}
FLOODS: Mapping[tuple[str, bool], Mapping[str, Draw]] = {  # by link, and whether the radio is signed
    ("peers", False): OPEN,
    ("peers", True): SIGNED,
    ("autopilot", False): OPEN,
    ("sensor", False): OPEN,
}
