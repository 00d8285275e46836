"""RPLIDAR A and S series, standard scan: Slamtec, Interface Protocol and Application Notes (rev. 2.1 and before).

A request is A5, command, and (with a payload) length, payload, XOR of all. An answer begins with a descriptor of 7
bytes: A5 5A, 30 bits of length and 2 of mode, type. Measurements are 5 bytes without a checksum: quality (6 bits),
inverse start flag, start flag; angle_q6 (15 bits, 1/64 degree) above a check bit of 1; distance_q2 (1/4 mm), 0 where
nothing came back. Angles are clockwise, seen from above.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from operator import xor
from typing import Final

from companion.lidar.driver import Return

STOP: Final = b"\xa5\x25"
RESET: Final = b"\xa5\x40"
SCAN: Final = b"\xa5\x20"
GET_INFO: Final = b"\xa5\x50"
GET_HEALTH: Final = b"\xa5\x52"

_MARK: Final = b"\xa5\x5a"
_DESCRIPTOR_BYTES: Final = 7
_INFO: Final = _MARK + b"\x14\x00\x00\x00\x04"
_HEALTH: Final = _MARK + b"\x03\x00\x00\x00\x06"
_SCANNING: Final = _MARK + b"\x05\x00\x00\x40\x81"
_BODY_BYTES: Final = {_INFO: 20, _HEALTH: 3, _SCANNING: 0}
_HEALTH_FAILED: Final = 2  # 0: good, 1: warning
_SAMPLE_BYTES: Final = 5
_ANGLE_MAX_Q6: Final = 360 * 64
LOCK_SAMPLES: Final = 8  # in a row before bytes are believed: of chance bytes one sample in six looks right
MOTOR_PWM: Final = 660  # of 1023; the maker's default for the A2's and A3's adapter. Others ignore it
SILENT_S: Final = 3.0  # the motor takes 1 to 2 s until measurements begin
RESET_S: Final = 2.0  # until it answers again


def make_request(command: int, payload: bytes) -> bytes:
    """A request with a payload."""
    body = bytes([0xA5, command, len(payload)]) + payload
    return body + bytes([reduce(xor, body)])


SET_PWM: Final = make_request(0xF0, MOTOR_PWM.to_bytes(2, "little"))
# Each with the wait after it: the maker asks for 1 ms or more after STOP, and answers should come by themselves.
_START: Final = ((STOP, 0.02), (GET_INFO, 0.05), (GET_HEALTH, 0.05), (SET_PWM, 0.02), (SCAN, SILENT_S))


class RpLidar:
    """Starts it, and starts it again where it falls silent."""

    def __init__(self) -> None:
        self.bad = 0
        self.notes: list[str] = []
        self._buffer = b""
        self._locked = False
        self._failed = False
        self._next = 0  # of _START
        self._due_s = 0.0
        self._has_measured = False

    def poll(self, now_s: float) -> bytes:
        """The next request of the start, while nothing is measured."""
        if self._has_measured:
            self._has_measured = False
            self._next, self._due_s = 0, now_s + SILENT_S
        if now_s < self._due_s:
            return b""
        if self._failed:
            self._failed = False
            self._next, self._due_s = 0, now_s + RESET_S
            return RESET
        request, wait_s = _START[self._next]
        self._next = (self._next + 1) % len(_START)
        self._due_s = now_s + wait_s
        return request

    def decode(self, data: bytes) -> Iterator[Return]:
        """Measurements; answers become notes."""
        buffer = self._buffer + data
        at = 0
        while True:
            if self._locked:
                if len(buffer) - at < _SAMPLE_BYTES:
                    break
                if _is_sample(buffer, at):
                    self._has_measured = True
                    yield _return_of(buffer, at)
                    at += _SAMPLE_BYTES
                    continue
                self._locked = False
            taken = self._synchronise(buffer, at)
            if not taken and not self._locked:
                break
            at += taken
        self._buffer = buffer[at:]

    def shutdown(self) -> bytes:
        """The laser off; the motor too, where the adapter has a say in it."""
        return STOP + make_request(0xF0, b"\x00\x00")

    def _synchronise(self, buffer: bytes, at: int) -> int:
        """Bytes that are done with, 0: more are needed, or it is locked now."""
        descriptor = buffer[at : at + _DESCRIPTOR_BYTES]
        if _MARK.startswith(descriptor[:2]) and len(descriptor) < _DESCRIPTOR_BYTES:
            return 0
        if descriptor in _BODY_BYTES:
            end = at + _DESCRIPTOR_BYTES + _BODY_BYTES[descriptor]
            if len(buffer) < end:
                return 0
            self._note_answer(descriptor, buffer[at + _DESCRIPTOR_BYTES : end])
            return end - at
        if len(buffer) - at < LOCK_SAMPLES * _SAMPLE_BYTES:
            return 0
        samples = range(at, at + LOCK_SAMPLES * _SAMPLE_BYTES, _SAMPLE_BYTES)
        self._locked = all(_is_sample(buffer, sample) for sample in samples)
        if self._locked:
            return 0
        self.bad += 1
        return 1

    def _note_answer(self, descriptor: bytes, body: bytes) -> None:
        if descriptor == _SCANNING:
            self._locked = True
        elif descriptor == _INFO:
            model, minor, major, hardware = body[:4]
            self.notes.append(
                f"RPLIDAR model {model >> 4}.{model & 15}, firmware {major}.{minor:02d}, hardware {hardware}, "
                f"serial number {body[4:].hex()}"
            )
        else:
            state = {0: "good", 1: "warning", _HEALTH_FAILED: "failed"}.get(body[0], f"{body[0]}, which is unknown")
            self.notes.append(f"RPLIDAR health: {state}, error code {body[1] | body[2] << 8}")
            self._failed = body[0] == _HEALTH_FAILED


def _is_sample(buffer: bytes, at: int) -> bool:
    first, second = buffer[at], buffer[at + 1]
    flags_differ = (first & 1) != (first >> 1 & 1)
    return flags_differ and bool(second & 1) and (second >> 1 | buffer[at + 2] << 7) <= _ANGLE_MAX_Q6


def _return_of(buffer: bytes, at: int) -> Return:
    angle_q6 = buffer[at + 1] >> 1 | buffer[at + 2] << 7
    distance_q2 = buffer[at + 3] | buffer[at + 4] << 8
    return round(angle_q6 / 0.64) % 36000, distance_q2 / 4000.0, 0.0, bool(buffer[at] & 1)
