"""The peers' link of one companion: datagrams of the radio in, beacons and reports out; frames to send."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, final

from companion.core.model.actions import Say
from companion.core.model.beacon import Beacon, RelativeReport, TrunkReport
from companion.core.model.states import Severity
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.beacon import COMPONENT, REFUSED, Decoded, Reader
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import source
from companion.mavlink.harvest import RecordLink
from companion.mavlink.orders.desk import OrderDesk
from companion.mavlink.orders.order import ORDER_ID, is_order_frame
from companion.mavlink.own_messages import encode_relative_report, encode_trunk_report
from companion.mavlink.peers.guard import Guard
from companion.mavlink.relative import (
    RELATIVE_ID,
    TRUNKS_ID,
    is_relative_report,
    is_trunk_report,
    read_relative_report,
    read_trunk_report,
)

Heard = RelativeReport | TrunkReport | tuple[int, Decoded]  # a beacon: its sender's system id, and what of it counts


@final
class PeersLink:
    """Whose frames its guard admits. Times are the local clock's, s."""

    def __init__(
        self,
        vehicle_id: int,
        reader: Reader,
        guard: Guard,
        records: RecordLink | None,
        orders: OrderDesk,
        *,
        ranging: bool,
        trunks: bool = False,
    ) -> None:
        """`records`, `orders`: take the frames of these.

        `ranging`: SWARM_RELATIVE goes with beacons; `trunks`: and SWARM_TRUNKS behind some.
        """
        self.guard: Final = guard
        self.without_beacon = 0  # datagrams
        self._reader: Final = reader
        self._records: Final = records
        self._orders: Final = orders
        self._ranging: Final = ranging
        self._trunks: Final = trunks
        self._sender: Final = wire.Sender(vehicle_id, COMPONENT, guard.flags)

    def read_datagram(self, data: bytes, now_s: float) -> Sequence[Heard]:
        """The reports in it, then the beacons; what proves or records is acted on as it comes."""
        one = _Datagram(
            self._reader, self.guard, self._records, self._orders, now_s, ranging=self._ranging, trunks=self._trunks
        )
        beacons = swarm_beacon.read_each(data, one.read_beacon, one.take_frame)
        heard: list[Heard] = [*one.reports]
        for sender, _, decoded in beacons:
            if decoded is not REFUSED:
                heard.append((sender, self.guard.believe(decoded, sender, now_s)))  # by the proof that came with it
        if not beacons and not one.others:
            self.without_beacon += 1
        return heard

    # --- out ---

    def send_beacon(self, said: Beacon, payload: bytes, word: RelativeReport | None, now_s: float) -> list[bytes]:
        """Frames of a beacon, with what goes before it in a GNSS-denied swarm. `payload`: its own, encoded."""
        frames = []
        if word is not None:
            frames.append(self.guard.seal(self._sender.frame(RELATIVE_ID, encode_relative_report(word)), now_s))
        frames.append(self.guard.seal(self._sender.frame(swarm_beacon.MESSAGE_ID, payload), now_s, said))
        return frames

    def send_trunks(self, trunks: TrunkReport, now_s: float) -> bytes:
        """The frame of trunks, a datagram, behind a beacon."""
        return self.guard.seal(self._sender.frame(TRUNKS_ID, encode_trunk_report(trunks)), now_s)

    def prove(self, now_s: float) -> list[bytes]:
        """Frames to send behind this tick's beacon: the own manifest, and two by which another is proven to lie."""
        proof = self.guard.proof(now_s)
        own = [] if proof is None else [self.guard.seal_proof(self._sender.frame(*proof))]
        return [*own, *self.guard.take_proofs()]

    def send_orders(self, now_s: float) -> list[bytes]:
        """Frames of the operator's order, each a datagram: they bear the key of the group, and prove themselves."""
        payloads = self._orders.payloads(now_s)
        return [self.guard.seal_proof(self._sender.frame(ORDER_ID, payload)) for payload in payloads]

    def send_records(self, now_s: float, beacon_bytes: int) -> list[bytes]:
        """Frames of records, each a datagram, behind so many bytes of beacons."""
        if self._records is None:
            return []
        frames = self._records.frames(now_s, beacon_bytes)
        return [self.guard.seal(self._sender.frame(*frame), now_s, named=False) for frame in frames]

    def take_says(self) -> list[Say]:
        """Words for the operator, since last asked."""
        lines = [] if self._records is None else self._records.lines()
        return [*(Say(Severity.WARNING, line) for line in lines), *self.guard.take_says(), *self._orders.take_says()]


class _Datagram:
    """One datagram while it is read: its frames pass the guard in the order in which they were sent."""

    __slots__ = ("_guard", "_now_s", "_orders", "_ranging", "_reader", "_records", "_trunks", "others", "reports")

    def __init__(
        self,
        reader: Reader,
        guard: Guard,
        records: RecordLink | None,
        orders: OrderDesk,
        now_s: float,
        *,
        ranging: bool,
        trunks: bool,
    ) -> None:
        self.reports: list[RelativeReport | TrunkReport] = []
        self.others = 0  # valid frames that are neither reports nor beacons
        self._reader = reader
        self._guard = guard
        self._records = records
        self._orders = orders
        self._now_s = now_s
        self._ranging = ranging
        self._trunks = trunks

    def read_beacon(self, frame: bytes) -> Decoded | None:
        """A frame with a beacon's id -> its beacon, or REFUSED; None: it is not valid."""
        decoded = self._reader.decode_frame(frame, self._passes)
        if decoded is not None and decoded is not REFUSED:
            self._guard.take_admitted(frame, self._now_s, decoded.said)
        return decoded

    def _passes(self, frame: bytes) -> bool:
        return self._guard.passes(frame, self._now_s)

    def take_frame(self, frame: bytes) -> bool:
        """A frame beside beacons; True: it is valid, and there is no need to look into it."""
        guard, records, now_s = self._guard, self._records, self._now_s
        if guard.take_proof(frame, now_s):
            self.others += 1
            return True
        if is_order_frame(frame):  # by whatever key it came: it bears the operator's
            taken = self._orders.receive(frame, now_s, is_proven=guard.holds_mac(frame))
            self.others += taken
            return taken
        if records is not None and records.is_record(frame):
            taken = guard.admits(frame, now_s, named=False) and records.receive(frame, now_s)
            self.others += taken
            return taken
        if self._trunks and is_trunk_report(frame):
            return self._take_trunks(frame)
        if not self._ranging or not is_relative_report(frame):
            return False
        if source(frame)[1] == COMPONENT and guard.admits(frame, now_s):
            report = read_relative_report(frame)
            if report is not None:
                self.reports.append(report)
        return True

    def _take_trunks(self, frame: bytes) -> bool:
        """A datagram of its own."""
        if source(frame)[1] == COMPONENT and self._guard.admits(frame, self._now_s):
            report = read_trunk_report(frame)
            if report is not None:
                self.others += 1
                self.reports.append(report)
        return True
