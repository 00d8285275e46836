"""A recording comes back from its folder to the bit, or with an error that names the file."""

from __future__ import annotations

import argparse
import dataclasses
import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.judge import run_folder
from sim_bridge.judge.recording import Recorder, Recording
from sim_bridge.judge.run_folder import FILE_NAME, RunFolderError, load, save
from sim_bridge.lab import report


def a_recording(ticks: int = 5, n: int = 3) -> Recording:
    rng = np.random.default_rng(1)
    shape = (ticks, n)
    return Recording(
        time_s=np.arange(ticks, dtype=np.float64) * 0.05,
        pos_ned_m=rng.normal(size=(*shape, 3)),
        vel_ned_mps=rng.normal(size=(*shape, 3)),
        on_ground=rng.random(shape) < 0.5,
        armed=rng.random(shape) < 0.5,
        agent_alive=rng.random(shape) < 0.5,
        touched=rng.integers(0, 4, shape).astype(np.int8),
        range_m=rng.random(shape),
        phase=rng.integers(-1, 6, shape).astype(np.int8),
        acting=rng.random(shape) < 0.5,
        leader=rng.integers(0, n + 1, shape).astype(np.int16),
    )


def arrays(recording: Recording) -> dict[str, Any]:
    return {field.name: getattr(recording, field.name) for field in dataclasses.fields(recording)}


def test_a_recording_comes_back_to_the_bit(tmp_path: Path) -> None:
    saved = a_recording()
    assert save(saved, tmp_path) == tmp_path / "recording.npz"
    loaded = load(tmp_path)
    for name, array in arrays(saved).items():
        np.testing.assert_array_equal(getattr(loaded, name), array, strict=True)


def test_the_same_recording_makes_the_same_file(tmp_path: Path) -> None:
    first = save(a_recording(), tmp_path).read_bytes()
    assert save(a_recording(), tmp_path).read_bytes() == first


def test_a_recording_without_a_tick_comes_back(tmp_path: Path) -> None:
    save(Recorder().recording(), tmp_path)
    assert load(tmp_path).time_s.shape == (0,)


def test_no_recording_in_the_folder(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "absent"):
        with pytest.raises(RunFolderError, match=r"recording\.npz: no such file"):
            load(folder)


@pytest.mark.parametrize("content", [b"", b"PK", b"no archive", b"\x93NUMPY\x01\x00"])
def test_a_file_of_something_else(tmp_path: Path, content: bytes) -> None:
    (tmp_path / FILE_NAME).write_bytes(content)
    with pytest.raises(RunFolderError, match=r"recording\.npz: must be the recording of a flight"):
        load(tmp_path)


def test_damage_anywhere_is_refused_or_harmless(tmp_path: Path) -> None:
    path = save(a_recording(ticks=2, n=1), tmp_path)
    whole = path.read_bytes()
    messages = []
    for place in range(0, len(whole), 7):
        for damaged in (whole[:place], whole[:place] + bytes([whole[place] ^ 0x41]) + whole[place + 1 :]):
            path.write_bytes(damaged)
            try:
                load(tmp_path)
            except RunFolderError as error:
                messages.append(str(error))
    assert len(messages) > 100
    assert all(str(path) in message for message in messages)


def test_a_column_is_missing(tmp_path: Path) -> None:
    rest = {name: array for name, array in arrays(a_recording()).items() if name not in ("acting", "leader")}
    np.savez_compressed(tmp_path / FILE_NAME, **rest)
    with pytest.raises(RunFolderError, match=r"recording\.npz.*has no acting, leader"):
        load(tmp_path)


