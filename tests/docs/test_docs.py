"""The documentation: links lead somewhere, the reference is what the code says, missions in it load."""

from __future__ import annotations

import ast
import importlib.util
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from companion.core.model.states import STEERED, FlightState
from companion.core.swarm import role_table
from companion.core.vehicle.failsafe import TABLE
from companion.core.vehicle.flight_table import TRANSITIONS
from companion.mavlink.orders.book import REASONS
from companion.mavlink.orders.desk import NEEDS_KEY
from companion.mavlink.peers.session import TWINS
from mission import __version__
from mission.document.load import load_mission
from mission.schema.fault_kinds import FORMS
from mission.schema.kinds import FaultKind
from sim_bridge.drive.faults import parsed
from sim_bridge.lab.study.load import load_study

ROOT = Path(__file__).parents[2]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
LINK = re.compile(r"\]\(([^)\s]+)\)")
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MESSAGES = (ROOT / "docs" / "how-to" / "read-the-messages.md").read_text(encoding="utf-8")
CORE = ROOT / "companion" / "core"
SPEAK = (
    *(
        "agent",
        "rise/rise",
        "vehicle/flight",
        "localisation/link_reports",
        "localisation/silence_reports",
        "localisation/gnss_denied/localiser",
        "vehicle/requests",
        "swarm/reports",
        "vehicle/operator_orders",
        "vehicle/accepted",
    ),
    "vehicle/autopilot_state",  # words what another says
)
EXAMPLE = re.compile(r"mission/examples/[\w/-]+\.toml")


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("docs_generate", ROOT / "docs" / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def anchors(page: Path) -> set[str]:
    """What a link may name after #: the headings as forges slug them."""
    text = BLOCK.sub("", page.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def documents() -> Iterator[tuple[str, str]]:
    """Every TOML block that is a whole mission or study: it says which schema it is of."""
    for page, name in zip(PAGES, NAMES, strict=True):
        blocks = [text for kind, text in BLOCK.findall(page.read_text(encoding="utf-8")) if kind == "toml"]
        for count, text in enumerate(block for block in blocks if re.search(r"^schema = ", block, re.MULTILINE)):
            yield f"{name}[{count}]", text


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_relative_links_lead_somewhere(page: Path) -> None:
    broken = []
    for link in LINK.findall(BLOCK.sub("", page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert not broken


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_examples_that_are_named_exist_and_check(page: Path) -> None:
    for name in set(EXAMPLE.findall(page.read_text(encoding="utf-8"))):
        load_mission(ROOT / name)


@pytest.mark.parametrize("text", [text for _, text in documents()], ids=[name for name, _ in documents()])
def test_missions_and_studies_in_the_text_load(text: str, tmp_path: Path) -> None:
    file = tmp_path / "document.toml"
    file.write_text(text, encoding="utf-8")
    if "[[run]]" in text:
        for folder in ("mission", "docs"):
            (tmp_path / folder).symlink_to(ROOT / folder)
        load_study(file)
    else:
        load_mission(file)


@pytest.mark.parametrize("kind", FORMS)
def test_each_fault_is_shown_as_an_option_that_is_read(kind: FaultKind) -> None:
    page = (ROOT / "docs" / "how-to" / "write-a-mission.md").read_text(encoding="utf-8")
    shown = re.findall(rf"^\| `--{kind.value} (\S+)` \|", page, re.MULTILINE)
    assert shown
    assert all(parsed(kind, text)["kind"] == kind.value for text in shown)


@pytest.mark.parametrize("file", sorted((ROOT / "sim_bridge" / "lab" / "study" / "examples").glob("*.toml")), ids=str)
def test_studies_that_come_with_the_project_load(file: Path) -> None:
    assert load_study(file).cases


def test_reference_is_what_the_code_says(generator: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    code = generator.main(["--check"])
    assert (code, capsys.readouterr().err) == (0, "")


def test_a_stale_page_is_named(
    generator: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(generator, "REFERENCE", tmp_path)
    assert generator.main([]) == 0
    assert generator.main(["--check"]) == 0
    (tmp_path / "beacon.md").write_text("old\n", encoding="utf-8")
    (tmp_path / "metrics.md").unlink()
    assert generator.main(["--check"]) == 1
    said = capsys.readouterr().err
    assert re.findall(r"reference/(\w+)\.md", said) == ["metrics", "beacon"]


def test_the_reference_does_not_depend_on_the_terminal(generator: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    narrow = generator.pages()
    monkeypatch.setenv("COLUMNS", "200")
    assert generator.pages() == narrow


def test_every_key_and_figure_is_in_the_reference(generator: ModuleType) -> None:
    from mission.document.model import Mission
    from sim_bridge.judge.metrics import FIGURES

    pages = generator.pages()
    for table in Mission.model_fields:
        names = (f"`{table}`", f"`[{table}]`", f"`[[{table}]]`")
        assert any(name in pages["mission.md"] for name in names) or table == "schema_version"
    for name in (figure.name for figure in FIGURES):
        assert f"| `{name}` |" in pages["metrics.md"]


def test_the_version_is_told_alike_everywhere() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {__version__}\n" in citation
    assert __version__ in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_every_decision_is_listed() -> None:
    folder = ROOT / "docs" / "decisions"
    listed = LINK.findall((folder / "README.md").read_text(encoding="utf-8"))
    assert sorted(listed) == sorted(page.name for page in folder.glob("*.md") if page.name != "README.md")


def test_the_hooks_are_the_commands_of_make_check() -> None:
    hooks = re.findall(r"^ +entry: (.+)$", (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"), re.MULTILINE)
    check = re.search(r"^check:.*\n((?:\t.+\n)+)", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert check is not None
    assert hooks == [line.strip().replace("$(BIN)", ".venv/bin") for line in check[1].splitlines()]


def texts(module: Path) -> Iterator[str]:
    """The string literals of a module, and the literal parts of its f-strings; not docstrings, nor what is raised."""
    silent: set[ast.AST] = set()
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Raise) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            silent.update(ast.walk(node))
        elif isinstance(node, ast.FormattedValue) and node.format_spec is not None:
            silent.update(ast.walk(node.format_spec))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in silent:
            yield node.value.strip()


def test_every_message_of_a_companion_is_explained_to_its_operator() -> None:
    sources = {str(file.relative_to(CORE).with_suffix("")): file for file in CORE.rglob("*.py")}
    speaking = {name for name, file in sources.items() if "Say(" in file.read_text(encoding="utf-8")}
    assert speaking - {"model/actions"} <= set(SPEAK)
    missing = [text for name in SPEAK for text in texts(CORE / f"{name}.py") if text not in MESSAGES]
    missing += [part for row in TABLE for part in row.text.split("{}") if part not in MESSAGES and not row.advice]
    assert not missing


SAYING = {"Say", "_report_text", "_report_sender", "ground"}  # functions that take a text for the operator


def said_by(module: Path) -> Iterator[str]:
    """The literal parts of what these functions are called with."""
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in SAYING:
            for argument in node.args:
                parts = argument.values if isinstance(argument, ast.JoinedStr) else [argument]
                yield from (
                    part.value.strip()
                    for part in parts
                    if isinstance(part, ast.Constant) and isinstance(part.value, str)
                )


def test_every_message_of_radio_and_orders_is_explained_to_its_operator() -> None:
    folder = ROOT / "companion" / "mavlink"
    said = {text for module in folder.rglob("*.py") for text in said_by(module)}
    assert {"is there twice: the later is ignored", "sends unsigned frames: ignored", "order obeyed:"} <= said
    said = (said | {*REASONS.values(), *TWINS.values(), NEEDS_KEY}) - {"not saved:"}  # the name of a reason
    assert not sorted(text for text in said if text not in MESSAGES)


def test_every_failsafe_is_in_the_reference(generator: ModuleType) -> None:
    page = generator.pages()["failsafe.md"]
    lines = [line for line in page.splitlines() if re.match(r"\| \d+ \|", line)]
    assert [line.split(" | ")[1] for line in lines] == [row.cause.name.lower() for row in TABLE]
    for line, row in zip(lines, TABLE, strict=True):
        assert row.when in line
        assert (row.until or row.clear.value) in line
        assert f"| {row.response.name.lower()}" in line
        assert not row.delay_s or f"| {row.delay_s:.3g} |" in line


def drawn(page: str) -> set[tuple[str, str, str]]:
    """Start, event and end of each edge of a diagram."""
    lines = re.findall(r"^    (\w+) --> (\w+): (.+)$", page, re.MULTILINE)
    return {(start, event, end) for start, end, events in lines for event in events.split(", ")}


def test_the_diagram_of_roles_has_every_transition(generator: ModuleType) -> None:
    page = generator.pages()["flight-states.md"].partition("## Roles")[2]
    assert drawn(page) == {
        (role.name, event.name.lower(), following.name)
        for role, rows in role_table.TRANSITIONS.items()
        for event, following in rows.items()
    }


def test_the_diagram_of_flight_states_has_every_transition(generator: ModuleType) -> None:
    page = generator.pages()["flight-states.md"].partition("## Roles")[0]
    edges = drawn(page)
    node = {state: "STEERED" if state in STEERED else state.name for state in FlightState}
    assert edges == {
        (node[state], event.name.lower(), node[row.state])
        for state, rows in TRANSITIONS.items()
        for event, row in rows.items()
    }


def test_the_reference_is_what_the_code_says_compiled_or_not() -> None:
    command = [sys.executable, str(ROOT / "docs" / "generate.py"), "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_functions_in_the_table_of_algorithm_1_exist() -> None:
    """Names as `module.Class.method`, of the core and of paper mode."""
    paper = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    table = paper.partition("## Algorithm 1, line by line")[2].partition("\n## ")[0]
    named = set(re.findall(r"`((?:[a-z]\w+)(?:\.\w+)+)`", table))
    files = [*CORE.rglob("*.py"), *(ROOT / "sim_bridge" / "lab" / "paper").glob("*.py")]
    defined = {
        f"{file.stem}.{node.name}{'.' * bool(inner)}{inner}"
        for file in files
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef | ast.FunctionDef)
        for inner in ("", *(part.name for part in getattr(node, "body", ()) if isinstance(part, ast.FunctionDef)))
    }
    assert len(named) >= 10
    assert named <= defined, sorted(named - defined)
