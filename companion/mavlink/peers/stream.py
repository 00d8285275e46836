"""One boot of one sender: which of its frames are new, and what of them it has vouched for."""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple, final

from companion.core.localisation.peer_reports import TAKEN_BACK
from companion.core.model.beacon import Beacon, Candidate, Lease
from companion.mavlink.peers.frame_mac import UNITS_PER_S, epoch_of, mac_holds, mac_of, timestamp_of
from companion.mavlink.peers.manifest import Manifest
from companion.mavlink.peers.session import Session

AHEAD_S: Final = 3.0  # a sender's clock may be ahead of what its frames showed before: those were late
DRIFT: Final = 0.001  # of two clocks, ten times what crystals have
PROVEN_S: Final = 5.0  # a manifest vouches for so long: at 50 % loss one of them comes in 97 %
CHECKED_S: Final = 3.5  # a signature costs 0.1 ms: of manifests that tell nothing new it is checked so seldom
DISPUTED_S: Final = 3.0  # after a frame that its sender does not vouch for
HEARD_MAX: Final = 64  # frames that wait for their manifest

COUNTS_HZ: Final = 20.0  # of a lease, at most: the fastest that beacons are
COUNTS_SLACK: Final = 20.0  # beyond the count that was vouched for: news of a leader comes by several ways


class Waiting(NamedTuple):
    """A manifest whose signature has not been checked yet."""

    manifest: Manifest
    signed: bytes
    signature: bytes
    heard_s: float


def says_same(one: Beacon, other: Beacon) -> bool:
    """Two beacons of one sender have the same word: what moves a swarm, or takes an alarm back.

    It counts once the sender has vouched for it. Compared in place: it is asked about each beacon that comes.
    """
    return (
        one.phase == other.phase
        and one.stop == other.stop
        and one.done == other.done
        and one.present == other.present
        and one.flown == other.flown
        and _claims_same(one.lease, other.lease)
        and _proposes_same(one.candidate, other.candidate)
        and _taken_back(one) == _taken_back(other)
    )


def _claims_same(one: Lease | None, other: Lease | None) -> bool:
    """Whatever their counts and scores."""
    if one is None or other is None:
        return one is other
    return (
        one.leader == other.leader
        and one.priority == other.priority
        and one.established == other.established
        and one.heir == other.heir
        and one.ends == other.ends
        and one.quorum == other.quorum
    )


def _proposes_same(one: Candidate | None, other: Candidate | None) -> bool:
    if one is None or other is None:
        return one is other
    return one.vehicle == other.vehicle and one.priority == other.priority and one.score == other.score


def _taken_back(said: Beacon) -> int:
    """The vehicle of an alarm that it takes back; 0: of none."""
    sighting = said.sighting
    return sighting.vehicle if sighting is not None and sighting.relays == TAKEN_BACK else 0


@final
class Mark:
    """The newest frame of one kind of a sender: only newer ones count, as far as its clock can be by now."""

    __slots__ = ("_offset_s", "_seen_s", "at")

    def __init__(self, at: int, now_s: float) -> None:
        """`at`: a timestamp. The sender's clock less the own is known by the frame that came soonest: what waits in
        sockets while one stalls shows less.
        """
        self.at = at
        self._offset_s, self._seen_s = at / UNITS_PER_S - now_s, now_s

    def refusal(self, timestamp: int, now_s: float) -> str:
        """The reason not to take a frame of this timestamp; empty: it is new."""
        if timestamp <= self.at:
            return "repeated"
        ahead_s = timestamp / UNITS_PER_S - now_s - self._offset_s
        return "ahead of its sender's clock" if ahead_s > AHEAD_S + DRIFT * (now_s - self._seen_s) else ""

    def move(self, timestamp: int, now_s: float) -> None:
        """To a frame that was taken."""
        self.at = timestamp
        offset_s = timestamp / UNITS_PER_S - now_s
        if offset_s >= self._offset_s - DRIFT * (now_s - self._seen_s):
            self._offset_s, self._seen_s = offset_s, now_s


