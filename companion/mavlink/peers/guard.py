"""The guard of the swarm's radio: what of it may be acted on, and how far. Signed, or open."""

from __future__ import annotations

import math
from collections import Counter, deque
from typing import Final, Protocol, final

from companion.core.model.actions import Say
from companion.core.model.beacon import Beacon
from companion.core.model.states import Severity
from companion.mavlink.beacon import Decoded
from companion.mavlink.framing.frames import SIGNED
from companion.mavlink.peers import manifest as manifests
from companion.mavlink.peers.belief import limit_belief
from companion.mavlink.peers.equivocation import SignedManifest, Witness
from companion.mavlink.peers.frame_mac import (
    TIMESTAMP_MAX,
    UNITS_PER_S,
    epoch_of,
    is_signed,
    mac_holds,
    mac_of,
    seal,
)
from companion.mavlink.peers.manifest import MANIFEST_ID, Manifest
from companion.mavlink.peers.session import Session, name_of, twin_of
from companion.mavlink.peers.stream import Stream, Waiting, says_same
from companion.mavlink.schema.tables.signing import ECHOES_MAX, MACS_MAX

MANIFEST_S: Final = 1.0
NEWS_S: Final = 0.35  # a manifest goes with each beacon for so long after news: three beacons
MEETING_S: Final = 1.0  # and after a boot that was not heard before
ALIVE_S: Final = 1.0  # a sender that was heard within it has not begun anew: another boot is another vehicle
PAST_MAX: Final = 64  # boots of one sender that are over
CHECKS_MAX: Final = 16  # manifests of one sender that are checked in CHECKS_S: an Ed25519 signature costs 0.1 ms
CHECKS_S: Final = 1.0
MEETING_PERIOD_S: Final = 0.1  # of manifests of one that has no beacon to send yet
TOLD_S: Final = 10.0  # between two words of the same kind


