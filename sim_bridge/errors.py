"""Errors that end `sim-bridge` with a message instead of a traceback."""

from __future__ import annotations


class StartError(Exception):
    """The bridge cannot start. `exit_code`: EXIT_BAD_FILE for wrong usage, else EXIT_ENVIRONMENT."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code
