"""The guard of one that only hears: who made a frame, and whether its sender vouches for it.

It cannot ask for an echo of a boot of its own, so what it has never heard live may be a recording: a vehicle's boot
that another one has followed never counts again, and each change of boot is told.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, final

from companion.core.model.beacon import Beacon
from companion.mavlink.peers.belief import without_word
from companion.mavlink.peers.frame_mac import epoch_of, is_signed, mac_holds
from companion.mavlink.peers.guard import ALIVE_S, CHECKS_MAX, CHECKS_S
from companion.mavlink.peers.manifest import Manifest, read_manifest
from companion.mavlink.peers.session import Session
from companion.mavlink.peers.stream import Stream

TOLD_S: Final = 3.0  # a stranger is told for so long after its last frame
PAST_MAX: Final = 64  # boots of one vehicle that are over

UNSIGNED: Final = "sends unsigned frames, which are not shown"
FORGED: Final = "frames in its name that it has not made are on the air, and not shown"
TWICE: Final = "two speak as it, or one of them is a recording: the later is not shown"
OVER: Final = "a recording of it is on the air, which is not shown"
AGAIN: Final = "its companion has started again, or this is a recording"
DISOWNED: Final = "another member speaks in its name"
_GRAVITY: Final = (UNSIGNED, FORGED, OVER, TWICE, DISOWNED, AGAIN)  # the later of these is told, while it is new


@final
class ListeningGuard:
    """Of a fleet's radio. Tables are bounded by the fleet's; of no member nothing is kept but that it was heard."""

    def __init__(self, session: Session) -> None:
        """`session`: of the operator's keyring; nothing is sent with it."""
        self._session = session
        self._streams: dict[int, Stream] = {}
        self._past: dict[int, deque[int]] = {}
        self._checks: dict[int, tuple[float, int]] = {}
        self._proven_s: dict[int, float] = {}  # when what each says was last vouched for, or its boot began
        self._strangers: dict[int, tuple[str, float]] = {}

    def take_manifest(self, frame: bytes, now_s: float) -> bool:
        """A manifest, whatever it is worth; False: the frame is none."""
        found = read_manifest(frame)
        if found is None:
            return False
        sender, (manifest, vouched, signature) = frame[5], found
        key = self._session.keys.get(epoch_of(frame)) if is_signed(frame) else None
        if sender not in self._session.verifiers or key is None or not mac_holds(frame, key):
            self._note_stranger(sender, FORGED, now_s)
        elif self._is_due(sender, manifest, now_s):
            if self._session.verifiers[sender].holds(signature, vouched):
                self._take_manifest_of(sender, manifest, now_s)
            else:
                self._note_stranger(sender, FORGED, now_s)
        return True

    def admits(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bool:
        """True: made by a member in this boot, and new. `named`: by its sender's manifests."""
        sender = frame[5]
        stream = self._streams.get(sender)
        if not is_signed(frame):
            self._note_stranger(sender, UNSIGNED, now_s)
            return False
        if stream is None:  # until its first manifest
            return False
        refusal = stream.refusal(frame, self._session, sender, now_s, named=named)
        if refusal:
            if refusal != "repeated":  # by two ways
                self._note_stranger(sender, FORGED, now_s)
            return False
        stream.take_frame(frame, said, now_s, named=named)
        return True

    def believe(self, said: Beacon, now_s: float) -> Beacon:
        """The part of an admitted beacon that is shown: all of it, or no word that its sender has not vouched for."""
        if not self._streams[said.sender].is_proven(said, now_s):
            return without_word(said)
        self._proven_s[said.sender] = now_s
        return said

    def unproven_s(self, sender: int, now_s: float) -> float:
        """Time since it vouched for what it says."""
        return now_s - self._proven_s.get(sender, now_s)

    def strangers(self, now_s: float) -> dict[int, str]:
        """By system id, what was wrong with frames of late."""
        return {sender: what for sender, (what, at_s) in sorted(self._strangers.items()) if now_s - at_s < TOLD_S}

    def _is_due(self, sender: int, manifest: Manifest, now_s: float) -> bool:
        """The signature is worth its time."""
        stream = self._streams.get(sender)
        if stream is not None and manifest.boot == stream.boot and manifest.last <= stream.vouched:
            return False
        if manifest.boot in self._past.get(sender, ()):
            self._note_stranger(sender, OVER, now_s)
            return False
        since_s, count = self._checks.get(sender, (-math.inf, 0))
        if now_s - since_s >= CHECKS_S:
            since_s, count = now_s, 0
        self._checks[sender] = (since_s, count + 1)
        return count < CHECKS_MAX

    def _take_manifest_of(self, sender: int, manifest: Manifest, now_s: float) -> None:
        """A genuine one, perhaps of an earlier flight."""
        stream = self._streams.get(sender)
        if stream is not None and stream.boot != manifest.boot:
            if now_s - stream.heard_s < ALIVE_S:
                self._note_stranger(sender, TWICE, now_s)
                return
            self._past.setdefault(sender, deque(maxlen=PAST_MAX)).append(stream.boot)
            self._note_stranger(sender, AGAIN, now_s)
            stream = None
        if stream is None:
            stream = self._streams[sender] = Stream(manifest.boot, manifest.last, now_s)
            self._proven_s[sender] = now_s
        if not stream.vouch(manifest, now_s):
            self._note_stranger(sender, DISOWNED, now_s)

    def _note_stranger(self, sender: int, what: str, now_s: float) -> None:
        told, at_s = self._strangers.get(sender, (what, now_s))
        if now_s - at_s >= TOLD_S or _GRAVITY.index(what) >= _GRAVITY.index(told):
            self._strangers[sender] = (what, now_s)
