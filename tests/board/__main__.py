"""`make board-test`: the bundle on a board, as far as one computer can show it. On Debian, x86_64, as root.

1. x86_64, with a systemd of its own: install, upgrade and roll back without a network; one of three flies as a service,
   is killed and hung in flight.
2. arm64, emulated (qemu): install without a network; one of three flies from in there, in lockstep with the bridge.

Minimal Debian userlands are made under build/ (kept) and copied for the test (removed).
"""

from __future__ import annotations

import argparse
import io
import os
import platform
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from companion.board import bundle
from companion.keys.fleet_folder import file_name, make_fleet
from companion.keys.key_file import load_keyring
from mission.document.load import parse_mission
from sim_bridge.drive import fly
from sim_bridge.judge.progress import Progress
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.board.userland import Booted, Userland, emulation, fresh, tools
from tests.interop.interop_kit import Station, child, listening, serving

ROOT = Path(__file__).parents[2]
CACHE = ROOT / "build" / "board"
NEXT_VERSION = "0.2.0.post1"
SERVICE = "understory-companion"
MISSION = """\
schema = 1
name = "board test"
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [{length_m}, 0.0, 8.0]
vel_leader_mps = 2.0
[swarm]
size = 3
start_timeout_s = 5.0
[coverage]
duration_s = 15.0
[sim]
placement = "grid"
"""
BOARDS = 1  # the vehicle that flies from the board; the others are programs of this computer
FLY_LIMIT_S = 180.0
CRUISING_MPS, BRAKING_MPS, MOVING_MPS, HOLDING_MPS = 1.7, 1.5, 1.0, 0.2  # of a leader's 2 m/s


class Report:
    """Rows of figures, printed as they are found and kept as Markdown."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.failed = False

    def part(self, title: str) -> None:
        self._add("", f"## {title}", "", "| what | wanted | seen | reached |", "|---|---|---|---|")

    def row(self, what: str, wanted: str, seen: str, reached: bool) -> None:
        self.failed |= not reached
        self._add(f"| {what} | {wanted} | {seen} | {'yes' if reached else '**no**'} |")

    def _add(self, *lines: str) -> None:
        self.lines += lines
        print(*lines, sep="\n", flush=True)


def main() -> int:
    """Exit code 1 when a figure was not reached, 3 when this computer cannot run the test."""
    parser = argparse.ArgumentParser(prog="python -m tests.board", description=__doc__)
    parser.add_argument("--only", choices=("x86_64", "arm64"), help="one of the two parts")
    parser.add_argument("--write", type=Path, metavar="FILE", help="the report as Markdown, too")
    args = parser.parse_args()
    if os.getuid() != 0 or platform.machine() != "x86_64" or shutil.which("apt-get") is None:
        print("board-test: needs root on a Debian or Ubuntu machine (x86_64)", file=sys.stderr)
        return bundle.EXIT_ENVIRONMENT
    tools()
    report = Report()
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="understory-") as folder:
        work = Path(folder)
        work.chmod(0o755)
        first = bundle.make(work, CACHE)
        if args.only != "arm64":
            (work / "next").mkdir()
            second = bundle.make(work / "next", CACHE, NEXT_VERSION)
            with fresh("amd64", CACHE) as userland:
                as_service(userland, first, second, work, report)
        if args.only != "x86_64":
            with emulation(), fresh("arm64", CACHE) as userland:
                emulated(userland, first, work, report)
    print(f"\n{time.monotonic() - began_s:.0f} s")
    if args.write:
        args.write.write_text("\n".join([*heading(), *report.lines, ""]), encoding="utf-8")
    return bundle.EXIT_FAILED if report.failed else bundle.EXIT_DONE


def heading() -> list[str]:
    qemu = subprocess.run(["qemu-aarch64-static", "--version"], capture_output=True, text=True, check=True).stdout
    systemd = subprocess.run(["systemctl", "--version"], capture_output=True, text=True, check=True).stdout
    return [
        "# Board test",
        "",
        "Written by `make board-test WRITE=docs/reference/board-test.md`, on "
        f"{datetime.now(UTC):%Y-%m-%d}; {os.cpu_count()} cores, Linux {platform.release().split('-')[0]}, "
        f"{qemu.split(' (')[0]}, {' '.join(systemd.split()[:2])}, Debian bookworm userlands.",
        "",
        "Nothing here was flown on hardware: the vehicles are the bridge's, and the arm64 processor is emulated.",
    ]


# --- installing ---


@contextmanager
def timed(seen: list[float]) -> Iterator[None]:
    began_s = time.monotonic()
    yield
    seen.append(time.monotonic() - began_s)


def install(userland: Userland, archive: Path, report: Report) -> str:
    """Install offline, twice; the bundle's folder in the tree."""
    folder = userland.unpack(archive)
    first, second = (make_fleet(userland.root / "root" / name, 3) for name in ("fleet", "other"))
    given = f"/root/fleet/{file_name(BOARDS)}"
    took_s: list[float] = []
    with timed(took_s):
        userland.offline(f"{folder}/install.sh", "--key", given)
    said = userland.offline("companion", "--version").strip()
    ask = "import platform as p; print(p.machine(), 'Python', p.python_version())"
    machine = userland.offline("python3", "-c", ask)
    report.row("install, network off", "works", f"{took_s[0]:.0f} s; {said}, {machine.strip()}", "understory" in said)
    bindings = userland.offline(
        "/opt/understory/current/bin/python", "-c", "import mavsdk.asyncio; print('loads')"
    ).strip()
    report.row("MAVSDK's library, for the preflight", "loads", bindings, bindings == "loads")
    installed = userland.root / "etc/understory/vehicle.key"
    mode = userland.offline("stat", "-c", "%a %U", "/etc/understory/vehicle.key").strip()
    good = mode == "600 understory" and load_keyring(installed, BOARDS) == first.keyring_of(BOARDS)
    report.row("the key", "0600, the service's", mode, good)
    other = f"/root/other/{file_name(BOARDS)}"
    again = userland.offline(f"{folder}/install.sh", "--key", other)
    kept = "is installed already" in again and load_keyring(installed, BOARDS) == first.keyring_of(BOARDS)
    report.row("install again", "nothing changes", "the same release, the same key" if kept else again, kept)
    told = userland.offline("understory-install", "--replace-key", other).strip().splitlines()[0]
    report.row("another key", "replaced", told, load_keyring(installed, BOARDS) == second.keyring_of(BOARDS))
    return folder


