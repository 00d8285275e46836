"""The stand's report: one page of static HTML that opens from disk, without a network, and prints on one sheet."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import Final

from companion.stand.figures.estimate import CLASS_M, DBH_MIN_M, FOUND_MIN, REPEATED_MIN, SeenGround, StandFigures
from companion.stand.figures.intervals import Estimate
from companion.stand.fusion.diameters import BOTH, MEASURED, TAPER
from companion.stand.fusion.fuse import FusedStem, Fusion
from companion.stand.products.payload import quantities_of
from companion.stand.products.plan import Plan, drawn_plan
from companion.stand.records import Harvest
from companion.survey.observation import Grade
from mission import __version__
from mission.document.model import Mission

POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
STYLE: Final = """\
:root { color-scheme: light dark; --ground: #ffffff; --panel: #f5f7f8; --edge: #cfd6dc; --ink: #1d2327;
  --muted: #515b64; --seen: #dcead8; --good: #6f4a2b; --fair: #b35900; --poor: #b2182b; --bar: #0b62a8; }
@media (prefers-color-scheme: dark) { :root { --ground: #11161a; --panel: #1a2126; --edge: #38434c; --ink: #e8edf1;
  --muted: #a9b5bf; --seen: #1f3524; --good: #c79b6d; --fair: #ffb35c; --poor: #ff8389; --bar: #6db6f2; } }
@media print { :root { color-scheme: light; --ground: #ffffff; --panel: #ffffff; --edge: #cfd6dc; --ink: #1d2327;
  --muted: #515b64; --seen: #dcead8; --good: #6f4a2b; --fair: #b35900; --poor: #b2182b; --bar: #0b62a8; }
  html { font-size: 9.5px !important; } main { max-width: none !important; padding: 0 !important; }
  @page { size: A4; margin: 11mm; } }
* { box-sizing: border-box; }
html { background: var(--ground); color: var(--ink); font: 15px/1.4 system-ui, "Segoe UI", Roboto, sans-serif; }
body { margin: 0; } main { max-width: 1120px; margin: 0 auto; padding: 16px; }
h1 { font-size: 1.4rem; margin: 0 0 4px; } h2 { font-size: 1.05rem; margin: 0 0 4px; }
.answer { font-size: 1.1rem; margin: 0 0 12px; } .muted, caption, figcaption { color: var(--muted); }
.columns { display: grid; grid-template-columns: minmax(0, 3fr) minmax(0, 2fr); gap: 18px; }
@media (max-width: 720px) { .columns { grid-template-columns: minmax(0, 1fr); } }
section { margin-bottom: 12px; } figure { margin: 0; } p { margin: 0 0 6px; } ul { margin: 0; padding-left: 18px; }
figure svg { display: block; width: 100%; max-height: 60vh; border: 1px solid var(--edge); border-radius: 8px; }
.wide { overflow-x: auto; } table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding-bottom: 4px; font-size: 0.9rem; }
th, td { text-align: right; padding: 2px 8px; border-bottom: 1px solid var(--edge); }
th { font-weight: 600; } th[scope="row"] { font-weight: 400; } th:first-child { text-align: left; padding-left: 0; }
td.bar { width: 35%; } td.bar i { display: block; height: 0.8em; background: var(--bar); }
.seen rect { fill: var(--seen); } .area { fill: none; stroke: var(--muted); } .ink { fill: var(--ink); }
circle { fill: var(--ground); stroke: var(--good); } circle.good { fill: var(--good); }
circle.fair { stroke: var(--fair); } circle.poor { stroke: var(--poor); stroke-dasharray: 0.4 0.3; }
circle.left { opacity: 0.6; }
"""


def report_page(mission: Mission, harvest: Harvest, fusion: Fusion, ground: SeenGround, origin_note: str = "") -> str:
    """The document of the mission's stand. `origin_note`: what is to be said of its origin."""
    name, area_m = mission.name, mission.surveyed_enu_m
    title = f"Stand report: {escape(name)}"
    figures = ground.figures
    lines = [*_made(mission, harvest, origin_note), *_method(harvest, fusion)]
    plan = drawn_plan(fusion.stems, ground, area_m, f"Stems of {name}")
    distribution = "" if figures is None else "\n".join(_distribution(figures))
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>
{STYLE}</style>
</head>
<body>
<main>
<h1>{title}</h1>
<p class="answer">{_answer(figures)}</p>
<div class="columns">
<div>
<section><h2>Map of stems</h2>
<figure>{"" if plan is None else plan.svg}<figcaption>{_legend(plan, fusion.stems)}</figcaption></figure></section>
<section><h2>How it was measured</h2>
<ul>{"".join(f"<li>{line}</li>" for line in lines)}</ul></section>
</div>
<div>
<section><h2>Stand</h2>{_stand(figures)}</section>
<section><h2>Diameters</h2>{distribution}</section>{_payload(harvest)}
<section><h2>Not seen</h2>{"".join(f"<p>{line}</p>" for line in _unseen(figures, fusion.stems))}</section>
</div>
</div>
<p class="muted">Intervals of 95 %. Made by understory {escape(__version__)}.</p>
</main>
</body>
</html>
"""


def _answer(figures: StandFigures | None) -> str:
    """The finding in a sentence."""
    if figures is None:
        return "Too little ground was seen, or too few stems were found, for figures per hectare."
    area = "the ground that was seen"
    if figures.area_ha is not None:
        area = f"the mission's area of {figures.area_ha:.2f} ha ({100.0 * figures.seen_share:.0f} % seen)"
    return (
        f"Basal area {_said(figures.basal_area_m2_per_ha, 1)} m²/ha and {_said(figures.stems_per_ha, 0)} stems/ha "
        f"on {area}, of stems from {100.0 * DBH_MIN_M:g} cm."
    )


def _said(estimate: Estimate, digits: int) -> str:
    if estimate.low is None or estimate.high is None:
        return f"{estimate.value:.{digits}f} (interval not known)"
    return f"{estimate.value:.{digits}f} ({estimate.low:.{digits}f} to {estimate.high:.{digits}f})"


def _stand(figures: StandFigures | None) -> str:
    if figures is None:
        return "<p>No figures.</p>"
    rows = (
        ("Stems", "per ha", figures.stems_per_ha, 0),
        ("Basal area", "m²/ha", figures.basal_area_m2_per_ha, 1),
        ("Volume", "m³/ha", figures.volume_m3_per_ha, 0),
        ("Mean diameter", "cm", figures.dbh_mean_cm, 1),
        ("Quadratic mean diameter", "cm", figures.dbh_quadratic_mean_cm, 1),
    )
    body = "".join(
        f'<tr><th scope="row">{what}</th><td>{unit}</td><td>{estimate.value:.{digits}f}</td>'
        f"<td>{_bound(estimate.low, digits)}</td><td>{_bound(estimate.high, digits)}</td></tr>"
        for what, unit, estimate, digits in rows
    )
    return (
        f"<table><caption>Stems from {100.0 * DBH_MIN_M:g} cm at breast height; {figures.stems} were found.</caption>"
        '<thead><tr><th scope="col">Figure</th><th scope="col">Unit</th><th scope="col">Estimate</th>'
        f'<th scope="col">Low</th><th scope="col">High</th></tr></thead><tbody>{body}</tbody></table>'
        f'<p class="muted">Volume is basal area times a form height of {figures.form_height_m:.1f} m, which nobody '
        "measured: with yours, multiply by it over this. The interval is of the basal area alone.</p>"
    )


def _bound(value: float | None, digits: int) -> str:
    return "not known" if value is None else f"{value:.{digits}f}"


def _distribution(figures: StandFigures) -> Iterator[str]:
    most = max((c.stems_per_ha.value for c in figures.classes), default=0.0) or 1.0
    yield "<table><caption>Stems per hectare in classes of diameter at breast height</caption>"
    yield '<thead><tr><th scope="col">Class, cm</th><th scope="col">Stems/ha</th><th scope="col">Low</th>'
    yield '<th scope="col">High</th><th scope="col"><span class="muted">Share</span></th></tr></thead><tbody>'
    for row in figures.classes:
        value, low, high = row.stems_per_ha
        width = 100.0 * value / most
        yield f'<tr><th scope="row">{row.from_cm} to {row.from_cm + round(100 * CLASS_M)}</th><td>{value:.0f}</td>'
        yield f"<td>{_bound(low, 0)}</td><td>{_bound(high, 0)}</td>"
        yield f'<td class="bar"><i style="width:{width:.0f}%"></i></td></tr>'
    yield "</tbody></table>"


def _payload(harvest: Harvest) -> str:
    """The section of other sensors; empty: none was recorded."""
    quantities = quantities_of(harvest.payload)
    if not quantities:
        return ""
    body = "".join(
        f'<tr><th scope="row">{escape(one.name)}</th><td>{escape(one.unit)}</td><td>{one.n}</td><td>{one.mean:.4g}</td>'
        f"<td>{'' if one.sd is None else f'{one.sd:.3g}'}</td><td>{one.min:.4g}</td><td>{one.max:.4g}</td></tr>"
        for one in quantities
    )
    columns = ("Quantity", "Unit", "Values", "Mean", "SD", "Least", "Greatest")
    head = "".join(f'<th scope="col">{column}</th>' for column in columns)
    return (
        "\n<section><h2>Other sensors</h2><table><caption>Where the vehicles flew, each value once; SD: between values."
        f"</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></section>"
    )


def _legend(plan: Plan | None, stems: Sequence[FusedStem]) -> str:
    if plan is None:
        return "Nothing to draw."
    circles = (
        f"Circles: stems, {plan.times:g} times as thick as they are, filled of grade good, open of fair, broken of "
        "poor, and pale where not counted. "
    )
    return f"Green: ground that the figures are of. {circles * bool(stems)}Line: the mission's area."


def _made(mission: Mission, harvest: Harvest, origin_note: str) -> Iterator[str]:
    """Mission, sensor, place, and the records that there are."""
    sensor = "no obstacle sensor" if mission.sensing is None else f"sensor {mission.sensing.sensor.value}"
    if mission.origin is None:
        place = "no [origin], so places are in metres of the mission's frame and not on Earth"
    else:
        place = f"origin {mission.origin.lat_deg:.6f}, {mission.origin.lon_deg:.6f}{origin_note}"
    yield escape(f"Mission {mission.name}: {sensor}; {place}.")
    vehicles = len({log.vehicle_id for log in harvest.counted()})
    records = len(harvest.records)
    signed = ", each signed by the one that made it" * bool(records and all(r.proven for r in harvest.records))
    yield f"{records} record{'s' * (records != 1)} of {vehicles} vehicle{'s' * (vehicles != 1)}{signed}."
    unproven = harvest.unproven_line()
    if unproven is not None:
        yield f"<strong>{unproven}</strong>: whoever was in radio range may have made them."
    missing = harvest.missing_line()
    if missing is not None:
        yield f"<strong>{missing}</strong>: what they saw is in no figure."


def _method(harvest: Harvest, fusion: Fusion) -> Iterator[str]:
    stems = fusion.stems
    if not stems:
        yield "No stem was found."
        return
    vehicles = sorted({v for s in stems for v in s.vehicles})
    seen = sum(len(s.vehicles) > 1 for s in stems)
    yield (
        f"{len(harvest.observations)} observations by {len(vehicles)} vehicle{'s' * (len(vehicles) != 1)} became "
        f"{len(stems)} stems; {seen} of them were seen by two or more."
    )
    cuts = sorted(s.cut_up_m for s in stems)
    yield (
        f"Cut at {cuts[0]:.1f} to {cuts[-1]:.1f} m above the ground (median {cuts[len(cuts) // 2]:.1f} m). Diameter at "
        f"breast height (1.3 m): {_share(stems, MEASURED)} measured there, {_share(stems, TAPER)} by taper from the "
        f"cut, {_share(stems, BOTH)} by both."
    )
    grades = {grade: sum(s.grade is grade for s in stems) for grade in Grade}
    yield (
        f"Grades: {grades[Grade.GOOD]} good, {grades[Grade.FAIR]} fair, {grades[Grade.POOR]} poor. Poor ones are in no "
        "figure: what they miss, the correction for stems that were not found makes good."
    )
    middle = len(stems) // 2
    yield (
        f"Median standard error of a stem: diameter {100.0 * sorted(s.dbh_sd_m for s in stems)[middle]:.1f} cm, "
        f"position {sorted(s.position_sd_m for s in stems)[middle]:.2f} m north and east."
    )
    if harvest.refused:
        yield f"{harvest.refused} records could not be read and are left out."


def _share(stems: Sequence[FusedStem], how: str) -> int:
    return sum(s.dbh_from == how for s in stems)


def _unseen(figures: StandFigures | None, stems: Sequence[FusedStem]) -> Iterator[str]:
    if figures is None:
        yield "Figures need ground that was looked at twice at least, by two vehicles or on two passes."
        return
    if figures.area_ha is not None:
        rest = max(0.0, figures.area_ha - figures.seen_ha)
        share = 100.0 * figures.seen_share
        yield (
            f"{figures.seen_ha:.2f} ha of {figures.area_ha:.2f} ha were seen ({share:.0f} %); {rest:.2f} ha were not. "
            "The figures take these to be as the rest: the interval says how far that may be off."
        )
    else:
        yield f"{figures.seen_ha:.2f} ha were seen; the figures are of them, and say nothing of ground beyond."
    yield (
        f"Ground counts as seen where a stem would have been found with {100.0 * FOUND_MIN:.0f} % at least; with fewer "
        f"than {REPEATED_MIN} stems that were looked at twice, only where it was looked at twice. Of the stems on it "
        f"about {100.0 * figures.found_share:.0f} % were found; the figures are corrected for the others."
    )
    outside = len(stems) - figures.stems
    yield f"{outside} stems are in the map and the files, but not in the figures: elsewhere, thinner, or not counted."
    yield "Not measured: heights, species, stems below the thinnest that the sensor resolves."
