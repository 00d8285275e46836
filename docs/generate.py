"""Generate docs/reference/ from the code: mission keys, figures, programs, beacon, preflight. `--check`: compare."""

from __future__ import annotations

import argparse
import ast
import inspect
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from unittest import mock

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import flight_pages

import companion.cli
import mission.cli.main
import sim_bridge.cli
from companion.mavlink.makes import MAKES
from companion.mavlink.schema import page as own_messages
from companion.preflight.checks import ABOUT
from mission.common.problems import shown
from mission.document.model import Mission
from mission.schema.json_schema import Node, allowed, json_schema, resolved
from sim_bridge.judge import estimate_recorder, metrics, recording, verdict
from sim_bridge.judge.page import about as replay_keys
from sim_bridge.lab.study.law import LAWS, law_module
from sim_bridge.lab.study.localise.spec import Study as EstimatorStudy
from sim_bridge.lab.study.results.figures import ESTIMATOR, FLIGHT
from sim_bridge.lab.study.spec import Study

REFERENCE = Path(__file__).parent / "reference"
WIDTH = 100
FENCED = Mission.model_validate(  # any with a polygon
    {
        "schema": 1,
        "route": {"d1_enu_m": (0.0, 0.0, 8.0), "d2_enu_m": (60.0, 0.0, 8.0), "vel_leader_mps": 1.0},
        "fence": {"polygon_enu_m": ((-200.0, -200.0), (300.0, -200.0), (300.0, 200.0), (-200.0, 200.0))},
    }
)
NOTE = flight_pages.NOTE
TABLE = "a table"  # what mission.schema.allowed calls one

BETWEEN_KEYS = """\
## Between keys

Each key by itself may be good and the whole still not fly. Refused as well:

- the order of distances: `separation.hard_m` < `separation.soft_m` < `radio.transit_range_m` ≤ `radio.full_range_m`;
- what ranges must reach: 1.5 × `separation.soft_m` ≤ `ranging.reach_m`;
- the order about d2: `coverage.keep_out_m` < `route.arrival_distance_m` < `coverage.radius_m`;
- `route.arrival_distance_m` must be less than the way from d1 to d2;
- `route.vel_leader_mps` must be at most `limits.speed_max_mps`, and must not make the leader climb or descend faster
  than `limits.climb_max_mps`;
- neighbours spread evenly in coverage must be at least `separation.hard_m` and at most `radio.full_range_m` apart;
- a ring that is wider than `radio.full_range_m` needs a `coverage.duration_s` in which it can close, or 0;
- d1, d2 and the coverage must be inside the fence: its altitudes, and its polygon with 5 m to spare; so must be the
  straight way between them and the simulator's starting points;
- `separation.hard_m` < `sim.placement_spacing_m` < `radio.transit_range_m`;
- `swarm.leader_priority`, `sim.personalities`, `sim.battery_mah` and `sim.faults` name only vehicles of the swarm;
- `swarm.gnss` names vehicles of the swarm, one at least; with `"leader"` there must be a
  `swarm.leader_priority`. Where some have no satellites, that has 127 ids at most, and `ranging.start_enu_m` has a
  place for each vehicle, apart by `separation.hard_m` and 2 m;
- a fault has a time before `sim.time_limit_s`, the keys that its kind needs and no others, and a partition leaves
  somebody on the other side;
- what holds for d2 holds for every one of `route.stops` too, and what holds for the way holds for each leg of it;
- a tree must stand outside the starting points, and a trunk that d2 stands beside must not reach beyond
  `coverage.keep_out_m`;
- d1 and d2 must be more than 1 m above the ground, where that slopes, and below all crowns of `[forest.stand]`, or
  above all its trees; `coverage.keep_out_m` must hold half of its `dbh_max_m` and a vehicle;
- a forest has `file` or `[forest.stand]`, not both;
- the trees of `[forest.stand]` must find room: `dbh_min_m` < `dbh_mean_m` < `dbh_max_m` < `spacing_min_m`, and at most
  20,000 trees, whose discs of half `spacing_min_m` take at most 35 % of the area;
- `sensing.range_m` must hold the way of one scan, that of braking from `route.vel_leader_mps`, `vehicle_radius_m` and
  `margin_m`; `stale_s` two scans; `separation.hard_m` twice `vehicle_radius_m` and `margin_m`.
"""

