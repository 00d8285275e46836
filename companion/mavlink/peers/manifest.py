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
_ID_BYTES: Final = MANIFEST_ID.to_bytes(3, "little")
_CRC_EXTRA: Final = bytes([dialect.MAVLink_swarm_manifest_message.crc_extra])


@dataclass(frozen=True, slots=True)
class Manifest:
    """The boot and the frames that a sender vouches for."""

    boot: int  # of the sender
    first: int  # timestamp of the first frame that is named
    last: int  # of the last: between them it sent those named, and no other
    macs: Sequence[bytes]  # of these frames, in their order; at most MACS_MAX
    echoes: Sequence[tuple[int, int]]  # boots that it has heard: system id, boot; at most ECHOES_MAX


def encode_manifest(manifest: Manifest, sender: int, signer: Signer) -> bytes:
    """The payload of SWARM_MANIFEST."""
    echoes = b"".join(_ECHO.pack(*echo) for echo in manifest.echoes[:ECHOES_MAX])
    macs = b"".join(manifest.macs[:MACS_MAX])
    packed = _PAYLOAD.pack(
        manifest.last, manifest.boot, manifest.last - manifest.first, echoes, macs, bytes(SIGNATURE_BYTES)
    )
    signed = packed[:-SIGNATURE_BYTES]
    return signed + signer.sign(_vouched(sender, signed))


def is_manifest(frame: bytes) -> bool:
    """A whole SWARM_MANIFEST frame whose checksum holds; nothing of it is read."""
    return _payload(frame) is not None


def read_manifest(frame: bytes) -> tuple[Manifest, bytes, bytes] | None:
    """A whole SWARM_MANIFEST frame -> what it says, what is signed of it, and the signature, as yet unchecked.

    None: it is none, its checksum is wrong, or it makes no sense.
    """
    payload = _payload(frame)
    if payload is None:
        return None
    last, boot, span, echoes, macs, signature = _PAYLOAD.unpack(payload)
    if boot == 0 or span > last:
        return None
    named = [macs[at : at + MAC_BYTES] for at in range(0, len(macs), MAC_BYTES)]
    manifest = Manifest(
        boot,
        last - span,
        last,
        tuple(mac for mac in named if mac != bytes(MAC_BYTES)),
        tuple((sender, heard) for sender, heard in _ECHO.iter_unpack(echoes) if sender),
    )
    return manifest, _vouched(frame[5], payload[:-SIGNATURE_BYTES]), signature


def _payload(frame: bytes) -> bytes | None:
    return payload_of(frame, _ID_BYTES, _CRC_EXTRA, _PAYLOAD.size)


def _vouched(sender: int, payload: bytes) -> bytes:
    return DOMAIN + bytes([sender]) + payload
