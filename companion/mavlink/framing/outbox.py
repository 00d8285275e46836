"""Output of one tick of an endpoint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from companion.core.model.actions import Say
from companion.core.model.states import BeaconFate


@dataclass(slots=True, init=False)
class Outbox:
    """One datagram's worth for each link (empty: nothing), what was said, for the log, and which beacons were heard."""

    autopilot: bytes
    peers: bytes
    said: list[Say]
    sensor: bytes  # a HEARTBEAT, by which a driver that waits for one learns this end's address
    records: list[bytes]  # to the peers, each a datagram, after `peers`: a beacon is not lost with a record
    heard: Final[
        dict[tuple[int, BeaconFate], int]
    ]  # sender's system id, fate of its beacons that the gate admits -> how many

    def __init__(
        self,
        autopilot: bytes = b"",
        peers: bytes = b"",
        said: list[Say] | None = None,
        sensor: bytes = b"",
        heard: dict[tuple[int, BeaconFate], int] | None = None,
    ) -> None:
        self.autopilot = autopilot
        self.peers = peers
        self.said = [] if said is None else said
        self.sensor = sensor
        self.records = []
        self.heard = {} if heard is None else heard
