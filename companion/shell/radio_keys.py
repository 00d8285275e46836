"""The keys of a radio, opened: a companion's, with the book of its operator's orders, and the base station's."""

from __future__ import annotations

import os
import time
from contextlib import ExitStack
from typing import NamedTuple

from companion.keys.autopilot_link import link_key
from companion.keys.fingerprints import summary
from companion.keys.key_file import load_keyring
from companion.keys.keyring import OPERATOR, Keyring
from companion.keys.process import harden_process
from companion.mavlink.autopilot_link.signing import LinkSigning, timestamp_at
from companion.mavlink.framing.signing import Gate
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.peers.guard import Guard, SignedGuard
from companion.mavlink.peers.session import BASE_ID, Session, open_session
from companion.shell.orders import orders_of, orders_path
from mission.document.load import mission_sha256

BOOT_BYTES = 4
UNSIGNED = "UNSIGNED (--unsigned): whoever is in radio range can start, lead and land this vehicle"
NEEDS_KEY = (
    "--key FILE is needed: without one whoever is in radio range commands {what}. `companion key new fleet --vehicles "
    "{size}` makes a fleet's key files (docs/how-to/keys.md); in the simulator, --unsigned flies without"
)


class NoKeyError(Exception):
    """Neither a key nor the word that none is wanted; the message says what to do."""


def choose_key(key: str | None, *, unsigned: bool, what: str, size: int) -> str | None:
    """The key file; None: unsigned, as was asked for. `what` is commanded else, in a swarm of `size`. NoKeyError."""
    if key is None and not unsigned:
        raise NoKeyError(NEEDS_KEY.format(what=what, size=size))
    return key


class RadioKeys(NamedTuple):
    """Of one start of a companion."""

    guard: Guard | None  # None: whoever is in range is heard
    orders: OrderBook | None
    lines: list[str]  # for the log
    autopilot_gate: Gate | None = None  # of a link that is signed
    session: Session | None = None  # of the radio


def open_keys(
    key: str | None,
    mission: str,
    vehicle_id: int,
    size: int,
    log: str | None,
    opened: ExitStack,
    *,
    beside_loop: bool,
    signs_autopilot: bool,
) -> RadioKeys:
    """`key`, `mission`: files; `key` None: unsigned. KeyFileError, OldOrdersError; OSError: no folder for orders."""
    if key is None:
        return RadioKeys(None, None, [UNSIGNED])
    weakness = harden_process()
    keyring = load_keyring(key, vehicle_id)
    session = open_radio_session(keyring, vehicle_id, mission)
    digest, path = mission_digest(mission), orders_path(log, vehicle_id)
    orders = orders_of(keyring, digest, size, session.boot, path, opened, beside_loop=beside_loop)
    lines = [f"radio signed: {summary(keyring)}", *([weakness] if weakness else [])]
    gate = open_autopilot_gate(keyring) if signs_autopilot else None
    if gate is not None:
        lines.append("autopilot link signed: what it sends without the key is refused")
    return RadioKeys(SignedGuard(session), orders, lines, gate, session)


def open_autopilot_gate(keyring: Keyring) -> LinkSigning:
    """Of the link to the autopilot of this keyring's vehicle, from now on."""
    return LinkSigning(link_key(keyring), timestamp=timestamp_at(time.time()))


def open_base_session(key: str | None, mission: str) -> Session | None:
    """The base station's, by the operator's key file; None: whoever is in range is heard. KeyFileError."""
    if key is None:
        return None
    harden_process()
    return open_radio_session(load_keyring(key, OPERATOR), BASE_ID, mission)


def open_radio_session(keyring: Keyring, me: int, mission: str) -> Session:
    """Of this start: its boot is drawn. `mission`: its file."""
    boot = int.from_bytes(os.urandom(BOOT_BYTES), "little") or 1
    return open_session(keyring, me, mission_digest(mission), boot)


def mission_digest(mission: str) -> bytes:
    """SHA-256 of a mission file, as sha256sum has it."""
    return bytes.fromhex(mission_sha256(mission))
