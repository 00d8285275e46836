"""The base station without its sockets: the radio's bytes in, datagrams out. The same on a laptop and in lockstep."""

from __future__ import annotations

from typing import Final

from companion.core.model.beacon import Beacon
from companion.core.model.states import FlightState
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.framing import wire
from companion.mavlink.orders.order import order_payload
from companion.mavlink.own_messages import decode_beacon
from companion.mavlink.peers.guard import Guard, OpenGuard
from companion.records.exchange import RecordExchange
from companion.records.record import BASE_ID, Progress
from companion.records.summary import StandSummary


class BaseStation:
    """Takes in records, and answers with the vector of what it has on its disk. Times are the local clock's, s."""

    def __init__(self, records: RecordExchange, guard: Guard | None = None) -> None:
        """`records`: the base station's, by `companion.records.node.open_base`.

        `guard`: of its radio; by default whoever is in range is heard.
        """
        self.records: Final = records
        self._guard: Final[Guard] = guard or OpenGuard()
        self._sender = wire.Sender(BASE_ID, swarm_beacon.COMPONENT, self._guard.flags)
        self._heard_s: dict[int, float] = {}  # by system id, at most 255
        self._flown = 0  # bit k-1: vehicle k has taken off, as beacons have it
        self._landed: set[int] = set()  # that said so last
        self._leader = 0  # that acts, as the last beacon has it that names one with the majority; 0: none yet

    def receive(self, data: bytes, now_s: float) -> None:
        """A datagram of the swarm's radio."""

        guard = self._guard

        def take_frame(frame: bytes) -> bool:
            if guard.take_proof(frame, now_s) or order_payload(frame) is not None:
                return True
            is_ours = self.records.is_record(frame) and guard.admits(frame, now_s, named=False)
            return is_ours and self.records.receive(frame, now_s)

        for sender, frame, fields in swarm_beacon.read_each(data, swarm_beacon.unpack, take_frame):
            said = decode_beacon(sender, fields)
            if guard.admits(frame, now_s, said):
                self._heard_s[sender] = now_s
                if said is not None:
                    self._note_flown(said)
                if said is not None and said.lease is not None and said.lease.established and said.lease.quorum:
                    self._leader = said.lease.leader

    def tick(self, now_s: float) -> list[bytes]:
        """Datagrams to send now."""
        guard, sender = self._guard, self._sender
        proof = guard.proof(now_s)
        proofs = [] if proof is None else [guard.seal_proof(sender.frame(*proof))]
        frames = self.records.frames(now_s, 0)
        return [*proofs, *(guard.seal(sender.frame(*frame), now_s, named=False) for frame in frames)]

    def lines(self) -> list[str]:
        """Lines for the operator, since last asked."""
        return [*self.records.lines(), *(say.text for say in self._guard.take_says())]

    def in_range(self, now_s: float, within_s: float = 3.0) -> list[int]:
        """Vehicles whose beacons were heard lately."""
        return sorted(k for k, heard_s in self._heard_s.items() if now_s - heard_s <= within_s)

    def may_hold_more(self, now_s: float) -> list[int]:
        """Vehicles that have flown out of range: nobody here tells of what they have recorded since."""
        known = {*self.in_range(now_s), *self._landed}
        return [k for k in range(1, self.records.members + 1) if self._flown >> (k - 1) & 1 and k not in known]

    def _note_flown(self, said: Beacon) -> None:
        self._flown |= said.flown
        if said.state is FlightState.LANDED:
            self._landed.add(said.sender)
        else:
            self._landed.discard(said.sender)

    @property
    def summary(self) -> StandSummary | None:
        """The stand as the acting leader has it; until it has told, by whoever told it of the most records."""
        told = self.records.summaries
        return told.get(self._leader) or max(told.values(), key=lambda one: one.fused, default=None)

    @property
    def text(self) -> str:
        """Progress and stand in a line, for people."""
        summary = self.summary
        return str(self.progress) if summary is None else f"{self.progress}; {summary}"

    @property
    def progress(self) -> Progress:
        """Count of the records that were heard of, and of those that are here."""
        return self.records.progress()
