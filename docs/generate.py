"""Generate docs/reference/ from the code: mission keys, figures, programs, beacon, preflight. `--check`: compare."""

from __future__ import annotations

import argparse
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
from api_pages import api_page
from hazard_pages import HazardsError, hazards_page
from key_pages import mission_page, row, study_page
from mutant_pages import mutants_page

import companion.cli
import mission.cli.main
import sim_bridge.cli
from companion.mavlink.makes import MAKES
from companion.mavlink.schema import page as own_messages
from companion.preflight.checks import ABOUT
from mission.document.model import Mission
from sim_bridge.judge import estimate_errors, estimate_recorder, metrics, recording, verdict
from sim_bridge.judge.metrics import stems
from sim_bridge.judge.page import about as replay_keys
from sim_bridge.judge.page.names import name_of

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
| `end_s` | Simulated time then. What was recorded after it (records on their way to the base station; the landing of \
external autopilots) is neither coverage nor landed early; dangers count. |
| `verdict` | The last line of `fly`: see above. |
| `wall_time_s` | How long it took on your machine. |
| `real_time_factor` | `sim_time_s` over the wall time of the flight itself, without the start of the companions. |
| `records_made`, `records_delivered` | Of a mission [that surveys](../how-to/collect-records.md): records on the \
disks of all vehicles with those that never came onto one, and on the base station's. |
| `records_lost`, `records_waiting` | By vehicle: its own records that the base station lacks, where its companion \
never came back, and where it runs. |
| `records_unwritten` | By vehicle: its own records that never came onto its disk, because it was full or the \
companion ended first. Companions that are processes say it in their logs alone (`own ones lost`, `own ones waiting \
for the disk`): neither this figure nor `records_made` has theirs. |
| `beacons_lost` | By vehicle: the share that it missed of what was broadcast within its radio range: lost at random, \
to a cut, or behind trunks; null: nothing was, or the radio was not ours. |
| `trace_hash` | SHA-256 over every vehicle's state and every beacon of every tick: equal hashes, equal flights. |
| `flown_by`, `law`, `law_sha256`, `safety_filter` | Only where [not all was ours](../how-to/fly-your-own-law.md): \
in words, as the verdict has it; the law's name; SHA-256 of its file, or null; whether there was a safety filter. |
| `mission_sha256` | SHA-256 of `mission.toml` as flown: `sim-bridge report` tells when it was changed since. |

The figures and the hash depend on the mission and the seed alone, on one machine and with the same versions of the
libraries; `wall_time_s` and `real_time_factor` depend on the machine.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 1 when `--check` finds a file out of date."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--check", action="store_true", help="compare with docs/reference/ instead of writing it")
    check = parser.parse_args(argv).check
    stale = False
    try:
        made = pages()
    except HazardsError as error:
        print(error, file=sys.stderr)
        return 1
    for name, text in made.items():
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
        "hazards.md": hazards_page,
        "mutants.md": mutants_page,
        "python.md": api_page,
    }
    return {name: "\n".join(maker()).rstrip() + "\n" for name, maker in makers.items()}


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
    yield from ("| figure | shown as | unit | better | definition |", "|---|---|---|---|---|")
    for figure in metrics.FIGURES:
        better = figure.better.value if figure.better else ""
        yield row(f"`{figure.name}`", name_of(figure.name), figure.unit, better, figure.text)
    about, _, claims = (inspect.getdoc(verdict) or "").partition("\n\n")
    yield from ("", "## The verdict", "", about, "", claims, "")
    yield "Exit code 0 is ARRIVED, with or without somebody; anything else is 1."
    yield from ("", "## Estimates of the vehicles", "")
    yield "Not how the swarm flew, but how well it knew: what vehicles report of positions, against the truth while the"
    yield "simulator flies them. They are not in the recording, so `sim-bridge report` does not work them out again."
    yield from ("", "| figure | definition |", "|---|---|")
    for name, text in estimate_recorder.definitions().items():
        yield f"| `{name}` | {text} |"
    yield from ("", "Over external autopilots these instead:", "", "| figure | definition |", "|---|---|")
    for name, text in estimate_errors.definitions().items():
        yield f"| `{name}` | {text} |"
    yield from (
        "",
        "Of a survey, in a mission with `[survey]`:",
        "",
    )
    yield from ("| figure | definition |", "|---|---|")
    for name, text in stems.definitions().items():
        yield f"| `{name}` | {text} |"
    yield from ("", BESIDES_METRICS)


