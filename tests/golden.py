"""Golden transcripts: a scenario in, what each vehicle says and does out, as etcd's raft has them.

`tests/testdata/{election,failsafe}/*.txt` hold steps. Each is one command a line, then `----`, then what happens while
these run, then an empty line; `#` begins a comment. `python -m tests.golden --rewrite` writes what happens now: read
the difference before you keep it.

| command | what it does |
|---|---|
| `fleet size=3 priority=2,1 d2=200 at_end=land reelection=5` | vehicles 1..size on the ground; the mission's keys |
| `fleet size=3 lost=hold` | the same, and what follows where a leader does not know its place any more |
| `fleet size=3 sensing=8 stop=60,40` | the same, with obstacle sensors; with a tree before d2, east and north |
| `show says state cause lease acts phase setpoint` | what is written from now on; all but setpoint, else |
| `only 2 3` | of these vehicles alone |
| `start 1`, `land_all 1`, `hold 1 2`, `land 1 2` | an operator's order to these vehicles |
| `run 3.5`, `until TRANSIT 60 2 3` | seconds; until all (these) are in that state, within so many |
| `mute 1`, `unmute 1` | the radio is off, on |
| `cut 1 2`, `links 1-2 2-3`, `heal` | these do not hear the others; only these pairs hear each other; all do |
| `lose 0.3 7` | each receiver misses this share of the beacons, by this seed |
| `hang 1`, `wake 1`, `restart 1` | its companion stands still, goes on, is started again |
| `battery 1 15` | percent |
| `mode 1 RETURN`, `failsafe 1 RETURN` | a pilot changes the mode; the autopilot's failsafe does |
| `disarm 1`, `refuse 1 DENIED`, `stay 1`, `obey 1` | its autopilot: motors off; refuses all; does not climb; obeys |
| `down 1` | it touches the ground |
| `unlink 1`, `link 1` | autopilot and companion do not hear each other; do |
| `fix 1 off` | its receiver has no fix, and positions go on (`on`: it has one again) |
| `displace 1 0 6`, `displace 1 0 0 6` | its position is so far off, north, east (and up) |
| `freeze 1 on` | its position stays as it is (`off`: goes on) |
| `astray 1` | its fix would be found to be led astray, if trunks told its way |
| `heartbeat 1 off`, `position 1 off`, `late 1 1.5` | no mode, no position told (`on`: again); told late, by s |
| `health 1 off` | no charge and no readiness to arm told (`on`: again) |
| `unsure 1 2` | its filter, if it flew by ranges, would be too unsure where that vehicle is (0: of none) |
| `placeless 1 on` | it may be off by more than the budget, if it flew by ranges (`off`: not any more) |
| `sensor 1 off` | its obstacle sensor is silent (`on`: again); of a fleet with `sensing=8` (its range) |

Setpoints are `none`, `rest` (below 0.05 m/s) or `moves`.

`tests/testdata/tick/*.txt` are of another kind, and written anew alike: see `tests/tick_arrows.py`.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from companion.core.agent import Agent
from companion.core.localisation.integrity.fix_monitor import Parted
from companion.core.model.actions import Say, VelocitySetpoint
from companion.core.model.states import FlightMode, Order, Result, Role
from companion.core.model.vectors import norm
from mission.document.model import PositionUncertain
from tests import tick_arrows
from tests.unit.core.core_fleet import Aircraft, Fleet
from tests.unit.core.core_kit import mission

TESTDATA = Path(__file__).parent / "testdata"
FOLDERS = ("election", "failsafe")
BOOTED_S = 490.0  # by the fleet's clock, which begins at 500
RESTS_MPS = 0.05
SHOWN = ("says", "state", "cause", "lease", "acts", "phase")


def transcripts() -> list[Path]:
    """All that there are."""
    return [path for folder in FOLDERS for path in sorted((TESTDATA / folder).glob("*.txt"))]


def play(text: str) -> str:
    """The same transcript with what happens now."""
    player = Player()
    out: list[str] = []
    for comments, commands in steps(text):
        out += comments
        if commands:
            out += [*commands, "----", *player.step(commands), ""]
    return "\n".join(out).rstrip("\n") + "\n"


def steps(text: str) -> Iterator[tuple[list[str], list[str]]]:
    """(comments and empty lines before it, commands) of each step."""
    comments: list[str] = []
    commands: list[str] = []
    lines = iter(text.splitlines())
    for line in lines:
        if line == "----":
            yield comments, commands
            comments, commands = [], []
            for result in lines:  # up to the empty line that ends them
                if not result:
                    break
        elif commands or (line and not line.startswith("#")):
            commands.append(line)
        else:
            comments.append(line)
    if commands:
        raise ValueError(f"no ---- after {commands[-1]!r}")
    yield comments, []


class Player:
    """Flies a fleet by the commands of a transcript."""

    def __init__(self) -> None:
        self._fleet = Fleet(mission())
        self._shown = set(SHOWN)
        self._only: set[int] | None = None
        self._last: dict[int, dict[str, str]] = {}
        self._lines: list[str] = []

    def step(self, commands: list[str]) -> list[str]:
        """What happens while these run."""
        self._lines = []
        for command in commands:
            name, *words = command.split()
            do: Callable[..., None] | None = getattr(self, f"do_{name}", None)
            if do is None:
                raise ValueError(f"{command!r}: no such command")
            do(*words)
        return self._lines

    def one(self, vehicle: str) -> Aircraft:
        return self._fleet.aircraft[int(vehicle)]

    def _tick(self) -> None:
        self._fleet.tick()
        for one in self._fleet.aircraft.values():
            if one.id in self._fleet.hung:
                continue
            said = [("says", f"{a.severity.name.lower()}: {a.text}") for a in one.actions if isinstance(a, Say)]
            now, last = self._look(one), self._last[one.id]
            changes = [(what, f"{last[what]} -> {value}") for what, value in now.items() if value != last[what]]
            self._last[one.id] = now
            for what, text in said + changes:
                if what in self._shown and (self._only is None or one.id in self._only):
                    since_s = self._fleet.now_s - 500.0
                    self._lines.append(f"{since_s:7.2f}  vehicle {one.id}  {what:8} {text}")

    def _look(self, one: Aircraft) -> dict[str, str]:
        status = one.agent.status(self._fleet.now_s)
        lease, phase = status.lease, status.phase.name.lower()
        leader = "none"
        if lease is not None:
            words = ["" if lease.established else "claimed", "" if lease.quorum else "without majority"]
            heir = f"heir {lease.heir}" if lease.heir else ""
            leader = " ".join(word for word in (str(lease.leader), *words, heir) if word)
        speeds = [norm(a.vel_ned_mps) for a in one.actions if isinstance(a, VelocitySetpoint)]
        return {
            "lease": leader,
            "acts": "yes" if status.role is Role.LEADER else "no",
            "phase": phase,
            "cause": "none" if status.cause is None else status.cause.name.lower(),
            "state": status.state.name.lower(),
            "setpoint": "none" if not speeds else "rest" if speeds[0] < RESTS_MPS else "moves",
        }

    # --- commands ---

    def do_fleet(self, *words: str) -> None:
        keys: dict[str, str] = dict(word.split("=") for word in words)
        size = int(keys.pop("size"))
        priority = tuple(int(k) for k in keys.pop("priority", "").split(",") if k)
        swarm: dict[str, Any] = {"size": size, "leader_priority": priority}
        if "reelection" in keys:
            swarm["reelection_period_s"] = float(keys.pop("reelection"))
        if "lost" in keys:
            swarm["position_uncertain"] = keys.pop("lost")
        route: dict[str, Any] = {
            "d2_enu_m": (float(keys.pop("d2", "200")), 0.0, 8.0),
            "at_end": keys.pop("at_end", "hold"),
        }
        if "stop" in keys:
            route["stops"] = [{"pos_enu_m": (*map(float, keys.pop("stop").split(",")), 8.0)}]
        coverage = {"duration_s": float(keys.pop("coverage", "600"))}
        tables: dict[str, Any] = {"sensing": {"range_m": float(keys.pop("sensing"))}} if "sensing" in keys else {}
        if keys:
            raise ValueError(f"fleet: no key {', '.join(keys)}")
        self._fleet = Fleet(mission(route=route, swarm=swarm, coverage=coverage, **tables))
        for one in self._fleet.aircraft.values():
            one.boot_s = BOOTED_S
            self._last[one.id] = self._look(one)

    def do_show(self, *what: str) -> None:
        self._shown = set(what)

    def do_only(self, *vehicles: str) -> None:
        self._only = {int(k) for k in vehicles}

    def do_start(self, *vehicles: str) -> None:
        self._order(Order.START, vehicles)

    def do_land_all(self, *vehicles: str) -> None:
        self._order(Order.ABORT, vehicles)

    def do_hold(self, *vehicles: str) -> None:
        self._order(Order.HOLD, vehicles)

    def do_land(self, *vehicles: str) -> None:
        self._order(Order.LAND, vehicles)

    def _order(self, order: Order, vehicles: Iterable[str]) -> None:
        for vehicle in vehicles:
            self._fleet.order(int(vehicle), order)

    def do_run(self, seconds: str) -> None:
        end_s = self._fleet.now_s + float(seconds)
        while self._fleet.now_s < end_s - 1e-6:
            self._tick()

    def do_until(self, state: str, limit_s: str, *vehicles: str) -> None:
        end_s = self._fleet.now_s + float(limit_s)
        among = [self.one(k) for k in vehicles] or list(self._fleet.aircraft.values())
        while any(one.state.name != state for one in among):
            if self._fleet.now_s >= end_s:
                raise ValueError(f"not {state} within {limit_s} s: {[one.state.name for one in among]}")
            self._tick()

    def do_mute(self, *vehicles: str) -> None:
        self._fleet.mute |= {int(k) for k in vehicles}

    def do_unmute(self, *vehicles: str) -> None:
        self._fleet.mute -= {int(k) for k in vehicles}

    def do_cut(self, *vehicles: str) -> None:
        self._fleet.apart = {int(k) for k in vehicles}

    def do_links(self, *pairs: str) -> None:
        self._fleet.links = {frozenset(int(k) for k in pair.split("-")) for pair in pairs}

    def do_heal(self) -> None:
        self._fleet.apart, self._fleet.links = set(), None

    def do_lose(self, share: str, seed: str) -> None:
        self._fleet.loss, self._fleet.rng = float(share), random.Random(int(seed))

    def do_hang(self, *vehicles: str) -> None:
        self._fleet.hung |= {int(k) for k in vehicles}

    def do_wake(self, *vehicles: str) -> None:
        self._fleet.hung -= {int(k) for k in vehicles}

    def do_restart(self, vehicle: str) -> None:
        self.one(vehicle).agent = Agent(self._fleet.mission, int(vehicle))

    def do_battery(self, vehicle: str, percent: str) -> None:
        self.one(vehicle).battery_percent = int(percent)

    def do_mode(self, vehicle: str, mode: str) -> None:
        self.one(vehicle).mode, self.one(vehicle).failsafe = FlightMode[mode], False

    def do_failsafe(self, vehicle: str, mode: str) -> None:
        self.one(vehicle).mode, self.one(vehicle).failsafe = FlightMode[mode], True

    def do_disarm(self, vehicle: str) -> None:
        self.one(vehicle).armed = self.one(vehicle).can_arm = False

    def do_refuse(self, vehicle: str, result: str) -> None:
        self.one(vehicle).refuses = Result[result]

    def do_obey(self, vehicle: str) -> None:
        one = self.one(vehicle)
        one.refuses, one.can_arm, one.can_climb = None, True, True

    def do_stay(self, vehicle: str) -> None:
        self.one(vehicle).can_climb = False

    def do_down(self, vehicle: str) -> None:
        north_m, east_m, _ = self.one(vehicle).pos_ned_m
        self.one(vehicle).pos_ned_m = (north_m, east_m, 0.0)

    def do_unlink(self, vehicle: str) -> None:
        self.one(vehicle).is_linked = False

    def do_link(self, vehicle: str) -> None:
        self.one(vehicle).is_linked = True

    def do_health(self, vehicle: str, on: str) -> None:
        self.one(vehicle).tells_health = on == "on"

    def do_heartbeat(self, vehicle: str, on: str) -> None:
        self.one(vehicle).tells_mode = on == "on"

    def do_position(self, vehicle: str, on: str) -> None:
        self.one(vehicle).estimates_position = on == "on"

    def do_fix(self, vehicle: str, on: str) -> None:
        self.one(vehicle).has_fix = on == "on"

    def do_displace(self, vehicle: str, north_m: str, east_m: str, up_m: str = "0") -> None:
        self.one(vehicle).off_ned_m = (float(north_m), float(east_m), 0.0 - float(up_m))

    def do_freeze(self, vehicle: str, on: str) -> None:
        one = self.one(vehicle)
        one.frozen_ned_m = one.told_ned_m if on == "on" else None

    def do_astray(self, vehicle: str) -> None:
        own = self.one(vehicle).agent.flight.vehicle.position
        assert own is not None
        led = (own.pos_ned_m[0], own.pos_ned_m[1])
        now_s = self._fleet.now_s
        self.one(vehicle).agent.own_position._begin_reckoning(own, Parted(now_s - 5.0, led, 0.0), now_s)

    def do_sensor(self, vehicle: str, on: str) -> None:
        self.one(vehicle).sees = on == "on"

    def do_unsure(self, vehicle: str, of: str) -> None:
        self.one(vehicle).agent.localiser.uncertain_peer = int(of)

    def do_placeless(self, vehicle: str, on: str) -> None:
        self.one(vehicle).agent.localiser.is_position_lost = on == "on"
        for one in self._fleet.aircraft.values():  # as if the mission had vehicles that fly by ranges
            spec = one.agent.mission.swarm.position_uncertain
            one.agent.swarm.trust.gate.may_turn_back = spec is PositionUncertain.RETURN

    def do_late(self, vehicle: str, seconds: str) -> None:
        self.one(vehicle).late_s = float(seconds)


def main() -> int:
    """Exit code 1 when a transcript is not what happens now."""
    parser = argparse.ArgumentParser(description="Compare the golden transcripts with what happens now.")
    parser.add_argument("--rewrite", action="store_true", help="write what happens now")
    parser.add_argument("files", nargs="*", type=Path, help="all of tests/testdata, else")
    arguments = parser.parse_args()
    differ = False
    for path in arguments.files or [*transcripts(), *tick_arrows.transcripts()]:
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        found = tick_arrows.record(path.stem) if path.parent.name == tick_arrows.TESTDATA.name else play(text)
        if found != text:
            print(f"{path}: {'rewritten' if arguments.rewrite else 'differs'}")
            differ = True
            if arguments.rewrite:
                path.write_text(found, encoding="utf-8")
    return 1 if differ and not arguments.rewrite else 0


if __name__ == "__main__":
    sys.exit(main())