class Guard(Protocol):
    """Decides on each valid frame of the peers' link, before anything else remembers of its sender."""

    flags: int  # incompatibility flags of the frames that are sent
    cloned: bool  # another companion flies as this vehicle
    refused: Counter[str]  # frames, by reason

    def passes(self, frame: bytes, now_s: float) -> bool:
        """True: this valid frame was sent by one of the swarm, now. Asked before it is decoded: see `take_admitted`."""

    def take_admitted(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> None:
        """A frame that has passed. `said`: of a beacon; `named`: by its sender's manifests."""

    def admits(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bool:
        """`passes`, and then `take_admitted`."""

    def take_proof(self, frame: bytes, now_s: float) -> bool:
        """A frame that proves itself; False: it is none."""

    def holds_mac(self, frame: bytes) -> bool:
        """The frame of a message that proves itself was sealed by one of the swarm, in this flight or an earlier."""

    def boots(self) -> dict[int, int]:
        """The boot of each sender that has proven it."""

    def believe(self, decoded: Decoded, sender: int, now_s: float) -> Decoded:
        """The part of an admitted beacon that counts: all of it, or what slows alone."""

    def seal(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bytes:
        """A frame as it is sent. `said`: of a beacon; `named`: by the next manifest."""

    def proof(self, now_s: float) -> tuple[int, bytes] | None:
        """A message to send behind this tick's beacon: id and payload; None: not now."""

    def seal_proof(self, frame: bytes) -> bytes:
        """The frame of a message that proves itself, as it is sent."""

    def take_liars(self) -> list[int]:
        """Members that are proven to vouch for what they deny to others, since last asked."""

    def take_proofs(self) -> list[bytes]:
        """Frames of theirs that prove it to anybody, to be sent again as they came, since last asked."""

    def take_says(self) -> list[Say]:
        """Words for the operator, since last asked."""


@final
class OpenGuard:
    """Of a radio without keys: all that is not signed counts. A signature that is not read proves nothing."""

    def __init__(self) -> None:
        self.flags = 0
        self.cloned = False
        self.refused: Counter[str] = Counter()

    def passes(self, frame: bytes, now_s: float) -> bool:  # noqa: ARG002
        if is_signed(frame):
            self.refused["signed"] += 1
            return False
        return True

    def take_admitted(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> None:
        pass

    def admits(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bool:  # noqa: ARG002
        return self.passes(frame, now_s)

    def take_proof(self, frame: bytes, now_s: float) -> bool:  # noqa: ARG002
        return False

    def holds_mac(self, frame: bytes) -> bool:  # noqa: ARG002
        return False

    def boots(self) -> dict[int, int]:
        return {}

    def believe(self, decoded: Decoded, sender: int, now_s: float) -> Decoded:  # noqa: ARG002
        return decoded

    def seal(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bytes:  # noqa: ARG002
        return frame

    def proof(self, now_s: float) -> tuple[int, bytes] | None:  # noqa: ARG002
        return None

    def seal_proof(self, frame: bytes) -> bytes:
        return frame

    def take_liars(self) -> list[int]:
        return []

    def take_proofs(self) -> list[bytes]:
        return []

    def take_says(self) -> list[Say]:
        return []


@final
class SignedGuard:
    """Of a swarm with keys. Tables are bounded by the fleet's: of a sender without a public key nothing is kept."""

    def __init__(self, session: Session) -> None:
        self.flags = SIGNED
        self.refused: Counter[str] = Counter()
        self.cloned = False
        self._session = session
        self._streams: dict[int, Stream] = {}
        self._newcomers: dict[int, int] = {}  # by sender, the last boot that was not met, or is another companion's
        self._past: dict[int, deque[int]] = {}  # by sender, boots that are over
        self._witness = Witness(session.verifiers)
        self._turn = 0  # of the echoes
        # By sender, and whether of the boot that was met: since when, how many. Recordings of another cost it nothing.
        self._checks: dict[tuple[int, bool], tuple[float, int]] = {}
        self._own_key = session.stream_key(session.active, session.me, session.boot) or b""
        self._timestamp = 0
        self._sent: deque[tuple[int, bytes]] = deque(maxlen=MACS_MAX)  # named by the next manifest
        self._unnamed = 0  # sent since the last one
        self._said: Beacon | None = None  # the last own beacon
        self._manifest_s = -math.inf
        self._urgent_until_s = -math.inf
        self._says: list[Say] = []
        self._told_s: dict[str, float] = {}

    # --- in ---

    def passes(self, frame: bytes, now_s: float) -> bool:
        return self._is_new(frame, now_s, named=True)

    def take_admitted(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> None:
        self._streams[frame[5]].take_frame(frame, said, now_s, named=named)

    def admits(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bool:
        if not self._is_new(frame, now_s, named=named):
            return False
        self.take_admitted(frame, now_s, said, named=named)
        return True

    def _is_new(self, frame: bytes, now_s: float, *, named: bool) -> bool:
        refusal = self._refusal(frame, frame[5], now_s, named=named)
        if refusal:
            self.refused[refusal] += 1
        return not refusal

    def _refusal(self, frame: bytes, sender: int, now_s: float, *, named: bool) -> str:
        if not is_signed(frame):
            self._report_sender(sender, "sends unsigned frames: ignored", now_s)
            return "unsigned"
        if sender == self._session.me:
            return "own"
        stream = self._streams.get(sender)
        if stream is None:
            return "not met"
        return stream.refusal(frame, self._session, sender, now_s, named=named)

    def take_proof(self, frame: bytes, now_s: float) -> bool:
        payload = manifests.manifest_payload(frame)
        if payload is None:
            return False
        sender = frame[5]
        if not self.holds_mac(frame):
            self.refused["forged manifest"] += 1
            self._report_sender(sender, "has another key, or another mission file: ignored", now_s)
            return True
        found = manifests.read_payload(sender, payload)
        if found is None:
            return False
        manifest, signed, signature = found
        stream = self._streams.get(sender)
        if stream is not None and stream.boot == manifest.boot:
            self._witness.take_manifest(sender, SignedManifest(manifest, signed, signature, frame), now_s)
        if not self._is_due(sender, manifest, signed, signature, now_s):
            return True
        if stream is not None and stream.boot == manifest.boot and stream.is_known(manifest, now_s):
            stream.put_off(Waiting(manifest, signed, signature, now_s))
        elif self._holds_signature(sender, manifest, signed, signature, now_s):
            self._take_manifest(sender, manifest, now_s)
        return True

    def holds_mac(self, frame: bytes) -> bool:
        key = self._session.keys.get(epoch_of(frame)) if is_signed(frame) else None
        return key is not None and mac_holds(frame, key)

    def boots(self) -> dict[int, int]:
        return {sender: stream.boot for sender, stream in self._streams.items()}

    def _is_due(self, sender: int, manifest: Manifest, signed: bytes, signature: bytes, now_s: float) -> bool:
        """Of a member, newer than the last that held, and none that was put off before."""
        if sender not in self._session.verifiers:
            self.refused["of no member"] += 1
            self._report_text(f"{name_of(sender)} is not of this fleet, or revoked: ignored", now_s)
            return False
        if manifest.boot in self._past.get(sender, ()):
            self.refused["of a boot that is over"] += 1
            self._report_text(f"recording of {name_of(sender)}: ignored", now_s)
            return False
        stream = self._streams.get(sender)
        if stream is not None and manifest.boot == stream.boot and stream.has_heard(manifest, signed, signature):
            self.refused["repeated"] += 1
            return False
        if sender == self._session.me and manifest.boot == self._session.boot:
            self.refused["own"] += 1
            return False
        return True

    def _holds_signature(self, sender: int, manifest: Manifest, signed: bytes, signature: bytes, now_s: float) -> bool:
        """Its sender's, as far as there is time for it: not in a flood."""
        stream = self._streams.get(sender)
        is_met = stream is not None and manifest.boot == stream.boot
        since_s, count = self._checks.get((sender, is_met), (-math.inf, 0))
        if now_s - since_s >= CHECKS_S:
            since_s, count = now_s, 0
        self._checks[sender, is_met] = (since_s, count + 1)
        if count >= CHECKS_MAX:
            self.refused["too many manifests"] += 1
            if is_met:  # by a member: its own may be among those that are not checked
                self._report_text(f"flood of manifests in the name of {name_of(sender)}", now_s)
            return False
        if not self._session.verifiers[sender].holds(signature, signed):
            self.refused["forged manifest"] += 1
            return False
        return True

    def _take_manifest(self, sender: int, manifest: Manifest, now_s: float) -> None:
        """A genuine one, perhaps of an earlier flight."""
        session, stream = self._session, self._streams.get(sender)
        is_new = (session.me, session.boot) in manifest.echoes
        if sender == session.me:
            self._note_newcomer(sender, manifest.boot, now_s)
            if is_new:  # it hears this vehicle, and has its key
                self.cloned = True
                self._report_text(twin_of(sender), now_s, Severity.CRITICAL)
            return
        if stream is None or stream.boot != manifest.boot:
            self._note_newcomer(sender, manifest.boot, now_s)
            if not is_new:
                self.refused["not met"] += 1
                return
            # Its word that it is there counts while it vouches for it: others have its key of this boot.
            if stream is not None and now_s - stream.heard_s < ALIVE_S and stream.is_vouched(now_s):
                self.refused["twice"] += 1
                self._report_text(f"{name_of(sender)} is there twice: the later is ignored", now_s, Severity.CRITICAL)
                return
            if stream is not None:
                self._leave(sender, stream.boot)
            stream = self._streams[sender] = Stream(manifest.boot, manifest.last, now_s)
            del self._newcomers[sender]
        self._vouch(stream, sender, manifest, now_s)

    def _leave(self, sender: int, boot: int) -> None:
        """A boot that another one has followed never counts again: what comes of it is a recording."""
        self._past.setdefault(sender, deque(maxlen=PAST_MAX)).append(boot)

    def _vouch(self, stream: Stream, sender: int, manifest: Manifest, now_s: float) -> None:
        if not stream.vouch(manifest, now_s):
            self.refused["disowned"] += 1
            self._report_text(f"somebody speaks as {name_of(sender)}: it only slows", now_s, Severity.CRITICAL)

    def _note_newcomer(self, sender: int, boot: int, now_s: float) -> None:
        """To be echoed, beside the boot that was met, which no flood of recordings takes from the echoes."""
        if self._newcomers.get(sender) != boot:
            self._newcomers[sender] = boot
            self._urgent_until_s = now_s + MEETING_S

    def believe(self, decoded: Decoded, sender: int, now_s: float) -> Decoded:
        said, stream = decoded.said, self._streams.get(sender)
        if said is None or stream is None:
            return decoded
        is_proven, is_vouched = stream.is_proven(said, now_s), stream.is_vouched(now_s)
        if not (is_proven and is_vouched):
            waiting, stream.waiting = stream.waiting, None
            if waiting is not None and self._holds_signature(sender, *waiting[:3], now_s):
                self._vouch(stream, sender, waiting.manifest, waiting.heard_s)
                is_proven, is_vouched = stream.is_proven(said, now_s), stream.is_vouched(now_s)
        return limit_belief(decoded, is_proven=is_proven, is_vouched=is_vouched)

    # --- out ---

    def seal(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bytes:
        self._count_up(now_s)
        sealed = seal(frame, self._own_key, self._session.active, self._timestamp)
        if named:
            self._sent.append((self._timestamp, mac_of(sealed)))
            self._unnamed += 1
        if said is not None:
            if self._said is None or not says_same(said, self._said):
                self._urgent_until_s = max(self._urgent_until_s, now_s + NEWS_S)
            self._said = said
        return sealed

    def proof(self, now_s: float) -> tuple[int, bytes] | None:
        since_s = now_s - self._manifest_s
        is_due = since_s >= MANIFEST_S or self._unnamed >= MACS_MAX - 2
        is_urgent = now_s < self._urgent_until_s and (self._unnamed > 0 or since_s >= MEETING_PERIOD_S)
        if not (is_due or is_urgent):
            return None
        self._count_up(now_s)
        self._manifest_s, self._unnamed = now_s, 0
        boots = [*self.boots().items(), *self._newcomers.items()]
        turn = self._turn % max(1, len(boots))
        self._turn = turn + ECHOES_MAX
        stamps, macs = [at for at, _ in self._sent], [mac for _, mac in self._sent]
        first = stamps[0] if stamps else self._timestamp
        named = Manifest(self._session.boot, first, self._timestamp, macs, (boots[turn:] + boots[:turn])[:ECHOES_MAX])
        return MANIFEST_ID, manifests.encode_manifest(named, self._session.me, self._session.signer)

    def seal_proof(self, frame: bytes) -> bytes:
        session = self._session
        return seal(frame, session.keys[session.active], session.active, self._timestamp)

    def take_liars(self) -> list[int]:
        return self._witness.take_liars()

    def take_proofs(self) -> list[bytes]:
        return self._witness.take_proofs()

    def take_says(self) -> list[Say]:
        says, self._says = self._says, []
        return says

    def _count_up(self, now_s: float) -> None:
        self._timestamp = min(max(self._timestamp + 1, int(now_s * UNITS_PER_S)), TIMESTAMP_MAX)

    def _report_sender(self, sender: int, what: str, now_s: float) -> None:
        """Of another member alone: anybody may send in 255 names, and each text costs the autopilot's link."""
        if sender in self._session.verifiers and sender != self._session.me:
            self._report_text(f"{name_of(sender)} {what}", now_s)

    def _report_text(self, text: str, now_s: float, severity: Severity = Severity.WARNING) -> None:
        if now_s - self._told_s.get(text, -math.inf) >= TOLD_S and len(self._told_s) < 1024:
            self._told_s[text] = now_s
            self._says.append(Say(severity, text))
