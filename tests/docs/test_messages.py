"""Messages to operators: each fits one STATUSTEXT, whatever it names."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.core.model.actions import TEXT_MAX, brief
from companion.core.model.states import Request
from companion.core.rise.reasons import Reason
from companion.core.swarm.partition_recovery import Stage
from companion.core.swarm.roster import list_vehicles
from companion.core.vehicle.failsafe import TABLE, Readings, Row

ROOT = Path(__file__).parents[2]
CORE = ROOT / "companion" / "core"
MANY = list_vehicles(range(1, 251))  # 250: the most that a mission may have
# Every value that a message of the core names, as long as it may be.
WIDEST = {
    "vehicle": "250",
    "why": "hands down a false course",
    "leader": "250",
    "self._leader": "250",
    "missing": MANY,
    "list_vehicles(waits_for)": MANY,
    "list_vehicles(without)": MANY,
    "math.ceil(left_s)": "60",
    "list_vehicles(missing)": MANY,
    "tree": "tree 20 of 21",
    "stop + 1": "20",
    "stop // 2 + 1": "15",
    "before // 2 + 1": "15",
    "self._lanes": "15",
    "height_m": "120",
    "end": "start",
    "self._name_lane(stop)": "lane 15 of 15",
    "'on' if stop % 2 else 'leaving for'": "leaving for",
    "self._visits": "21",
    "'gathered at d1' if before is SwarmPhase.GATHER else 'coverage done'": "gathered at d1",
    "self._takeoff_altitude_m": "120.0",
    "self.battery_percent": "10",
    "one": "249",
    "other": "250",
    "apart_m": "111.4",
    "expected_m": "108.0",
    "off_m": "1000",
    "where": "on the ground",
    "lease.leader": "250",
    "self.recovery.stage.value": max([stage.value for stage in Stage], key=len),
    "ask.request.value": "offboard",
    "event.request.value": "offboard",
    "event.result.name": "TEMPORARILY_REJECTED",
    "self._answer.name": "IN_PROGRESS",
    "reason.value": max([reason.value for reason in Reason], key=len),
    "self.grounded": "",  # the preflight's own words: `brief` cuts them
}
WAITS = "waiting: "  # before what these modules say that a vehicle lacks
LACKS = ("autopilot_state", "obstacle_sensor_monitor", "start_placement")
SAYS = ("Say(", "def missing(", "def start_mismatch", "def find_mismatch")
WORST = Readings(
    silence_s=999.9,
    steers=True,
    telemetry_late_s=9999.9,
    battery_percent=10,
    mode="custom mode 0x12345678",
    refused=max([request.value for request in Request if request is not Request.LAND], key=len),
    missing=f", without {MANY}",
    search=max([f": {stage.value}" for stage in Stage] + [", following 250"], key=len),
    unsure_of=250,
)


def messages(module: Path) -> Iterator[str]:
    """The texts of a module as long as they may be; not docstrings, errors, nor what `brief` cuts."""
    silent: set[ast.AST] = set()
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        cut = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "brief"
        if cut or isinstance(node, ast.Raise) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            silent.update(ast.walk(node))
        elif isinstance(node, ast.JoinedStr) and node not in silent:
            silent.update(ast.walk(node))
            yield "".join(
                str(part.value) if isinstance(part, ast.Constant) else WIDEST[ast.unparse(part.value)]  # type: ignore[attr-defined]
                for part in node.values
            )
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in silent:
            yield node.value


MODULES = [
    file for file in sorted(CORE.rglob("*.py")) if any(word in file.read_text(encoding="utf-8") for word in SAYS)
]


@pytest.mark.parametrize("module", MODULES, ids=[file.stem for file in MODULES])
def test_every_message_fits_one_statustext(module: Path) -> None:
    before = WAITS if module.stem in LACKS else ""
    too_long = [before + text for text in messages(module) if len(before + text) > TEXT_MAX]
    assert not too_long


@pytest.mark.parametrize("row", TABLE, ids=[row.cause.name.lower() for row in TABLE])
def test_every_failsafe_fits_one_statustext(row: Row) -> None:
    detail = "" if row.detail is None else row.detail(WORST)
    assert len(row.text.replace("{}", detail)) <= TEXT_MAX
    assert ("{}" in row.text) is (row.detail is not None)


def test_a_message_names_some_vehicles_and_how_many_more() -> None:
    assert list_vehicles([3, 4, 5, 6]) == "3, 4, 5, 6"
    assert list_vehicles([3, 4, 5, 6, 7]) == "3, 4, 5, 2 more"


def test_words_of_others_are_cut_at_a_word() -> None:
    assert brief("grounded, no preflight") == "grounded, no preflight"
    cut = brief("grounded, preflight failed: GF_ACTION, COM_OBL_RC_ACT, NAV_RCL_ACT")
    assert cut == "grounded, preflight failed: GF_ACTION, ..."
    assert len(brief("preflight waived: " + "x" * 60)) <= TEXT_MAX
