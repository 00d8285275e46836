"""The program `companion`; also `python -m companion`."""

import signal
import sys


def main() -> int:
    """`companion.cli`. Returns the exit code."""
    until_stopped = sys.argv[1:2] in (["run"], ["watch"], ["lidar"])
    if until_stopped:
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # until the loop takes both
    try:
        from companion import cli

        return cli.main()
    except KeyboardInterrupt:  # before a flight nothing is open yet
        return 0 if until_stopped else 130


if __name__ == "__main__":
    sys.exit(main())
