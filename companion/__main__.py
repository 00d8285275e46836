"""The program `companion`; also `python -m companion`."""

import gc
import signal
import sys


def main() -> int:
    """`companion.cli`, loaded without collections, as what loading makes stays. Returns the exit code."""
    runs = sys.argv[1:2] == ["run"]
    if runs:
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # until the loop takes both
    try:
        return _main()
    except KeyboardInterrupt:  # before a flight nothing is open yet
        return 0 if runs else 130


def _main() -> int:
    gc.disable()
    from companion import cli

    gc.freeze()
    gc.enable()
    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
