"""`report.html`: one file that replays a flight, opens from disk, and asks nothing of any network."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mission.document.model import Mission
from sim_bridge.judge import run_folder
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics import Metrics
from sim_bridge.judge.page.black_boxes import box_section, read_boxes
from sim_bridge.judge.page.html import BUNDLE, page
from sim_bridge.judge.page.replay import Verdict, replay
from sim_bridge.judge.recording import Recording
from sim_bridge.options.report import PAGE_NAME

__all__ = ["BUNDLE", "PAGE_NAME", "page", "show", "write_flight"]


def write_flight(
    recording: Recording,
    mission: Mission,
    folder: Path,
    *,
    title: str,
    metrics: Metrics,
    verdict: Verdict,
    figures: Mapping[str, Any],
    faults: Sequence[FaultEvent] = (),
) -> Path:
    """Write the page of a flight into its run folder; its file. As `replay`; OSError as run_folder.write."""
    document = replay(
        recording, mission, folder, title=title, metrics=metrics, verdict=verdict, figures=figures, faults=faults
    )
    path = folder / PAGE_NAME
    run_folder.write(path, page(document, title, box_section(read_boxes(folder))).encode())
    return path


def show(where: Path | str) -> bool:
    """Open a page, a file or an address, in the reader's browser; False where there is no display, or no browser."""
    return _has_display() and webbrowser.open(where if isinstance(where, str) else where.resolve().as_uri())


def _has_display() -> bool:
    """False: what would be opened is a browser for terminals, in the midst of what we write."""
    shown_by = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in shown_by)
