"""A plan of a stand as SVG: trunks, crowns, undergrowth, boxes, and a mission's route and fence in it. North is up."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from html import escape

from mission.common.plane import Point
from mission.document.model import CoverageShape, Mission
from mission.rules.flight_rules import placement_radius_m
from mission.stand.stand import Stand

WIDTH_PX = 1000.0
EDGE_M = 5.0
TRUNK, CROWN, BUSH, BOX, WAY, FENCE, INK = "#5b3a1e", "#4a7c43", "#a9b665", "#8a8f94", "#c0392b", "#2c6fbb", "#222222"
SCALES_M = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)


def drawn(stand: Stand, mission: Mission | None, title: str) -> str:
    """The SVG document. ValueError when there is nothing to draw."""
    points = [(tree.east_m, tree.north_m) for tree in (*stand.trees, *stand.bushes)]
    points += [corner for box in stand.boxes for corner in box.corners()]
    if mission is not None:
        points += [(p[0], p[1]) for p in mission.route.points_enu_m] + list(mission.fence.polygon_enu_m or ())
    if not points:
        raise ValueError("nothing to draw")
    west, east = min(p[0] for p in points) - EDGE_M, max(p[0] for p in points) + EDGE_M
    south, north = min(p[1] for p in points) - EDGE_M, max(p[1] for p in points) + EDGE_M
    wide_m, high_m = east - west, north - south
    parts = [*_ground(stand), *([] if mission is None else _mission(mission)), *_scale(west, south, wide_m)]
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH_PX:g}" height="{WIDTH_PX * high_m / wide_m:.0f}" '
        f'viewBox="{west:.2f} {-north:.2f} {wide_m:.2f} {high_m:.2f}" font-family="sans-serif" fill="{INK}">'
    )
    about = f"<title>{escape(title)}</title>"
    paper = f'<rect x="{west:.2f}" y="{-north:.2f}" width="{wide_m:.2f}" height="{high_m:.2f}" fill="#ffffff"/>'
    return "\n".join((head, about, paper, *parts, "</svg>")) + "\n"


def _ground(stand: Stand) -> Iterator[str]:
    yield from _discs(((b.east_m, b.north_m, b.radius_m) for b in stand.bushes), f'fill="{BUSH}" fill-opacity="0.6"')
    crowns = ((t.east_m, t.north_m, t.crown_radius_m) for t in stand.trees if t.crown_base_m < t.height_m)
    yield from _discs(crowns, f'fill="{CROWN}" fill-opacity="0.18"')
    yield from _discs(((t.east_m, t.north_m, t.radius_m) for t in stand.trees), f'fill="{TRUNK}"')
    for box in stand.boxes:
        path = " ".join(f"{east_m:.2f},{-north_m:.2f}" for east_m, north_m in box.corners())
        yield f'<polygon points="{path}" fill="{BOX}"/>'


def _discs(circles: Iterable[tuple[float, float, float]], style: str) -> Iterator[str]:
    yield f"<g {style}>"
    for east_m, north_m, radius_m in circles:
        yield f'<circle cx="{east_m:.2f}" cy="{-north_m:.2f}" r="{radius_m:.3f}"/>'
    yield "</g>"


def _mission(mission: Mission) -> Iterator[str]:
    route = mission.route
    if mission.fence.polygon_enu_m:
        yield _line((*mission.fence.polygon_enu_m, mission.fence.polygon_enu_m[0]), FENCE, 0.4, dashes="2 1")
    yield _line([(p[0], p[1]) for p in route.points_enu_m], WAY, 0.4)
    yield _ring(route.d1_enu_m, placement_radius_m(mission), WAY)
    for visit in mission.visits:
        yield _ring(visit.pos_enu_m, mission.coverage.radius_m, WAY)
        if mission.coverage.shape is CoverageShape.RING:
            yield _ring(visit.pos_enu_m, mission.coverage.keep_out_m, FENCE)
    names = ["d1", *(f"stop {k}" for k in range(1, len(route.stops) + 1)), "d2"]
    for name, pos_enu_m in zip(names, route.points_enu_m, strict=True):
        east_m, north_m, _ = pos_enu_m
        yield f'<text x="{east_m + 1.0:.2f}" y="{-north_m - 1.0:.2f}" font-size="4" fill="{WAY}">{name}</text>'


def _ring(pos_enu_m: Sequence[float], radius_m: float, colour: str) -> str:
    style = f'fill="none" stroke="{colour}" stroke-width="0.25" stroke-dasharray="1 0.7"'
    return f'<circle cx="{pos_enu_m[0]:.2f}" cy="{-pos_enu_m[1]:.2f}" r="{radius_m:.2f}" {style}/>'


def _line(points: Sequence[Point], colour: str, width_m: float, dashes: str = "none") -> str:
    path = " ".join(f"{east_m:.2f},{-north_m:.2f}" for east_m, north_m in points)
    style = f'fill="none" stroke="{colour}" stroke-width="{width_m}" stroke-dasharray="{dashes}"'
    return f'<polyline points="{path}" {style}/>'


def _scale(west: float, south: float, wide_m: float) -> Iterator[str]:
    """A bar of about a tenth of the width, with its length."""
    length_m = min(SCALES_M, key=lambda scale_m: abs(math.log(scale_m / (0.1 * wide_m))))
    left, base, size = west + 0.02 * wide_m, -south - 0.02 * wide_m, 0.016 * wide_m
    yield f'<rect x="{left:.2f}" y="{base:.2f}" width="{length_m:g}" height="{0.004 * wide_m:.2f}"/>'
    yield f'<text x="{left:.2f}" y="{base - 0.3 * size:.2f}" font-size="{size:.2f}">{length_m:g} m, north up</text>'
