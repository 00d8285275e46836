"""A radio that is no vehicle's: the base station's."""

from __future__ import annotations

from typing import Protocol

from mission.common.frames import Vec3


class RadioNode(Protocol):
    """Hears and sends in this process."""

    @property
    def id(self) -> int:
        """Its system id."""

    @property
    def pos_ned_m(self) -> Vec3:
        """Position in the mission's frame."""

    def receive(self, data: bytes, now_s: float) -> None:
        """Hand over what reaches it."""

    def tick(self, now_s: float) -> list[bytes]:
        """Frames that it sends now."""
