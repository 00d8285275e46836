"""The replay of a flight: what report.html shows is what was flown."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mission.document.load import load_mission
from sim_bridge import cli
from sim_bridge.judge import page, run_folder
from sim_bridge.judge.metrics import FIGURES, acting_leader, links
from sim_bridge.judge.metrics.pairs import look_at_pairs
from sim_bridge.judge.outcome import NAME_CHARS
from sim_bridge.judge.page.about import ABOUT
from sim_bridge.judge.page.coding import read_column, read_steps, unpack
from sim_bridge.judge.page.names import name_of
from sim_bridge.judge.recording import Recording
from sim_bridge.lab.judged import judged
from sim_bridge.trunk_attenuation import range_share

POSITION_M = 0.005  # half a step
ABSENT = frozenset({"stand_report", "chart", "chart.tiles"})  # of this flight
OPEN = frozenset({"figures", "links", "events[].severity"})  # keys inside are not listed, or not in every entry


@pytest.fixture(scope="module")
def replay(run: Path) -> dict[str, Any]:
    return judged(run).document()


@pytest.fixture(scope="module")
def recording(run: Path) -> Recording:
    return run_folder.load(run)


def rows(replay: dict[str, Any], recording: Recording) -> Any:
    """The ticks of the recording that the replay has."""
    return np.searchsorted(recording.time_s, read_column(replay["time_s"]) - 1e-6)


def test_positions_are_the_recordings_to_half_a_centimetre(replay: dict[str, Any], recording: Recording) -> None:
    ticks = rows(replay, recording)
    assert ticks[0] == 0
    assert ticks[-1] == len(recording.time_s) - 1
    assert np.median(np.diff(recording.time_s[ticks])) == pytest.approx(0.1)
    for k, vehicle in enumerate(replay["vehicles"]):
        assert vehicle["id"] == k + 1
        north, east, down = recording.pos_ned_m[ticks, k].T
        for name, true in (("north_m", north), ("east_m", east), ("up_m", -down)):
            assert np.abs(read_column(vehicle[name]) - true).max() <= POSITION_M + 1e-9


def test_leader_phase_and_states_are_the_recordings(replay: dict[str, Any], recording: Recording) -> None:
    ticks = rows(replay, recording)
    found = read_steps(replay["swarm"]["leader"], len(ticks))
    np.testing.assert_array_equal(found, acting_leader(recording)[ticks])
    for k, vehicle in enumerate(replay["vehicles"]):
        for name, true in (
            ("alive", recording.agent_alive),
            ("phase", recording.phase),
            ("range_m", recording.range_m),
        ):
            np.testing.assert_allclose(read_steps(vehicle[name], len(ticks)), true[ticks, k], atol=0.05)


def test_links_come_and_go_as_in_the_recording(run: Path, replay: dict[str, Any], recording: Recording) -> None:
    ticks = rows(replay, recording)
    found = judged(run)
    share = range_share(found.mission.sim, found.stand)
    for row in (0, len(ticks) // 2, len(ticks) - 1):
        linked = {
            (a - 1, b - 1) for a, b, *changes in replay["links"] if np.count_nonzero(np.cumsum(changes) <= row) % 2 == 1
        }
        assert linked == {tuple(pair) for pair in links(recording, int(ticks[row]), share).tolist()}


def test_the_least_separation_is_that_of_the_metrics_to_the_rows_rate(replay: dict[str, Any], run: Path) -> None:
    least_m = np.nanmin(read_column(replay["swarm"]["separation_m"]))
    assert least_m == pytest.approx(replay["figures"]["min_separation_m"], abs=0.1)
    whole = look_at_pairs(run_folder.load(run), load_mission(run / "mission.toml"))
    assert least_m >= whole.separation_m.min() - 0.005


def test_figures_have_names_with_units_and_no_keys(replay: dict[str, Any]) -> None:
    shown = dict(replay["figures_named"])
    assert len(shown) == len(replay["figures"])  # no two have one name
    assert not [name for name in shown if "_" in name]
    assert shown["least separation, m"] == replay["figures"]["min_separation_m"]
    assert shown["connected in transit, %"] == 100.0 * replay["figures"]["connected_fraction_transit"]
    page_of_figures = (Path(__file__).parents[2] / "docs" / "reference" / "metrics.md").read_text(encoding="utf-8")
    for figure in FIGURES:
        assert f"| `{figure.name}` | {name_of(figure.name)} |" in page_of_figures
        assert name_of(figure.name) in shown
        assert len(name_of(figure.name)) <= NAME_CHARS


def test_a_killed_leader_is_a_fault_and_the_reason_of_the_next_election(replay: dict[str, Any]) -> None:
    faults = [event for event in replay["events"] if event["kind"] == "fault"]
    leads = [event for event in replay["events"] if event["kind"] == "lead"]
    killed = faults[0]["vehicles"][0]
    assert faults[0]["text"] == f"leader {killed} killed"
    assert leads[0]["text"] == f"vehicle {killed} leads: first election"
    next_one = leads[1]["vehicles"][0]
    assert next_one != killed
    assert leads[1]["text"] == f"vehicle {next_one} leads: leader {killed} killed at 30 s"
    assert 30.0 < leads[1]["time_s"] < 33.0
    times_s = [event["time_s"] for event in replay["events"]]
    assert times_s == sorted(times_s)
    assert {"phase", "closest", "text", "end"} <= {event["kind"] for event in replay["events"]}


def test_telemetry_is_in_it_where_it_was_logged(replay: dict[str, Any]) -> None:
    length = len(read_column(replay["time_s"]))
    killed = next(event for event in replay["events"] if event["kind"] == "fault")["vehicles"][0]
    for vehicle in replay["vehicles"]:
        battery = read_column(vehicle["battery_pct"])
        assert 0 < np.nanmin(battery) <= np.nanmax(battery) <= 100
        off_m = np.hypot(*(read_column(vehicle["estimate_off"][axis]) for axis in ("east_m", "north_m")))
        assert np.nanmax(off_m) < 1.0  # the estimates of this flight are exact
        silent_s = np.nanmax(read_column(vehicle["beacon_age_s"]))
        assert (silent_s > 10.0) == (vehicle["id"] == killed)
        scans = vehicle["scans"]
        assert len(scans["ranges_dm"]) == len(scans["rows"]) * scans["sectors"]
        assert sum(scans["rows"]) < length


def test_scans_show_trunks_where_they_stand(replay: dict[str, Any]) -> None:
    """Most of what a scan met is the surface of a trunk or bush, or another vehicle."""
    east, north, radius = (
        np.concatenate([read_column(replay["stand"][kind][name]) for kind in ("trees", "bushes")])
        for name in ("east_m", "north_m", "radius_m")
    )
    vehicle = replay["vehicles"][1]
    scans, yaw_deg = vehicle["scans"], read_column(vehicle["yaw_deg"])
    at = read_column(vehicle["east_m"]), read_column(vehicle["north_m"])
    near = total = 0
    for row, ranges in zip(
        np.cumsum(scans["rows"]), np.reshape(scans["ranges_dm"], (-1, scans["sectors"])), strict=True
    ):
        for sector in np.flatnonzero(ranges > 0):
            bearing = np.radians(yaw_deg[row] + scans["start_deg"] + sector * scans["step_deg"])
            x, y = (
                at[0][row] + ranges[sector] / 10 * np.sin(bearing),
                at[1][row] + ranges[sector] / 10 * np.cos(bearing),
            )
            near += bool((np.abs(np.hypot(east - x, north - y) - radius) < 0.6).any())
            total += 1
    assert total > 50
    assert near / total > 0.8


def test_every_key_is_documented_and_every_documented_key_is_there(replay: dict[str, Any]) -> None:
    found = set(keys(replay, ""))
    assert found - OPEN == set(ABOUT) - OPEN - ABSENT
    assert (OPEN - {"events[].severity"}) <= found


def keys(value: Any, place: str) -> Iterator[str]:
    if place in OPEN or (isinstance(value, dict) and "is" in value):
        yield place
    elif isinstance(value, dict):
        for name, inner in value.items():
            yield from keys(inner, f"{place}.{name}".removeprefix("."))
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for inner in value:
            yield from keys(inner, f"{place}[]")
    else:
        yield place


def test_report_writes_a_page_that_holds_the_replay_and_asks_for_nothing(
    run: Path, replay: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "page.html"
    code = cli.main(["report", str(run), "--out", str(file)])
    text = file.read_text(encoding="utf-8")
    assert f"  {'replay':<{NAME_CHARS}} {file}\n" in capsys.readouterr().out
    assert code == (0 if replay["verdict"]["succeeded"] else 1)
    held = re.search(r'id="data">([^<]*)<', text)
    assert held is not None
    assert unpack(held[1]) == json.loads(json.dumps(replay))
    assert not re.search(r'(?:src|href)="(?!data:)', text)
    assert "<title>oak &amp; &lt;beech&gt;</title>" in text
    assert "default-src 'none'" in text
    assert len(text) < 2_000_000


def test_open_shows_the_page(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []
    monkeypatch.setattr(page.webbrowser, "open", shown.append)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    cli.main(["report", str(run), "--out", str(tmp_path / "page.html")])
    assert not shown
    cli.main(["report", str(run), "--open", "--out", str(tmp_path / "page.html")])
    assert not shown  # without a display, one for terminals would be opened
    monkeypatch.setenv("DISPLAY", ":0")
    cli.main(["report", str(run), "--open", "--out", str(tmp_path / "page.html")])
    assert shown == [(tmp_path / "page.html").as_uri()]
