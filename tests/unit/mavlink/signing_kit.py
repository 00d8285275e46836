"""A fleet with keys, and the air between its guards."""

from __future__ import annotations

from dataclasses import replace

from companion.keys.crypto import public_key
from companion.keys.keyring import OPERATOR, Keyring
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.framing import wire
from companion.mavlink.own_messages import decode_beacon
from companion.mavlink.peers.guard import SignedGuard
from companion.mavlink.peers.session import open_session
from mission.common.frames import Wgs84
from tests.unit.core.core_kit import beacon

MISSION = b"m" * 32
SECRET = b"s" * 32
HERE = Wgs84(47.0, 8.0, 400.0)
PERIOD_S = 0.1


def seed(owner: int) -> bytes:
    return bytes([owner]) * 32


def keyring(owner: int, size: int = 4, secret: bytes = SECRET) -> Keyring:
    vehicles = {k: public_key(seed(k)) for k in range(1, size + 1)}
    return Keyring(owner, seed(owner), {0: secret}, 0, public_key(seed(OPERATOR)), vehicles)


def guard(owner: int, *, boot: int = 0, mission: bytes = MISSION, ring: Keyring | None = None) -> SignedGuard:
    return SignedGuard(open_session(ring or keyring(owner), owner, mission, boot or 1000 + owner))


def beacon_frame(sender: int, **says: object) -> bytes:
    """Whose header says that it is signed, as yet without its signature."""
    payload = swarm_beacon.encode(beacon(sender, **says), HERE)
    return wire.frame(swarm_beacon.MESSAGE_ID, payload, seq=0, system=sender, component=191, flags=1)


class Node:
    """One guard, which sends a beacon each period, and what it has admitted."""

    def __init__(self, owner: int, **changes: object) -> None:
        self.id = owner
        self.guard = guard(owner, **changes)
        self.says: dict[str, object] = {}
        self.heard: list[tuple[int, bool]] = []  # sender, whether all of its beacon counted
        self.believed: list[swarm_beacon.Decoded] = []  # what of each counted
        self.texts: list[str] = []

    def send(self, now_s: float) -> list[bytes]:
        said = beacon(self.id, **self.says)
        frames = [self.guard.seal(beacon_frame(self.id, **self.says), now_s, said)]
        proof = self.guard.proof(now_s)
        if proof is not None:
            unsigned = wire.frame(*proof, seq=0, system=self.id, component=191, flags=1)
            frames.append(self.guard.seal_proof(unsigned))
        self.texts += [say.text for say in self.guard.take_says()]
        return frames

    def receive(self, frames: list[bytes], now_s: float) -> list[tuple[int, bool]]:
        """As an endpoint does with one datagram."""
        admitted = []
        for frame in frames:
            if self.guard.take_proof(frame, now_s):
                continue
            fields = swarm_beacon.unpack(frame)
            if fields is None:
                continue
            said = decode_beacon(frame[5], fields)
            if self.guard.admits(frame, now_s, said):
                admitted.append((frame[5], swarm_beacon.Decoded(1, said, (0.0, 0.0, 0.0))))
        counts = [self.guard.believe(one, sender, now_s) for sender, one in admitted]
        self.believed += counts
        found = [(sender, left is one) for (sender, one), left in zip(admitted, counts, strict=True)]
        self.heard += found
        self.texts += [say.text for say in self.guard.take_says()]
        return found


def exchange(nodes: list[Node], now_s: float, periods: int) -> float:
    """All hear one another; returns the time after."""
    for _ in range(periods):
        sent = [(node, node.send(now_s)) for node in nodes]
        for sender, frames in sent:
            for node in nodes:
                if node is not sender:
                    node.receive(frames, now_s)
        now_s = round(now_s + PERIOD_S, 6)
    return now_s


def met(*owners: int, now_s: float = 100.0) -> tuple[list[Node], float]:
    """Nodes that have met, and have forgotten what they heard."""
    nodes = [Node(owner) for owner in owners]
    now_s = exchange(nodes, now_s, 20)
    for node in nodes:
        node.heard.clear()
        node.believed.clear()
    return nodes, now_s


def with_secrets(ring: Keyring, secrets: dict[int, bytes], active: int) -> Keyring:
    return replace(ring, secrets=secrets, active=active)
