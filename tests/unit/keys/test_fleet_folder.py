"""A fleet's folder: made once, rewritten whole, and after a power cut at any write as it was or as it is to be."""

from __future__ import annotations

import fcntl
import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.keys import fleet_folder
from companion.keys.fleet_folder import change_fleet, file_name, make_fleet
from companion.keys.key_file import KeyFileError, load_keyring
from companion.keys.keyring import OPERATOR, Keyring
from companion.keys.rotation import Step, advance, revoke, step_of
from tests.unit.keys.keys_kit import key_file, operator_of, random_bytes, vehicle_of
from tests.unit.keys.power_cut_kit import cuts


def begin(operator: Keyring) -> Keyring:
    return advance(operator, os.urandom(32))


def revoke_2(operator: Keyring) -> Keyring:
    return revoke(operator, 2, os.urandom(32))


def content(folder: Path) -> dict[str, bytes]:
    return {entry.name: entry.read_bytes() for entry in folder.iterdir()}


def step_in(folder: Path) -> Step:
    return step_of(load_keyring(folder / "operator.key", OPERATOR))


def test_new_fleet_is_one_file_for_each_and_nobodys_but_the_users(tmp_path: Path):
    before = os.umask(0)
    try:
        make_fleet(tmp_path / "fleet", 3)
    finally:
        os.umask(before)
    folder = tmp_path / "fleet"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert sorted(content(folder)) == ["operator.key", "vehicle-1.key", "vehicle-2.key", "vehicle-3.key"]
    assert {stat.S_IMODE(entry.stat().st_mode) for entry in folder.iterdir()} == {0o600}
    assert [entry.name for entry in tmp_path.iterdir()] == ["fleet"]
    rings = [load_keyring(folder / file_name(owner), owner) for owner in (OPERATOR, 1, 2, 3)]
    assert len({ring.seed for ring in rings}) == 4
    assert len({(*ring.secrets.items(), ring.active, ring.operator, *ring.vehicles.items()) for ring in rings}) == 1
    make_fleet(tmp_path / "other", 3)
    other = load_keyring(tmp_path / "other" / "operator.key", OPERATOR)
    assert {other.seed, *other.secrets.values()}.isdisjoint({rings[0].seed, *rings[0].secrets.values()})


def test_files_of_a_folder_that_others_may_look_into_stay_nobodys_but_the_users(tmp_path: Path):
    make_fleet(tmp_path / "fleet", 2)
    (tmp_path / "fleet").chmod(0o755)
    before = os.umask(0)
    try:
        change_fleet(tmp_path / "fleet", begin)
    finally:
        os.umask(before)
    assert {stat.S_IMODE(entry.stat().st_mode) for entry in (tmp_path / "fleet").iterdir()} == {0o600}


@pytest.mark.parametrize("there", ["folder", "empty", "file", "link"])
def test_what_is_there_is_never_overwritten(there: str, tmp_path: Path):
    path = tmp_path / "fleet"
    if there == "folder":
        make_fleet(path, 2)
    elif there == "empty":
        path.mkdir()
    elif there == "file":
        path.write_text("mine")
    else:
        path.symlink_to(tmp_path / "nowhere")
    before = content(path) if path.is_dir() else None
    with pytest.raises(KeyFileError, match="fleet: is there already: keys are never overwritten"):
        make_fleet(path, 3)
    assert before == (content(path) if path.is_dir() else None)


def test_change_rewrites_all_files_and_a_revoked_vehicle_has_none(tmp_path: Path):
    folder = tmp_path / "fleet"
    old = make_fleet(folder, 3)
    fleet, was_interrupted = change_fleet(folder, revoke_2)
    assert not was_interrupted
    assert sorted(content(folder)) == ["operator.key", "vehicle-1.key", "vehicle-3.key"]
    for owner in (OPERATOR, 1, 3):
        ring = load_keyring(folder / file_name(owner), owner)
        assert (ring.secrets, ring.active) == (fleet.operator.secrets, old.operator.active)
        assert sorted(ring.vehicles) == [1, 3]
    assert load_keyring(folder / "vehicle-3.key", 3).seed == old.seeds[3]


def test_folder_at_which_another_command_works_is_refused(tmp_path: Path):
    folder = tmp_path / "fleet"
    make_fleet(folder, 2)
    fd = os.open(folder, os.O_RDONLY)
    fcntl.flock(fd, fcntl.LOCK_EX)
    with pytest.raises(KeyFileError, match="another `companion key` is at work there"):
        change_fleet(folder, begin)
    os.close(fd)
    change_fleet(folder, begin)


