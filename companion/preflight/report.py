"""Report of a preflight, as a file; and what that file allows: to arm, or not.

Reading a report never fails a companion: one that starts again in flight must fly on, so whatever is wrong with
the file is a reason to stay on the ground, no error.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict

from companion.mavlink.sensor_source import Finding
from mission.common.problems import MissionError, printable
from mission.document.load import mission_sha256

AGE_MAX_S = 12 * 3600.0  # a day's work at one site: batteries and fences change between days
AHEAD_MAX_S = 300.0  # a clock that was set in between
NOT_SET = "and the clock is not synchronised: run it again"
REPORT_BYTES_MAX = 1 << 20
WAIVE_ALL = "all"


class Verdict(StrEnum):
    """Of one check. A warning does not keep the vehicle on the ground."""

    PASS = "pass"
    WARN = "warn"
    FAIL = "fail"


class Check(BaseModel):
    """One row: what was looked at, what was there, what should be."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    verdict: Verdict
    found: str
    wanted: str
    fix: str = ""


def good(name: str, found: str, wanted: str = "") -> Check:
    """A row that passes."""
    return Check(name=name, verdict=Verdict.PASS, found=found, wanted=wanted)


def doubt(name: str, found: str, wanted: str, fix: str) -> Check:
    """A row that warns, and what to do."""
    return Check(name=name, verdict=Verdict.WARN, found=found, wanted=wanted, fix=fix)


def problem(name: str, found: str, wanted: str, fix: str) -> Check:
    """A row that fails, and what to do."""
    return Check(name=name, verdict=Verdict.FAIL, found=found, wanted=wanted, fix=fix)


def check_of(name: str, finding: Finding) -> Check:
    """A sensor's finding as a row."""
    bad = Verdict.WARN if finding.is_warning else Verdict.FAIL
    verdict = bad if finding.fix else Verdict.PASS
    return Check(name=name, verdict=verdict, found=finding.found, wanted=finding.wanted, fix=finding.fix)


class Report(BaseModel):
    """One preflight of one vehicle for one mission."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = 1
    verdict: Verdict
    time_unix_s: float
    time_utc: str
    boot_id: str = ""  # of the kernel that ran then; empty: not known, as in reports of versions before
    boot_s: float = 0.0  # since that was started
    mission: str
    mission_sha256: str
    vehicle_id: int
    autopilot: str = ""  # px4, ardupilot; empty: none of them
    version: str = ""
    uid: str = ""
    applied: dict[str, Any] = {}  # what --apply changed, and to what
    checks: tuple[Check, ...]

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the failed checks."""
        return tuple(check.name for check in self.checks if check.verdict is Verdict.FAIL)


def write_report(report: Report, path: Path) -> None:
    """Atomically: a reader sees the old report or the new one, also after a power cut. OSError."""
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with part.open("w", encoding="utf-8") as file:
            file.write(report.model_dump_json(indent=1) + "\n")
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            part.unlink()
        raise


class Now(NamedTuple):
    """This moment, by the wall clock and by what goes on while the kernel runs."""

    unix_s: float
    boot_id: str  # of the kernel that runs; empty: not known
    boot_s: float  # since it was started, asleep or not


@dataclass(frozen=True, slots=True)
class Clearance:
    """Verdict: a companion may arm, or not. `grounded`: why not, or empty. `waived`: failed checks that were accepted.

    `unknown`: what was to be waived and is no check of the report, in words, or empty. It does not ground.
    """

    grounded: str
    waived: tuple[str, ...]
    unknown: str = ""


def clearance(
    report_file: str | None,
    waived: Sequence[str],
    mission_file: str,
    vehicle_id: int,
    *,
    now: Now,
    is_clock_set: Callable[[], bool | None],
    needs: Sequence[str] = (),
) -> Clearance:
    """By the report and the names given to `--waive`. `needs`: checks that the report must have, as this one flies.

    `is_clock_set`: the wall clock is synchronised; None: nobody tells.
    """
    if WAIVE_ALL in waived:
        return Clearance("", (WAIVE_ALL,))
    if report_file is None:
        return Clearance("no preflight: run `companion preflight`", ())
    try:
        report = _read_report(report_file)
        flown = mission_sha256(mission_file)
    except (OSError, ValueError, MissionError) as error:
        reason = (isinstance(error, OSError) and error.strerror) or "it is not one"
        return Clearance(f"preflight report not readable: {reason}", ())
    if report.vehicle_id != vehicle_id:
        return Clearance(f"preflight was of vehicle {report.vehicle_id}", ())
    if report.mission_sha256 != flown:
        return Clearance("preflight was for another mission", ())
    age_s = _age_s(report, now, is_clock_set)
    if age_s is None:
        return Clearance(
            f"preflight was {'before a reboot' if report.boot_id else 'by an older version'}, {NOT_SET}", ()
        )
    if not -AHEAD_MAX_S <= age_s <= AGE_MAX_S:
        when = f"{age_s / 3600.0:.0f} h old" if age_s > 0.0 else "of a time to come"
        return Clearance(f"preflight is {printable(when)}", ())
    names = {check.name for check in report.checks}
    failed = (*report.failed, *(name for name in needs if name not in names))
    accepted = tuple(name for name in failed if name in waived)
    left = [name for name in failed if name not in waived]
    names.update(needs)
    strange = ", ".join(repr(name) for name in waived if name not in names)
    unknown = f"waive: no check named {strange}" if strange else ""
    reasons = (f"preflight failed: {','.join(left)}", unknown) if left else ()
    return Clearance("; ".join(filter(None, reasons)), accepted, unknown)


def _age_s(report: Report, now: Now, is_clock_set: Callable[[], bool | None]) -> float | None:
    """None: not known. A board without a battery for its clock goes on, when it boots, from where it was shut down.

    So that clock tells the age of a report from before the boot only once it is set again.
    """
    if report.boot_id and report.boot_id == now.boot_id:
        return now.boot_s - report.boot_s
    is_set = is_clock_set()
    if is_set is False or (is_set is None and report.boot_id):
        return None
    return now.unix_s - report.time_unix_s


def _read_report(path: str) -> Report:
    """OSError; ValueError, of which pydantic's is one."""
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
        data = file.read(REPORT_BYTES_MAX)
    report = Report.model_validate_json(data)
    if report.verdict is Verdict.FAIL and not report.failed:
        raise ValueError("failed, without a failed check")
    return report
