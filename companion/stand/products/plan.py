"""A plan of the stems and the ground seen, as SVG in a page: north up, in metres, with scale bar and north arrow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape
from typing import Final, NamedTuple

import numpy as np

from companion.stand.figures.estimate import SeenGround
from companion.stand.fusion.fuse import FusedStem
from companion.survey.observation import Grade
from mission.common.plane import Point

EDGE_M: Final = 4.0
STRIP: Final = 0.06  # of its width, below the ground: scale bar and north arrow
SHOWN: Final = 0.012  # of the plan's width: what the mean diameter is drawn at, or small stems would not be seen
SCALES_M: Final = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1_000.0, 2_000.0, 5_000.0)
MAX_RECTANGLES: Final = 20_000  # of ground seen; more are not drawn singly


class Plan(NamedTuple):
    """A drawing."""

    svg: str
    times: float  # as thick as they are stems are drawn


def drawn_plan(
    stems: Sequence[FusedStem], ground: SeenGround, area_m: Sequence[Point] | None, title: str
) -> Plan | None:
    """None when there is nothing to draw."""
    seen_m = ground.grid.middle_m[ground.is_seen]
    places = [(s.east_m, s.north_m) for s in stems] + list(area_m or ()) + [(float(e), float(n)) for e, n in seen_m]
    if not places:
        return None
    west, south = (min(p[k] for p in places) - EDGE_M for k in (0, 1))
    east, north = (max(p[k] for p in places) + EDGE_M for k in (0, 1))
    wide_m = east - west
    south -= STRIP * wide_m
    high_m = north - south
    times = _magnification(stems, wide_m)
    parts = [f'<g class="seen">{"".join(_rectangles(ground))}</g>']
    if area_m:
        path = " ".join(f"{e:.2f},{-n:.2f}" for e, n in area_m)
        parts.append(f'<polygon class="area" points="{path}" stroke-width="{0.003 * wide_m:.2f}"/>')
    parts += [_circle(stem, times) for stem in sorted(stems, key=lambda s: -s.dbh_m)]
    parts += _furniture(west, south, east)
    box = f"{west:.2f} {-north:.2f} {wide_m:.2f} {high_m:.2f}"
    about = f"{escape(title)}. {f'Stems are drawn {times:g} times as thick as they are.' if stems else 'None.'}"
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" role="img" aria-label="{about}">'
    return Plan("\n".join((head, f"<title>{escape(title)}</title>", *parts, "</svg>")), times)


def _magnification(stems: Sequence[FusedStem], wide_m: float) -> float:
    """Whole number by which diameters are drawn larger in a plan that is so wide."""
    if not stems:
        return 1.0
    mean_m = sum(s.dbh_m for s in stems) / len(stems)
    return float(max(1, min(20, round(SHOWN * wide_m / mean_m))))


def _circle(stem: FusedStem, times: float) -> str:
    kind = {Grade.GOOD: "good", Grade.FAIR: "fair", Grade.POOR: "poor"}[stem.grade]
    kind += "" if stem.is_counted else " left"
    said = f"{stem.stem_id}: {100.0 * stem.dbh_m:.1f} cm, {kind}"
    radius = stem.dbh_m / 2.0 * times
    return (
        f'<circle class="{kind}" cx="{stem.east_m:.2f}" cy="{-stem.north_m:.2f}" r="{radius:.3f}" '
        f'stroke-width="{0.25 * radius:.3f}"><title>{escape(said)}</title></circle>'
    )


def _rectangles(ground: SeenGround) -> Iterator[str]:
    """Rows of cells seen, in runs."""
    cell_m = ground.grid.cell_m
    cells = np.round(ground.grid.middle_m[ground.is_seen] / cell_m - 0.5).astype(np.int64)
    cells = cells[np.lexsort((cells[:, 0], cells[:, 1]))]
    breaks = np.flatnonzero((np.diff(cells[:, 1]) != 0) | (np.diff(cells[:, 0]) != 1)) + 1
    for run in np.split(cells, breaks)[:MAX_RECTANGLES]:
        if len(run):
            east_m, north_m = run[0] * cell_m
            size = f'width="{len(run) * cell_m:.2f}" height="{cell_m:.2f}"'
            yield f'<rect x="{east_m:.2f}" y="{-(north_m + cell_m):.2f}" {size}/>'


def _furniture(west: float, south: float, east: float) -> Iterator[str]:
    """A scale bar of about a fifth of the width, and a north arrow."""
    wide_m = east - west
    length_m = min(SCALES_M, key=lambda scale_m: abs(math.log(scale_m / (0.2 * wide_m))))
    size, left, base = 0.022 * wide_m, west + 0.02 * wide_m, -south - 0.02 * wide_m
    yield f'<rect class="ink" x="{left:.2f}" y="{base:.2f}" width="{length_m:g}" height="{0.005 * wide_m:.2f}"/>'
    yield f'<text class="ink" x="{left:.2f}" y="{base - 0.4 * size:.2f}" font-size="{size:.2f}">{length_m:g} m</text>'
    x, y = east - 0.06 * wide_m, -south - 0.058 * wide_m
    arrow = f"{x:.2f},{y:.2f} {x + 0.4 * size:.2f},{y + 2.2 * size:.2f} {x - 0.4 * size:.2f},{y + 2.2 * size:.2f}"
    yield f'<polygon class="ink" points="{arrow}"/>'
    yield f'<text class="ink" x="{x + 0.7 * size:.2f}" y="{y + 1.8 * size:.2f}" font-size="{size:.2f}">N</text>'