def test_a_recording_from_before_contacts_were_kept_has_none(tmp_path: Path) -> None:
    rest = {name: array for name, array in arrays(a_recording()).items() if name != "touched"}
    np.savez_compressed(tmp_path / FILE_NAME, **rest)
    assert not load(tmp_path).touched.any()


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("phase", np.zeros((5, 3)), "phase is float64: must be int8"),
        ("acting", np.zeros((5, 2), dtype=np.bool_), "acting has the shape"),
        ("pos_ned_m", np.zeros((5, 3, 2)), "pos_ned_m has the shape"),
        ("time_s", np.zeros((5, 1)), "time_s has the shape"),
        ("time_s", np.zeros(0), "has the shape"),
        ("on_ground", np.array(True), "has the shape"),
        ("phase", np.full((5, 3), 6, dtype=np.int8), "phase has 6 to 6: must be -1 to 5"),
        ("touched", np.full((5, 3), 6, dtype=np.int8), "touched has 6 to 6: must be 0 to 5"),
        ("leader", np.full((5, 3), 4, dtype=np.int16), "leader has 4 to 4: must be 0 to 3"),
        ("leader", np.full((5, 3), -1, dtype=np.int16), "leader has -1 to -1: must be 0 to 3"),
        ("time_s", np.array([0.0, 1.0, 2.0, 1.5, 3.0]), "time_s runs backwards"),
        ("time_s", np.array([0.0, 1.0, np.nan, 2.0, 3.0]), "time_s has a value that is not finite"),
        ("pos_ned_m", np.full((5, 3, 3), np.nan), "pos_ned_m has a value that is not finite"),
        ("pos_ned_m", np.full((5, 3, 3), 1e300), "pos_ned_m has a value that is not finite, or beyond"),
        ("vel_ned_mps", np.full((5, 3, 3), -np.inf), "vel_ned_mps has a value that is not finite"),
        ("range_m", np.full((5, 3), -5.0), "range_m has -5: must be at least 0"),
        ("range_m", np.full((5, 3), np.inf), "range_m has a value that is not finite"),
        ("leader", np.array(["pickle", None], dtype=object), "Object arrays cannot be loaded"),
    ],
)
def test_a_column_of_another_kind(tmp_path: Path, name: str, array: np.ndarray[Any, Any], message: str) -> None:
    np.savez_compressed(tmp_path / FILE_NAME, **{**arrays(a_recording()), name: array})
    with pytest.raises(RunFolderError, match=message) as caught:
        load(tmp_path)
    assert str(tmp_path / FILE_NAME) in str(caught.value)


def npz(path: Path, values: dict[str, np.ndarray[Any, Any]], compression: int) -> None:
    """As numpy writes it, compressed as told."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, array in values.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array)


@pytest.mark.parametrize("compression", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_an_archive_that_unpacks_without_bound_is_refused_unread(tmp_path: Path, compression: int) -> None:
    npz(tmp_path / FILE_NAME, arrays(a_recording()), compression)
    with pytest.raises(RunFolderError, match=r"recording\.npz.*must be deflated"):
        load(tmp_path)


def test_an_archive_larger_than_any_flight_is_refused_unread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(a_recording(ticks=3000), tmp_path)
    assert len(load(tmp_path).time_s) == 3000
    monkeypatch.setattr(run_folder, "BYTES_MAX", 2**18)
    with pytest.raises(RunFolderError, match=r"recording\.npz.*unpacks to 1 MiB: must be at most 0 MiB"):
        load(tmp_path)


def test_a_header_that_promises_more_than_any_memory_is_refused(tmp_path: Path) -> None:
    header = io.BytesIO()
    promised = {"descr": "<f8", "fortran_order": False, "shape": (2**58,)}
    np.lib.format.write_array_header_1_0(header, promised)
    path = save(a_recording(), tmp_path)
    with zipfile.ZipFile(path) as whole:
        members = {name: whole.read(name) for name in whole.namelist()}
    with zipfile.ZipFile(path, "w") as forged:
        for name, data in members.items():
            forged.writestr(name, header.getvalue() if name == "time_s.npy" else data)
    with pytest.raises(RunFolderError, match=r"recording\.npz: must be the recording of a flight"):
        load(tmp_path)


def test_a_report_of_another_missions_recording_is_refused(tmp_path: Path) -> None:
    route = {"d1_enu_m": (0.0, 0.0, 8.0), "d2_enu_m": (90.0, 0.0, 8.0), "vel_leader_mps": 2.0}
    mission = Mission.model_validate({"schema": 1, "route": route})
    save(a_recording(), tmp_path)
    (tmp_path / "mission.toml").write_text(dump_mission(mission))
    args = argparse.Namespace(folder=tmp_path, json=True, against=None)
    with pytest.raises(RunFolderError, match=r"mission\.toml: swarm\.size = 8: must be 3, as many vehicles as"):
        report.run(args)
