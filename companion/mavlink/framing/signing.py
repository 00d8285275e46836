"""The gate of a link: decides on each valid frame before anything is remembered of its sender.

This one has no key, and reads no signature. `companion.mavlink.autopilot_link.signing` has one: there the MAC is
checked first, timestamps move after it, and only then do last heard, sequence and agent see the frame.
"""

from __future__ import annotations

from companion.mavlink.framing.frames import MAGIC_V2, SIGNED


class Gate:
    """Of one link. Takes unsigned frames; signed ones, which it cannot check, where the link is trusted."""

    __slots__ = ("_takes_signed", "refused", "signed")

    def __init__(self, *, takes_signed: bool) -> None:
        """`takes_signed`: a frame counts though its signature was not read, as from one's own autopilot."""
        self._takes_signed = takes_signed
        self.signed = 0  # signed frames, taken or refused
        self.refused = 0

    def admits(self, frame: bytes) -> bool:
        """True when this whole, valid frame may be acted on. Nothing else may look at it before."""
        if frame[0] != MAGIC_V2 or not frame[2] & SIGNED:
            return True
        self.signed += 1
        if not self._takes_signed:
            self.refused += 1
        return self._takes_signed

    def seal(self, frame: bytes, now_s: float) -> bytes:  # noqa: ARG002
        """A frame as it is sent."""
        return frame

    def counters(self) -> dict[str, int]:
        """Counts of what was refused, for the log."""
        return {}
