"""`sim-bridge fly`: its options, its run folder, its words."""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

from mission.cli.main import EXIT_BAD_FILE
from mission.common.network import own_addresses
from mission.document import simulator
from mission.document.airtime import find_short_batteries
from mission.document.load import load_with_source
from mission.document.model import Mission
from mission.schema.fault_kinds import FORMS
from mission.schema.faults import FaultKind
from mission.stand.resolve import resolve_stand
from sim_bridge.drive.entrant.law import find_law
from sim_bridge.drive.entrant.stages import Entrant
from sim_bridge.drive.external.options import ExternalAutopilots
from sim_bridge.drive.external.program import fly_external
from sim_bridge.drive.faults import with_options
from sim_bridge.drive.fly import INTERRUPTED, ORIGINAL_NAME, Flight, fly
from sim_bridge.drive.interrupts import interrupt_once
from sim_bridge.drive.links.ports import PORT_MAX
from sim_bridge.drive.links.router import parse_url
from sim_bridge.drive.live.audience import LOOK_S, is_attended, stay
from sim_bridge.drive.live.live import CONTROLS, Live
from sim_bridge.drive.live.map import Map
from sim_bridge.drive.live.pace import Pace
from sim_bridge.drive.live.ros2_open import check_options, open_topics
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.errors import StartError
from sim_bridge.judge import page, run_folder
from sim_bridge.judge.outcome import Outcome, describe_end, present, write_page
from sim_bridge.judge.progress import Progress
from sim_bridge.world.airframe.point_mass import point_mass_airframes
from sim_bridge.world.world import DEFAULT_ORIGIN

PROCESSES, IN_PROCESS = "processes", "in-process"
POINT_MASS = "point-mass"


def run(args: argparse.Namespace) -> int:
    """Exit code: 0 flown, 1 the mission failed, 3 flown, but a file could not be written.

    Bad files and a poor environment raise: see cli.py.
    """
    external, entrant = _external(args), _entrant(args)
    if args.signed and external is not None:
        raise StartError("--signed: flies in the bridge alone, not over --autopilots", EXIT_BAD_FILE)
    mission, original = _mission(args, external)
    check_options(args, mission)
    interrupt_once()
    if args.stay is None:
        args.stay = is_attended()
    title = mission.name or args.mission.stem
    with contextlib.ExitStack() as stack:
        publish = open_topics(args, mission, stack)
        folder = _new_folder(args.out, f"{args.mission.stem}-n{mission.swarm.size}-seed{mission.sim.seed}")
        run_folder.write(folder / ORIGINAL_NAME, original)  # the file may change, or go, while it is flown
        if mission.forest.file is not None:
            shutil.copyfile(args.mission.parent / mission.forest.file, folder / mission.forest.file)
        map_ = None
        if args.map is not None:
            map_ = Map(args.map, CONTROLS if external is None else ())
            stack.callback(map_.close)
        with Progress(sys.stderr) as progress:
            _announce(args, mission, title, map_, entrant, progress)
            if external is None:
                live = None if map_ is None else Live(map_, Pace(args.speed), title, LOOK_S if args.stay else 0.0)
                outcome = _fly(args, mission, folder, progress, live, entrant, publish)
            else:
                try:
                    outcome = fly_external(mission, external, folder, progress, map_)
                except StartError:
                    _leave_nothing(folder, mission.forest.file)
                    raise
            lost: list[str] = []
            if mission.keeps_records:
                from sim_bridge.drive.stand_files import write_stand  # numpy's and scipy's parts that only it needs

                lines, lost = write_stand(mission, folder)
                for line in lines:
                    progress.event(outcome.metrics.sim_time_s, line)
            unwritten = write_page(outcome, folder, title, progress) + lost  # it links what there is by now
        code = present(outcome, folder, unwritten, as_json=args.json, verbose=args.verbose)
        if map_ is not None:
            map_.send_changes(over=describe_end(outcome, folder))
            if args.stay and outcome.ended != INTERRUPTED:
                sys.stdout.flush()
                with Progress(sys.stderr) as progress:
                    stay(map_, progress, outcome.metrics.sim_time_s)
    if args.open and args.map is None and (folder / page.PAGE_NAME).exists():
        page.show(folder / page.PAGE_NAME)
    return code


def _mission(args: argparse.Namespace, external: ExternalAutopilots | None) -> tuple[Mission, bytes]:
    """The mission as it is flown, with what the options change, and its file as it is."""
    mission, original = load_with_source(args.mission)
    if args.personality is not None:
        mission = mission.with_personality(args.personality)
    if args.estimates is not None:
        mission = mission.with_estimates(args.estimates)
    if args.n is not None:
        mission = mission.with_size(args.n, place="-n")
    if args.seed is not None:
        mission = mission.with_seed(args.seed)
    mission = with_options(mission, {kind: getattr(args, kind.value) for kind in FaultKind})
    if external is None:
        simulator.check(mission, str(args.mission))
        if args.airframe == POINT_MASS and any(fault.kind is FaultKind.WIND for fault in mission.sim.faults):
            raise StartError(
                "--airframe point-mass: flies in still air, and the mission has a wind fault", EXIT_BAD_FILE
            )
        if args.signed and any(fault.kind is FaultKind.INSIDER for fault in mission.sim.faults):
            _fly_in_process(args, "--signed, with an insider", "what lies for a process has not its keys")
    else:
        simulator.needs_satellites(mission, str(args.mission), "--autopilots: the bridge has no range radios for these")
        for fault in mission.sim.faults:
            if FORMS[fault.kind].of_vehicle:
                why = f"--autopilots: {fault.kind.value} happens to simulated vehicles, not there"
                raise StartError(why, EXIT_BAD_FILE)
    if mission.forest.file is not None:
        resolve_stand(mission, args.mission)  # a bad one is told before there is a folder
    return mission, original


