"""What is written is MCAP, as the mcap library reads it; what is read may be anything."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from mcap.reader import NonSeekingReader
from mcap.records import Metadata
from mcap.stream_reader import StreamReader

from companion.journal.channels import ARRIVED, SCHEMAS, TOPICS, Channel
from companion.journal.reading import BlackBoxError, CutOff, find_flights, read_flight
from companion.mavlink.framing.frames import Framing
from tests.unit.journal.journal_kit import recorded


def test_the_mcap_library_reads_it(tmp_path: Path) -> None:
    flight = recorded(tmp_path, 40)
    counts: dict[str, int] = {}
    with flight.segments[1].open("rb") as file:
        for schema, channel, message in NonSeekingReader(file, validate_crcs=True).iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if schema is not None:
                assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
                body = json.loads(message.data)
                jsonschema.validate(body, json.loads(schema.data))
                assert set(body) <= set(json.loads(schema.data)["properties"])
            elif channel.topic == TOPICS[Channel.AUTOPILOT_OUT]:
                assert Framing().read_messages(message.data[ARRIVED.size :])
    assert counts["/start"] == counts["/end"] == 1
    assert counts["/tick"] == 40
    assert counts["/in/autopilot"] == 42
    assert counts["/in/peers"] == 20


def test_a_segment_says_whose_it_is(tmp_path: Path) -> None:
    flight = recorded(tmp_path, 5)
    with flight.segments[1].open("rb") as file:
        (about,) = [record for record in StreamReader(file).records if isinstance(record, Metadata)]
    assert about.metadata["vehicle"] == "3"
    assert about.metadata["mission_sha256"] == "its digest"


def test_every_json_channel_has_a_schema() -> None:
    for schema in SCHEMAS.values():
        jsonschema.Draft202012Validator.check_schema(schema)


def test_what_is_no_black_box_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none", tmp_path / "a.mcap"):
        if path.suffix:
            path.write_bytes(b"x")
        with pytest.raises(BlackBoxError, match=str(path)):
            find_flights(path)


@pytest.mark.parametrize(
    "data", [b"", b"\x89MCAP0", b"\x89MCAP0\r\n", b"no MCAP at all", b"\x89MCAP0\r\n" + b"\xff" * 99]
)
def test_bytes_that_are_no_log_are_told(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "vehicle-1-flight-0001-0001.mcap").write_bytes(data)
    (flight,) = find_flights(tmp_path)
    *broken, cut_off = read_flight(flight)
    assert isinstance(cut_off, CutOff)
    assert len(broken) == (data[:2] == b"no" or len(data) > 99)