REPLAYS = """\
What [`report.html`](../how-to/replay-a-flight.md) holds besides the page itself: one JSON document, deflated (raw, RFC
1951), in base64, in the element with the id `data`. Its rows are ticks of the flight at about 10 Hz, the first and the
last among them. Places are ENU metres about the mission's origin. The document of a study
has the format `understory-study`.

```python
import re
from pathlib import Path

from sim_bridge.judge.page.coding import read_column, unpack

page = Path("runs/FOLDER/report.html").read_text()
replay = unpack(re.search(r'id="data">([^<]*)', page)[1])
print(read_column(replay["time_s"]), read_column(replay["vehicles"][0]["east_m"]))
```

- A **column** is `step`, `order`, `is`: a number for each row (of trees: for each tree), divided by `step`, rounded,
  and differenced `order` times, each time with 0 before the first. `gaps`, where there is one: the first row and the
  length of each stretch without a value.
- **steps** are `step`, `rows`, `is`: the rows in which the value changes, as differences, and the value from there on,
  divided by `step`.
- **differences**: each number less the one before, the first less 0.
"""

BESIDES_METRICS = """\
## Other keys of metrics.json

| key | meaning |
|---|---|
| `seed` | `sim.seed` of the flight. |
| `ended` | Why: `coverage complete`, `all landed` (`but K`: armed for another 60 s), a time limit, `interrupted`, or \
no companion left. |
| `verdict` | The last line of `fly`: see above. |
| `wall_time_s` | How long it took on your machine. |
| `real_time_factor` | `sim_time_s` over the wall time of the flight itself, without the start of the companions. |
| `trace_hash` | SHA-256 over every vehicle's state and every beacon of every tick: equal hashes, equal flights. |
| `mission_sha256` | SHA-256 of `mission.toml` as flown: `sim-bridge report` tells when it was changed since. |

The figures and the hash depend on the mission and the seed alone, on one machine and with the same versions of the
libraries; `wall_time_s` and `real_time_factor` depend on the machine.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 1 when `--check` finds a file out of date."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare with docs/reference/ instead of writing it")
    check = parser.parse_args(argv).check
    stale = False
    for name, text in pages().items():
        path = REFERENCE / name
        if not check:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            print(f"docs/reference/{name} is not what the code says: run `make docs`", file=sys.stderr)
            stale = True
    return 1 if stale else 0


def pages() -> dict[str, str]:
    """File name -> text of every generated page."""
    makers: dict[str, Callable[[], Iterator[str]]] = {
        "mission.md": mission_page,
        "metrics.md": metrics_page,
        "recording.md": recording_page,
        "replay.md": replay_page,
        "study.md": study_page,
        "programs.md": programs_page,
        "beacon.md": beacon_page,
        "preflight.md": preflight_page,
        "failsafe.md": flight_pages.failsafe_page,
        "flight-states.md": flight_pages.flight_states_page,
    }
    return {name: "\n".join(maker()).rstrip() + "\n" for name, maker in makers.items()}


# --- mission files ----------------------------------------------------------------------------------------------------


def mission_page() -> Iterator[str]:
    """Every key of a mission file."""
    schema = json_schema(Mission)
    yield from ("# Mission files", "", NOTE, "")
    yield "A mission is a TOML file of at most 64 KiB. Positions are metres east, north and up from the origin;"
    yield "up = 0 is the ground there. `mission check FILE` names every problem with its line; `mission schema`"
    yield "prints the JSON Schema for editors. How to choose: [Write a mission](../how-to/write-a-mission.md)."
    yield from ("", "The least that a mission needs:", "", "```toml")
    yield from ("schema = 1", "", "[route]", "d1_enu_m = [0.0, 0.0, 8.0]", "d2_enu_m = [130.0, 0.0, 8.0]")
    yield from ("vel_leader_mps = 3.0", "```", "")
    yield from ("## Top level", "")
    top = {key: node for key, node in schema["properties"].items() if not _is_table(schema, node)}
    yield from _keys(schema, top, schema.get("required", ()))
    for key, node in schema["properties"].items():
        if _is_table(schema, node):
            node = {**resolved(schema, node), **node}
            optional = key not in schema.get("required", ()) and "Optional" not in node["description"]
            needed = " Optional." if optional else ""
            yield from ("", f"## `[{key}]`", "", node["description"] + needed, "")
            yield from _table(schema, key, resolved(schema, node))
    yield from ("", BETWEEN_KEYS)


def _is_table(schema: Node, node: Node) -> bool:
    return allowed(schema, node) == TABLE


def _table(schema: Node, name: str, table: Node) -> Iterator[str]:
    keys = table["properties"]
    arrays = {key: node for key, node in keys.items() if "items" in node and _is_table(schema, node["items"])}
    tables = {
        key: node for key, node in keys.items() if _is_table(schema, node) and "properties" in resolved(schema, node)
    }
    plain = {key: node for key, node in keys.items() if key not in arrays and key not in tables}
    if plain:
        yield from _keys(schema, plain, table.get("required", ()))
    for key, node in tables.items():
        node = {**resolved(schema, node), **node}
        yield from ("", f"### `[{name}.{key}]`", "", node["description"], "")
        yield from _keys(schema, node["properties"], node.get("required", ()))
    for key, node in arrays.items():
        yield from ("",) if plain or tables else ()
        yield from (f"### `[[{name}.{key}]]`", "", f"{node['description']} At most {node['maxItems']}.", "")
        inner = resolved(schema, node["items"])
        yield from _keys(schema, inner["properties"], inner.get("required", ()))


def _keys(schema: Node, keys: Node, required: Sequence[str]) -> Iterator[str]:
    yield from ("| key | allowed | default | meaning |", "|---|---|---|---|")
    for key, node in keys.items():
        whole = {**resolved(schema, node), **node}
        default = "required" if key in required else _default(whole)
        yield _row(f"`{key}`", allowed(schema, node), default, whole.get("description", ""))


def _default(node: Node) -> str:
    return f"`{shown(node['default'])}`" if node.get("default", {}) != {} else "none"


# --- figures ----------------------------------------------------------------------------------------------------------


def metrics_page() -> Iterator[str]:
    """Every figure of a flight."""
    about = inspect.getdoc(metrics) or ""
    headline, _, terms = about.partition("\n\nTerms")
    yield from ("# Figures of a flight", "", NOTE, "", headline, "")
    yield "`sim-bridge fly` writes them to `metrics.json` in the run folder, `sim-bridge report` works them out"
    yield "again, and the verdict. A dash (`null` in JSON) means that the flight never came to that point. Times are"
    yield "simulated."
    yield from ("", "## Terms", "", terms.partition("\n\n")[2], "", "## Figures", "")
    yield from ("| figure | unit | better | definition |", "|---|---|---|---|")
    for figure in metrics.FIGURES:
        yield _row(f"`{figure.name}`", figure.unit, figure.better.value if figure.better else "", figure.text)
    about, _, claims = (inspect.getdoc(verdict) or "").partition("\n\n")
    yield from ("", "## The verdict", "", about, "", claims, "")
    yield "Anything else is FAILED, with all that does not hold. Exit code 0 is ARRIVED, with or without somebody."
    yield from ("", "## Estimates of the vehicles", "")
    yield "Not how the swarm flew, but how well it knew: what vehicles tell of places, held against the truth while the"
    yield "simulator flies them. They are not in the recording, so `sim-bridge report` does not work them out again."
    yield from ("", "| figure | definition |", "|---|---|")
    for name, text in estimate_recorder.definitions().items():
        yield f"| `{name}` | {text} |"
    yield from ("", BESIDES_METRICS)


# --- preflight --------------------------------------------------------------------------------------------------------


def recording_page() -> Iterator[str]:
    """recording.npz, array by array."""
    yield from ("# recording.npz", "", NOTE, "")
    yield "Ground truth of a flight at 20 Hz, in its [run folder](../how-to/read-a-run-folder.md): an archive of numpy"
    yield "(`numpy.load`) over T ticks and n vehicles, with vehicle K in column K - 1. Positions and velocities are the"
    yield "true ones, not what vehicles believe; over external autopilots they are what those tell. `phase`,"
    yield "`acting` and `leader` are what companions said."
    yield from ("", "| array | type | shape | unit | meaning |", "|---|---|---|---|---|")
    for name, about in recording.ABOUT.items():
        kind = np.dtype(recording.COLUMNS[name]).name
        yield _row(f"`{name}`", kind, about.shape, about.unit, about.meaning)
    yield from (
        "",
        "Values of `phase`: [SWARM_PHASE](beacon.md#swarm_phase). Older archives have no `touched`: `report` takes",
    )
    yield "it for 0. A later version may add arrays."


def replay_page() -> Iterator[str]:
    """What a report.html holds, key by key."""
    yield from ("# Replays", "", NOTE, "", REPLAYS, "| key | type | unit | meaning |", "|---|---|---|---|")
    for name, about in replay_keys.ABOUT.items():
        yield _row(f"`{name}`", about.kind, about.unit, about.meaning)
    yield from ("", "## Studies", "", "| key | type | meaning |", "|---|---|---|")
    for name, about in replay_keys.STUDY.items():
        yield _row(f"`{name}`", about.kind, about.meaning)


def preflight_page() -> Iterator[str]:
    """Every check, and every parameter of each autopilot."""
    yield from ("# Preflight", "", NOTE, "")
    yield "What `companion preflight` checks. How to use it: [Preflight](../how-to/preflight.md)."
    yield from ("", "## Checks", "", "| check | passes when |", "|---|---|")
    for name, text in ABOUT.items():
        yield _row(f"`{name}`", text)
    for make in MAKES.values():
        yield from ("", f"## Parameters of {make.name}", "")
        yield "The first value is what `--apply` sets; the others are as good. Each is a check, by this name."
        yield from ("", "| parameter | good | why |", "|---|---|---|")
        for rule in make.canopy_rules:
            older = f" (before: {', '.join(f'`{name}`' for name in rule.older_names)})" if rule.older_names else ""
            optional = " Not in older firmwares: without it only a warning." if rule.optional else ""
            yield _row(f"`{rule.name}`{older}", rule.text, rule.why + optional)
        for rule in make.satellite_rules:
            yield _row(f"`{rule.name}`", rule.text, f"Only with satellites where not all have them. {rule.why}")
        for rule in make.odometry_rules(FENCED):
            good = "height of `route.d1_enu_m`" if isinstance(rule.wanted, float) else rule.text
            yield _row(f"`{rule.name}`", good, f"Only without satellites (`swarm.gnss`). {rule.why}")
        for rule in make.fence_rules(FENCED):
            good = "`fence.altitude_max_m`" if isinstance(rule.wanted, float) else rule.text
            yield _row(f"`{rule.name}`", good, rule.why)


# --- studies ----------------------------------------------------------------------------------------------------------


def study_page() -> Iterator[str]:
    """Every key of a study file, every law with its parameters."""
    schema = json_schema(Study)
    yield from ("# Study files", "", NOTE, "")
    yield "A study is a TOML file of at most 64 KiB: flights for `sim-bridge study FILE`. What is crossed is flown in"
    yield "every combination, and each of those with every seed. [Run a study](../how-to/run-a-study.md) has examples."
    yield from ("", "## Top level", "")
    yield from _keys(schema, schema["properties"], schema.get("required", ()))
    yield from ("", "## `[[run]]`", "")
    yield "One law on one backend. What stands here goes before the study's own: a mission key in its `set` is not"
    yield "crossed by the study's `cross`. A key in the `cross` of both, or in a run's `set` and `cross`, is refused,"
    yield from ("and so is `sim.seed` anywhere: the seeds are `first_seed` and those that follow.", "")
    run = schema["$defs"]["Run"]
    yield from _keys(schema, run["properties"], run.get("required", ()))
    yield from ("", "## Backends", "", "| backend | what it flies |", "|---|---|")
    yield _row(
        "`point-mass`",
        "the law alone, many seeds at once, on point masses; no loss, wind, wrong estimates, trees or coverage. A "
        "mission with `[sensing]`: agents among trees, without the wire: scans, losses, gusts, errors and contacts",
    )
    yield _row("`agents`", "the whole stack in lockstep (agents, codec, radio, autopilots) on point masses")
    yield _row("`jsbsim`", "the same on JSBSim quadrotors: what `sim-bridge fly` flies")
    yield _row(
        "`estimator`",
        "the estimator of relative localisation on simulated measurements of a flight; in files of its own, below",
    )
    yield from ("", "With `agents` and `jsbsim` the autopilots' estimates are as wrong as those of real ones, unless")
    yield 'the study or the mission file says `sim.estimates = "exact"`. The rows have it among their settings.'
    yield from study_figures()
    yield from estimator_keys()
    for law in LAWS:
        params = json_schema(law_module(law).Params)
        source = Path(__file__).parents[1] / f"{LAWS[law].replace('.', '/')}.py"  # compiled modules have no docstring
        about, _, _ = (ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or "").partition("\n\n")
        yield from ("", f"## Law `{law}`", "", about, "")
        if params.get("properties"):
            yield from _keys(params, params["properties"], ())
        else:
            yield "No parameters."


def study_figures() -> Iterator[str]:
    """The figures that studies put together."""
    yield from ("", "## Figures", "")
    yield "What summary, limits (`must`), plots and page of a study have: the"
    yield "[figures of a flight](metrics.md#figures) that have a better end, and these. `worst` and `p95` are"
    yield "of the other end."
    yield from ("", "| figure | backend | unit | better | what it is |", "|---|---|---|---|---|")
    known = {figure.name for figure in metrics.FIGURES} | set(estimate_recorder.definitions())
    for figure in (*FLIGHT, *ESTIMATOR):
        if figure.name not in known:
            assert figure.better is not None
            flown_by = "`estimator`" if figure in ESTIMATOR else "all others"
            yield _row(f"`{figure.name}`", flown_by, figure.unit, figure.better.value, figure.text)


def estimator_keys() -> Iterator[str]:
    """Every key of a study of the estimator."""
    schema = json_schema(EstimatorStudy)
    yield from ("", "## Studies of the estimator", "")
    yield "A study file with `localise = 1`: `mission/studies/localise.toml` is one."
    yield ""
    yield from _keys(schema, schema["properties"], schema.get("required", ()))
    for table, name in (("run", "Run"), ("run.motion", "Motion"), ("run.sensors", "Sensors")):
        node = schema["$defs"][name]
        yield from ("", f"### `[[{table}]]`" if table == "run" else f"### `[{table}]`", "")
        yield from _keys(schema, node["properties"], node.get("required", ()))


# --- programs ---------------------------------------------------------------------------------------------------------


def programs_page() -> Iterator[str]:
    """--help of every program and subcommand."""
    yield from ("# Programs", "", NOTE, "")
    yield "What `--help` prints. The programs are in `.venv/bin` after `make install`. Each completes its commands,"
    yield "options and files in bash and zsh: `source <(sim-bridge --print-completion bash)`; how to keep it is at the"
    yield "top of what is printed."
    for module in (mission.cli.main, companion.cli, sim_bridge.cli):
        parser = module.build_parser()
        yield from ("", f"## {parser.prog}", *_help(parser))
        for command in _commands(parser):
            yield from ("", f"### {command.prog}", *_help(command))


def _commands(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """Its commands, each before its own."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield command
                yield from _commands(command)


def _help(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Its help; the usage, which Python's versions wrap differently, wrapped here."""
    with mock.patch.dict(os.environ, {"COLUMNS": str(WIDTH), "NO_COLOR": "1"}):
        usage, _, rest = parser.format_help().partition("\n\n")
    words = re.findall(r"\[[^\]]*\]|--?\S+ [A-Z]+(?= |$)|\S+", " ".join(usage.split()))
    lines = [words[0]]
    for word in words[1:]:
        if len(lines[-1]) + 1 + len(word) > WIDTH:
            lines.append("   ")
        lines[-1] += f" {word}"
    yield from ("", "```text", *lines, "", *rest.rstrip().splitlines(), "```")


# --- the beacon -------------------------------------------------------------------------------------------------------


def beacon_page() -> Iterator[str]:
    """Our own messages, field by field."""
    return own_messages.page(NOTE)


def _row(*cells: str) -> str:
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    sys.exit(main())
