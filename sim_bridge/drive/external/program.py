"""`sim-bridge fly --autopilots`: n companions over external autopilots (SITL, HITL), on the wall clock.

The bridge stands between: it routes each companion to its autopilot, is the radio between the companions, and listens
in. Positions (for sensors, radio and judge) are the truth where an autopilot's simulator tells it, else
GLOBAL_POSITION_INT as the autopilot sends it: the verdict says so.
"""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path

from mission.cli.main import EXIT_ENVIRONMENT
from mission.common.frames import LocalFrame
from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.drive.children import loss
from sim_bridge.drive.external.autopilots import Autopilots, origin_at_home, strays
from sim_bridge.drive.external.flight import ExternalFlight
from sim_bridge.drive.external.launched import Launched
from sim_bridge.drive.external.options import ExternalAutopilots
from sim_bridge.drive.faults import keep_faults
from sim_bridge.drive.interrupts import interrupt_once, no_more_interrupts
from sim_bridge.drive.links.router import open_sockets
from sim_bridge.drive.live.map import Map
from sim_bridge.errors import StartError
from sim_bridge.judge import run_folder
from sim_bridge.judge.outcome import Outcome, conclude
from sim_bridge.judge.progress import Progress

HEARD_LIMIT_S = 60.0  # from start to an autopilot's first heartbeat
POSITION_LIMIT_S = 120.0  # ... to its position: ArduPilot's estimator takes 42 s
LAND_LIMIT_S = 120.0
SAID_LIMIT_S = 2.0  # from all being down until their companions have said so
TRUTH_LIMIT_S = 3.0  # ... to a simulator's truth, when all else is there; hardware tells none


def fly_external(
    mission: Mission, external: ExternalAutopilots, folder: Path, progress: Progress, map_: Map | None = None
) -> Outcome:
    """Fly `mission` into the empty `folder`; one without an origin is placed at the first vehicle's home.

    `map_`: where it is watched. It is begun here.
    The first KeyboardInterrupt orders all to land, the second ends it at once. StartError when an autopilot cannot be
    had.
    """
    began_s = time.monotonic()
    ids = range(1, mission.swarm.size + 1)
    with ExitStack() as stack:
        sockets = open_sockets(external.url, ids, external.first_port)
        stack.callback(sockets.close)
        launched = Launched()
        stack.callback(launched.close)
        if external.launch is not None:
            commands = {k: external.command(k, port) for k, port in sockets.ports.items()}
            launched.start_all(commands, folder / "autopilots")
        autopilots = Autopilots(
            ids, sockets, lambda text: progress.event(0.0, text), sensing=mission.sensing is not None
        )
        stack.callback(autopilots.listener.close)
        mission = _meet(mission, autopilots, launched)
        assert mission.origin is not None
        run_folder.write(folder / "mission.toml", dump_mission(mission).encode())
        autopilots.frame = LocalFrame(mission.origin.wgs84)
        if map_ is not None:
            map_.begin(folder / "mission.toml", mission.name or "flight", mission.swarm.size)
        flight = ExternalFlight(mission, autopilots, folder, stack, map_, black_box=external.black_box)
        for stray in strays(mission, autopilots.positions()):
            flight.note(stray)
        if mission.sensing is not None and (unseen := autopilots.heights_by_estimates()):
            flight.note(f"how hard these meet the ground is not seen, by estimates: {', '.join(map(str, unseen))}")
        began_flying_s = time.monotonic()
        try:
            ended = _run(flight, launched, progress)
        except KeyboardInterrupt:
            ended = "interrupted"
        flown_s = time.monotonic() - began_flying_s
        end_s = flight.now_s  # before the order to land lifts the faults
        flight.note_left_behind()
        _land(flight, progress)
        keep_faults(flight.faults, flight.now_s, folder, progress)
        records = flight.tell_records()
    if flight.forks.failure is not None:
        flight.observer.tell_once(flight.now_s, loss(0, flight.forks.failure))
    flight.show(progress)
    return conclude(
        flight.recorder.recording(),
        mission,
        folder,
        ended,
        flown_s=flown_s,
        wall_s=time.monotonic() - began_s,
        trace_hash=None,  # no two flights on the wall clock are the same to the bit
        faults=flight.faults.happened,
        end_s=end_s,
        stand=flight.stand,
        estimates=flight.errors(),
        records=records,
    )


def _meet(mission: Mission, autopilots: Autopilots, launched: Launched) -> Mission:
    """Wait until every vehicle is heard and knows where it is; the mission with its origin. StartError."""
    began_s = time.monotonic()
    home_of = autopilots.ids[0] if mission.origin is None else None
    while missing := autopilots.missing(home_of=home_of):
        now_s = time.monotonic()
        all_heard = all(autopilots.router.knows(k) for k in autopilots.ids)
        limit_s = POSITION_LIMIT_S if all_heard else HEARD_LIMIT_S
        if now_s - began_s > limit_s:
            raise StartError(f"{missing} within {limit_s:g} s", EXIT_ENVIRONMENT)
        for died in launched.died():
            raise StartError(died, EXIT_ENVIRONMENT)
        autopilots.request_streams(now_s)
        autopilots.listener.poll(0.1)
    known_s = time.monotonic()
    while autopilots.lacks_truth() and (now_s := time.monotonic()) - known_s < TRUTH_LIMIT_S:
        autopilots.request_streams(now_s)
        autopilots.listener.poll(0.1)
    autopilots.fix_position_sources()
    home = autopilots.telemetry[autopilots.ids[0]].home
    return mission if mission.origin is not None or home is None else origin_at_home(mission, home)


def _run(flight: ExternalFlight, launched: Launched, progress: Progress) -> str:
    """Step until the end; why it ended."""
    while (ended := flight.finished()) is None:
        if flight.step():
            flight.order_start()
            for died in launched.died():
                flight.note(died)
            flight.show(progress)
    return ended


def _land(flight: ExternalFlight, progress: Progress) -> None:
    """However a flight has ended, no vehicle is left in the air without being told to land."""
    flight.over = True
    began_s = flight.now_s
    interrupt_once()
    try:
        while aloft := flight.order_land():
            if flight.now_s - began_s > LAND_LIMIT_S:
                break
            flight.step()
            flight.show(progress)
        down_s = flight.now_s
        while flight.landings_unsaid() and flight.now_s - down_s <= SAID_LIMIT_S:
            flight.step()
    except KeyboardInterrupt:
        aloft = flight.order_land()
    no_more_interrupts()
    flight.show(progress)
    if aloft:
        vehicles = ", ".join(map(str, aloft))
        progress.event(flight.now_s, f"still in the air or armed: {vehicles}: land them from a ground station")
