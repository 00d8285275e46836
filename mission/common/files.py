"""A file's bytes, or MissionError: whatever stands at the path, and however much of it."""

from __future__ import annotations

import errno
import json
import os
import stat
from typing import Any

from mission.common.problems import MissionError, Problem, printable

MAX_PLACE_CHARS = 200
_OS_REASONS = {
    errno.ENOENT: "no such file",
    errno.EISDIR: "is a directory: must be a file",
    errno.EACCES: "must be readable: permission denied",
}


def os_words(error: OSError) -> str:
    """For people, without its number: `FILE: no such file`, where it names one. One that has none is as it was said."""
    if error.errno is None:
        return str(error)
    reason = error.strerror or os.strerror(error.errno)
    if reason == os.strerror(error.errno):
        reason = _OS_REASONS.get(error.errno, reason)
    return reason if error.filename is None else f"{printable(str(error.filename), MAX_PLACE_CHARS)}: {reason}"


def refused(place: str, line: int | None, message: str) -> MissionError:
    """A problem with the file as a whole."""
    return MissionError([Problem(place, line, "", "", message)])


def read_bytes(path: str | os.PathLike[str], place: str, most_bytes: int) -> bytes:
    """All of the regular file `path`, at most `most_bytes`; MissionError names `place`."""
    try:
        with open(path, "rb", opener=open_at_once) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise refused(place, None, "is not a regular file")
            data = file.read(most_bytes + 1)
    except OSError as error:
        reason = _OS_REASONS.get(error.errno or 0, f"cannot be read: {os.strerror(error.errno or 0)}")
        raise refused(place, None, reason) from None
    except ValueError:  # a NUL in the path
        raise refused(place, None, "is not a path") from None
    if len(data) > most_bytes:
        raise refused(place, None, f"is too large: must be at most {most_bytes // 1024} KiB")
    return data


def decoded(data: bytes, place: str) -> str:
    """UTF-8 without a byte order mark, which some editors write."""
    try:
        return data.decode().removeprefix("\ufeff")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise refused(place, line, f"not UTF-8 text: byte 0x{data[error.start]:02x}") from None


def parsed_json(text: str, place: str) -> Any:
    """A JSON document's values; MissionError names `place` and the line."""

    def no_number(name: str) -> None:
        raise ValueError(f"{name} is no number")

    try:
        return json.loads(text, parse_constant=no_number)
    except json.JSONDecodeError as error:
        raise refused(place, error.lineno, f"not JSON: {error.msg} (column {error.colno})") from None
    except RecursionError:
        raise refused(place, None, "nested too deep") from None
    except ValueError as error:  # NaN, Infinity, or an integer of thousands of digits
        raise refused(place, None, f"not JSON: {printable(str(error))}") from None


def open_at_once(path: str, flags: int) -> int:
    """As an opener: opening a named pipe that nobody writes to would wait for ever."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
