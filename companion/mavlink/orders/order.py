"""SWARM_ORDER <-> its value, its signature, and the boots that it names. Bytes from outside never raise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import Final

from companion.core.model.states import Order
from companion.keys.crypto import Signer, Verifier
from companion.mavlink import dialect
from companion.mavlink.framing.frames import payload_of
from companion.mavlink.schema.tables.orders import BOOTS_BYTES, ORDER, ORDER_VERSION, SIGNATURE_BYTES

ORDER_ID: Final = dialect.MAVLINK_MSG_ID_SWARM_ORDER
DOMAIN: Final = b"understory order 1"  # nothing else that this key signs begins so
NONCE_BYTES: Final = 8
DIGEST_BYTES: Final = 8
NO_FLIGHT: Final = bytes(NONCE_BYTES)
COUNTER_MAX: Final = (1 << 64) - 1
BOOT_BITS_MAX: Final = 32
_PAYLOAD: Final = Struct("<" + "".join(row.code for row in ORDER.on_wire))
_ID_BYTES: Final = ORDER_ID.to_bytes(3, "little")
_EXTRA: Final = bytes([dialect.MAVLink_swarm_order_message.crc_extra])
_SIGNATURE_AT: Final = _PAYLOAD.size - BOOTS_BYTES - SIGNATURE_BYTES
_BOOTS_AT: Final = _PAYLOAD.size - BOOTS_BYTES


class OrderKind(IntEnum):
    """SWARM_ORDER_KIND. Of those that cannot be taken back the greater is above the other."""

    START = 1
    HOLD = 2
    LAND = 3
    ABORT = 4

    @property
    def latched(self) -> int:
        """Its rank, where it cannot be taken back; 0: it can."""
        return self.value if self >= OrderKind.LAND else 0

    @property
    def order(self) -> Order:
        """As the core has it."""
        return Order[self.name]


@dataclass(frozen=True, slots=True)
class SignedOrder:
    """An order as it is on the wire. Its signature has not been checked, unless who has it says so."""

    kind: OrderKind
    counter: int
    flight: bytes
    mission: bytes  # the first bytes of the mission file's digest
    hand_back: int
    boots: bytes
    payload: bytes  # whole, with its trailing zeros: what is passed on


def is_order_frame(frame: bytes) -> bool:
    """A whole MAVLink 2 frame of this message, by its header alone."""
    return frame[7:10] == _ID_BYTES


def order_payload(frame: bytes) -> bytes | None:
    """A whole frame of whomever -> the payload of its order; None: it is none, or its checksum is wrong."""
    return payload_of(frame, _ID_BYTES, _EXTRA, _PAYLOAD.size)


def read_order(payload: bytes) -> SignedOrder | None:
    """A payload -> what it says, by whomever; None: it is of another version, or makes no sense."""
    if len(payload) != _PAYLOAD.size:
        return None
    counter, flight, mission, version, kind, hand_back, _, boots = _PAYLOAD.unpack(payload)
    if version != ORDER_VERSION or kind not in OrderKind._value2member_map_ or counter == 0:
        return None
    return SignedOrder(OrderKind(kind), counter, flight, mission, hand_back, boots, payload)


def order_holds(payload: bytes, operator: Verifier) -> bool:
    """True when the owner of the operator's key has made this order."""
    return operator.holds(payload[_SIGNATURE_AT:_BOOTS_AT], _signed_part(payload))


def make_order(
    signer: Signer,
    kind: OrderKind,
    *,
    counter: int,
    flight: bytes,
    digest: bytes,
    boots: bytes = b"",
    hand_back: int = 0,
) -> bytes:
    """The payload of an order. `digest`: of the mission file, SHA-256; `boots`: by `pack_boots`."""
    head = (counter, flight, digest[:DIGEST_BYTES], ORDER_VERSION, kind, hand_back)
    unsigned = _PAYLOAD.pack(*head, b"", boots)
    signature = signer.sign(_signed_part(unsigned))
    return unsigned[:_SIGNATURE_AT] + signature + unsigned[_BOOTS_AT:]


def _signed_part(payload: bytes) -> bytes:
    return DOMAIN + payload[:_SIGNATURE_AT] + payload[_BOOTS_AT:]


def boot_bits(size: int) -> int:
    """Number of bits of an order for each vehicle of a swarm of `size`: 32 up to 41 vehicles, 5 of 250."""
    return min(BOOT_BITS_MAX, 8 * BOOTS_BYTES // size)


def pack_boots(boots: Mapping[int, int], size: int) -> bytes:
    """Boot nonces by vehicle, of a swarm of `size`, as an order names them; the others are not named."""
    bits, packed = boot_bits(size), 0
    for vehicle, boot in boots.items():
        if 1 <= vehicle <= size:
            packed |= _mark_of(boot, bits) << (vehicle - 1) * bits
    return packed.to_bytes(BOOTS_BYTES, "little")


def names_boot(boots: bytes, vehicle: int, size: int, boot: int) -> bool:
    """True when an order names this start of a vehicle's companion; of another it does with 2^-bits at most."""
    bits = boot_bits(size)
    said = int.from_bytes(boots, "little") >> (vehicle - 1) * bits & (1 << bits) - 1
    return said == _mark_of(boot, bits)


def _mark_of(boot: int, bits: int) -> int:
    """Never 0, which names nobody."""
    return boot % ((1 << bits) - 1) + 1
