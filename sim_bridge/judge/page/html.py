"""The page's HTML: its bundle, and in it a document, or where its stream is."""

from __future__ import annotations

import html
from functools import cache
from pathlib import Path
from typing import Any, Final

from sim_bridge.judge.page.coding import pack

BUNDLE: Final = Path(__file__).parent / "bundle"  # what `npm run build` makes of web/
STREAM: Final = "live"  # of a live page, relative to it
AROUND: Final = "around"  # instead: a page that frames this one sends, over a channel that it is handed
# The browser itself refuses any request: the page's own scripts and styles are in it.
POLICY: Final = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; "
    "form-action 'none'"
)


def page(document: dict[str, Any], title: str, below: str = "") -> str:
    """Of `document`, what docs/reference/replay.md describes; it opens from disk and asks nothing of any network.

    `below`: HTML that stands below it.
    """
    policy = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
    return _page(title, policy, f'{below}<script type="text/plain" id="data">{pack(document)}</script>')


def live_page(title: str, stream: str = STREAM) -> str:
    """Of a flight under way: docs/reference/live.md describes its stream. To be sent with `live_policy`.

    `stream`: AROUND for a page that another one frames, and sends to.
    """
    policy = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">' if stream == AROUND else ""
    return _page(title, policy, f'<script type="text/plain" id="data" data-stream="{stream}"></script>')


def live_policy(host: str) -> str:
    """Content-Security-Policy of the live page that `host` (ADDRESS:PORT) sends: its own stream, and nothing else."""
    return f"{POLICY}; connect-src ws://{host}; frame-ancestors 'none'"


@cache
def _bundled(name: str) -> str:
    return (BUNDLE / name).read_text(encoding="utf-8")


def _page(title: str, policy: str, data: str) -> str:
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
{policy}
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{html.escape(title)}</title>
<link rel="icon" href="data:,">
<style>{_bundled("page.css")}</style>
</head>
<body>
<main id="page"><h1>{html.escape(title)}</h1><noscript>This page needs JavaScript.</noscript></main>
{data}
<script>{_bundled("page.js")}</script>
</body>
</html>
"""
