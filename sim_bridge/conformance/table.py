"""The report as people read it: on a terminal and as Markdown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime

import rich.box
import rich.console
import rich.markup
import rich.table

from mission.document.model import Personality
from sim_bridge.conformance import messages, motion, steps
from sim_bridge.conformance.report import Report

SAID = ("commands", "answers", "heartbeat", "landed_state", "streams", "texts")
FLOWN = ("takeoff", "setpoint loss", "landing")
WIDTH_MIN = 125
COMMAND = "make conformance"

LEGEND = (
    f"commands: COMMAND_ACKs (command, result, receiver, order) as recorded, and the longest wait for one, recorded /"
    f" ours; at most {messages.ACK_WITHIN_S * 1e3:.0f} ms.",
    "answers: PARAM_VALUE with its value, AUTOPILOT_VERSION, MESSAGE_INTERVAL, HOME_POSITION to the one that asked.",
    f"heartbeat, landed_state: states in the same order, and the largest difference in time: at most"
    f" {motion.ASKED_WITHIN_S} s; {motion.CLIMB_WITHIN_S:.0f} s at the end of a climb; at the end of a landing"
    f" {motion.LANDING_WITHIN:.0%} of its time, since the recorded ones sank at 0.27 to 0.55 m/s for one setting.",
    f"streams: message ids at the recorded rate, within {messages.RATE_WITHIN:.0%} or {messages.COUNT_WITHIN:.0f}"
    " messages.",
    "texts: STATUSTEXT of warnings and worse, in order, on the link that was recorded.",
    f"takeoff: height reached (within {motion.HEIGHT_WITHIN_M} m) and time to 80 % of it (within"
    f" {motion.CLIMB_WITHIN_S:.0f} s).",
    f"setpoint loss: sink rate from 2.5 to 6.5 s after the last setpoint (within {motion.SINK_WITHIN_MPS} m/s), and how"
    f" far it has come (within {motion.DRIFT_WITHIN_M:.0f} m).",
    "Not compared: EVENT (410) and COMMAND_LONG that PX4 sends by itself, texts below a warning, PARAM_VALUE's index"
    " and count, an answer told twice in a row, rates between the client's requests for streams.",
    "The tolerances of climb, landing and sink were set after seeing these flights: they bound what is, and would miss"
    " an error smaller than they are. Clocks are aligned by the first heartbeat, so that is not compared.",
    f"landing: mean sink rate from its begin until landed (within {motion.SINK_WITHIN_MPS} m/s).",
)


@dataclass(frozen=True, slots=True)
class Grid:
    """A table, wherever it is shown."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def grids(report: Report) -> Iterator[Grid]:
    """Said, flown, steps."""
    for title, names in (("Messages", SAID), ("Flights (recorded / ours)", FLOWN)):
        rows = []
        for flight in report.flights:
            cells = {check.name: check.summary for check in flight.checks}
            unknown = {name for name, _ in flight.verdict.unexplained} | {why.check for why in flight.verdict.stale}
            explained = {name for name, _, _ in flight.verdict.explained}
            marked = [cells[name] + (" !" if name in unknown else " *" if name in explained else "") for name in names]
            rows.append((flight.name, *marked))
        yield Grid(title, ("recording", *names), tuple(rows))
    rows = []
    for row in report.steps:
        times = [f"{low:.2f}-{high:.2f} / {ours:.2f}" for (low, high), ours in zip(row.recorded, row.ours, strict=True)]
        shares = [f"{high:.0%} / {ours:.0%}" for (_, high), ours in zip(row.recorded[3:], row.ours[3:], strict=True)]
        rows.append((row.personality.value, row.kind, *times[:3], *shares, "yes" if row.within else "NO"))
    header = ("ours", "step, m/s", "t10, s", "t63, s", "t90, s", "overshoot", "error", "within")
    yield Grid("Velocity steps (recorded, both autopilots / ours)", header, tuple(rows))


def findings(report: Report) -> Iterator[str]:
    """Differences in words: first those that fail."""
    for flight in report.flights:
        for name, difference in flight.verdict.unexplained:
            yield (
                f"NOT EXPLAINED: {flight.name}, {name}: {difference.what}: recorded {difference.recorded},"
                f" ours {difference.ours}"
            )
        for why in flight.verdict.stale:
            yield f"NO LONGER TRUE: {flight.name}, {why.check}: {why.reason}"
    for why, what in report.unused():
        yield f"NO LONGER TRUE: {what}: {why.reason}"
    for personality in Personality:
        for number, why in enumerate(report.explained(personality), start=1):
            names = ", ".join(sorted(why.recordings)) or "every flight"
            yield f"{personality.value} {number} ({names}, {why.check}): {why.reason}"


def verdict(report: Report) -> str:
    """One line."""
    counts = " / ".join(f"{len(report.explained(personality))} {personality.value}" for personality in Personality)
    state = "holds" if report.holds else "DOES NOT HOLD"
    return f"Conformance {state}: {len(report.flights)} flights, explained differences (*): {counts}."


def show(report: Report) -> None:
    """On the terminal."""
    console = rich.console.Console()
    console.width = max(console.width, WIDTH_MIN)  # rather wrapped by the terminal than in every cell
    for grid in grids(report):
        drawn = rich.table.Table(title=grid.title, box=rich.box.SIMPLE_HEAD, title_justify="left", padding=(0, 1, 0, 0))
        for column in grid.header:
            drawn.add_column(column, no_wrap=True)
        for row in grid.rows:
            drawn.add_row(*map(rich.markup.escape, row))
        console.print(drawn)
    for line in findings(report):
        console.print(rich.markup.escape(line))
    console.print(rich.markup.escape(verdict(report)))


def markdown(report: Report) -> str:
    """The page docs/reference/conformance.md."""
    lines = ["# Conformance with recorded autopilots", ""]
    lines += [
        f"Written by `{COMMAND}` on {datetime.now(UTC):%Y-%m-%d}. What the client sent in each flight recorded from",
        "PX4 1.16 and ArduCopter 4.7-dev (software in the loop; `tests/recordings`) is sent to the bridge's autopilot",
        "at the same times of the autopilot's clock, on JSBSim with full physics, and the answers are compared.",
        "",
        f"**{verdict(report)}**",
    ]
    for grid in grids(report):
        lines += ["", f"## {grid.title}", ""]
        lines += ["| " + " | ".join(grid.header) + " |", "|" + "---|" * len(grid.header)]
        lines += ["| " + " | ".join(row).replace("*", "\\*") + " |" for row in grid.rows]
    lines += ["", f"Within: {steps.RULE}", "", "## Differences", ""]
    lines += [f"- {line}" for line in findings(report)]
    lines += ["", "## Columns", ""]
    lines += [f"- {line}" for line in LEGEND]
    return "\n".join(lines) + "\n"
