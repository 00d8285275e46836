"""Equivocation: a member vouches to some for what it denies to others. Two of its manifests prove it to anybody.

A manifest says that from its first frame to its last its sender sent those named, and no others. Two of one boot that
disagree about a time of which both speak bear the sender's own signature: no third one can have made them. They are
passed on as they came, so that each receiver finds the contradiction by itself.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Final, NamedTuple, final

from companion.keys.crypto import Verifier
from companion.mavlink.peers.manifest import Manifest

KEPT_MAX: Final = 6  # manifests of one sender, of the last seconds: two of one time come within a second or so
TRIED_MAX: Final = 2  # contradictions of one sender that are looked into in TRIED_S: two signatures cost 0.2 ms
TRIED_S: Final = 1.0


class SignedManifest(NamedTuple):
    """A manifest as it came, of which the signature may not hold."""

    manifest: Manifest
    signed: bytes
    signature: bytes
    frame: bytes


def contradict(one: Manifest, other: Manifest) -> bool:
    """One sender's: they cannot both be true."""
    if one.boot != other.boot:
        return False
    if one.last == other.last:  # a count that is used once
        return one != other
    earlier, later = (one, other) if (one.first, one.last) <= (other.first, other.last) else (other, one)
    if not earlier.macs or not later.macs or later.first > earlier.last:
        return False
    named = list(earlier.macs)
    if later.macs[0] not in named:  # the frame of its first timestamp
        return True
    shared = named[named.index(later.macs[0]) :]
    count = len(shared) if later.last > earlier.last else len(later.macs)
    return shared[:count] != list(later.macs[:count])


@final
class Witness:
    """Keeps each member's last manifests, and finds two that contradict each other. Bounded by the fleet's size."""

    def __init__(self, verifiers: Mapping[int, Verifier]) -> None:
        """`verifiers`: by system id."""
        self._verifiers = verifiers
        self._kept: dict[int, deque[SignedManifest]] = {}
        self._tried: dict[int, tuple[float, int]] = {}  # by sender: since when, how many
        self._proven: set[int] = set()
        self._liars: list[int] = []
        self._proofs: list[bytes] = []

    def take_manifest(self, sender: int, heard: SignedManifest, now_s: float) -> None:
        """A manifest of a member, under the group's key, of the boot that was met."""
        if sender in self._proven:
            return
        kept = self._kept.setdefault(sender, deque(maxlen=KEPT_MAX))
        if heard.signed in [one.signed for one in kept]:
            return
        for other in [one for one in kept if contradict(one.manifest, heard.manifest)]:
            if not self._may_try(sender, now_s):
                break
            if not self._holds(sender, other):
                kept.remove(other)
                continue
            if not self._holds(sender, heard):
                return
            self._proven.add(sender)
            self._liars.append(sender)
            self._proofs += [other.frame, heard.frame]
            return
        kept.append(heard)

    def take_liars(self) -> list[int]:
        """Members that are proven to equivocate, since last asked."""
        liars, self._liars = self._liars, []
        return liars

    def take_proofs(self) -> list[bytes]:
        """Frames of theirs that prove it, to be sent once more as they came."""
        proofs, self._proofs = self._proofs, []
        return proofs

    def _may_try(self, sender: int, now_s: float) -> bool:
        since_s, count = self._tried.get(sender, (-math.inf, 0))
        if now_s - since_s >= TRIED_S:
            since_s, count = now_s, 0
        self._tried[sender] = (since_s, count + 1)
        return count < TRIED_MAX

    def _holds(self, sender: int, one: SignedManifest) -> bool:
        return self._verifiers[sender].holds(one.signature, one.signed)
