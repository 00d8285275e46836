"""SWARM_MANIFEST: once a second a sender vouches, with its own key, for this boot of it and for its last frames.

The group's MAC says that one of the swarm made a frame; the manifest says which (the idea of RFC 9575). It names frames
by their MACs, of which each is already 48 bits of a keyed hash, and echoes the boots that its sender has heard: who
finds its own among them knows that this manifest is no recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from struct import Struct
from typing import Final

from companion.keys.crypto import SIGNATURE_BYTES, Signer
from companion.mavlink import dialect
from companion.mavlink.framing.frames import payload_of
from companion.mavlink.peers.frame_mac import MAC_BYTES
from companion.mavlink.schema.tables.signing import ECHOES_MAX, MACS_MAX, MANIFEST

MANIFEST_ID: Final = dialect.MAVLINK_MSG_ID_SWARM_MANIFEST
DOMAIN: Final = b"understory manifest 1"  # a signature of one kind of message is none of another
_PAYLOAD: Final = Struct("<" + "".join(row.code for row in MANIFEST.on_wire))
_ECHO: Final = Struct("<BI")
_MACS: Final = Struct(f"{MAC_BYTES}s" * MACS_MAX)
_NO_MAC: Final = bytes(MAC_BYTES)
_ID_BYTES: Final = MANIFEST_ID.to_bytes(3, "little")
_CRC_EXTRA: Final = bytes([dialect.MAVLink_swarm_manifest_message.crc_extra])


@dataclass(slots=True, init=False, unsafe_hash=True)
class Manifest:
    """The boot and the frames that a sender vouches for."""

    boot: Final[int]  # of the sender
    first: Final[int]  # timestamp of the first frame that is named
    last: Final[int]  # of the last: between them it sent those named, and no other
    macs: Final[Sequence[bytes]]  # of these frames, in their order; at most MACS_MAX
    echoes: Final[Sequence[tuple[int, int]]]  # boots that it has heard: system id, boot; at most ECHOES_MAX

    def __init__(
        self, boot: int, first: int, last: int, macs: Sequence[bytes], echoes: Sequence[tuple[int, int]]
    ) -> None:
        self.boot = boot
        self.first = first
        self.last = last
        self.macs = macs
        self.echoes = echoes


def encode_manifest(manifest: Manifest, sender: int, signer: Signer) -> bytes:
    """The payload of SWARM_MANIFEST."""
    echoes = b"".join(_ECHO.pack(*echo) for echo in manifest.echoes[:ECHOES_MAX])
    macs = b"".join(manifest.macs[:MACS_MAX])
    packed = _PAYLOAD.pack(
        manifest.last, manifest.boot, manifest.last - manifest.first, echoes, macs, bytes(SIGNATURE_BYTES)
    )
    signed = packed[:-SIGNATURE_BYTES]
    return signed + signer.sign(_vouched(sender, signed))


def manifest_payload(frame: bytes) -> bytes | None:
    """A whole SWARM_MANIFEST frame whose checksum holds -> its payload, of which nothing is read; None: it is none."""
    return payload_of(frame, _ID_BYTES, _CRC_EXTRA, _PAYLOAD.size)


def read_manifest(frame: bytes) -> tuple[Manifest, bytes, bytes] | None:
    """A whole SWARM_MANIFEST frame -> what it says, what is signed of it, and the signature, as yet unchecked.

    None: it is none, its checksum is wrong, or it makes no sense.
    """
    payload = manifest_payload(frame)
    return None if payload is None else read_payload(frame[5], payload)


def read_payload(sender: int, payload: bytes) -> tuple[Manifest, bytes, bytes] | None:
    """As `read_manifest`, of a payload that `manifest_payload` has found. `sender`: system id."""
    last, boot, span, echoes, macs, signature = _PAYLOAD.unpack(payload)
    if boot == 0 or span > last:
        return None
    named: tuple[bytes, ...] = _MACS.unpack(macs)
    if _NO_MAC in named:
        named = tuple([mac for mac in named if mac != _NO_MAC])
    heard = tuple([echo for echo in _ECHO.iter_unpack(echoes) if echo[0]])
    manifest = Manifest(boot, last - span, last, named, heard)
    return manifest, _vouched(sender, payload[:-SIGNATURE_BYTES]), signature


def _vouched(sender: int, payload: bytes) -> bytes:
    return DOMAIN + bytes([sender]) + payload
