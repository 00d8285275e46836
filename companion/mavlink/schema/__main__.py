"""Generate what is made of the schema: dialect.py with its types from swarm.xml. `--check` only compares."""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
from pathlib import Path

from pymavlink.generator import mavgen, mavparse

import companion
from companion.mavlink.schema.stub import stub

ROOT = Path(companion.__path__[0]).parent
SWARM_XML = "companion/mavlink/swarm.xml"


def generated() -> dict[str, str]:
    """File, from the root -> the text that it is to have; the same from run to run."""
    dialect = dialect_of(ROOT / SWARM_XML)
    return {
        "companion/mavlink/dialect.py": dialect,
        "companion/mavlink/dialect.pyi": stub(dialect),
    }


def dialect_of(definition: Path) -> str:
    """The text that mavgen makes of a definition."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "dialect"
        options = mavgen.Opts(str(out), wire_protocol=mavparse.PROTOCOL_2_0, language="Python3", validate=False)
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            done = mavgen.mavgen(options, [str(definition)])
        if not done:
            raise SystemExit(f"mavgen refused {definition}:\n{printed.getvalue()}")
        return out.with_suffix(".py").read_text(encoding="utf-8")


def main() -> int:
    """Exit code 1 when `--check` finds a file out of date."""
    parser = argparse.ArgumentParser(prog="python -m companion.mavlink.schema", description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare with the files instead of writing them")
    check = parser.parse_args().check
    stale = 0
    for name, text in generated().items():
        path = ROOT / name
        if not check:
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            print(f"{name} is not what the schema generates: run `make dialect`", file=sys.stderr)
            stale = 1
    return stale


if __name__ == "__main__":
    sys.exit(main())
