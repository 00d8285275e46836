"""Exit codes of the programs."""

EXIT_DONE = 0
EXIT_BAD_FILE = 2  # argparse uses the same for bad usage
EXIT_ENVIRONMENT = 3
EXIT_INTERRUPTED = 130  # as a shell says of SIGINT
