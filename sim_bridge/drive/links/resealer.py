"""Signs an insider's frames anew: it has its own keys, and names in its manifests what it really sent."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from typing import Final

from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import SIGNED
from companion.mavlink.peers.frame_mac import is_signed, mac_of, seal, timestamp_of
from companion.mavlink.peers.manifest import MANIFEST_ID, encode_manifest, read_manifest
from companion.mavlink.peers.session import Session
from companion.mavlink.schema.tables.signing import MACS_MAX

REMEMBERED: Final = 4 * MACS_MAX  # frames: more than a manifest names


class Resealer:
    """Of one start of one vehicle's companion, in a signed swarm."""

    def __init__(self, session: Session) -> None:
        self.session: Final = session
        self._key: Final = session.stream_key(session.active, session.me, session.boot) or b""
        self._macs: OrderedDict[bytes, bytes] = OrderedDict()  # of the frame that was signed -> of what was sent

    def reseal(self, frame: bytes, lie: bytes) -> bytes:
        """The lie in the place of `frame`, with its signature. `lie`: the same frame, rewritten, without one."""
        if not is_signed(frame):
            return lie
        payload, message_id = lie[wire.HEADER_BYTES : wire.HEADER_BYTES + lie[1]], lie[7] | lie[8] << 8 | lie[9] << 16
        flagged = wire.frame(message_id, payload, seq=lie[4], system=self.session.me, component=COMPONENT, flags=SIGNED)
        sealed = seal(flagged, self._key, self.session.active, timestamp_of(frame))
        self._macs[mac_of(frame)] = mac_of(sealed)
        while len(self._macs) > REMEMBERED:
            self._macs.popitem(last=False)
        return sealed

    def reprove(self, frame: bytes) -> bytes:
        """A manifest that names the frames as they were sent; the same where it named no other."""
        found = read_manifest(frame)
        if found is None:
            return frame
        manifest, session = found[0], self.session
        macs = tuple(self._macs.get(mac, mac) for mac in manifest.macs)
        if macs == manifest.macs:
            return frame
        payload = encode_manifest(replace(manifest, macs=macs), session.me, session.signer)
        framed = wire.frame(MANIFEST_ID, payload, seq=frame[4], system=session.me, component=COMPONENT, flags=SIGNED)
        return seal(framed, session.keys[session.active], session.active, timestamp_of(frame))
