"""`mission edit`: a page in the browser to plan a mission by clicking."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import webbrowser
from pathlib import Path
from typing import Any

from mission.common.exit_codes import EXIT_DONE, EXIT_ENVIRONMENT

_ABOUT = """\
Serves a page on this computer, at 127.0.0.1, and prints its address. There one plans by clicking: stem map, d1, d2,
stops and fence on the map, numbers beside it. Each change is checked as `mission check` does, and written by Save
alone; a stem map from elsewhere is copied beside the mission. Ctrl-C ends it.
"""
LOOK_S = 0.2  # at whether it is to stop


def add_parser(commands: Any) -> None:
    """`edit`."""
    parser = commands.add_parser(
        "edit",
        help="plan a mission by clicking, in the browser",
        description=_ABOUT,
        epilog="exit codes: 0 ended by SIGINT or SIGTERM, 2 wrong usage or a file is refused, 3 the port cannot be had",
    )
    parser.add_argument("file", metavar="FILE.toml", help="a mission file; where there is none yet, a new one is begun")
    parser.add_argument("--stems", metavar="FILE", help="begin a new mission in this stem map: .csv, .geojson or .gpkg")
    parser.add_argument("--port", type=_port, default=0, metavar="P", help="of the page (default: a free one)")
    parser.add_argument("--open", action="store_true", help="open the page in the browser")


def run(args: argparse.Namespace) -> int:
    """The exit code; MissionError is for the caller."""
    try:
        import tomlkit  # noqa: F401  an extra
    except ModuleNotFoundError:
        print("mission edit: tomlkit is not installed: in the checkout, pip install -e '.[edit]'", file=sys.stderr)
        return EXIT_ENVIRONMENT
    from mission.common.signals import Stop
    from mission.edit.api import Api
    from mission.edit.editor import Editor
    from mission.edit.flight import Flight
    from mission.edit.server import EditServer

    draft = _draft(Path(os.path.abspath(args.file)), args.stems)
    flight = Flight()
    try:
        server = EditServer(Api(Editor(draft), flight), args.port)
    except OSError as error:
        print(f"mission edit: --port {args.port}: {os.strerror(error.errno or 0)}", file=sys.stderr)
        return EXIT_ENVIRONMENT
    with server:
        print(f"plan at {server.url}", flush=True)
        if args.open:
            webbrowser.open(server.url)
        server.timeout = LOOK_S
        with Stop() as stop, contextlib.closing(flight):
            while not stop.asked:
                server.handle_request()
    if not draft.is_saved:
        print(f"mission edit: {args.file}: the last changes were not saved", file=sys.stderr)
    return EXIT_DONE


def _draft(path: Path, stems: str | None) -> Any:
    """The file's, or a new one. MissionError."""
    from mission.common.files import refused
    from mission.edit.beginning import begin_text, bring_stems
    from mission.edit.draft import Draft, open_draft

    if path.suffix != ".toml":
        raise refused(path.name, None, "must be a mission file, which ends in .toml")
    if path.exists():
        if stems is not None:
            raise refused("--stems", None, f"{path.name} is there already: choose its stem map on the page")
        return open_draft(path)
    if not path.parent.is_dir():
        raise refused(str(path), None, "its folder is not there")
    beside = None if stems is None else bring_stems(Path(stems), path.parent)
    return Draft(path, begin_text(path.stem, beside), None)


def _port(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and int(text[:6]) < 1 << 16):
        raise argparse.ArgumentTypeError(f"{text[:20]}: must be 0 (a free one) to 65535")
    return int(text)