# --- preflight --------------------------------------------------------------------------------------------------------


def recording_page() -> Iterator[str]:
    """recording.npz, array by array."""
    yield from ("# recording.npz", "", NOTE, "")
    yield "Ground truth of a flight at 20 Hz, in its [run folder](../how-to/read-a-run-folder.md): an archive of numpy"
    yield "(`numpy.load`) over T ticks and n vehicles, with vehicle K in column K - 1. Positions and velocities are the"
    yield "true ones, not what they believe; over external autopilots they are their simulators' truth, or where the"
    yield "verdict says `by estimates`, what the autopilots tell. What these believe is in `vehicle-K.tlog` beside it"
    yield "(GLOBAL_POSITION_INT). `phase`, `acting` and `leader` are what companions said."
    yield from ("", "| array | type | shape | unit | meaning |", "|---|---|---|---|---|")
    for name, about in recording.ABOUT.items():
        kind = np.dtype(recording.COLUMNS[name]).name
        yield row(f"`{name}`", kind, about.shape, about.unit, about.meaning)
    yield from (
        "",
        "Values of `phase`: [SWARM_PHASE](beacon.md#swarm_phase). Older archives have no `touched`: `report` takes",
    )
    yield "it for 0. A later version may add arrays."


def replay_page() -> Iterator[str]:
    """What a report.html holds, key by key."""
    yield from ("# Replays", "", NOTE, "", REPLAYS, "| key | type | unit | meaning |", "|---|---|---|---|")
    for name, about in replay_keys.ABOUT.items():
        yield row(f"`{name}`", about.kind, about.unit, about.meaning)
    yield from ("", "## Studies", "", "| key | type | meaning |", "|---|---|---|")
    for name, about in replay_keys.STUDY.items():
        yield row(f"`{name}`", about.kind, about.meaning)


def preflight_page() -> Iterator[str]:
    """Every check, and every parameter of each autopilot."""
    yield from ("# Preflight", "", NOTE, "")
    yield "What `companion preflight` checks. How to use it: [Preflight](../how-to/preflight.md)."
    yield from ("", "## Checks", "", "| check | passes when |", "|---|---|")
    for name, text in ABOUT.items():
        yield row(f"`{name}`", text)
    for make in MAKES.values():
        yield from ("", f"## Parameters of {make.name}", "")
        yield "The first value is what `--apply` sets; the others are as good. Each is a check, by this name."
        yield from ("", "| parameter | good | why |", "|---|---|---|")
        for rule in make.canopy_rules:
            older = f" (before: {', '.join(f'`{name}`' for name in rule.older_names)})" if rule.older_names else ""
            optional = " Not in older firmwares: without it only a warning." if rule.optional else ""
            yield row(f"`{rule.name}`{older}", rule.text, rule.why + optional)
        for rule in make.satellite_rules:
            yield row(f"`{rule.name}`", rule.text, f"Only with GNSS where not all have it. {rule.why}")
        for rule in make.odometry_rules(FENCED):
            good = "height of `route.d1_enu_m`" if isinstance(rule.wanted, float) else rule.text
            yield row(f"`{rule.name}`", good, f"Only without GNSS (`swarm.gnss`). {rule.why}")
        for rule in make.fence_rules(FENCED):
            good = "`fence.altitude_max_m`, or `survey.rise_to_m`" if isinstance(rule.wanted, float) else rule.text
            yield row(f"`{rule.name}`", good, rule.why)


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


if __name__ == "__main__":
    sys.exit(main())
