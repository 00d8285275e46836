"""Other sensors in whole flights: values at the base station are the field's truth, and the swarm flies alike."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.journal.reading import find_flights
from companion.journal.replay import replay_flight
from companion.stand.products.write import write_products
from companion.stand.records import read_records
from mission.document.model import Mission
from mission.stand.stand import stand_of
from sim_bridge.drive.lockstep.black_box import FOLDER_NAME
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.judge import run_folder
from sim_bridge.world.sensors.payload.drivers import HUMIDITY_SD_PCT, LIGHT_SD, TEMPERATURE_SD_C
from sim_bridge.world.sensors.payload.fields import LIGHT_LX, FieldsOfStand
from tests.flights import flown, short_mission

SEED = 3
PAYLOAD = [
    {"name": "light", "unit": "lx", "period_s": 1.0, "source": "NAMED_VALUE_FLOAT.light"},
    {"name": "temperature", "unit": "degC", "period_s": 2.0, "source": "HYGROMETER_SENSOR.temperature"},
    {"name": "humidity", "unit": "%", "period_s": 2.0, "source": "HYGROMETER_SENSOR.humidity"},
    {"name": "health", "unit": "1", "period_s": 5.0, "source": "SYS_STATUS.health"},
]
NOISE = {"temperature_degc": TEMPERATURE_SD_C, "humidity_pct": HUMIDITY_SD_PCT}
SIGMAS = 5.0  # of some thousand draws
QUANTUM = 0.005  # of HYGROMETER_SENSOR


def carrying(n: int = 3, *, payload: bool = True, **tables: Any) -> Mission:
    """Among trees, there and back, and the base station at d1; no lidar, nothing is surveyed."""
    stand = {"seed": 5, "density_per_ha": 300.0, "area_enu_m": [(-30, -30), (70, -30), (70, 30), (-30, 30)]}
    sim = {"seed": SEED, **tables.pop("sim", {})}
    mission = short_mission(
        swarm={"size": n},
        route={"at_end": "return", **tables.pop("route", {})},
        sim=sim,
        sensing={"range_m": 8.0},
        forest={"stand": stand},
        **tables,
    )
    return Mission.model_validate({**mission.model_dump(by_alias=True), "payload": PAYLOAD if payload else []})


def values_at_base(mission: Mission, folder: Path) -> list[dict[str, str]]:
    """Rows of payload.csv, as the base station writes it."""
    write_products(read_records(folder / "records.db"), mission, folder / "stand")
    with (folder / "stand" / "payload.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_values_at_the_base_station_are_the_fields_truth_within_noise(tmp_path: Path) -> None:
    mission = carrying(sim={"radio_loss": 0.2})
    outcome, shown = flown(mission, tmp_path, keys=FleetKeys(mission), black_box=True)
    assert outcome.succeeded, shown
    assert outcome.summary["records_delivered"] == outcome.summary["records_made"] > 300
    assert all(record.proven for record in read_records(tmp_path / "records.db"))
    rows, run = values_at_base(mission, tmp_path), run_folder.load(tmp_path)
    fields = FieldsOfStand(stand_of(mission))
    misses = []
    for row in rows:
        tick = int(np.argmin(np.abs(run.time_s - float(row["made_s"]))))
        assert run.time_s[tick] == pytest.approx(float(row["made_s"]), abs=1e-3)
        true_ned_m = run.pos_ned_m[tick, int(row["vehicle_id"]) - 1]
        truth = fields.at(tuple(true_ned_m.tolist()))
        told_m = np.array([float(row["north_m"]), float(row["east_m"]), -float(row["up_m"])])
        assert np.abs(told_m - true_ned_m).max() < 3.0 * float(row["position_sd_m"])
        for column, value in zip(("light_lx", "temperature_degc", "humidity_pct"), truth, strict=True):
            if row[column]:
                off = float(row[column]) - value
                assert abs(off) <= SIGMAS * NOISE.get(column, LIGHT_SD * value) + QUANTUM
                misses += [off / NOISE[column]] if column in NOISE else []
        assert row["health"] in ("", "1.0")
    light = [float(row["light_lx"]) for row in rows if row["light_lx"]]
    assert min(light) < 0.3 * LIGHT_LX < 0.9 * LIGHT_LX < max(light)  # it was below crowns, and in the open
    assert abs(np.mean(misses)) < 4.0 / np.sqrt(len(misses))
    assert np.std(misses) == pytest.approx(1.0, abs=0.15)
    for flight in find_flights(tmp_path / FOLDER_NAME):
        replayed = replay_flight(flight)
        assert (replayed.difference, replayed.breaks, replayed.stopped) == ([], [], "")
        assert replayed.same == replayed.summary.ticks > 100


def test_values_survive_a_lost_leader_a_restart_and_bad_links(tmp_path: Path) -> None:
    faults = [
        {"kind": "kill", "phase": "transit", "at_s": 3.0},
        {"kind": "restart", "vehicles": [3], "phase": "transit", "at_s": 6.0, "for_s": 2.0},
    ]
    mission = carrying(4, sim={"radio_loss": 0.3, "faults": faults}, radio={"bit_rate_kbps": 250.0})
    outcome, shown = flown(mission, tmp_path)
    figures = outcome.summary
    unwritten = sum(figures["records_unwritten"].values())  # made in the last half second before a fault
    assert figures["records_made"] > 300
    assert unwritten <= 12, shown
    lost = sum(figures["records_lost"].values())
    assert figures["records_delivered"] + lost + unwritten == figures["records_made"]
    rows = values_at_base(mission, tmp_path)
    assert {row["vehicle_id"] for row in rows} == {"1", "2", "3", "4"}
    assert len({(row["vehicle_id"], row["flight"], row["made_s"]) for row in rows}) == len(rows)
    restarted = [float(row["made_s"]) for row in rows if row["vehicle_id"] == "3" and row["light_lx"]]
    gaps = np.diff(sorted(restarted))
    assert (gaps > 1.5).sum() == 1  # while it was started again


def test_a_swarm_with_payload_flies_as_one_without_to_the_bit(tmp_path: Path) -> None:
    for payload in (True, False):
        flown(carrying(payload=payload), tmp_path / str(payload))
    carries, plain = (run_folder.load(tmp_path / str(payload)) for payload in (True, False))
    ticks = plain.time_s.size  # the other waits for the last records, on the ground
    assert carries.time_s.size > ticks
    assert np.array_equal(carries.pos_ned_m[:ticks], plain.pos_ned_m)
