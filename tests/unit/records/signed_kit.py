"""Keys of a small fleet, for the tests of its records."""

from __future__ import annotations

from companion.keys.keyring import OPERATOR, Keyring
from companion.mavlink.peers.session import BASE_ID, open_session
from companion.records.signed.keys import RecordKeys, record_keys
from tests.unit.mavlink.signing_kit import MISSION, keyring


def keys_of(me: int, *, mission_hash: int = 0, ring: Keyring | None = None) -> RecordKeys:
    """Of a vehicle, or of the base station; of a fleet of six unless another keyring is given."""
    ring = ring or keyring(OPERATOR if me == BASE_ID else me, 6)
    found = record_keys(open_session(ring, me, MISSION, 1000 + me), mission_hash)
    assert found is not None
    return found
