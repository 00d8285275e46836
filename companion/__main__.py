"""The program `companion`; also `python -m companion`."""

import os
import signal
import sys


def main() -> int:
    """`companion.cli`. Returns the exit code."""
    until_stopped = sys.argv[1:2] in (["run"], ["watch"], ["lidar"])
    if until_stopped:
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # until the loop takes both
    try:
        from companion import cli

        code = cli.main()
        if not until_stopped and sys.stdout is not None:  # None: it was closed before
            sys.stdout.flush()
        return code
    except KeyboardInterrupt:  # before a flight nothing is open yet
        return 0 if until_stopped else 130
    except OSError as error:  # of its output: a full disk or a closed pipe; commands tell of all else themselves
        if until_stopped:
            raise
        from mission.common.exit_codes import EXIT_ENVIRONMENT

        if not isinstance(error, BrokenPipeError):
            print(f"companion: cannot write: {os.strerror(error.errno or 0)}", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the interpreter flushes once more at its end
        return EXIT_ENVIRONMENT


if __name__ == "__main__":
    sys.exit(main())
