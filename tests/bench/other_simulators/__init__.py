"""Ours beside other simulators, on one task, in turn: `make other-simulators`.

Each of the others has an environment of its own, `.venv-other-simulators/NAME`, from `NAME.lock`: their dependencies
exclude one another. What each flies, and with which controller, is in `fly_NAME.py`. Where they are installed,
`python -m tests.bench other-simulators` will do.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.bench.table import Row, spread
from tests.bench.turns import ROOT, StintError, StintProgram, cost_s, stint_command

HERE = Path(__file__).resolve().parent
ENVIRONMENTS = ROOT / ".venv-other-simulators"
STINT_S = 5.0
STINTS = 8  # 120 of the 130 m, all of them in transit
LAST_S = 15.0  # to the places at d2: not timed
MISSION = "mission/examples/lone_tree.toml"
ALONE = "no autopilot, MAVLink, radio, agents or recording"


@dataclass(frozen=True, slots=True)
class Entrant:
    """Another simulator, or a part of ours."""

    name: str
    script: str
    environment: str | None  # under ENVIRONMENTS; None: this one
    what: str


ENTRANTS = (
    Entrant("ours, airframes only (JSBSim", "fly_jsbsim.py", None, f"rotors, legs, air, velocity loops; {ALONE}"),
    Entrant(
        "crazyflow (", "fly_crazyflow.py", "crazyflow", f"one world, on the CPU; rotors with drag, no contacts; {ALONE}"
    ),
    Entrant("PyFlyt (", "fly_pyflyt.py", "pyflyt", f"Bullet, rotors, velocity loops; {ALONE}"),
    Entrant("RotorPy (", "fly_rotorpy.py", "rotorpy", f"rotors with drag, velocity loop; {ALONE}"),
)
FULL = (
    f"one task, 8 quadrotors, 130 m at 3 m/s, velocity setpoints at 20 Hz, {STINTS} stints of {STINT_S:g} s in turn: "
    "ours, full stack (200 Hz JSBSim, simulated PX4, MAVLink both ways, radio, election, separation, logs)"
)


def other_simulators() -> Iterator[Row]:
    """Vehicle-seconds for a processor's second, threads and processes counted. Compiling is not timed."""
    told: dict[str, dict[str, Any]] = {}
    missing: dict[str, str] = {}
    with ExitStack() as stack:
        full = stack.enter_context(StintProgram(stint_command(MISSION)))
        full.fly("transit")
        programs = {}
        for entrant in ENTRANTS:
            program = _start(entrant, stack)
            if program is None:
                missing[entrant.name] = "not flown: not installed (`make other-simulators` does)"
                continue
            try:
                told[entrant.name] = program.answer()
                program.fly(STINT_S)  # compiles where it does
                programs[entrant.name] = program
            except StintError as error:
                missing[entrant.name] = f"not flown: {error}"
        for _ in range(STINTS):
            for program in (full, *programs.values()):
                program.fly(STINT_S)
        full.fly("end")
        for name, program in programs.items():
            program.fly(LAST_S)
            told[name] |= program.finish()
    arrived = full.end is not None and full.end["verdict"] == "ARRIVED"
    yield Row(FULL, "told, arrives", _speed(full), arrived)
    for entrant in ENTRANTS:
        if entrant.name in missing:
            yield Row(f"- {entrant.name.rstrip(' (')}", "told, arrives", missing[entrant.name], False)
            continue
        seen = told[entrant.name]
        what = f"- {entrant.name} {seen['version']}; {seen['rates']}; {entrant.what})".replace("( ", "(")
        yield Row(what, "told, arrives", _speed(programs[entrant.name]), seen["arrived"])
    yield Row("- gym-pybullet-drones", "told", "not flown: the package index has no package of that name", True)


def _start(entrant: Entrant, stack: ExitStack) -> StintProgram | None:
    """None when its environment is not there."""
    python = Path(sys.executable)
    if entrant.environment is not None:
        python = ENVIRONMENTS / entrant.environment / "bin" / "python"
    if not python.exists():
        return None
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))  # some write logs where they work
    return stack.enter_context(StintProgram([str(python), str(HERE / entrant.script)], folder=folder))


def _speed(program: StintProgram) -> str:
    stints = program.stints[1 : 1 + STINTS]
    return spread([1.0 / cost_s([stint]) for stint in stints], "")
