"""Cuts of the safety filter and beacons heard, of the black boxes in a run folder: a table below the replay."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from companion.journal.reading import (
    BlackBoxError,
    Break,
    CutOff,
    Flight,
    Gap,
    Item,
    NoBlackBoxError,
    Recorded,
    Start,
    find_flights,
    read_flight,
)
from companion.journal.summary import Summary
from mission.common.problems import printable
from sim_bridge.options.report import BOXES_NAME

FOLDER_NAME: Final = BOXES_NAME
DAMAGES_MAX: Final = 20  # of a box, that are told
TEXT_MAX: Final = 300  # characters of one

_HEAD = "<tr><th>vehicle</th><th>flight</th><th>what</th><th>how much</th><th>at most</th><th>over its time</th></tr>"
_SECTION = '<section style="max-width: 1680px; margin: 0 auto; padding: 0 18px 30px">{}</section>'


@dataclass(slots=True)
class Box:
    """The black box of one flight of one vehicle, summed up as far as it could be read."""

    file: Path  # its first; of what stands where the folder should be, that
    flight: Flight | None = None
    summary: Summary = field(default_factory=Summary)
    damages: list[str] = field(default_factory=list)  # what no companion leaves: changed, or cannot be read
    lacks: list[str] = field(default_factory=list)  # what a kill, a loss of power or a full disk leaves

    @property
    def name(self) -> str:
        """Whose it is."""
        return f"vehicle {self.flight.vehicle_id}, flight {self.flight.number}" if self.flight else str(self.file)

    def take_item(self, item: Item) -> None:
        """Add what was read of it."""
        match item:
            case Recorded() if not item.is_end:
                self.summary.add(item.body)
            case Break():
                self.damage(f"broken chain: {item.what}")
            case Gap():
                self._lack(f"gap: ticks {item.first} to {item.last} were lost ({item.why})")
            case CutOff() if not any(item.what in damage for damage in self.damages):
                end = "behind its last entry" if item.has_last_entry else "and may lack ticks"
                self._lack(f"ends without being closed, {end}: {item.what}")

    def damage(self, what: str) -> None:
        """Note what is damaged."""
        _note(self.damages, what)

    def _lack(self, what: str) -> None:
        _note(self.lacks, what)


def _note(notes: list[str], what: str) -> None:
    if len(notes) < DAMAGES_MAX:
        notes.append(printable(what, TEXT_MAX))
    elif len(notes) == DAMAGES_MAX:
        notes.append("and more")


def read_boxes(folder: Path) -> list[Box]:
    """The black boxes of a run folder, summed up, the damaged ones as far as they can be; none where there are none."""
    path = folder / FOLDER_NAME
    if not path.exists():
        return []
    try:
        return [_read_box(flight) for flight in find_flights(path)]
    except NoBlackBoxError:
        return []
    except BlackBoxError as error:
        box = Box(path)
        box.damage(_without_name(error, path))
        return [box]


def _read_box(flight: Flight) -> Box:
    box, has_start = Box(flight.segments[min(flight.segments)], flight), False
    try:
        for item in read_flight(flight):
            box.take_item(item)
            has_start = has_start or isinstance(item, Start)
    except BlackBoxError as error:
        box.damage(_without_name(error, box.file))
    if not (has_start or box.damages):
        box.damage("its beginning is missing")
    return box


def _without_name(error: BlackBoxError, file: Path) -> str:
    return str(error).removeprefix(f"{file}: ")


def damage_lines(boxes: Sequence[Box]) -> list[str]:
    """The damaged ones, each by its file, with what is wrong first."""
    return [
        f"{box.file}: is a damaged black box: {box.damages[0]}" + (" (and more)" if box.damages[1:] else "")
        for box in boxes
        if box.damages
    ]


def box_lines(boxes: Sequence[Box]) -> list[str]:
    """For the terminal."""
    lines: list[str] = []
    for box in boxes:
        lines.append(f"black box of {box.name}")
        if box.summary.ticks or not box.damages:
            lines += box.summary.lines()
        lines += [f"  DAMAGED: {what}" for what in box.damages]
        lines += [f"  {what}" for what in box.lacks]
    return lines


def box_section(boxes: Sequence[Box]) -> str:
    """For the page; empty: there are none."""
    if not boxes:
        return ""
    rows = "".join(row for box in boxes for row in _rows(box))
    table = f'<div class="wide"><table><thead>{_HEAD}</thead><tbody>{rows}</tbody></table></div>'
    note = '<p class="note">Of the black boxes; `companion replay` runs them again.</p>'
    title = "<summary>Setpoints cut by the safety filter, beacons heard</summary>"
    return _SECTION.format(f"<details open>{title}{table}{note}</details>")


def _rows(box: Box) -> list[str]:
    """One for each thing that is wrong with it, for each reason of a cut, then for each fate of a beacon."""
    summary = box.summary
    wrong = [f"DAMAGED: {what}" for what in box.damages] + box.lacks
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
    who = "".join(f"<td>{cell}</td>" for cell in _who(box))
    return [f'<tr>{who}<td colspan="4">{html.escape(what)}</td></tr>' for what in wrong] + [
        f"<tr>{who}" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in found
    ]


def _who(box: Box) -> tuple[str, str]:
    return (str(box.flight.vehicle_id), str(box.flight.number)) if box.flight else (FOLDER_NAME, "")
