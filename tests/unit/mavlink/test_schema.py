"""The schema of our own messages: a field is one row, and whatever is generated follows it."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink import dialect
from companion.mavlink.schema import __main__ as program
from companion.mavlink.schema.generate import CODEC, DIALECT, SWARM_XML, VALUES, generated
from companion.mavlink.schema.messages import OWN
from companion.mavlink.schema.rows import Field, Message, Value, field
from companion.mavlink.schema.stub import stub
from mission.common.frames import Wgs84

ROOT = program.ROOT
HERE = Wgs84(47.0, 8.0, 400.0)
TEMPERATURE = field(
    "motor_cdegc",
    "uint16_t",
    "Temperature of the sender's hottest motor.",
    Value("motor_degc", kind="float", default="0.0"),
    unit="cdegC",
    pack="round({} * 100.0)",
    unpack="{} / 100.0",
    most=9000,
)


def with_row(row: Field) -> list[Message]:
    """The schema with one row more in the beacon's table."""
    beacon, *others = OWN
    return [replace(beacon, fields=(*beacon.fields, row)), *others]


def loaded(name: str, text: str, folder: Path) -> ModuleType:
    path = folder / f"{name.replace('.', '_')}.py"
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


Made = tuple[dict[str, str], Any, Any, Any]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Made]:
    """Of the schema with TEMPERATURE: the texts, and the values, codec and dialect as modules."""
    texts, folder = generated(ROOT, with_row(TEMPERATURE)), tmp_path_factory.mktemp("schema")
    values = loaded("extended_values", texts[VALUES], folder)
    codec = loaded("extended_codec", texts[CODEC].replace("companion.core.model.beacon", "extended_values"), folder)
    extended = loaded("extended_dialect", texts[DIALECT], folder)
    yield texts, values, codec, extended
    for name in ("extended_values", "extended_codec", "extended_dialect"):
        del sys.modules[name]


def beacon(values: Any, **changes: Any) -> Any:
    still = (0.0, 0.0, 0.0)
    required: dict[str, Any] = {
        "sender": 2,
        "time_ms": 7,
        "vel_ned_mps": still,
        "ref_ned_mps": still,
        "dest_ned_m": None,
        "route_cost": 1.0,
        "governor": 1.0,
        "lease": None,
        "hop": 1,
        "agreed": True,
        "candidate": None,
        "parent": 1,
        "phase": SwarmPhase.TRANSIT,
        "state": FlightState.TRANSIT,
        "airborne": True,
        "start": True,
        "abort": False,
        "done": 5,
        "range_m": 30.0,
    }
    return values.Beacon(**{**required, **changes})


def test_a_row_more_is_encoded_decoded_and_part_of_the_value(made: Made) -> None:
    _, values, codec, _ = made
    assert beacon(values).motor_degc == 0.0
    sent = beacon(values, motor_degc=36.5, sighting=values.PeerReport(3, (1.0, 2.0, 3.0), 0.5, True))
    fields = codec.unpack_beacon(codec.encode_beacon(sent, HERE))
    assert fields.motor_cdegc == 3650
    assert codec.decode_beacon(2, fields) == sent
    assert codec.here_of(fields) == HERE


def test_a_row_more_is_bounded(made: Made) -> None:
    _, values, codec, _ = made
    fields = codec.unpack_beacon(codec.encode_beacon(beacon(values, motor_degc=90.0), HERE))
    assert codec.decode_beacon(2, fields) is not None
    assert codec.decode_beacon(2, fields._replace(motor_cdegc=9001)) is None


def test_a_row_more_is_in_the_definition_the_dialect_and_its_types(made: Made) -> None:
    texts, values, codec, extended = made
    assert '<field type="uint16_t" name="motor_cdegc" units="cdegC">' in texts[SWARM_XML]
    message = extended.MAVLink_swarm_beacon_message
    assert tuple(message.ordered_fieldnames) == codec.WireBeacon._fields
    assert message.unpacker.size == codec.BEACON_PAYLOAD.size == dialect.MAVLink_swarm_beacon_message.unpacker.size + 2
    assert message.crc_extra != dialect.MAVLink_swarm_beacon_message.crc_extra
    (line,) = (
        line
        for line in texts[f"{DIALECT}i"].splitlines()
        if line.startswith("    def swarm_beacon_encode(self, time_boot_ms: int")
    )
    assert "motor_cdegc: int" in line
    payload = codec.encode_beacon(beacon(values, motor_degc=36.5), HERE)
    sent = message(**dict(zip(message.ordered_fieldnames, message.unpacker.unpack(payload), strict=False)))
    assert sent.motor_cdegc == 3650


def test_whatever_is_generated_follows_the_row() -> None:
    plain, extended = generated(ROOT), generated(ROOT, with_row(TEMPERATURE))
    for name, text in extended.items():
        word = "motor_degc" if name == VALUES else "motor_cdegc"
        assert word in text, name
        assert word not in plain[name], name


HANDWRITTEN = ["companion/mavlink/beacon.py", "companion/mavlink/relative.py", "companion/mavlink/codec.py"]


@pytest.mark.parametrize("name", [*HANDWRITTEN, "companion/watch/heard.py", "docs/generate.py"])
def test_what_is_written_by_hand_names_no_field_of_the_wire(name: str) -> None:
    """Fields whose names are not also those of values, of the autopilots' messages, or of a mission."""
    carried = [value for message in OWN for row in message.fields for value in row.carried()]
    values = {value.name for value in carried} | {value.part for value in carried}
    common = {"lat", "lon", "alt", "vx", "vy", "vz", "time_boot_ms", "version", "leader", "ranges", "flags", "seen"}
    common |= {"leader_priority"}
    own = {row.name for message in OWN for row in message.fields} - values - common
    assert {"range_dm", "seen_age", "leader_seq", "flight_state", "members", "odo_n", "place_sd"} <= own
    text = (ROOT / name).read_text(encoding="utf-8")
    words = set("".join(c if c.isalnum() or c == "_" else " " for c in text).split())
    assert own & words == set()


def test_what_is_generated_is_what_stands_there(capsys: pytest.CaptureFixture[str], monkeypatch: Any) -> None:
    monkeypatch.setattr(sys, "argv", ["schema", "--check"])
    assert program.main() == 0
    monkeypatch.setattr(program, "generated", lambda root: {**generated(root), CODEC: "other"})
    assert program.main() == 1
    assert capsys.readouterr().err == f"{CODEC} is not what the schema generates: run `make dialect`\n"


def test_fields_of_other_sizes_are_sent_in_mavlinks_order() -> None:
    first = field("first", "uint8_t", "A byte.")
    last = field("last", "float", "Four.")
    row = Message(id=1, name="M", meaning="", fields=(first, last))
    assert [one.name for one in row.on_wire] == ["last", "first"]


def names_in(text: str) -> Sequence[str]:
    return [line.partition(":")[0] for line in text.splitlines() if ": Final = " in line]


def test_the_stub_has_every_constant_of_the_dialect() -> None:
    source = (ROOT / DIALECT).read_text(encoding="utf-8")
    constants = [name for name, value in vars(dialect).items() if name.startswith("MAV") and type(value) is int]
    assert set(constants) - {"MAVLINK_IGNORE_CRC"} <= set(names_in(stub(source)))