# --- x86_64, as a service ---


def as_service(userland: Userland, first: Path, second: Path, work: Path, report: Report) -> None:
    report.part("x86_64, with a systemd of its own")
    install(userland, first, report)
    verified = userland.offline("systemd-analyze", "verify", "--man=no", f"/etc/systemd/system/{SERVICE}.service")
    report.row("`systemd-analyze verify`", "no word", verified.strip() or "no word", not verified.strip())
    newer = userland.unpack(second)
    with ExitStack() as stack:
        fleet = userland.root / "root/other"  # the one that was installed last
        served = stack.enter_context(serving(work, MISSION.format(length_m=60.0), "--keys", str(fleet)))
        (userland.root / "etc/understory/companion.env").write_text(
            f"UNDERSTORY_ID={BOARDS}\n"
            f"UNDERSTORY_AUTOPILOT={served.vehicle(BOARDS)['mavsdk']}\n"
            f"UNDERSTORY_PEERS=udpout://127.0.0.1:{served.notice['radio']['port']}\n"
            "UNDERSTORY_OPTIONS=--waive all\n"
        )
        shutil.copy(served.notice["mission"], userland.root / "etc/understory/mission.toml")
        board = Booted(userland, work / "boot.log")
        stack.callback(board.close)
        board.run("systemctl", "enable", "--now", SERVICE)
        active = board.shown("ActiveState") == "active"
        report.row("`systemctl enable --now`", "READY=1", board.shown("StatusText"), active)
        up_and_down(board, newer, report)
        for vehicle_id in range(BOARDS + 1, 4):
            program, *options = served.vehicle(vehicle_id)["companion"]
            command = [sys.executable, "-m", f"{Path(program).name}.cli", *options]
            stack.enter_context(child(command, work, f"companion-{vehicle_id}", stdin=subprocess.DEVNULL))
        station = stack.enter_context(listening(served))
        in_flight(board, station, served.notice["orders"]["start"], newer, report)
        hardening(board, report)


def release(board: Booted) -> str:
    return board.run("companion", "--version").split()[1].rstrip(",")


