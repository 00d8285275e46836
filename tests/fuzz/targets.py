"""What is fuzzed: each target reads bytes as a program of ours does, and raises only what that program expects."""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from random import Random
from typing import Final, Protocol

from companion.base.station import BaseStation
from companion.keys.key_file import KeyFileError, load_keyring
from companion.lidar.models import MODELS
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.framing.frames import Framing
from companion.mavlink.lidar_scan import LIDAR_SCAN_ID, decode_lidar_scan
from companion.mavlink.relative import read_relative_report, read_trunk_report
from companion.records.frames import read_record, read_vector
from companion.records.node import open_base
from companion.records.store import StoreError, open_store
from companion.watch.command import about, view
from companion.watch.heard import Heard
from mission.basemap.chart import ChartError
from mission.basemap.charts import open_chart
from mission.common.problems import MissionError
from mission.document.load import load_mission
from mission.plan.qgc_plan import from_plan
from mission.stems.stem_map import read_stems
from mission.stems.utm import zone_of
from tests.fuzz.companion import Episode
from tests.fuzz.flights import mission_of
from tests.fuzz.mutations import NUMBERS, change_bytes, change_datagram
from tests.fuzz.tape import Kind, Step, read_tape, tick, write_tape

CORPUS: Final = Path(__file__).parent.parent / "testdata" / "fuzz"
PNG: Final = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x1e\0\0\0\x14"
SPLITS: Final = (1, 7, 64, 280)  # bytes of one read of a stream
WORDS: Final = tuple(
    word.encode()
    for word in (
        *("nan", "inf", "-inf", "1e999", "-1", "0", "9" * 400, "1e-400", "true", "[[", "]]", '"', "'''", "[", "{", "}"),
        *("\n", ",", ";", "=", ".", "\\u0000", "\\", "#", "null", "-0.0", "1979-05-27T07:32:00Z", "0x7fffffffffffffff"),
        *("../../../etc/passwd", "\0", "\ufeff", "é", "x" * 300),
    )
)


class Target(Protocol):
    """One thing that reads bytes."""

    def run(self, data: bytes) -> object:
        """Read them; what comes of it, in short: an input of which something new came is changed further."""

    def draw(self, rng: Random, corpus: Sequence[bytes]) -> bytes:
        """Another input, near those of the corpus."""


class Loader:
    """A file of `suffix`, read by `load`, which raises `expected` for all that it refuses."""

    def __init__(self, suffix: str, load: Callable[[Path], object], expected: tuple[type[Exception], ...]) -> None:
        self._load, self._expected, self._name = load, expected, f"fuzzed{suffix}"

    def run(self, data: bytes) -> object:
        """The shape of what was said."""
        with tempfile.TemporaryDirectory(prefix="understory-fuzz-") as folder:
            path = Path(folder) / self._name
            path.write_bytes(data)
            try:
                found = self._load(path)
            except self._expected as error:
                found = "".join(letter for letter in str(error) if letter.isalpha())[-40:]
        return found

    def draw(self, rng: Random, corpus: Sequence[bytes]) -> bytes:
        """Bytes changed, words put in between, parts of two files."""
        data = rng.choice(corpus)
        if rng.random() < 0.5:
            return change_bytes(rng, data, rng.choice(corpus))
        for _ in range(1 + rng.randrange(3)):
            at = rng.randrange(len(data) + 1)
            word = rng.choice(WORDS) if rng.random() < 0.8 else rng.choice(NUMBERS)
            data = data[:at] + word + data[at + rng.choice((0, 0, 1, len(word))) :]
        return data


class Datagrams:
    """A tape's datagrams, of one link, with ticks between: read by what `make` returns."""

    def __init__(self, make: Callable[[], Callable[[Step], object]]) -> None:
        self._make = make

    def run(self, data: bytes) -> object:
        """From the start."""
        do = self._make()
        found: object = None
        for step in read_tape(data):
            found = do(step)
        return found

    def draw(self, rng: Random, corpus: Sequence[bytes]) -> bytes:
        """A few datagrams of genuine ones, changed, and ticks."""
        genuine = [step.data for step in read_tape(rng.choice(corpus)) if step.kind is not Kind.TICK] or [b""]
        steps: list[Step] = []
        for _ in range(1 + rng.randrange(12)):
            steps.append(Step(Kind.PEERS, change_datagram(rng, rng.choice(genuine), rng.choice(genuine))))
            if rng.random() < 0.3:
                steps.append(tick(rng.choice((0.0, 0.05, 0.5, 6.0))))
        return write_tape(steps)


class Companion:
    """A whole companion; its campaigns are flights (tests/fuzz/companion.py), its corpus parts of them."""

    def __init__(self, mission_name: str) -> None:
        self.mission_name = mission_name

    def run(self, data: bytes) -> object:
        """From the start."""
        episode = Episode(self.mission_name)
        for step in read_tape(data):
            episode.do(step)
        return episode.signature

    def draw(self, rng: Random, corpus: Sequence[bytes]) -> bytes:
        """A part of a flight with forged datagrams between."""
        steps: list[Step] = []
        genuine = [step for step in read_tape(rng.choice(corpus)) if step.kind is not Kind.TICK] or [tick()]
        for step in read_tape(rng.choice(corpus)):
            steps.append(step)
            if step.kind is not Kind.TICK:
                steps.append(Step(step.kind, change_datagram(rng, step.data, rng.choice(genuine).data)))
        return write_tape(steps)


# --- readers ---


