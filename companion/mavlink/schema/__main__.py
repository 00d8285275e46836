"""Write what is generated from the schema of our own messages. `--check` only compares."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import companion
from companion.mavlink.schema.generate import generated

ROOT = Path(companion.__path__[0]).parent


def main() -> int:
    """Exit code 1 when `--check` finds a file out of date."""
    parser = argparse.ArgumentParser(prog="python -m companion.mavlink.schema", description=__doc__, allow_abbrev=False)
    parser.add_argument("--check", action="store_true", help="compare with the files instead of writing them")
    check = parser.parse_args().check
    stale = 0
    for name, text in generated(ROOT).items():
        path = ROOT / name
        if not check:
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            print(f"{name} is not what the schema generates: run `make dialect`", file=sys.stderr)
            stale = 1
    return stale


if __name__ == "__main__":
    sys.exit(main())