@final
class Stream:
    """Of one boot of one sender, known to be no recording. Times are the local clock's, s."""

    __slots__ = (
        "_clean_s",
        "_count",
        "_disputed_until_s",
        "_heard",
        "_keys",
        "_latest",
        "_marks",
        "_proven_s",
        "_put_off",
        "_said",
        "boot",
        "heard_s",
        "vouched",
        "waiting",
    )

    def __init__(self, boot: int, mark: int, now_s: float) -> None:
        """`mark`: timestamp of the last frame that its manifest names; only newer ones count."""
        self.boot: Final = boot
        self.heard_s = now_s  # its last frame that was taken
        self.vouched = -1  # `last` of its newest manifest
        self.waiting: Waiting | None = None  # the newest manifest that told nothing new
        # What was signed in such, and the signature: whoever repeats both tells nothing
        self._put_off: dict[tuple[bytes, bytes], None] = {}  # at most HEARD_MAX, the oldest first
        # Of frames that manifests name, and of others: whoever makes one of those in its name silences none of these.
        self._marks = {True: Mark(mark, now_s), False: Mark(mark, now_s)}
        self._keys: dict[int, bytes] = {}  # by epoch
        # Timestamp, MAC; of a beacon, one with the same word, and the count of its lease. To keep each as it came
        # would be a hundred beacons in a swarm of twelve, which the processor's cache holds no longer.
        self._heard: deque[tuple[int, bytes, Beacon | None, int]] = deque(maxlen=HEARD_MAX)
        self._latest: Beacon | None = None
        self._proven_s = -math.inf  # its newest manifest that has told what it says,
        self._clean_s = -math.inf  # and that has named all that was taken in its name
        self._disputed_until_s = -math.inf
        self._said: Beacon | None = None  # the newest that it has vouched for,
        self._count = 0  # and the count of the lease in it

    def refusal(self, frame: bytes, session: Session, sender: int, now_s: float, *, named: bool) -> str:
        """The reason not to take this signed frame; empty: it was made by one of the swarm, in this boot, and is new.

        `named`: as of `take_frame`. The MAC comes first, and nothing is remembered of what it does not hold for.
        """
        epoch = epoch_of(frame)
        known = self._keys.get(epoch)
        key = known or session.stream_key(epoch, sender, self.boot)
        if key is None:
            return "of an unknown epoch"
        if not mac_holds(frame, key):
            return "forged, or of another boot"
        if known is None:
            self._keys[epoch] = key
        return self._marks[named].refusal(timestamp_of(frame), now_s)

    def take_frame(self, frame: bytes, said: Beacon | None, now_s: float, *, named: bool) -> None:
        """A frame that nothing speaks against. `said`: of a beacon; `named`: of a message that manifests name."""
        timestamp = timestamp_of(frame)
        self._marks[named].move(timestamp, now_s)
        self.heard_s = now_s
        if not named:
            return
        count = 0
        if said is not None:
            count = _count_of(said)
            if self._latest is not None and says_same(said, self._latest):
                said = self._latest
            self._latest = said
        self._heard.append((timestamp, mac_of(frame), said, count))

    def is_known(self, manifest: Manifest, now_s: float) -> bool:
        """A manifest whose signature may wait: the last that held is not long ago, and this one would change nothing.

        Nothing is taken of it. Whoever made it: a frame that the sender has not made stays here, and the sender's own
        manifest contradicts it.
        """
        if now_s - self._proven_s > CHECKED_S or now_s < self._disputed_until_s:
            return False
        said, _ = self._newest_said(manifest)
        return self._names_all(manifest) and (said is None or self._has_vouched_for(said))

    def put_off(self, waiting: Waiting) -> None:
        """A manifest that `is_known`: its signature is checked if no newer one comes."""
        while len(self._put_off) >= HEARD_MAX:
            del self._put_off[next(iter(self._put_off))]
        self._put_off[waiting.signed, waiting.signature] = None
        if self.waiting is None or waiting.manifest.last > self.waiting.manifest.last:
            self.waiting = waiting

    def has_heard(self, manifest: Manifest, signed: bytes, signature: bytes) -> bool:
        """A manifest that is not newer than the last that held, or was put off before."""
        return manifest.last <= self.vouched or (signed, signature) in self._put_off

    def vouch(self, manifest: Manifest, now_s: float) -> bool:
        """Its newest manifest. False: somebody else has made frames in its name."""
        self.vouched = last = manifest.last
        if self.waiting is not None and self.waiting.manifest.last <= last:
            self.waiting = None
        clean = self._names_all(manifest)
        said, count = self._newest_said(manifest, named=None if clean else frozenset(manifest.macs))
        if said is not None:
            self._said, self._count = said, count
        if clean or said is not None:
            self._proven_s = now_s
        if clean:
            self._clean_s = now_s
        else:
            # What was taken may be the other's: go on from what the sender itself says that it has sent.
            self._marks[True] = Mark(last, now_s)
            self._disputed_until_s = now_s + DISPUTED_S
        while self._heard and (self._heard[0][0] <= last or not clean):
            self._heard.popleft()
        return clean

    def _names_all(self, manifest: Manifest) -> bool:
        """All that was taken of the time that the manifest speaks of."""
        named, first, last = frozenset(manifest.macs), manifest.first, manifest.last
        for at, mac, _, _ in reversed(self._heard):  # in their order: only newer ones are taken
            if at < first:
                return True
            if at <= last and mac not in named:
                return False
        return True

    def _newest_said(self, manifest: Manifest, named: frozenset[bytes] | None = None) -> tuple[Beacon | None, int]:
        """The word of the last beacon of that time, as far as it was taken, and the count of its lease.

        `named`: MACs, of which it has one; None: whichever it has.
        """
        for at, mac, said, count in reversed(self._heard):
            if said is not None and manifest.first <= at <= manifest.last and (named is None or mac in named):
                return said, count
        return None, 0

    def is_proven(self, said: Beacon, now_s: float) -> bool:
        """The sender vouches for its frames and has vouched for this word, and its leader's count is not far ahead.

        Whoever else sent it, while somebody speaks in its name: see `is_vouched`.
        """
        age_s = now_s - self._proven_s
        if age_s > PROVEN_S or not self._has_vouched_for(said):
            return False
        return _count_of(said) <= self._count + COUNTS_SLACK + COUNTS_HZ * age_s

    def is_vouched(self, now_s: float) -> bool:
        """It has vouched of late for all that was taken in its name, and nobody else speaks in it."""
        return now_s - self._clean_s <= PROVEN_S and now_s >= self._disputed_until_s

    def _has_vouched_for(self, said: Beacon) -> bool:
        """It has this beacon's word in one that it has vouched for."""
        return self._said is not None and says_same(said, self._said)


def _count_of(said: Beacon) -> int:
    return 0 if said.lease is None else said.lease.seq