def test_files_of_another_fleet_and_missing_ones_are_refused_before_anything_is_written(tmp_path: Path):
    folder = tmp_path / "fleet"
    operator = operator_of(3)
    folder.mkdir()
    with pytest.raises(KeyFileError, match=r"operator.key: cannot be read: No such file"):
        change_fleet(folder, begin)
    with pytest.raises(KeyFileError, match="nowhere: No such file or directory"):
        change_fleet(tmp_path / "nowhere", begin)
    for ring in (operator, *(vehicle_of(operator, vehicle) for vehicle in (1, 2, 3))):
        key_file(folder / file_name(ring.owner), ring)
    make_fleet(tmp_path / "other", 4)
    for stranger in (3, 4):
        own = (folder / f"vehicle-{stranger}.key").read_bytes() if stranger == 3 else b""
        key_file(folder / file_name(stranger), load_keyring(tmp_path / "other" / f"vehicle-{stranger}.key", stranger))
        before = content(folder)
        with pytest.raises(KeyFileError, match=rf"vehicle-{stranger}.key: is of another fleet than operator.key"):
            change_fleet(folder, begin)
        assert content(folder) == before
        (folder / f"vehicle-{stranger}.key").unlink()
        if own:
            (folder / f"vehicle-{stranger}.key").write_bytes(own)
            (folder / f"vehicle-{stranger}.key").chmod(0o600)
    (folder / "vehicle-2.key").unlink()
    with pytest.raises(KeyFileError, match=r"vehicle-2.key: is missing: without vehicle 2's private key"):
        change_fleet(folder, begin)
    fleet, _ = change_fleet(folder, revoke_2, leaving=2)
    assert sorted(fleet.operator.vehicles) == [1, 3]


def test_full_disk_changes_nothing_and_leaves_no_secret_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = tmp_path / "fleet"
    make_fleet(folder, 2)
    before = content(folder)

    def write(_fd: int, _data: bytes) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr(fleet_folder.os, "write", write)
        with pytest.raises(OSError, match="No space"):
            change_fleet(folder, begin)
        with pytest.raises(OSError, match="No space"):
            make_fleet(tmp_path / "second", 2)
    assert content(folder) == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["fleet"]


def test_write_that_takes_a_part_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write = os.write
    monkeypatch.setattr(fleet_folder.os, "write", lambda fd, data: write(fd, data[:100]))
    fleet = make_fleet(tmp_path / "fleet", 2)
    assert load_keyring(tmp_path / "fleet" / "vehicle-2.key", 2) == fleet.keyring_of(2)


# --- power cuts ---


def test_power_cut_at_any_write_of_a_new_fleet_leaves_all_of_it_or_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    found = set()
    for image, is_cut in cuts(tmp_path, monkeypatch, lambda root: make_fleet(root / "fleet", 2), lambda _: None):
        folder = image / "fleet"
        is_there = folder.exists()
        assert is_there or is_cut
        found.add(is_there)
        if not is_there:
            make_fleet(folder, 2)
        assert sorted(content(folder)) == ["operator.key", "vehicle-1.key", "vehicle-2.key"]
        change_fleet(folder, begin)  # reads all, and finds one fleet
        assert step_in(folder) is Step.NEW_ACCEPTED
        assert [entry.name for entry in image.iterdir()] == ["fleet"] or is_there
    assert found == {False, True}


def fleet_at(step: Step) -> Keyring:
    """The operator's keyring of a fleet of three at this step."""
    operator = operator_of(3)
    for number in range(step.value):
        operator = advance(operator, random_bytes("fresh", number))
    return operator


@pytest.mark.parametrize(
    ("before", "after", "change"),
    [
        (Step.REST, Step.NEW_ACCEPTED, begin),
        (Step.NEW_ACCEPTED, Step.NEW_ACTIVE, begin),
        (Step.NEW_ACTIVE, Step.REST, begin),
        (Step.REST, Step.NEW_ACCEPTED, revoke_2),
        (Step.NEW_ACTIVE, Step.NEW_ACCEPTED, revoke_2),
    ],
)
def test_step_that_a_power_cut_interrupts_at_any_write_is_completed_by_the_next_run(
    before: Step,
    after: Step,
    change: Callable[[Keyring], Keyring],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    old = fleet_at(before)

    def prepare(root: Path) -> None:
        (root / "fleet").mkdir()
        for ring in (old, *(vehicle_of(old, vehicle) for vehicle in old.vehicles)):
            key_file(root / "fleet" / file_name(ring.owner), ring)

    found = set()
    for image, is_cut in cuts(tmp_path, monkeypatch, lambda root: change_fleet(root / "fleet", change), prepare):
        folder = image / "fleet"
        operator = load_keyring(folder / "operator.key", OPERATOR)
        rings = [load_keyring(path, None) for path in folder.glob("vehicle-*.key")]
        # Else the next run, which draws another secret, would lose a vehicle that was given this file
        assert all(set(ring.secrets.values()) <= {*old.secrets.values(), *operator.secrets.values()} for ring in rings)
        if operator == old:
            assert is_cut
            _, was_interrupted = change_fleet(folder, change)
            assert not was_interrupted
        else:
            fleet, was_interrupted = change_fleet(folder, lambda ring: ring)
            assert fleet.operator == operator
            assert is_cut or not was_interrupted
        found.add((operator == old, was_interrupted))
        assert step_in(folder) is after
        left = [1, 3] if change is revoke_2 else [1, 2, 3]
        assert sorted(content(folder)) == ["operator.key", *(f"vehicle-{vehicle}.key" for vehicle in left)]
        assert not change_fleet(folder, lambda ring: ring)[1]
    assert found == {(True, False), (False, True), (False, False)}