def up_and_down(board: Booted, newer: str, report: Report) -> None:
    """One command each, with the network off, while the service runs."""
    seen = [release(board)]
    took_s: list[float] = []
    rollback = ["understory-install", "--rollback"]
    for command in ([f"{newer}/install.sh"], rollback, rollback):
        with timed(took_s):
            board.run(*command, network=False)
        seen.append(release(board))
    wanted = [seen[0], NEXT_VERSION, seen[0], NEXT_VERSION]
    text = f"{' → '.join(seen)} in {' / '.join(f'{s:.1f} s' for s in took_s)}; {board.shown('ActiveState')}"
    good = seen == wanted and text.endswith("; active")
    report.row("upgrade, roll back, and forth again", " → ".join(wanted), text, good)


class Tracker:
    """One vehicle, as its autopilot tells the ground station."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self.texts: list[str] = []

    def until(self, wanted: Callable[[float], bool], limit_s: float) -> float:
        """Monotonic time at which the speed (m/s) of the board's vehicle is `wanted`; inf when it does not happen."""
        for message in self._station.messages(limit_s):
            if message.get_type() == "STATUSTEXT":
                self.texts.append(message.text)
            elif message.get_type() == "GLOBAL_POSITION_INT" and message.get_srcSystem() == BOARDS:
                speed_mps = (message.vx**2 + message.vy**2 + message.vz**2) ** 0.5 / 100.0
                if wanted(speed_mps):
                    return time.monotonic()
        return float("inf")


def in_flight(board: Booted, station: Station, start: list[str], newer: str, report: Report) -> None:
    """Take off, be killed, be hung, arrive. `start`: the command that gives the operator's order."""
    ready: set[int] = set()
    for message in station.messages(FLY_LIMIT_S):
        if message.get_type() == "STATUSTEXT" and message.get_srcComponent() == 191 and message.text == "ready":
            ready.add(message.get_srcSystem())
        if len(ready) >= 2:  # the board's has said so before
            break
    program, *options = start
    order = [sys.executable, "-m", Path(program).name, *options, "--yes"]
    ordered = subprocess.run(order, capture_output=True, text=True, check=False)
    said = (ordered.stdout.strip().splitlines() or [ordered.stderr.strip()])[-1]
    report.row("the operator's START, signed", "all act on it", said, ordered.returncode == 0)
    track = Tracker(station)
    cruise = track.until(lambda speed_mps: speed_mps > CRUISING_MPS, FLY_LIMIT_S)
    report.row("one of three flies from the board", "cruises", board.shown("StatusText"), cruise < float("inf"))
    refused = subprocess.run(board.command(f"{newer}/install.sh"), capture_output=True, text=True, check=False)
    report.row("upgrade in flight", "refused, code 3", refused.stderr.strip(), refused.returncode == 3)
    lost(board, track, report, "SIGKILL", "`kill -9` in flight", up_limit_s=2.0)
    track.until(lambda speed_mps: speed_mps > CRUISING_MPS, 30.0)
    lost(board, track, report, "SIGSTOP", "hung in flight (SIGSTOP)", up_limit_s=4.0)
    arrived = any("arrived" in text for text in track.texts)
    end_s = time.monotonic() + FLY_LIMIT_S
    while not arrived and time.monotonic() < end_s:
        track.until(lambda _: False, 1.0)
        arrived = any("arrived" in text for text in track.texts)
    report.row("the swarm", "arrives", next((t for t in track.texts if "arrived" in t), "did not"), arrived)


def lost(board: Booted, track: Tracker, report: Report, sign: str, what: str, *, up_limit_s: float) -> None:
    """Send `sign` to the service's main process; measure holding, start and return."""
    restarts = int(board.shown("NRestarts"))
    began_s = time.monotonic()
    board.run("systemctl", "kill", f"--signal={sign}", "--kill-whom=main", SERVICE)
    brakes_s = track.until(lambda speed_mps: speed_mps < BRAKING_MPS, 10.0) - began_s
    held_s = track.until(lambda speed_mps: speed_mps < HOLDING_MPS, 10.0) - began_s
    again_s = track.until(lambda speed_mps: speed_mps > MOVING_MPS, 20.0) - began_s
    up_s = int(board.shown("ActiveEnterTimestampMonotonic")) / 1e6 - began_s
    restarted = int(board.shown("NRestarts")) == restarts + 1
    report.row(f"{what}: below {BRAKING_MPS} m/s", "≤ 1 s", f"{brakes_s:.2f} s", brakes_s <= 1.0)
    report.row(f"{what}: below {HOLDING_MPS} m/s", "≤ 2 s from 2 m/s", f"{held_s:.2f} s", held_s <= 2.0)
    report.row("service ready again", f"≤ {up_limit_s:.0f} s", f"{up_s:.2f} s", restarted and 0.0 < up_s <= up_limit_s)
    report.row("steered again with the swarm", "≤ 5 s after ready", f"{again_s:.2f} s", again_s - up_s <= 5.0)


