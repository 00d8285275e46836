"""A serial port that is opened beside the loop: a device that does not answer keeps no setpoint waiting.

To open one sets its rate and lines, by questions to an adapter on USB, which the kernel gives up after 5 s each.
"""

from __future__ import annotations

import errno
import termios
import threading

import serial

from companion.shell.urls import Url

ERRORS = (OSError, ValueError, termios.error)  # of a port that cannot be opened


class PortOpening:
    """One try, by a thread of its own, which ends with the process."""

    def __init__(self, url: Url, *, dtr: bool) -> None:
        self._changed = threading.Lock()
        self._port: serial.Serial | None = None
        self._error: Exception | None = None
        self._is_given_up = False
        self._thread = threading.Thread(target=self._run, args=(url, dtr), name="serial port", daemon=True)
        try:
            self._thread.start()
        except RuntimeError as error:  # no more threads: as of a port that cannot be opened
            self._error = OSError(errno.EAGAIN, str(error))

    def wait(self, limit_s: float | None) -> None:
        """Until it is done, at most so long."""
        if not self.is_done:
            self._thread.join(limit_s)

    @property
    def is_done(self) -> bool:
        """There is a port, or an error."""
        return not self._thread.is_alive()

    def take_port(self) -> serial.Serial | None:
        """The port, once it is done. One of ERRORS."""
        if self._error is not None:
            raise self._error
        return self._port

    def give_up(self) -> None:
        """Nobody takes the port: it is closed, or will be."""
        with self._changed:
            self._is_given_up = True
            if self._port is not None:
                self._port.close()

    def _run(self, url: Url, dtr: bool) -> None:
        try:
            port = open_port(url, dtr=dtr)
        except ERRORS as error:
            self._error = error
            return
        with self._changed:
            self._port = port
            if self._is_given_up:
                port.close()


def open_port(url: Url, *, dtr: bool) -> serial.Serial:
    """One of ERRORS."""
    # inter_byte_timeout=0 sets VMIN to 1: without data a read then fails with EAGAIN, and b"" means unplugged.
    port = serial.Serial(None, url.number, timeout=0, inter_byte_timeout=0, exclusive=True)
    port.port = url.place
    port.dtr = dtr
    port.open()
    return port
