"""Cuts of the safety filter and beacons heard, of the black boxes in a run folder: a table below the replay."""

from __future__ import annotations

import contextlib
import html
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from companion.journal.reading import BlackBoxError, Flight, find_flights
from companion.journal.summary import Summary, summarise_flight
from sim_bridge.options.report import BOXES_NAME

FOLDER_NAME: Final = BOXES_NAME
Box = tuple[Flight, Summary]

_HEAD = "<tr><th>vehicle</th><th>flight</th><th>what</th><th>how much</th><th>at most</th><th>over its time</th></tr>"
_SECTION = '<section style="max-width: 1680px; margin: 0 auto; padding: 0 18px 30px">{}</section>'


def read_boxes(folder: Path) -> list[Box]:
    """The black boxes of a run folder, summed up; none where there are none, or they cannot be read."""
    boxes: list[Box] = []
    if (folder / FOLDER_NAME).is_dir():
        with contextlib.suppress(BlackBoxError):
            boxes += [(flight, summarise_flight(flight)) for flight in find_flights(folder / FOLDER_NAME)]
    return boxes


def box_lines(boxes: Sequence[Box]) -> list[str]:
    """For the terminal."""
    lines: list[str] = []
    for flight, summary in boxes:
        lines += [f"black box of vehicle {flight.vehicle_id}, flight {flight.number}", *summary.lines()]
    return lines


def box_section(boxes: Sequence[Box]) -> str:
    """For the page; empty: there are none."""
    if not boxes:
        return ""
    rows = "".join(row for flight, summary in boxes for row in _rows(flight, summary))
    table = f'<div class="wide"><table><thead>{_HEAD}</thead><tbody>{rows}</tbody></table></div>'
    note = '<p class="note">Of the black boxes; `companion replay` runs them again.</p>'
    title = "<summary>Setpoints cut by the safety filter, beacons heard</summary>"
    return _SECTION.format(f"<details open>{title}{table}{note}</details>")


def _rows(flight: Flight, summary: Summary) -> list[str]:
    """One for each reason of a cut, then one for each fate of a beacon."""
    found = [
        (
            f"cut by {reason.lower().replace('_', ' ')}",
            f"{100.0 * len(span.times_s) / max(1, summary.ticks):.1f} % of ticks",
            f"{span.most_mps:.2f} m/s",
            summary.timeline(reason),
        )
        for reason, span in sorted(summary.cuts.items())
    ]
    fates = [(f"beacons {fate.lower().replace('_', ' ')}", count) for fate, count in sorted(summary.fates().items())]
    fates += [(f"refused, {reason}", count) for reason, count in sorted(summary.refused.items())]
    found += [(what, str(count), "", "") for what, count in fates]
    who = (str(flight.vehicle_id), str(flight.number))
    return ["<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in (*who, *row)) + "</tr>" for row in found]
