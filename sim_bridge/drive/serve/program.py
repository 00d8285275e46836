"""`sim-bridge serve`: the command line of a world on the wall clock."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from companion.keys.fleet_folder import file_name
from mission.cli.main import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT
from mission.common.problems import MissionError, printable
from mission.common.signals import Stop
from mission.document import simulator
from mission.document.load import MAX_PLACE_CHARS, dump_mission, load_mission
from mission.document.model import Mission
from mission.stand.resolve import resolve_stand
from sim_bridge.drive.live.map import Map
from sim_bridge.drive.serve import notice
from sim_bridge.drive.serve.served_map import CONTROLS, ServedMap
from sim_bridge.drive.serve.server import Pacer, PortPlan, Server, open_ports
from sim_bridge.errors import StartError
from sim_bridge.world.airframe.base import AirframeError
from sim_bridge.world.airframe.jsbsim_quad import jsbsim_airframes
from sim_bridge.world.autopilot import PROFILES, Link, StreamProfile
from sim_bridge.world.sensors.table import link_name
from sim_bridge.world.world import DEFAULT_ORIGIN, World

STREAMS = {"px4": PROFILES, "minimal": dict.fromkeys(Link, StreamProfile.MINIMAL)}


def run(args: argparse.Namespace) -> int:
    """Serve until SIGINT or SIGTERM; returns the exit code."""
    try:
        mission = _mission(args)
        if args.keys is not None:
            _check_keys(args.keys, mission.swarm.size)
        sensor = link_name(mission)
        if args.first_sensor_port and not sensor:
            why = "has no [sensing]" if mission.sensing is None else "sends scans by way of the autopilots"
            raise StartError(f"--first-sensor-port: {printable(args.mission)} {why}", EXIT_BAD_FILE)
        first_sensor = args.first_sensor_port if sensor else None
        plan = PortPlan(args.ground_port, args.radio_port, args.first_port, args.ground, first_sensor)
        with Stop() as stop, contextlib.ExitStack() as stack:
            ports = open_ports(plan, range(1, mission.swarm.size + 1))
            stack.callback(ports.close)
            stand = resolve_stand(mission, args.mission)
            world = World(mission, jsbsim_airframes(mission), links=STREAMS[args.streams], stand=stand)
            mission_file = stack.enter_context(_written(mission, args.out))
            onboard = args.onboard_to.of(world.vehicles) if args.onboard_to else None
            server = Server(world, ports, push=args.ground, push_onboard=onboard, say=_to_stderr)
            stack.callback(server.close)
            where = notice.where(mission, mission_file, ports, args.speed, args.keys)
            served = None
            if args.map is not None:
                map_ = Map(args.map, CONTROLS)
                stack.callback(map_.close)
                title = mission.name or Path(args.mission).stem
                map_.begin(mission_file, title, mission.swarm.size, Path(args.mission).parent)
                served = ServedMap(map_, server, _to_stderr)
                where["map"], where["maps"] = map_.urls[0], map_.urls
            print(json.dumps(where) if args.json else notice.table(where, args.ground), flush=True)
            _serve(server, args.speed, stop, served)
    except MissionError as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_FILE
    except StartError as error:
        _to_stderr(str(error))
        return error.exit_code
    except AirframeError as error:
        _to_stderr(str(error))
        return EXIT_ENVIRONMENT
    return EXIT_DONE


def _serve(server: Server, speed: float, stop: Stop, served: ServedMap | None) -> None:
    pacer = Pacer(time.monotonic(), speed)
    while not stop.asked:
        share = server.run_step(pacer)
        if served is not None:
            served.step(time.monotonic())
        if share is not None:
            _to_stderr(f"this machine reaches {share * speed:.2f} x real time, not {speed:g}: going on at that")


def _to_stderr(message: str) -> None:
    print(f"sim-bridge serve: {message}", file=sys.stderr, flush=True)


def _mission(args: argparse.Namespace) -> Mission:
    mission = load_mission(args.mission)
    if args.personality is not None:
        mission = mission.with_personality(args.personality)
    if args.estimates is not None:
        mission = mission.with_estimates(args.estimates)
    if args.n is not None:
        mission = mission.with_size(args.n, place="-n")
    if args.seed is not None:
        mission = mission.with_seed(args.seed)
    simulator.check(mission, str(args.mission))
    simulator.needs_satellites(mission, str(args.mission), "`serve` has no range radios: `sim-bridge fly` has")
    return mission if mission.origin else mission.with_origin(DEFAULT_ORIGIN)


def _check_keys(folder: Path, size: int) -> None:
    """The files of so many vehicles and of the operator are there. The programs that sign read them."""
    for owner in range(size + 1):
        if not (folder / file_name(owner)).is_file():
            place = printable(str(folder / file_name(owner)), MAX_PLACE_CHARS)
            made_by = f"companion key new FLEET --vehicles {size}"
            raise StartError(f"--keys: {place}: no such file ({made_by})", EXIT_BAD_FILE)


@contextlib.contextmanager
def _written(mission: Mission, out: Path | None) -> Iterator[Path]:
    """The mission as flown, in `out`, or in a temporary file for as long as it is served."""
    with contextlib.ExitStack() as stack:
        try:
            if out is None:
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="understory-"))
                out = Path(folder, "mission.toml")
            out.write_text(dump_mission(mission), encoding="utf-8")
        except OSError as error:
            place = printable(str(out or tempfile.gettempdir()), MAX_PLACE_CHARS)
            reason = os.strerror(error.errno or 0)
            raise StartError(f"--out: cannot write {place}: {reason}", EXIT_ENVIRONMENT) from None
        yield out.absolute()