def hardening(board: Booted, report: Report) -> None:
    status = board.run("cat", f"/proc/{board.shown('MainPID')}/status")
    found = dict(re.findall(r"^(\w+):\s*(.*)$", status, re.MULTILINE))
    good = (found["NoNewPrivs"], found["Seccomp"], int(found["CapBnd"], 16)) == ("1", "2", 0)
    seen = f"NoNewPrivs {found['NoNewPrivs']}, Seccomp {found['Seccomp']}, CapBnd {int(found['CapBnd'], 16)}"
    report.row("the process is confined", "1, 2, 0", seen, good)
    report.row("memory at its highest", "< 128 MB of 256", found["VmHWM"], int(found["VmHWM"].split()[0]) < 128_000)
    journal = board.run("journalctl", "--unit", SERVICE, "--no-pager", "--output=cat")
    trace = "Aborted" in journal and "by_monotonic" in journal
    report.row("where it hung is in the journal", "a trace", "a trace" if trace else "nothing", trace)


# --- arm64, emulated ---


def emulated(userland: Userland, archive: Path, work: Path, report: Report) -> None:
    report.part("arm64, emulated")
    install(userland, archive, report)
    mission = parse_mission(MISSION.format(length_m=30.0)).with_origin(DEFAULT_ORIGIN)
    native = flight(mission, work / "native", {})
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        name = f"@understory-board-{os.getpid()}"
        manager.bind(name.replace("@", "\0"))
        manager.setblocking(False)
        words: list[str] = []
        shared = work / "emulated"
        program = userland.command(
            *("setpriv", "--reuid=understory", "--regid=understory", "--init-groups"),
            *("env", f"NOTIFY_SOCKET={name}", "WATCHDOG_USEC=1500000", "/opt/understory/current/bin/companion"),
            shared=shared,
        )
        outcome = flight(mission, shared, {BOARDS: program}, lambda _: words.extend(heard(manager)))
    metrics = outcome.summary
    ended = f"{outcome.ended}, {metrics['sim_time_s']:.0f} s"
    report.row("one of three flies from the board, lockstep", "arrives", ended, outcome.succeeded)
    signs = sum("WATCHDOG=1" in word for word in words)
    report.row("READY=1, then WATCHDOG=1", "heard", f"{signs} words", "READY=1" in words[0] and signs > 1)
    for name in ("leader_overhead", "separation_min_m", "contacts", "connected_fraction_transit"):
        if name in metrics:
            report.row(f"`{name}`", f"{native.summary[name]:.6g} (all native)", f"{metrics[name]:.6g}", True)
    same = metrics["trace_hash"] == native.summary["trace_hash"]
    report.row("the same flight to the bit as all native", "for information", "yes" if same else "no", True)
    for label, one in (("all native", native), ("one emulated", outcome)):
        factor = one.summary["real_time_factor"]
        seen = f"{factor:.1f} x real time, {50.0 / factor:.2f} ms a tick, of all three and the bridge"
        report.row(f"speed, {label}", "for information", seen, True)


def flight(mission: Any, folder: Path, programs: Any, watch: Any = None) -> Any:
    folder.mkdir()
    folder.chmod(0o777)
    os.umask(0)  # the emulated companion is another user, and writes its log beside the others
    try:
        return fly.fly(mission, folder, Progress(io.StringIO()), watch=watch, programs=programs)
    finally:
        os.umask(0o022)


def heard(manager: socket.socket) -> Iterator[str]:
    while True:
        try:
            yield manager.recv(4096).decode()
        except BlockingIOError:
            return


if __name__ == "__main__":
    sys.exit(main())
