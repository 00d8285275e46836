"""Others that are up count as beside a vehicle below: it keeps out of the column that they came up, and come down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from companion.core.model.beacon import PeerReport
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import norm
from mission.common.frames import Vec3

Others = tuple[Sequence[Neighbour], Mapping[int, PeerReport]]  # heard, and by id those that hover


def bring_beside(others: Others, *, above_m: float) -> Others:
    """The same, with those that are more than `above_m` above this vehicle at its own height."""
    neighbours, hovering = others
    if any([-n.rel_ned_m[2] > above_m for n in neighbours]):
        neighbours = [_level_neighbour(n) if -n.rel_ned_m[2] > above_m else n for n in neighbours]
    if any([-report.rel_ned_m[2] > above_m for report in hovering.values()]):
        hovering = {k: _level_report(r) if -r.rel_ned_m[2] > above_m else r for k, r in hovering.items()}
    return neighbours, hovering


def _level_neighbour(neighbour: Neighbour) -> Neighbour:
    rel, vel = neighbour.rel_ned_m, neighbour.vel_ned_mps
    level = (rel[0], rel[1], 0.0)
    return Neighbour(
        neighbour.beacon,
        level,
        neighbour.dest_ned_m,
        neighbour.age_s,
        (vel[0], vel[1], 0.0),
        norm(level),
        neighbour.late_s,
        neighbour.share,
        neighbour.is_overdue,
    )


def _level_report(report: PeerReport) -> PeerReport:
    return PeerReport(
        report.vehicle,
        _level(report.rel_ned_m),
        report.age_s,
        report.silent,
        report.relays,
        report.received,
        every_height=True,
        elsewhere=tuple([_level(rel) for rel in report.elsewhere]),
    )


def _level(rel_ned_m: Vec3) -> Vec3:
    return (rel_ned_m[0], rel_ned_m[1], 0.0)
