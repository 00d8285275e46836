"""README and tutorial, typed as they stand: every command, in order, in a copy of the checkout; its output, compared.

What cannot run here is listed with its reason: a command that is neither run nor listed fails, and so does a listed one
that no page has any more.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from test_docs import BLOCK, ROOT

README, TUTORIAL = "README.md", "docs/tutorial.md"
LIMIT_S = 600.0  # of wall time, pure and on a busy computer

MAKES = "sets up a virtual environment from the network; what it flies is flown, see INSTEAD"
SERVES = "serves until Ctrl-C, on a fixed port: tests/interop does it, on free ones"
RUNS = "against serve, until the flight ends: tests/interop does it"
TYPED = "a prompt to type at, of a program that is not in .venv: tests/interop/test_mavproxy.py types there"
NOT_RUN = {
    "sudo apt install git make python3-venv": "root, and a network",
    "make fly MISSION=mission/examples/managed_stand.toml": f"{MAKES}; among trees it takes a minute",
    "make fly MISSION=mission/examples/surveyed_stand.toml": f"{MAKES}; with a lidar of 15 layers it takes minutes",
    "make test": "these tests",
    "sim-bridge fly mission/examples/lone_tree.toml -n 12 --seed 7": "half a minute and more; n = 8 is flown",
    "pip install mavproxy==1.8.75": "the network, and 800 MB",
    "sim-bridge serve mission/examples/lone_tree.toml -n 1 --ground-port 14600": SERVES,
    "sim-bridge serve mission/examples/lone_tree.toml -n 3 --ground-port 14600 --first-port 14601 --radio-port 14701 "
    "--out served.toml": SERVES,
    **{
        f"companion run --mission served.toml --id {k} --autopilot udpout://127.0.0.1:1460{k} "
        "--peers udpout://127.0.0.1:14701 --waive all --unsigned": RUNS
        for k in (1, 2, 3)
    },
    "mavproxy.py --master=udpout:127.0.0.1:14600": TYPED,
}
FLIGHT = "sim-bridge fly mission/examples/lone_tree.toml --map"
INSTEAD = {"make fly": FLIGHT}  # the rest of the target is the installation
LOST_LEADER = "sim-bridge fly mission/examples/lone_tree.toml -n 4 --kill leader@60 --out runs/lost-leader"
SHOWN_BELOW = {"make fly", LOST_LEADER}  # what they print stands in the next block, in parts
IN_PARTS = {*SHOWN_BELOW, "mavlogdump.py --types STATUSTEXT runs/lost-leader/vehicle-2.tlog"}
REFUSED = {("sim-bridge fly mission/examples/lone_tree.toml -n 40", 1), ("mission check my.toml", 2)}  # the how-manieth


def own_mission(folder: Path, page: str) -> None:
    """The reader changes my.toml to what stands in the page."""
    (text,) = [block for kind, block in BLOCK.findall(page) if kind == "toml"]
    (folder / "my.toml").write_text(text, encoding="utf-8")


def two_mistakes(folder: Path, page: str) -> None:
    """And makes those that it asks for."""
    assert "move the fence's northern edge from 110 to 90, and write `sise` for `size`" in " ".join(page.split())
    text = (folder / "my.toml").read_text(encoding="utf-8")
    (folder / "my.toml").write_text(text.replace("110.0", "90.0").replace("\nsize", "\nsise"), encoding="utf-8")


EDITS: dict[tuple[str, int], Callable[[Path, str], None]] = {
    ("mission check my.toml", 1): own_mission,
    ("mission check my.toml", 2): two_mistakes,
    ("sim-bridge fly my.toml", 1): own_mission,
}


@dataclass(frozen=True)
class Typed:
    """One command of a page, and what the page shows of its output."""

    page: str
    command: str
    time: int  # the first of its kind, the second ...
    shown: list[str]


def typed(page: str) -> Iterator[Typed]:
    """The commands of a page, in order."""
    counts: Counter[str] = Counter()
    blocks = BLOCK.findall((ROOT / page).read_text(encoding="utf-8"))
    for at, (kind, block) in enumerate(blocks):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:] if kind == "console" else ():
            command, *shown = part.splitlines()
            counts[command] += 1
            if command in SHOWN_BELOW and counts[command] == 1:
                assert blocks[at + 1][0] == "text", f"{page}: nothing is shown of {command}"
                shown = blocks[at + 1][1].splitlines()
            yield Typed(page, command, counts[command], shown)


COMMANDS = [one for page in (README, TUTORIAL) for one in typed(page)]


def comparable(line: str) -> str:
    """Without what the clock on the wall says, and ports."""
    line = re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d\d", "<time>", line.rstrip())
    line = re.sub(r"(links \d+) +\d+x$", r"\1 <speed>", line)
    return re.sub(r"127\.0\.0\.1:\d+", "127.0.0.1:<port>", line)


class Reader:
    """Types at a shell, in a copy of the checkout whose .venv is the one that runs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._sourced: list[str] = []
        self._printed: dict[str, list[str]] = {}

    def type_command(self, command: str, code: int) -> list[str]:
        """What it prints. A flight that both pages have is flown once."""
        command = INSTEAD.get(command, command)
        if command.startswith("source "):
            self._sourced.append(command)
        elif command == FLIGHT and command in self._printed:
            return self._printed[command]
        script = "\n".join(["source .venv/bin/activate", *self._sourced, command])
        done = subprocess.run(
            ["bash", "-c", script],
            cwd=self.folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
        assert done.returncode == code, f"$ {command}\n{done.stdout}"
        self._printed[command] = done.stdout.splitlines()
        return self._printed[command]


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Reader:
    folder = tmp_path_factory.mktemp("checkout")
    for name in ("mission", "docs"):
        ignore = shutil.ignore_patterns("__pycache__", "*.so", "*.sums", "images")
        shutil.copytree(ROOT / name, folder / name, ignore=ignore)
    if not Path(sys.prefix, "bin", "activate").is_file():
        pytest.skip("Python runs in no virtual environment")
    (folder / ".venv").symlink_to(sys.prefix)
    return Reader(folder)


def check_shown(one: Typed, printed: list[str]) -> None:
    """Each line that the page shows is printed, in that order; all of them, where it does not show parts."""
    want = [comparable(line) for line in one.shown if line.strip() != "..."]
    have = [comparable(line) for line in printed]
    if one.command not in IN_PARTS:
        assert want == have or not want, f"{one.page}: $ {one.command}"
        return
    left = iter(have)
    missing = [line for line in want if not any(line == other for other in left)]
    assert not missing, f"{one.page}: $ {one.command}: shows {missing[0]!r}; it prints\n" + "\n".join(printed)


@pytest.mark.parametrize("page", [README, TUTORIAL])
def test_a_page_runs_as_it_is_written(page: str, reader: Reader) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    ran = []
    for one in COMMANDS:
        if one.page == page and one.command not in NOT_RUN:
            edit = EDITS.get((one.command, one.time))
            if edit is not None:
                edit(reader.folder, text)
            check_shown(one, reader.type_command(one.command, 2 if (one.command, one.time) in REFUSED else 0))
            ran.append(one.command)
    assert len(ran) >= (1 if page == README else 9)


def test_every_reason_not_to_run_is_of_a_command_that_a_page_has() -> None:
    commands = {one.command for one in COMMANDS}
    assert set(NOT_RUN) <= commands
    assert {command for command, _ in (*EDITS, *REFUSED)} | SHOWN_BELOW | IN_PARTS | set(INSTEAD) <= commands


def test_make_fly_flies_what_is_flown_in_its_place() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (recipe,) = re.findall(r"^\t\$\(BIN\)/(sim-bridge fly .*)$", makefile, re.MULTILINE)
    (mission,) = re.findall(r"^MISSION \?= (.*)$", makefile, re.MULTILINE)
    assert recipe.replace("$(MISSION)", mission).replace(" --open $(FLY)", "") == FLIGHT


def test_programs_of_others_that_the_tutorial_installs_are_those_of_the_tests() -> None:
    (version,) = re.findall(r"^\$ pip install mavproxy==(\S+)$", (ROOT / TUTORIAL).read_text("utf-8"), re.MULTILINE)
    assert f"\nmavproxy=={version} " in (ROOT / "requirements-dev.lock").read_text(encoding="utf-8")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert [name for name, wants in extras.items() if any("mavproxy" in one for one in wants)] == ["dev"]  # so it says
