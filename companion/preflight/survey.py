"""Survey of the autopilot: read by a program of its own, since MAVSDK can take a whole process down."""

from __future__ import annotations

import signal
import subprocess
import sys
from typing import Any

from pydantic import BaseModel, ConfigDict

from companion.mavlink.makes import MAKES
from companion.mavlink.makes.make import Make
from companion.preflight.fence import Vertex
from companion.preflight.report import Check
from companion.shell.urls import Url

SURVEY_LIMIT_S = 240.0  # every parameter of the table missing, at 3 s each, twice, and a fence of 64 vertices
EXIT_LINK = 3


class SurveyError(Exception):
    """There is no survey; the message says why."""


class Parameter(BaseModel):
    """`name`: as this firmware has it; `value`: None when it did not answer to any of its names."""

    model_config = ConfigDict(frozen=True)

    name: str
    value: float | None


class Survey(BaseModel):
    """Of one autopilot. Message fields are named as in MAVLink; times are of this computer."""

    model_config = ConfigDict(frozen=True)

    heard: tuple[int, ...] = ()  # system ids of all autopilots on the link
    kind: str | None = None  # its make's key; None: of no make that a companion can fly, or not there
    messages: dict[str, dict[str, Any]] = {}  # the last of each name
    window_s: float = 0.0
    counts: dict[str, int] = {}  # of each name in the window
    heartbeat_gap_s: float = 0.0  # the longest in the window
    clock_ahead_s: float | None = None  # this computer's, of the autopilot's SYSTEM_TIME
    parameters: dict[str, Parameter] = {}  # by the rule's name
    applied: dict[str, Any] = {}  # what was changed, and to what
    refused: dict[str, str] = {}  # what could not be changed, and the answer
    fence: tuple[Vertex, ...] | None = None
    fence_error: str = ""
    sensors: dict[str, Check] = {}  # by name: those heard in the window by way of the autopilot

    @property
    def make(self) -> Make | None:
        """Make whose key is `kind`."""
        return None if self.kind is None else MAKES[self.kind]

    @property
    def armed(self) -> bool:
        """By the last HEARTBEAT."""
        return bool(self.messages.get("HEARTBEAT", {}).get("base_mode", 0) & 0x80)  # MAV_MODE_FLAG_SAFETY_ARMED

    @property
    def is_unanswered(self) -> bool:
        """It is heard, and has told none of its parameters."""
        return bool(self.parameters) and all(parameter.value is None for parameter in self.parameters.values())

    @property
    def version(self) -> str:
        """Of the firmware, as 1.16.0; empty when not told."""
        packed = self.messages.get("AUTOPILOT_VERSION", {}).get("flight_sw_version", 0)
        return ".".join(str(packed >> shift & 0xFF) for shift in (24, 16, 8)) if packed else ""

    @property
    def uid(self) -> str:
        """Of the hardware, hexadecimal; empty when not told."""
        told = self.messages.get("AUTOPILOT_VERSION", {})
        long = bytes(told.get("uid2", ()))
        return long.hex() if any(long) else f"{told.get('uid') or 0:016x}" if told.get("uid") else ""


def take_survey(mission_file: str, vehicle_id: int, autopilot: Url, *, apply: bool) -> Survey:
    """SurveyError when the link cannot be opened, or the surveyor broke."""
    command = [
        *(sys.executable, "-P", "-m", "companion.preflight.surveyor", "--mission", mission_file),
        *("--id", str(vehicle_id), "--autopilot", str(autopilot), *(["--apply"] if apply else [])),
    ]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=SURVEY_LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise SurveyError(f"{autopilot}: not done after {SURVEY_LIMIT_S:g} s") from None
    if done.returncode == 0:
        return Survey.model_validate_json(done.stdout)
    said = done.stderr.strip()
    if done.returncode == EXIT_LINK:
        raise SurveyError(said)
    fate = signal.Signals(-done.returncode).name if done.returncode < 0 else f"exit code {done.returncode}"
    raise SurveyError(f"{autopilot}: the surveyor ended by {fate}\n{said}")
