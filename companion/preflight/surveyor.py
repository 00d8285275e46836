"""Looks at one autopilot with MAVSDK, and with --apply sets what is wrong. `companion preflight` runs it.

A program of its own: an error inside MAVSDK may end the process. Prints a Survey as JSON; exit code 3 with a
message when the link cannot be opened. The only user of MAVSDK; nothing that flies imports this.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from threading import Lock
from types import SimpleNamespace
from typing import Any

from mavsdk.connection_result import ConnectionResult
from mavsdk.logging import LogLevel, log_subscribe
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.geofence import Geofence, GeofenceError
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw, MissionRawError, MissionRawResult
from mavsdk.plugins.param import Param, ParamError
from mavsdk.system import System

from companion.mavlink import dialect
from companion.mavlink.endpoint import COMPONENT
from companion.mavlink.makes import load_installed_makes, make_of
from companion.mavlink.makes.make import Rule
from companion.mavlink.sensor_source import SensorSource, SensorTally
from companion.mavlink.streams import fastest_hz, receiver_hz, reception_counts, streams_hz
from companion.preflight.fence import Vertex, difference, fence_of
from companion.preflight.report import Check, check_of
from companion.preflight.survey import EXIT_LINK, Parameter, Survey
from companion.sensors.table import autopilot_hz, kinds_of
from mission.document.load import load_mission
from mission.document.model import Mission

HEARD_LIMIT_S = 10.0  # an autopilot sends a heartbeat a second
OTHERS_S = 1.5  # how long to listen on for what else is there
SETTLE_S = 0.5  # after the streams have been asked for
WINDOW_S = 4.0
ANSWER_S = 1.5
POLL_S = 0.05
AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1
ASKED = {"AUTOPILOT_VERSION": 148, "HOME_POSITION": 242, "GPS_RAW_INT": 24, "SYSTEM_TIME": 2}
FENCE_FRAME = 5  # MAV_FRAME_GLOBAL_INT
FENCE_MISSION = 1  # MAV_MISSION_TYPE_FENCE


class Received:
    """Counts and keeps one autopilot's messages; MAVSDK calls `count_message` from a thread of its own."""

    def __init__(self, system_id: int, sensors: Sequence[type[SensorSource]] = ()) -> None:
        """`sensors`: those that may come by way of the autopilot."""
        self.system_id = system_id
        self._sensors = sensors
        self._by_message = {name: kind.NAME for kind in sensors for name in kind.MESSAGES.values()}
        self.clock_ahead_s: float | None = None
        self._lock = Lock()
        self._counts: Counter[str] = Counter()
        self._last: dict[str, dict[str, Any]] = {}
        self._beats_s: list[float] = []
        self._tallies = self._new_tallies(time.monotonic())

    def count_message(self, message: MavlinkMessage, _: object) -> None:
        """One message."""
        if message.message_name in self._by_message:  # of any component, which the autopilot forwards
            self._take_forwarded(message)
        if (message.system_id, message.component_id) != (self.system_id, AUTOPILOT):
            return
        fields = json.loads(message.fields_json)
        with self._lock:
            self._counts[message.message_name] += 1
            self._last[message.message_name] = fields
            if message.message_name == "HEARTBEAT":
                self._beats_s.append(time.monotonic())
            if message.message_name == "SYSTEM_TIME" and fields.get("time_unix_usec"):
                self.clock_ahead_s = time.time() - fields["time_unix_usec"] / 1e6

    def _new_tallies(self, began_s: float) -> dict[str, SensorTally]:
        return {kind.NAME: kind.tally(began_s) for kind in self._sensors}

    def _take_forwarded(self, message: MavlinkMessage) -> None:
        fields = json.loads(message.fields_json)
        numbers = {name: math.nan if value is None else value for name, value in fields.items()}  # JSON has no NaN
        with self._lock, suppress(AttributeError, TypeError):
            tally = self._tallies[self._by_message[message.message_name]]
            tally.add(SimpleNamespace(**numbers), message.system_id, message.component_id, time.monotonic())

    def sensor_checks(self, mission: Mission) -> dict[str, Check]:
        """Rows of sensors by what was heard since the window began."""
        where = "the autopilot's link, and no --sensor"
        with self._lock:
            return {
                name: check_of(name, tally.check(mission, self.system_id, time.monotonic(), where))
                for name, tally in self._tallies.items()
            }

    def window(self) -> tuple[dict[str, int], float]:
        """Listen for WINDOW_S: how many of each, and the longest time without a heartbeat."""
        began_s = time.monotonic()
        with self._lock:
            self._counts.clear()
            self._beats_s = self._beats_s[-1:]
            self._tallies = self._new_tallies(began_s)
        time.sleep(WINDOW_S)
        ended_s = time.monotonic()
        with self._lock:
            beats_s = [*(self._beats_s or [began_s]), ended_s]
            gap_s = max(after - before for before, after in pairwise(beats_s))
            return {name: round(n * WINDOW_S / (ended_s - began_s)) for name, n in self._counts.items()}, gap_s

    def last(self) -> dict[str, dict[str, Any]]:
        """The last message of each name."""
        with self._lock:
            return dict(self._last)

    def wait_for(self, name: str) -> bool:
        """True if it has come within ANSWER_S."""
        deadline_s = time.monotonic() + ANSWER_S
        while name not in self.last():
            if time.monotonic() > deadline_s:
                return False
            time.sleep(POLL_S)
        return True


