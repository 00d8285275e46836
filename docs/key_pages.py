"""Reference pages of mission and study files: every key, from their schemas. For `generate.py`."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from pathlib import Path

from flight_pages import NOTE

from mission.common.problems import shown
from mission.document.model import Mission
from mission.schema.json_schema import Node, allowed, json_schema, resolved
from sim_bridge.judge import estimate_recorder, metrics
from sim_bridge.judge.metrics import stems
from sim_bridge.lab.study.law import LAWS, law_module
from sim_bridge.lab.study.localise.spec import Study as EstimatorStudy
from sim_bridge.lab.study.results.figures import ESTIMATOR, FLIGHT
from sim_bridge.lab.study.spec import Study

TABLE = "a table"  # what mission.schema.allowed calls one

BETWEEN_KEYS = """\
## Between keys

Each key by itself may be good and the whole still not fly. Refused as well:

- the order of distances: `separation.hard_m` < `separation.soft_m` < `radio.transit_range_m` ≤ `radio.full_range_m`;
- what ranges must reach: 1.5 × `separation.soft_m` ≤ `ranging.reach_m`;
- `ranging.radio = false` needs vehicles without GNSS (`swarm.gnss`) and a `sensing.sensor` that tells raw scans, but
  in a swarm of one;
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
  `swarm.leader_priority`. Where some have no GNSS, that list has 127 ids at most, and `ranging.start_enu_m` has a
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
  `margin_m`; `stale_s` two scans; `separation.hard_m` twice `vehicle_radius_m` and `margin_m`;
- `[[payload]]`: each unit is that of its source, no two have a source or a column of the base station's files in
  common, and all vehicles together make 25 records a second at most, or so many that they take a fifth of
  `radio.bit_rate_kbps`.
"""


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
    arrays = [key for key, node in schema["properties"].items() if _is_tables(schema, node)]
    top = {key: node for key, node in schema["properties"].items() if key not in arrays and not _is_table(schema, node)}
    yield from _keys(schema, top, schema.get("required", ()))
    for key, node in schema["properties"].items():
        if key in arrays:
            inner = resolved(schema, node["items"])
            yield from ("", f"## `[[{key}]]`", "", f"{node['description']} At most {node['maxItems']}.", "")
            yield from _keys(schema, inner["properties"], inner.get("required", ()))
        if _is_table(schema, node):
            node = {**resolved(schema, node), **node}
            optional = key not in schema.get("required", ()) and "Optional" not in node["description"]
            needed = " Optional." if optional else ""
            yield from ("", f"## `[{key}]`", "", node["description"] + needed, "")
            yield from _table(schema, key, resolved(schema, node))
    yield from ("", BETWEEN_KEYS)


def _is_table(schema: Node, node: Node) -> bool:
    return allowed(schema, node) == TABLE


def _is_tables(schema: Node, node: Node) -> bool:
    return "items" in node and _is_table(schema, node["items"])


def _table(schema: Node, name: str, table: Node) -> Iterator[str]:
    keys = table["properties"]
    arrays = {key: node for key, node in keys.items() if _is_tables(schema, node)}
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
        yield row(f"`{key}`", allowed(schema, node), default, whole.get("description", ""))


def _default(node: Node) -> str:
    return f"`{shown(node['default'])}`" if node.get("default", {}) != {} else "none"


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
    yield row(
        "`point-mass`",
        "the law alone, many seeds at once, on point masses; no loss, wind, wrong estimates, trees or coverage. A "
        "mission with `[sensing]`: agents among trees, without the wire: scans, losses, gusts, errors and contacts",
    )
    yield row("`agents`", "the whole stack in lockstep (agents, codec, radio, autopilots) on point masses in still air")
    yield row("`jsbsim`", "the same on JSBSim quadrotors: what `sim-bridge fly` flies")
    yield row(
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
    yield "of the other end. People see a figure by its name, with its unit; shares in percent."
    yield from ("", "| figure | name | backend | unit | better | what it is |", "|---|---|---|---|---|---|")
    known = (
        {figure.name for figure in metrics.FIGURES} | set(estimate_recorder.definitions()) | set(stems.definitions())
    )
    for figure in (*FLIGHT, *ESTIMATOR):
        if figure.name not in known:
            assert figure.better is not None
            flown_by = "`estimator`" if figure in ESTIMATOR else "all others"
            yield row(f"`{figure.name}`", figure.title, flown_by, figure.unit, figure.better.value, figure.text)


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


def row(*cells: str) -> str:
    """A row of a table."""
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"
