"""[[payload]]: what `mission check` refuses, by place and value, and that the tables come back as they were."""

from __future__ import annotations

from pathlib import Path

import pytest

from mission.cli import check
from mission.document.load import dump_mission, parse_mission
from mission.rules.payload_rules import records_hz, records_max_hz
from mission.schema.payload import heading_of

ROUTE = """
[route]
d1_enu_m = [0.0, 0.0, 4.0]
d2_enu_m = [40.0, 0.0, 4.0]
vel_leader_mps = 2.0
"""
LIGHT = {"name": '"light"', "unit": '"lx"', "source": '"NAMED_VALUE_FLOAT.light"'}
AIR = {"name": '"temperature"', "unit": '"degC"', "source": '"HYGROMETER_SENSOR.temperature"'}


def text_of(*tables: dict[str, str], more: str = "") -> str:
    payload = "".join("[[payload]]\n" + "".join(f"{k} = {v}\n" for k, v in one.items()) for one in tables)
    return f"schema = 1\n{payload}{ROUTE}{more}"


def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str) -> str:
    file = tmp_path / "m.toml"
    file.write_text(text)
    assert check.run([str(file)], as_json=False) != 0
    lines = [line.removeprefix(f"{file}:") for line in capsys.readouterr().err.splitlines()]
    (line,) = [line for line in lines if "payload" in line]
    return line


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        (
            [LIGHT | {"source": '"SCALED_PRESSURE.temperature"'}],
            '5: payload[0].source = "SCALED_PRESSURE.temperature": must be',
        ),
        ([LIGHT | {"source": '"NAMED_VALUE_FLOAT.eleven_char"'}], "NAME of 1 to 10 characters"),
        ([LIGHT | {"name": '"Light"'}], '3: payload[0].name = "Light"'),
        ([LIGHT | {"unit": '"l x"'}], '4: payload[0].unit = "l x"'),
        ([LIGHT | {"period_s": "0.1"}], "6: payload[0].period_s = 0.1: must be a number from 0.5 to 3600"),
        ([LIGHT, AIR | {"unit": '"K"'}], '8: payload[1].unit = "K": must be "degC", in which HYGROMETER_SENSOR.temp'),
        (
            [LIGHT, LIGHT | {"source": '"NAMED_VALUE_FLOAT.l"'}],
            '7: payload[1].name = "light": is that of payload[0], too',
        ),
        ([LIGHT, LIGHT | {"name": '"sun"'}], '9: payload[1].source = "NAMED_VALUE_FLOAT.light": is that of payload[0]'),
        (
            [LIGHT | {"name": '"up"', "unit": '"m"'}],
            '3: payload[0].name = "up": heads a column up_m, which all records',
        ),
    ],
)
def test_bad_tables_are_refused_by_place_and_value(
    tables: list[dict[str, str]], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert said in refused(tmp_path, capsys, text_of(*tables))


def test_more_records_than_disks_hold_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(tmp_path, capsys, text_of(LIGHT | {"period_s": "0.5"}, more="[swarm]\nsize = 20\n"))
    assert "payload[0].period_s = 0.5: all vehicles' payload makes 40.0 records a second: must be at most 25.0" in line
    assert "(swarm.size = 20)" in line


def test_a_slow_radio_allows_fewer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    slow = "[radio]\nbit_rate_kbps = 50.0\n"
    line = refused(tmp_path, capsys, text_of(LIGHT | {"period_s": "1.0"}, more=slow))
    assert "makes 8.0 records a second: must be at most 3.5 (swarm.size = 8, radio.bit_rate_kbps = 50.0)" in line
    slower = parse_mission(text_of(LIGHT | {"period_s": "4.0"}, more=slow))
    assert records_hz(slower) == 2.0 <= records_max_hz(slower)


def test_mission_check_says_how_many_records_there_will_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "m.toml"
    file.write_text(text_of(LIGHT, AIR | {"period_s": "10.0"}))
    assert check.run([str(file)], as_json=False) == 0
    said = "payload: light (lx) each 2 s, temperature (degC) each 10 s: 4.8 records a second of 25.0 at most"
    assert said in capsys.readouterr().out


def test_tables_are_written_out_and_loaded_back() -> None:
    mission = parse_mission(text_of(LIGHT, AIR))
    assert parse_mission(dump_mission(mission)) == mission
    assert parse_mission(dump_mission(mission, all_keys=False)) == mission
    assert mission.keeps_records


def test_a_mission_without_the_table_is_written_out_without_it() -> None:
    plain = parse_mission(f"schema = 1\n{ROUTE}")
    assert "payload" not in dump_mission(plain)
    assert not plain.keeps_records


def test_columns_are_headed_with_their_units() -> None:
    assert heading_of("temperature", "degC") == "temperature_degc"
    assert heading_of("humidity", "%") == "humidity_pct"
    assert heading_of("par", "umol/m2/s") == "par_umol_per_m2_per_s"
    assert heading_of("health", "1") == "health"