def _announce(
    args: argparse.Namespace, mission: Mission, title: str, map_: Map | None, entrant: Entrant, progress: Progress
) -> None:
    how = (args.agents or PROCESSES) if args.autopilots is None else f"autopilots {args.autopilots}"
    vehicles = "1 vehicle" if mission.swarm.size == 1 else f"{mission.swarm.size} vehicles"
    progress.event(0.0, f"{title}: {vehicles}, {how}")
    if map_ is not None:
        for line in own_addresses.lines("live map:", map_.urls):
            progress.event(0.0, line)
        if args.open and not page.show(map_.urls[0]):
            progress.event(0.0, "no display here: open the address in a browser that reaches this computer")
    if args.airframe == POINT_MASS:
        blows = any(mission.sim.wind_mps) or mission.sim.turbulence_mps
        unflown = ", whatever sim.wind_mps and sim.turbulence_mps say" if blows else ""
        progress.event(0.0, f"point masses: no flight dynamics, still air{unflown}")
    for note in find_short_batteries(mission) if args.autopilots is None else ():
        progress.event(0.0, note)
    if mission.flies_blind:
        progress.event(0.0, "no [sensing]: vehicles do not see the forest")
    if not args.signed and any(fault.kind is FaultKind.OUTSIDER for fault in mission.sim.faults):
        progress.event(0.0, "an outsider without --signed: what it sends counts as the members' own")
    if not entrant.is_ours:
        progress.event(0.0, f"not ours: {entrant.note()}")


def _fly(
    args: argparse.Namespace,
    mission: Mission,
    folder: Path,
    progress: Progress,
    live: Live | None,
    entrant: Entrant,
    publish: Callable[[Flight], None] | None,
) -> Outcome:
    """Over the simulator's own autopilots. `publish`: called after each tick."""
    mission = mission if mission.origin else mission.with_origin(DEFAULT_ORIGIN)
    return fly(
        mission,
        folder,
        progress,
        in_process=args.agents == IN_PROCESS,
        factor=args.speed,
        airframes=point_mass_airframes(mission) if args.airframe == POINT_MASS else None,
        watch=publish,
        live=live,
        entrant=entrant,
        keys=FleetKeys(mission) if args.signed else None,
        black_box=args.black_box,
    )


def _leave_nothing(folder: Path, stems: str | None) -> None:
    """Remove the folder of a flight that never began, but for a log of --launch that says something."""
    (folder / ORIGINAL_NAME).unlink(missing_ok=True)
    if stems is not None:
        (folder / stems).unlink(missing_ok=True)
    for root, _, files in os.walk(folder, topdown=False):
        with contextlib.suppress(OSError):
            for name in files:
                if (Path(root) / name).stat().st_size == 0:
                    (Path(root) / name).unlink()
            Path(root).rmdir()


def _external(args: argparse.Namespace) -> ExternalAutopilots | None:
    """Reads what is said of external autopilots. StartError when it does not fit."""
    if args.autopilots is None:
        if args.launch is not None or args.first_port is not None:
            raise StartError("--launch and --first-port want --autopilots", EXIT_BAD_FILE)
        return None
    if args.airframe is not None:
        raise StartError("--airframe: is of simulated vehicles, not of --autopilots", EXIT_BAD_FILE)
    if args.speed is not None or args.agents == IN_PROCESS:
        raise StartError("--autopilots: flies in real time, with agents as processes", EXIT_BAD_FILE)
    if args.first_port is not None and not 1 <= args.first_port <= PORT_MAX:
        raise StartError(f"--first-port {args.first_port}: must be 1..{PORT_MAX}", EXIT_BAD_FILE)
    try:
        url = parse_url(args.autopilots)
    except ValueError as error:
        raise StartError(f"--autopilots {error}", EXIT_BAD_FILE) from None
    return ExternalAutopilots(url, args.launch, args.first_port or 0, args.black_box)


def _entrant(args: argparse.Namespace) -> Entrant:
    """The entrant; other than ours, all agents are in this process. StartError where that cannot be, or LawError."""
    entrant = Entrant(None if args.law is None else find_law(args.law), args.safety_filter)
    if entrant.is_ours:
        return entrant
    asked = "--law" if args.law is not None else "--no-safety-filter"
    _fly_in_process(args, asked, "companions that are processes fly ours")
    entrant.stages()  # a bad law is told before there is a folder
    return entrant


def _fly_in_process(args: argparse.Namespace, asked: str, why: str) -> None:
    """All agents are in this process. StartError where that cannot be."""
    if args.autopilots is not None:
        raise StartError(f"{asked}: flies in the bridge alone, not over --autopilots", EXIT_BAD_FILE)
    if args.agents == PROCESSES:
        raise StartError(f"{asked}: {why}: --agents must be {IN_PROCESS}", EXIT_BAD_FILE)
    args.agents = IN_PROCESS


def _new_folder(asked: Path | None, name: str) -> Path:
    """The run folder, made. FileExistsError when the one asked for holds something already."""
    if asked is not None:
        if asked.exists() and (not asked.is_dir() or any(asked.iterdir())):
            raise FileExistsError(f"--out {asked}: exists and is not an empty folder")
        asked.mkdir(parents=True, exist_ok=True)
        return asked
    runs = Path("runs")
    for count in range(1, 10_000):
        folder = runs / (name if count == 1 else f"{name}-{count}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        return folder
    raise FileExistsError(f"{runs / name}: 9999 runs of that name exist; remove some")
