"""Addresses of a served world: for programs, and for people."""

from __future__ import annotations

import os
import shlex
import shutil
import socket
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from companion.keys.fleet_folder import file_name
from companion.keys.keyring import OPERATOR
from mission.common.network import own_addresses
from mission.document.model import Mission, Personality
from sim_bridge.drive.links.hub import place
from sim_bridge.drive.links.ports import LOOPBACK, Address
from sim_bridge.drive.serve.server import Ports
from sim_bridge.world.sensors.table import link_name

BASE_RECORDS = "records.db"  # where the command is given
TAKEOFF_NOTES = {
    Personality.PX4: "PX4: takeoff altitudes are above sea level",
    Personality.ARDUPILOT: "ArduPilot: takeoff altitudes are above home; it can be armed after about 42 s",
}


def where(mission: Mission, mission_file: Path, ports: Ports, speed: float, keys: Path | None = None) -> dict[str, Any]:
    """Addresses of `ports`: what `serve --json` prints. `mission_file`: as flown; `speed`: over wall time.

    `keys`: the fleet's folder; None: the radio is unsigned.
    """

    sensor = link_name(mission)

    def port(bound: socket.socket) -> int:
        number: int = bound.getsockname()[1]
        return number

    def url(bound: socket.socket) -> str:
        return f"udpout://{LOOPBACK}:{port(bound)}"

    def drivers(vehicle_id: int) -> list[str]:
        return ["--sensor", f"{sensor}={url(ports.sensors[vehicle_id])}"] if vehicle_id in ports.sensors else []

    def key(owner: int) -> list[str]:
        return ["--unsigned"] if keys is None else ["--key", str(keys.absolute() / file_name(owner))]

    return {
        "name": mission.name,
        "pid": os.getpid(),
        "mission": str(mission_file),
        "seed": mission.sim.seed,
        "speed": speed,
        "ground_amsl_m": None if mission.origin is None else mission.origin.alt_m,
        "host": LOOPBACK,
        "ground": {
            "port": port(ports.ground),
            "mavsdk": url(ports.ground),
            "mavproxy": f"--master=udpout:{LOOPBACK}:{port(ports.ground)}",
        },
        "radio": {"port": port(ports.radio)},
        "base": _base(mission_file, url(ports.radio), key(OPERATOR)) if mission.keeps_records else None,
        "orders": None if keys is None else _orders(mission_file, url(ports.radio), key(OPERATOR)),
        "page": None if keys is None else _page(mission_file, url(ports.radio), key(OPERATOR)),
        "sensor": sensor,
        "vehicles": [
            {
                "id": vehicle_id,
                "personality": mission.sim.personality_of(vehicle_id).value,
                "port": port(bound),
                "mavsdk": url(bound),
                "mavproxy": f"--master=udpout:{LOOPBACK}:{port(bound)}",
                "companion": [
                    *(_program("companion"), "run", "--mission", str(mission_file), "--id", str(vehicle_id)),
                    *("--autopilot", url(bound), "--peers", url(ports.radio), *drivers(vehicle_id)),
                    *("--waive", "all"),
                    *key(vehicle_id),
                ],
                **({sensor: {"port": port(ports.sensors[vehicle_id])}} if vehicle_id in ports.sensors else {}),
            }
            for vehicle_id, bound in ports.onboard.items()
        ],
    }


def table(where: Mapping[str, Any], push: Address | None) -> str:
    """The same for people, ready to paste. `push`: the ground station that is sent to unasked."""
    vehicles = where["vehicles"]
    ground = where["ground"]
    count = "1 vehicle" if len(vehicles) == 1 else f"{len(vehicles)} vehicles"
    rows = [(f"vehicle {v['id']}", v["mavsdk"], v["mavproxy"]) for v in vehicles]
    rows.insert(0, ("all, ground side", ground["mavsdk"], ground["mavproxy"]))
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    lines = [
        f"{where['name'] or 'unnamed mission'}: {count}, seed {where['seed']}, "
        f"{where['speed']:g} x real time; Ctrl-C ends it",
        "",
        f"{'':{widths[0]}}  {'MAVSDK':{widths[1]}}  mavproxy.py",
        *(f"{name:{widths[0]}}  {mavsdk:{widths[1]}}  {mavproxy}" for name, mavsdk, mavproxy in rows),
        "",
        *own_addresses.lines("live map:", where.get("maps", ())),
        f"a ground station that listens: {place(push) if push else 'none (--ground HOST:PORT)'}",
        "",
        *_drivers(vehicles, where["sensor"]),
        "companions, each in a shell of its own:",
        *(f"  {shlex.join(v['companion'])}" for v in vehicles),
        "",
        *_base_station(where["base"]),
        *_operator(where["orders"], where["page"]),
        f"the ground is at {where['ground_amsl_m']:g} m above sea level",
        *(TAKEOFF_NOTES[Personality(name)] for name in sorted({v["personality"] for v in vehicles}, reverse=True)),
    ]
    return "\n".join(lines)


def _base_station(command: Sequence[str] | None) -> list[str]:
    if command is None:
        return []
    return ["the base station, which collects their records:", f"  {shlex.join(command)}", ""]


def _operator(orders: Mapping[str, Sequence[str]] | None, page: Sequence[str] | None) -> list[str]:
    if orders is not None and page is not None:
        return [
            "they wait for the operator's key:",
            *(f"  {shlex.join(command)}" for command in orders.values()),
            "or for orders from a page:",
            f"  {shlex.join(page)}",
        ]
    return [
        "they wait for an operator; from MAVProxy on the ground side, for one of them (it tells the others):",
        "  set target_component 191",
        "  long MISSION_START 0 0 0 0 0 0 0",
    ]


def _drivers(vehicles: Sequence[Mapping[str, Any]], sensor: str) -> list[str]:
    ports = [f"  vehicle {v['id']}  {LOOPBACK}:{v[sensor]['port']}" for v in vehicles if sensor in v]
    if not ports:
        return []
    return [
        "drivers of the vehicles' sensors (to those that send there, anything, once in 10 s):",
        *ports,
        "",
    ]


def _base(mission_file: Path, radio: str, key: Sequence[str]) -> list[str]:
    options = ("--listen", radio, "--records", BASE_RECORDS, *key)
    return [_program("companion"), "base", str(mission_file), *options]


def _orders(mission_file: Path, radio: str, key: Sequence[str]) -> dict[str, list[str]]:
    options = (*key, "--mission", str(mission_file), "--peers", radio)
    return {kind: [_program("companion"), "order", kind, *options] for kind in ("start", "hold", "land", "abort")}


def _page(mission_file: Path, radio: str, key: Sequence[str]) -> list[str]:
    return [_program("companion"), "watch", *key, "--mission", str(mission_file), "--peers", radio, "--orders"]


def _program(name: str) -> str:
    """The command for one of our programs, in the shell that started this one."""
    beside = Path(sys.argv[0]).parent / name
    return name if shutil.which(name) or not beside.is_file() else str(beside)
