"""Generate dialect.py from swarm.xml with pymavlink's mavgen; `--check` only compares."""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
from pathlib import Path

from pymavlink.generator import mavgen, mavparse

HERE = Path(__file__).parent


def generated() -> str:
    """The text that mavgen makes of swarm.xml, the same from run to run."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "dialect"
        options = mavgen.Opts(str(out), wire_protocol=mavparse.PROTOCOL_2_0, language="Python3", validate=False)
        with contextlib.redirect_stdout(io.StringIO()) as told:
            done = mavgen.mavgen(options, [str(HERE / "swarm.xml")])
        if not done:
            raise SystemExit(f"mavgen refused swarm.xml:\n{told.getvalue()}")
        return out.with_suffix(".py").read_text(encoding="utf-8")


def main() -> int:
    """Exit code 1 when `--check` finds dialect.py out of date."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare with dialect.py instead of writing it")
    check = parser.parse_args().check
    target = HERE / "dialect.py"
    text = generated()
    if check:
        if target.read_text(encoding="utf-8") != text:
            print("dialect.py is not what swarm.xml generates: run `make dialect`", file=sys.stderr)
            return 1
        return 0
    target.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
