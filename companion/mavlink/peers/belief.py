"""The part of a beacon that counts, by how far its sender vouches for it."""

from __future__ import annotations

from dataclasses import replace

from companion.core.model.beacon import Beacon
from companion.mavlink.beacon import Decoded


def limit_belief(decoded: Decoded, *, is_proven: bool, is_vouched: bool) -> Decoded:
    """The part of a beacon that counts: without what its sender has not said, and without ways that others may tell."""
    said = decoded.said
    if said is None or (is_proven and is_vouched):
        return decoded
    left = _without_way(said) if is_proven else without_word(said)
    return Decoded(decoded.version, left, decoded.pos_ned_m, is_vouched)


def _without_way(said: Beacon) -> Beacon:
    """The same, of a word that its sender has: perhaps by somebody else, who may add what it never said."""
    return replace(said, dest_ned_m=None, sighting=None, agreed=False, start=False, abort=False, parent=0)


def without_word(said: Beacon) -> Beacon:
    """The same, of which only place, velocity and what slows are left: no leader, phase, order, or other vehicle."""
    return replace(
        said,
        lease=None,
        candidate=None,
        dest_ned_m=None,
        sighting=None,
        agreed=False,
        start=False,
        abort=False,
        done=0,
        present=0,
        flown=0,
        parent=0,
        accused=0,
    )