def main() -> int:
    """Exit code 0 with a survey on stdout, or 3."""
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--mission", required=True)
    parser.add_argument("--id", required=True, type=int)
    parser.add_argument("--autopilot", required=True)
    parser.add_argument("--apply", action="store_true")
    arguments = parser.parse_args()
    load_installed_makes()
    with os.fdopen(os.dup(1), "w") as out:  # stdout proper is for whatever MAVSDK prints
        os.dup2(2, 1)
        log_subscribe(lambda level, *_: level < LogLevel.ERROR)
        mavsdk = Mavsdk(Configuration.create_manual(arguments.id, COMPONENT, True))
        try:
            opened = mavsdk.add_any_connection(arguments.autopilot)
            if opened is not ConnectionResult.SUCCESS:
                print(f"{arguments.autopilot}: cannot be opened: {opened.name}", file=sys.stderr)
                return EXIT_LINK
            survey = survey_autopilot(mavsdk, load_mission(arguments.mission), arguments.id, apply=arguments.apply)
        finally:
            mavsdk.destroy()
        out.write(survey.model_dump_json())
    return 0


def survey_autopilot(mavsdk: Mavsdk, mission: Mission, vehicle_id: int, *, apply: bool) -> Survey:
    """All there is to know of vehicle `vehicle_id`'s autopilot, or which others are there."""
    autopilots = _autopilots(mavsdk, vehicle_id)
    heard = tuple(sorted(autopilots))
    if vehicle_id not in autopilots:
        return Survey(heard=heard)
    system = autopilots[vehicle_id]
    direct = MavlinkDirect(system)
    forwarded = [kind for kind in kinds_of(mission).values() if kind.IS_FORWARDED]
    received = Received(vehicle_id, forwarded)
    direct.subscribe_message("", received.count_message)
    received.wait_for("HEARTBEAT")
    make = make_of(received.last().get("HEARTBEAT", {}).get("autopilot", -1))
    reception = reception_counts(mission, vehicle_id)
    own_hz = fastest_hz(receiver_hz(mission, vehicle_id), autopilot_hz(mission))
    for message_id, rate_hz in streams_hz(make, sensors_hz=own_hz, reception=reception).items():
        _command(direct, vehicle_id, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / rate_hz)
    time.sleep(SETTLE_S)
    counts, gap_s = received.window()
    sensors = received.sensor_checks(mission)
    for name, message_id in ASKED.items():
        if name not in received.last():
            _command(direct, vehicle_id, dialect.MAV_CMD_REQUEST_MESSAGE, message_id)
            received.wait_for(name)
    survey = Survey(
        heard=heard,
        kind=None if make is None else make.key,
        messages={name: fields for name, fields in received.last().items() if name != "STATUSTEXT"},
        window_s=WINDOW_S,
        counts=counts,
        heartbeat_gap_s=gap_s,
        clock_ahead_s=received.clock_ahead_s,
        sensors=sensors,
    )
    if make is None:
        return survey
    aids = [
        name
        for aid in (
            *make.aids_of(mission, vehicle_id),
            *make.height_aids_of(mission),
            *make.odometry_aids_of(mission, vehicle_id),
        )
        for name in aid.names
    ]
    table = make.rules(mission, vehicle_id)
    return survey.model_copy(update=_settings(system, table, mission, survey, aids=aids, apply=apply))


def _autopilots(mavsdk: Mavsdk, vehicle_id: int) -> dict[int, System]:
    """By system id. Waits for the one that is wanted, then a little for others."""
    deadline_s = time.monotonic() + HEARD_LIMIT_S
    found: dict[int, System] = {}
    while time.monotonic() < deadline_s:
        known = vehicle_id in found
        for system in mavsdk.get_systems():
            if system.has_autopilot():
                found.setdefault(system.get_system_id(), system)
        if vehicle_id in found and not known:
            deadline_s = min(deadline_s, time.monotonic() + OTHERS_S)
        time.sleep(POLL_S)
    return found


