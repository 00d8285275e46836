"""The program `companion`; also `python -m companion`."""

import gc
import sys


def main() -> int:
    """`companion.cli`, loaded without collections, as what loading makes stays. Returns the exit code."""
    gc.disable()
    from companion import cli

    gc.freeze()
    gc.enable()
    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