def read_frames(data: bytes) -> object:
    """Both framings, at any split, and each message of our own by the decoder that it has."""
    whole = Framing()
    found = whole.parse(data)
    for size in SPLITS:
        stream = Framing(is_stream=True)
        for at in range(0, min(len(data), 4096), size):
            stream.read_messages(data[at : at + size])
    beside: list[bytes] = []
    swarm_beacon.beacons(data, lambda frame: beside.append(frame) or False)
    for frame in beside:
        read_record(frame), read_vector(frame), read_relative_report(frame), read_trunk_report(frame)
    for message in found:
        if message.get_msgId() == LIDAR_SCAN_ID:
            decode_lidar_scan(message)
    return tuple(sorted({message.get_msgId() for message in found}))


def _watch() -> Callable[[Step], object]:
    heard, mission, now_s = Heard(), mission_of("open"), 100.0

    def do(step: Step) -> object:
        nonlocal now_s
        if step.kind is Kind.TICK:
            now_s += step.seconds
        else:
            heard.receive_datagram(step.data, now_s)
        shown = view(heard, mission, now_s)
        json.dumps(shown, allow_nan=False)
        return tuple(alarm["kind"] for alarm in shown["alarms"])

    return do


def _base() -> Callable[[Step], object]:
    station, now_s = BaseStation(open_base(mission_of("stand"), None, lambda: 7, made_s=1)), 100.0

    def do(step: Step) -> object:
        nonlocal now_s
        if step.kind is Kind.TICK:
            now_s += step.seconds
            assert sum(map(len, station.tick(now_s))) < 1 << 16
            station.records.lines()
        else:
            station.receive(step.data, now_s)
        return tuple(count.bit_length() for count in station.records.counters().values())

    return do


def _chart(path: Path) -> object:
    chart = open_chart(path)
    with contextlib.closing(chart):
        json.dumps(about(None, chart), allow_nan=False)
        for zoom in (chart.about.min_zoom, chart.about.max_zoom):
            chart.tile(zoom, 0, 0)
        return chart.about.max_zoom, chart.image() is None


def _picture(path: Path) -> object:
    """With a world file that is right."""
    path.with_suffix(".pgw").write_text("0.001 0 0 -0.001 8 47")
    return _chart(path)


def _world_file(path: Path) -> object:
    """Beside a picture that is right."""
    picture = path.with_suffix(".png")
    picture.write_bytes(PNG)
    for zone in (None, zone_of("32N")):
        with contextlib.closing(open_chart(picture, zone)) as chart:
            json.dumps(about(None, chart), allow_nan=False)
    return True


def _records(path: Path) -> object:
    """A damaged file is set aside."""
    store, said = open_store(path, 2, lambda: 7, is_synced=False, mission_hash=1)
    with contextlib.closing(store):
        return len(store.holdings()), bool(said)


def _key_file(path: Path) -> object:
    path.chmod(0o600)
    keyring = load_keyring(path, None)
    return keyring.owner == 0, len(keyring.secrets), len(keyring.vehicles)


def _lidar(model: str, step: int, data: bytes) -> object:
    driver = MODELS[model].make()
    count = 0
    for at in range(0, len(data), step):
        count += len(list(driver.decode(data[at : at + step])))
    return count.bit_length(), driver.bad.bit_length()


class Reader:
    """`read` takes any bytes, and raises nothing."""

    def __init__(self, read: Callable[[bytes], object]) -> None:
        self.run = read

    def draw(self, rng: Random, corpus: Sequence[bytes]) -> bytes:
        """As a datagram."""
        return change_datagram(rng, rng.choice(corpus), rng.choice(corpus))


class PlainReader(Reader):
    """Of a protocol that is not MAVLink."""

    def draw(self, rng: Random, corpus: Sequence[bytes]) -> bytes:
        """Bytes changed."""
        return change_bytes(rng, rng.choice(corpus), rng.choice(corpus))


TARGETS: Final[dict[str, Callable[[], Target]]] = {
    "open": partial(Companion, "open"),
    "stand": partial(Companion, "stand"),
    "signed": partial(Companion, "signed"),
    "frames": partial(Reader, read_frames),
    "watch": partial(Datagrams, _watch),
    "base": partial(Datagrams, _base),
    "rplidar": partial(PlainReader, partial(_lidar, "rplidar-a", 61)),
    "ld19": partial(PlainReader, partial(_lidar, "ld19", 61)),
    "mid360": partial(PlainReader, partial(_lidar, "mid360", 1400)),
    "mission": partial(Loader, ".toml", load_mission, (MissionError,)),
    "plan": partial(
        Loader,
        ".plan",
        lambda path: bool(from_plan(path.read_bytes().decode("utf-8", "replace"), "p")),
        (MissionError,),
    ),
    "stems-csv": partial(Loader, ".csv", lambda path: len(read_stems(path).stems), (MissionError,)),
    "stems-geojson": partial(Loader, ".geojson", lambda path: len(read_stems(path).stems), (MissionError,)),
    "stems-gpkg": partial(Loader, ".gpkg", lambda path: len(read_stems(path).stems), (MissionError,)),
    "mbtiles": partial(Loader, ".mbtiles", _chart, (ChartError,)),
    "picture": partial(Loader, ".png", _picture, (ChartError,)),
    "world-file": partial(Loader, ".pgw", _world_file, (ChartError,)),
    "key-file": partial(Loader, ".key", _key_file, (KeyFileError,)),
    "records": partial(Loader, ".db", _records, (StoreError,)),
}


FLIGHTS: Final = ("open", "stand", "signed")


def corpus_of(name: str) -> dict[str, bytes]:
    """The committed inputs of a target, by their names: genuine ones, and what was once a finding."""
    return {path.name: path.read_bytes() for path in sorted((CORPUS / name).glob("*"))}
