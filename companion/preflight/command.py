"""`companion preflight`: look, judge, print one table and one verdict, write the report."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path

from companion.keys.autopilot_link import link_key
from companion.keys.key_file import KeyFileError, load_keyring
from companion.keys.keyring import SECRET_BYTES
from companion.keys.process import harden_process
from companion.mavlink.autopilot_link.signing import LinkSigning
from companion.preflight.checks import judge
from companion.preflight.computer import check_disk, check_key, check_monotonic, now
from companion.preflight.listen import SensorWindow
from companion.preflight.report import Check, Report, Verdict, check_of, write_report
from companion.preflight.signing import SigningProbe, SigningRelay
from companion.preflight.survey import Survey, SurveyError, take_survey
from companion.preflight.table import table
from companion.sensors.table import kinds_of
from companion.shell.links import Link, LinkError, open_link
from companion.shell.radio_keys import open_autopilot_gate
from companion.shell.urls import Scheme, Url
from mission.common.exit_codes import EXIT_BAD_FILE
from mission.common.problems import printable
from mission.document.load import mission_sha256
from mission.document.model import Mission

WINDOW_S = 4.0  # of sensors' links
EXIT_PASS, EXIT_FAIL, EXIT_ENVIRONMENT = 0, 1, 3


def preflight(arguments: argparse.Namespace, mission: Mission) -> int:
    """The exit code."""
    sha256 = mission_sha256(arguments.mission)
    urls: dict[str, Url] = arguments.sensors
    wanted = {"--autopilot": arguments.autopilot, **{f"--sensor {name}": url for name, url in urls.items()}}
    for option, url in wanted.items():
        try:
            open_link(url).close()  # its words for a port that is taken are better than MAVSDK's
        except LinkError as error:
            return _refused(f"{option} {error}")
    signing: tuple[Check, ...] = ()
    with ExitStack() as opened:
        speak = arguments.autopilot
        try:
            if arguments.sign_autopilot:
                signing, speak = _signed(arguments, opened)
            survey = take_survey(arguments.mission, arguments.id, speak, apply=arguments.apply)
            if survey.is_unanswered and not arguments.sign_autopilot:
                signing = _unsigned(arguments, opened)
        except KeyFileError as error:
            return _refused(f"--key {error}", EXIT_BAD_FILE)
        except SurveyError as error:
            return _refused(f"--autopilot {error}")
    if not survey.heard:
        return _refused(
            f"--autopilot {arguments.autopilot}: no autopilot is heard. Is it on, is this its port, the baud rate "
            "right? `companion doctor` looks further"
        )
    try:
        sensors = tuple(sensor_checks(urls, mission, arguments.id, survey))
    except LinkError as error:
        return _refused(f"--sensor {error}")
    report = _report(arguments, mission, sha256, survey, signing, sensors)
    if arguments.report is not None:
        try:
            write_report(report, Path(arguments.report))
        except OSError as error:
            return _refused(f"--report {printable(arguments.report)}: cannot be written: {error.strerror}")
    print(report.model_dump_json(indent=1) if arguments.json else f"{table(report.checks)}\n\n{verdict_line(report)}")
    return EXIT_FAIL if report.verdict is Verdict.FAIL else EXIT_PASS


def _refused(message: str, code: int = EXIT_ENVIRONMENT) -> int:
    print(f"companion: {message}", file=sys.stderr)
    return code


def _signed(arguments: argparse.Namespace, opened: ExitStack) -> tuple[tuple[Check, ...], Url]:
    """The row `signing`, and where the surveyor speaks: to an autopilot that signs by a relay, as it cannot itself.

    KeyFileError.
    """
    if arguments.key is None:
        raise KeyFileError("FILE: is needed for --sign-autopilot: the vehicle's key file")
    harden_process()
    keyring = load_keyring(arguments.key, arguments.id)
    link = open_link(arguments.autopilot)
    opened.callback(link.close)
    gate, is_stream = open_autopilot_gate(keyring), arguments.autopilot.scheme is Scheme.SERIAL
    probe = SigningProbe(link, gate, arguments.id, is_stream=is_stream)
    if arguments.apply:
        probe.give_key(link_key(keyring))
    check = probe.check()
    if not probe.is_signed:
        link.close()
        return (check,), arguments.autopilot
    relay = opened.enter_context(SigningRelay(link, gate, is_stream=is_stream))
    return (check,), relay.url


def _unsigned(arguments: argparse.Namespace, opened: ExitStack) -> tuple[Check, ...]:
    """The row `signing` of an autopilot that signs, and has told nothing to who has no key for it."""
    try:
        link = open_link(arguments.autopilot)
    except LinkError:  # it was there a moment ago: the other rows say that nothing was answered
        return ()
    opened.callback(link.close)
    nobodys = LinkSigning(os.urandom(SECRET_BYTES))
    is_stream = arguments.autopilot.scheme is Scheme.SERIAL
    check = SigningProbe(link, nobodys, arguments.id, is_stream=is_stream).find_signatures()
    return () if check is None else (check,)


def sensor_checks(urls: Mapping[str, Url], mission: Mission, vehicle_id: int, survey: Survey) -> Iterator[Check]:
    """A row for each sensor that the mission flies by: what comes by the sensors' links, or by way of the autopilot.

    LinkError.
    """
    kinds = list(kinds_of(mission).values())
    if not kinds:
        return
    window = SensorWindow(kinds)
    if urls:
        with ExitStack() as opened:
            links = [_open(url, opened) for url in urls.values()]
            streams = [url.scheme is Scheme.SERIAL for url in urls.values()]
            window.fill(links, streams=streams, seconds=WINDOW_S)
    where = ", ".join(map(str, urls.values())) or "the autopilot's link, and no --sensor"
    for kind in kinds:
        tally = window.tallies[kind.NAME]
        if tally.is_empty and kind.NAME in survey.sensors and kind.NAME not in urls:
            yield survey.sensors[kind.NAME]
        else:
            yield check_of(kind.NAME, tally.check(mission, vehicle_id, window.ended_s, where))


def _open(url: Url, opened: ExitStack) -> Link:
    link = open_link(url, hears_all=True)
    opened.callback(link.close)
    return link


def _report(
    arguments: argparse.Namespace,
    mission: Mission,
    sha256: str,
    survey: Survey,
    signing: Sequence[Check],
    sensors: Sequence[Check],
) -> Report:
    then = now()
    folder = Path(arguments.report).absolute().parent if arguments.report else Path.cwd()
    checks = (
        Check(name="mission", verdict=Verdict.PASS, found=f"sha256 {sha256[:16]}", wanted="valid, with an origin"),
        *signing,  # before the rows that fail by it
        *judge(survey, mission, arguments.id, apply=arguments.apply),
        *sensors,
        check_key(arguments.key, arguments.id, mission.swarm.size),
        check_disk(folder),
        check_monotonic(),
    )
    failed = any(check.verdict is Verdict.FAIL for check in checks)
    return Report(
        verdict=Verdict.FAIL if failed else Verdict.PASS,
        time_unix_s=then.unix_s,
        time_utc=datetime.fromtimestamp(then.unix_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        boot_id=then.boot_id,
        boot_s=then.boot_s,
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
