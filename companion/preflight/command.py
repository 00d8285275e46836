"""`companion preflight`: look, judge, print one table and one verdict, write the report."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

from companion.mavlink.endpoint import OBSTACLES
from companion.mavlink.frames import Framing
from companion.preflight.checks import judge
from companion.preflight.computer import check_disk, check_key, check_monotonic
from companion.preflight.listen import listen
from companion.preflight.report import Check, Report, Verdict, write_report
from companion.preflight.sensors import Tally, check_obstacles
from companion.preflight.survey import Survey, SurveyError, take_survey
from companion.preflight.table import table
from companion.shell.links import LinkError, open_link
from companion.shell.urls import Scheme, Url
from mission.common.problems import printable
from mission.document.load import mission_sha256
from mission.document.model import Mission

WINDOW_S = 4.0  # of the obstacle sensor's link
EXIT_PASS, EXIT_FAIL, EXIT_ENVIRONMENT = 0, 1, 3


def preflight(arguments: argparse.Namespace, mission: Mission) -> int:
    """The exit code."""
    sha256 = mission_sha256(arguments.mission)
    for option, url in (("--autopilot", arguments.autopilot), ("--obstacles", arguments.obstacles)):
        try:
            if url is not None:
                open_link(url).close()  # its words for a port that is taken are better than MAVSDK's
        except LinkError as error:
            return _refused(f"{option} {error}")
    try:
        survey = take_survey(arguments.mission, arguments.id, arguments.autopilot, apply=arguments.apply)
    except SurveyError as error:
        return _refused(f"--autopilot {error}")
    if not survey.heard:
        return _refused(
            f"--autopilot {arguments.autopilot}: no autopilot is heard. Is it on, is this its port, the baud rate "
            "right? `companion doctor` looks further"
        )
    try:
        obstacles = tuple(_obstacles(arguments, mission, survey))
    except LinkError as error:
        return _refused(f"--obstacles {error}")
    report = _report(arguments, mission, sha256, survey, obstacles)
    if arguments.report is not None:
        try:
            write_report(report, Path(arguments.report))
        except OSError as error:
            return _refused(f"--report {printable(arguments.report)}: cannot be written: {error.strerror}")
    print(report.model_dump_json(indent=1) if arguments.json else f"{table(report.checks)}\n\n{verdict_line(report)}")
    return EXIT_FAIL if report.verdict is Verdict.FAIL else EXIT_PASS


def _refused(message: str) -> int:
    print(f"companion: {message}", file=sys.stderr)
    return EXIT_ENVIRONMENT


def _obstacles(arguments: argparse.Namespace, mission: Mission, survey: Survey) -> Iterator[Check]:
    """What the obstacle sensor's own link carries, or what comes by way of the autopilot. LinkError."""
    url: Url | None = arguments.obstacles
    if mission.sensing is None:
        return
    if url is None:
        where = "the autopilot's link, and no --obstacles"
        yield check_obstacles(survey.sensors, mission.sensing, arguments.id, survey.window_s or WINDOW_S, where)
        return
    framing = Framing(frozenset({OBSTACLES}), is_stream=url.scheme is Scheme.SERIAL)
    tally = Tally(time.monotonic())
    for data in listen(open_link(url, hears_all=True), WINDOW_S):
        for heard in framing.read(data):
            tally.take(heard.message, heard.system, heard.component, time.monotonic())
    yield check_obstacles(tally.sensors(time.monotonic()), mission.sensing, arguments.id, WINDOW_S, str(url))


def _report(
    arguments: argparse.Namespace, mission: Mission, sha256: str, survey: Survey, obstacles: Sequence[Check]
) -> Report:
    now_s = time.time()
    folder = Path(arguments.report).absolute().parent if arguments.report else Path.cwd()
    checks = (
        Check(name="mission", verdict=Verdict.PASS, found=f"sha256 {sha256[:16]}", wanted="valid, with an origin"),
        *judge(survey, mission, arguments.id, apply=arguments.apply),
        *obstacles,
        check_key(arguments.key),
        check_disk(folder),
        check_monotonic(),
    )
    failed = any(check.verdict is Verdict.FAIL for check in checks)
    return Report(
        verdict=Verdict.FAIL if failed else Verdict.PASS,
        time_unix_s=now_s,
        time_utc=datetime.fromtimestamp(now_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        mission=mission.name,
        mission_sha256=sha256,
        vehicle_id=arguments.id,
        autopilot=survey.kind or "",
        version=survey.version,
        uid=survey.uid,
        applied=survey.applied,
        checks=checks,
    )


def verdict_line(report: Report) -> str:
    """In one line."""
    failed = report.failed
    warned = sum(check.verdict is Verdict.WARN for check in report.checks)
    doubts = f" ({warned} {'warning' if warned == 1 else 'warnings'})" if warned else ""
    who = f"vehicle {report.vehicle_id}"
    if not failed:
        return f"PASS: {who} is fit for {report.mission or 'the mission'}{doubts}"
    return f"FAIL: {who}: {len(failed)} of {len(report.checks)} checks: {', '.join(failed)}{doubts}"
