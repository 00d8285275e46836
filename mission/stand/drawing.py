"""A plan of a stand as SVG: trunks, crowns, undergrowth, boxes, and a mission's route and fence in it. North is up.

About it a grid in metres east and north of the origin, which d1 and d2 count from too; with the origin's place on Earth
also latitudes and longitudes. Its units are metres: it fits the window that it is opened in.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import Final, NamedTuple

from mission.common.frames import LocalFrame, Wgs84, enu_to_ned
from mission.common.plane import Point
from mission.document.model import CoverageShape, Mission
from mission.rules.flight_rules import placement_radius_m
from mission.schema.trees import StandTree
from mission.stand.stand import Stand

EDGE_M: Final = 5.0
TRUNK, CROWN, BUSH, BOX, WAY, FENCE, INK = "#5b3a1e", "#4a7c43", "#a9b665", "#8a8f94", "#c0392b", "#2c6fbb", "#222222"
GRID: Final = "#c9ccd1"
SCALES_M = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0)
LINES = 8.0  # of the grid, along the longer side
TEXT = 0.013  # height of letters, in shares of the longer side
NO_IDS: Final[Mapping[Point, str]] = {}


class _Sheet(NamedTuple):
    """The drawn part of the ground, ENU m."""

    west: float
    east: float
    south: float
    north: float

    @property
    def wide_m(self) -> float:
        return self.east - self.west

    @property
    def high_m(self) -> float:
        return self.north - self.south

    @property
    def longer_m(self) -> float:
        """Length that widths of lines and heights of letters are shares of."""
        return max(self.wide_m, self.high_m)

    @property
    def text_m(self) -> float:
        return TEXT * self.longer_m


def drawn(
    stand: Stand,
    mission: Mission | None,
    title: str,
    *,
    origin: Wgs84 | None = None,
    ids: Mapping[Point, str] = NO_IDS,
) -> str:
    """The SVG document. ValueError when there is nothing to draw.

    origin: on Earth, of the metres; None: not known. ids: of trees by their places, which are written beside them.
    """
    points = [(tree.east_m, tree.north_m) for tree in (*stand.trees, *stand.bushes)]
    points += [corner for box in stand.boxes for corner in box.corners()]
    if mission is not None:
        points += [(p[0], p[1]) for p in mission.route.points_enu_m] + list(mission.fence.polygon_enu_m or ())
    if not points:
        raise ValueError("nothing to draw")
    sheet = _Sheet(
        min(p[0] for p in points) - EDGE_M,
        max(p[0] for p in points) + EDGE_M,
        min(p[1] for p in points) - EDGE_M,
        max(p[1] for p in points) + EDGE_M,
    )
    parts = [*_grid(sheet, origin), *_ground(stand), *([] if mission is None else _mission(mission, sheet))]
    parts += [*_ids(stand.trees, ids, sheet), _scale(sheet), _north_arrow(sheet)]
    text_m = sheet.text_m
    above_m, below_m, left_m, right_m = 3.5 * text_m, (4.6 if origin else 3.4) * text_m, 8.5 * text_m, 3.0 * text_m
    left, top = sheet.west - left_m, -sheet.north - above_m
    wide_m, high_m = sheet.wide_m + left_m + right_m, sheet.high_m + above_m + below_m
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="100%" height="100%" '
        f'viewBox="{left:.2f} {top:.2f} {wide_m:.2f} {high_m:.2f}" font-family="sans-serif" fill="{INK}">'
    )
    about = f"<title>{escape(title)}</title>"
    paper = f'<rect x="{left:.2f}" y="{top:.2f}" width="{wide_m:.2f}" height="{high_m:.2f}" fill="#ffffff"/>'
    return "\n".join((head, about, paper, *parts, "</svg>")) + "\n"


def _grid(sheet: _Sheet, origin: Wgs84 | None) -> Iterator[str]:
    """Lines at round metres with these below and to the left, and the latitudes and longitudes there."""
    step_m = min(SCALES_M, key=lambda scale_m: abs(math.log(scale_m * LINES / sheet.longer_m)))
    text_m = sheet.text_m
    frame = None if origin is None else LocalFrame(origin)
    yield f'<g stroke="{GRID}" stroke-width="{0.0008 * sheet.longer_m:.3f}">'
    columns, rows = _multiples(sheet.west, sheet.east, step_m), _multiples(sheet.south, sheet.north, step_m)
    for east_m in columns:
        yield f'<line x1="{east_m:g}" y1="{-sheet.north:.2f}" x2="{east_m:g}" y2="{-sheet.south:.2f}"/>'
    for north_m in rows:
        yield f'<line x1="{sheet.west:.2f}" y1="{0.0 - north_m:g}" x2="{sheet.east:.2f}" y2="{0.0 - north_m:g}"/>'
    yield "</g>"
    yield f'<g font-size="{text_m:.2f}" text-anchor="middle">'
    base = -sheet.south + 1.3 * text_m
    for east_m in columns:
        yield f'<text x="{east_m:g}" y="{base:.2f}">{east_m:g}</text>'
        if frame is not None:
            lon_deg = math.remainder(frame.to_wgs84(enu_to_ned((east_m, sheet.south, 0.0))).lon_deg, 360.0)
            at = f'x="{east_m:g}" y="{base + 1.2 * text_m:.2f}" font-size="{0.8 * text_m:.2f}"'
            yield f"<text {at}>{lon_deg:.6f}°</text>"
    told = "metres east of the origin"
    if origin is not None:
        told += f", {origin.lat_deg:.7f}, {origin.lon_deg:.7f} (WGS84)"
    at = f'x="{sheet.west + sheet.wide_m / 2.0:.2f}" y="{base + (2.6 if origin else 1.5) * text_m:.2f}"'
    yield f"<text {at}>{told}</text>"
    yield "</g>"
    yield f'<g font-size="{text_m:.2f}" text-anchor="end">'
    side = sheet.west - 0.4 * text_m
    for north_m in rows:
        yield f'<text x="{side:.2f}" y="{-north_m + 0.35 * text_m:.2f}">{north_m:g}</text>'
        if frame is not None:
            lat_deg = frame.to_wgs84(enu_to_ned((sheet.west, north_m, 0.0))).lat_deg
            at = f'x="{side:.2f}" y="{-north_m + 1.3 * text_m:.2f}" font-size="{0.8 * text_m:.2f}"'
            yield f"<text {at}>{lat_deg:.6f}°</text>"
    yield "</g>"
    x, y = sheet.west - 7.3 * text_m, -sheet.south - sheet.high_m / 2.0
    turned = f'transform="rotate(-90 {x:.2f} {y:.2f})" text-anchor="middle" font-size="{text_m:.2f}"'
    yield f'<text x="{x:.2f}" y="{y:.2f}" {turned}>metres north</text>'


def _multiples(low: float, high: float, step_m: float) -> list[float]:
    return [k * step_m for k in range(math.ceil(low / step_m), math.floor(high / step_m) + 1)]


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


def _ids(trees: Sequence[StandTree], ids: Mapping[Point, str], sheet: _Sheet) -> Iterator[str]:
    """Each to the right of its trunk, small enough for the next tree to be beside it."""
    if not ids:
        return
    apart_m = math.sqrt(sheet.wide_m * sheet.high_m / len(trees))
    size_m = min(0.8 * sheet.text_m, 0.3 * apart_m)
    yield f'<g font-size="{size_m:.3f}">'
    for tree in trees:
        name = ids.get((tree.east_m, tree.north_m), "")
        if name:
            at = f'x="{tree.east_m + tree.radius_m + 0.2 * size_m:.2f}" y="{-tree.north_m + 0.35 * size_m:.2f}"'
            yield f"<text {at}>{escape(name)}</text>"
    yield "</g>"


def _mission(mission: Mission, sheet: _Sheet) -> Iterator[str]:
    route = mission.route
    if mission.fence.polygon_enu_m:
        yield _line((*mission.fence.polygon_enu_m, mission.fence.polygon_enu_m[0]), FENCE, 0.4, dashes="2 1")
    yield _line([(p[0], p[1]) for p in mission.way_enu_m], WAY, 0.4)
    yield _ring(route.d1_enu_m, placement_radius_m(mission), WAY)
    for visit in mission.trees:
        yield _ring(visit.pos_enu_m, mission.coverage.radius_m, WAY)
        if mission.coverage.shape is CoverageShape.RING:
            yield _ring(visit.pos_enu_m, mission.coverage.keep_out_m, FENCE)
    size_m = 1.6 * sheet.text_m
    for name, pos_enu_m in mission.named_places:
        at = f'x="{pos_enu_m[0] + 0.3 * size_m:.2f}" y="{-pos_enu_m[1] - 0.3 * size_m:.2f}"'
        yield f'<text {at} font-size="{size_m:.2f}" fill="{WAY}">{name}</text>'


def _ring(pos_enu_m: Sequence[float], radius_m: float, colour: str) -> str:
    style = f'fill="none" stroke="{colour}" stroke-width="0.25" stroke-dasharray="1 0.7"'
    return f'<circle cx="{pos_enu_m[0]:.2f}" cy="{-pos_enu_m[1]:.2f}" r="{radius_m:.2f}" {style}/>'


def _line(points: Sequence[Point], colour: str, width_m: float, dashes: str = "none") -> str:
    path = " ".join(f"{east_m:.2f},{-north_m:.2f}" for east_m, north_m in points)
    style = f'fill="none" stroke="{colour}" stroke-width="{width_m}" stroke-dasharray="{dashes}"'
    return f'<polyline points="{path}" {style}/>'


def _scale(sheet: _Sheet) -> str:
    """A bar of about a tenth of the longer side above the plan, with its length."""
    length_m = min(SCALES_M, key=lambda scale_m: abs(math.log(scale_m / (0.1 * sheet.longer_m))))
    text_m, base = sheet.text_m, -sheet.north - sheet.text_m
    bar = f'<rect x="{sheet.west:.2f}" y="{base:.2f}" width="{length_m:g}" height="{0.3 * text_m:.2f}"/>'
    at = f'x="{sheet.west:.2f}" y="{base - 0.4 * text_m:.2f}" font-size="{1.2 * text_m:.2f}"'
    return f"{bar}\n<text {at}>{length_m:g} m</text>"


def _north_arrow(sheet: _Sheet) -> str:
    """Above the plan, to the right."""
    text_m, x, base = sheet.text_m, sheet.east - 2.0 * sheet.text_m, -sheet.north - 0.7 * sheet.text_m
    corners = ((x, base - 2.0 * text_m), (x + 0.6 * text_m, base), (x - 0.6 * text_m, base))
    tip = " ".join(f"{right:.2f},{down:.2f}" for right, down in corners)
    at = f'x="{x + 0.9 * text_m:.2f}" y="{base:.2f}" font-size="{1.2 * text_m:.2f}"'
    return f'<polygon points="{tip}"/>\n<text {at}>N</text>'
