"""A vehicle in radio range, as this vehicle has it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, final

from companion.core.model.beacon import Beacon, PeerReport
from companion.core.model.states import CLIMBING, STEERED
from companion.core.model.vectors import norm
from mission.common.frames import Vec3

# Asked for every neighbour in every tick: in a tuple a member is found by identity, in a set by Enum's Python hash.
_STEERED, _CLIMBING = tuple(STEERED), tuple(CLIMBING)


@final
class Neighbour:
    """A vehicle in radio range, with its relative position and destination vector brought up to now.

    No dataclass: one is made for every neighbour in every tick, and a compiled dataclass is made several times slower.
    """

    __slots__ = (
        "age_s",
        "beacon",
        "dest_ned_m",
        "distance_m",
        "is_overdue",
        "late_s",
        "rel_ned_m",
        "share",
        "vel_ned_mps",
    )

    def __init__(
        self,
        beacon: Beacon,
        rel_ned_m: Vec3,
        dest_ned_m: Vec3 | None,
        age_s: float,
        vel_ned_mps: Vec3,
        distance_m: float,
        late_s: float = 0.0,
        share: float = 1.0,
        is_overdue: bool = False,
    ) -> None:
        self.beacon: Final = beacon
        self.rel_ned_m: Final = rel_ned_m  # from this vehicle to the neighbour
        self.dest_ned_m: Final = dest_ned_m  # from this vehicle to the destination, as the neighbour sees it
        self.age_s: Final = age_s  # since its beacon arrived
        self.late_s: Final = late_s  # for how long that had been on its way; what it says is as old as both together
        self.vel_ned_mps: Final = vel_ned_mps  # as claimed, corrected by how its position changes
        self.distance_m: Final = distance_m  # of `rel_ned_m`
        self.share: Final = share  # of its beacons that arrives, 0..1
        # By a good radio it would count as silent: it may be, and hover where it is reckoned to be.
        self.is_overdue: Final = is_overdue

    def at(self, rel_ned_m: Vec3, dest_ned_m: Vec3 | None) -> Neighbour:
        """The same neighbour at another position, with the destination from here."""
        return Neighbour(
            self.beacon,
            rel_ned_m,
            dest_ned_m,
            self.age_s,
            self.vel_ned_mps,
            norm(rel_ned_m),
            self.late_s,
            self.share,
            self.is_overdue,
        )

    @property
    def id(self) -> int:
        """System id."""
        return self.beacon.sender

    @property
    def gives_way(self) -> bool:
        """Its companion steers it and keeps its distance."""
        return self.beacon.state in _STEERED

    @property
    def stands(self) -> bool:
        """In the air without being steered, and not on its way up: with its pilot, held by its autopilot, landing."""
        return self.beacon.airborne and not self.gives_way and self.beacon.state not in _CLIMBING


def find_hover_places(reports: Iterable[PeerReport]) -> list[Vec3]:
    """Positions at which reported vehicles may hover, relative, NED m: of one of which words differ, all of them."""
    return [rel for report in reports for rel in (report.rel_ned_m, *report.elsewhere)]


def find_told_places(reports: Iterable[PeerReport]) -> list[Vec3]:
    """Of those places the ones at which others alone say that a vehicle hovers silent."""
    silent = [report for report in reports if report.silent]
    return [rel for s in silent for rel in ((s.rel_ned_m, *s.elsewhere) if s.received else s.elsewhere)]