def _command(direct: MavlinkDirect, system_id: int, command: int, *values: float) -> None:
    """Sent until answered. The answer does not count: what the command was to bring is looked for."""
    fields: dict[str, float] = {"target_system": system_id, "target_component": AUTOPILOT, "command": command}
    fields |= {"confirmation": 0}
    fields |= {f"param{k}": value for k, value in enumerate((*values, *[0.0] * (7 - len(values))), start=1)}
    message = MavlinkMessage("COMMAND_LONG", system_id, COMPONENT, system_id, AUTOPILOT, json.dumps(fields))
    with suppress(MavlinkDirectError):
        direct.send_command(message)


def _settings(
    system: System, table: Sequence[Rule], mission: Mission, survey: Survey, *, aids: Sequence[str], apply: bool
) -> dict[str, Any]:
    """Parameters and fence as they are, with `apply` after what was wrong has been set; never while armed.

    `aids`: parameters that are only read.
    """
    applied: dict[str, Any] = {}
    refused: dict[str, str] = {}
    param = Param(system)
    found = {name: _read_value(param, Rule(name, {0: ""}, "")) for name in aids}
    found |= {rule.name: _read_value(param, rule) for rule in table}
    fence, fence_error = _download(system)
    if apply and not survey.armed:
        for rule in table:
            there = found[rule.name]
            if there.value is not None and not rule.fits(there.value):
                error = _set(param, there.name, rule.wanted)
                if error:
                    refused[rule.name] = error
                else:
                    applied[rule.name] = rule.wanted
                found[rule.name] = _read_value(param, rule)
        wanted = fence_of(mission)
        if fence is None or difference(fence, wanted):
            error = _upload(system, wanted)
            if error:
                refused["fence"] = error
            else:
                applied["fence"] = len(wanted)
            fence, fence_error = _download(system)
    return {
        "parameters": found,
        "fence": fence,
        "fence_error": fence_error,
        "applied": applied,
        "refused": refused,
    }


def _read_value(param: Param, rule: Rule) -> Parameter:
    for name in rule.names:
        # The table's type first: firmwares have changed the type of some.
        readers = (param.get_param_int, param.get_param_float)
        for read in readers if isinstance(rule.wanted, int) else readers[::-1]:
            try:
                return Parameter(name=name, value=read(name))
            except ParamError as error:
                if error.result.name not in ("WRONG_TYPE", "TYPE_MISMATCH", "TYPE_UNSUPPORTED"):
                    break
    return Parameter(name=rule.name, value=None)


def _set(param: Param, name: str, value: int | float) -> str:
    """Set a parameter; the error in words, empty: none."""
    try:
        try:
            (param.set_param_int if isinstance(value, int) else param.set_param_float)(name, value)
        except ParamError as error:
            if error.result.name not in ("WRONG_TYPE", "TYPE_MISMATCH", "TYPE_UNSUPPORTED"):
                raise
            (param.set_param_float if isinstance(value, int) else param.set_param_int)(name, int(value))
    except ParamError as error:
        return str(error.result.name).lower()
    return ""


def _download(system: System) -> tuple[tuple[Vertex, ...] | None, str]:
    """The fence on the autopilot; None and why, when it does not tell."""
    raw = MissionRaw(system)
    try:
        items = raw.download_geofence()
    except MissionRawError as error:
        if error.result is MissionRawResult.NO_MISSION_AVAILABLE:
            return (), ""
        return None, str(error.result.name).lower()
    finally:
        raw.destroy()
    return tuple(Vertex(command=i.command, count=i.param1, lat_e7=i.x, lon_e7=i.y) for i in items), ""


def _upload(system: System, wanted: tuple[Vertex, ...]) -> str:
    """Upload the fence; the error in words, empty: the autopilot has taken it."""
    if not wanted:
        geofence = Geofence(system)
        try:
            geofence.clear_geofence()
        except GeofenceError as error:
            return str(error.result.name).lower()
        finally:
            geofence.destroy()
        return ""
    items = [
        MissionItem(
            seq=k,
            frame=FENCE_FRAME,
            command=vertex.command,
            autocontinue=1,
            param1=vertex.count,
            x=vertex.lat_e7,
            y=vertex.lon_e7,
            mission_type=FENCE_MISSION,
        )
        for k, vertex in enumerate(wanted)
    ]
    raw = MissionRaw(system)
    try:
        raw.upload_geofence(items)
    except MissionRawError as error:
        return str(error.result.name).lower()
    finally:
        raw.destroy()
    return ""


if __name__ == "__main__":
    sys.exit(main())
