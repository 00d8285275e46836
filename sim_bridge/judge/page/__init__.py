"""`report.html`: one file that replays a flight, opens from disk, and asks nothing of any network."""

from __future__ import annotations

import html
import webbrowser
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

from mission.model import Mission
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics import Metrics
from sim_bridge.judge.page.coding import pack
from sim_bridge.judge.page.replay import Verdict, replay
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.report import run_folder
from sim_bridge.options.report import PAGE_NAME as PAGE_NAME

BUNDLE: Final = Path(__file__).parent / "bundle"  # what `npm run build` makes of web/
# The browser itself refuses any request: the page's own scripts and styles are in it.
POLICY: Final = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; "
    "form-action 'none'"
)


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
    run_folder.write(path, page(document, title).encode())
    return path


def show(file: Path) -> None:
    """Open a page in the reader's browser."""
    webbrowser.open(file.resolve().as_uri())


@cache
def _bundled(name: str) -> str:
    return (BUNDLE / name).read_text(encoding="utf-8")


def page(document: dict[str, Any], title: str) -> str:
    """The HTML of `document`, what docs/reference/replay.md describes."""
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{html.escape(title)}</title>
<link rel="icon" href="data:,">
<style>{_bundled("page.css")}</style>
</head>
<body>
<main id="page"><h1>{html.escape(title)}</h1><noscript>This page needs JavaScript.</noscript></main>
<script type="text/plain" id="data">{pack(document)}</script>
<script>{_bundled("page.js")}</script>
</body>
</html>
"""
