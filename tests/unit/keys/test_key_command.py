"""`companion key`: what it says, with which exit code, and that nothing of it is secret."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from companion import cli
from companion.keys import command
from companion.keys.autopilot_link import link_key, link_passphrase
from companion.keys.fleet_folder import change_fleet, file_name
from companion.keys.key_file import load_keyring
from companion.keys.keyring import OPERATOR
from companion.keys.rotation import Step, advance, step_of
from tests.unit.keys.keys_kit import secret_texts

FINGERPRINT = re.compile(r"\b(?:[0-9a-f]{4}:){4}[0-9a-f]{4}\b")


@pytest.fixture(autouse=True)
def _tests_stay_dumpable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "harden_process", lambda: "")


@pytest.fixture
def fleet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["key", "new", "fleet", "--vehicles", "3"]) == 0
    return tmp_path / "fleet"


def said(capsys: pytest.CaptureFixture[str], folder: Path, *words: str, code: int = 0) -> str:
    """What `companion key WORDS` prints: no part of a secret that was in the folder, or is there now."""
    capsys.readouterr()
    secrets = secrets_in(folder)
    assert cli.main(["key", *words]) == code
    out, err = capsys.readouterr()
    assert not [part for part in secrets | secrets_in(folder) if part in out + err]
    assert (err == "") is (code in (0, 1))
    return out + err


def secrets_in(folder: Path) -> set[str]:
    return {part for k in folder.glob("*.key") for part in secret_texts(load_keyring(k, None, may_lack_vehicles=True))}


def step_in(folder: Path) -> Step:
    return step_of(load_keyring(folder / "operator.key", OPERATOR))


def test_new_says_what_to_do_and_refuses_what_is_there(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["key", "new", "second", "--vehicles", "3"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in ("operator.key", "vehicle-1.key", "vehicle-3.key", "next: "))
    assert not [part for part in secrets_in(fleet.with_name("second")) if part in out]
    told = said(capsys, fleet, "new", "fleet", "--vehicles", "3", code=2)
    assert told == f"companion: {fleet}: is there already: keys are never overwritten\n"


@pytest.mark.parametrize("size", ["0", "251", "-1", "x", "1e2", ""])
def test_number_of_vehicles_is_one_to_250(size: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["key", "new", "fleet", f"--vehicles={size}"])
    assert ended.value.code == 2
    assert "must be from 1 to 250" in capsys.readouterr().err


def test_show_id_shows_what_is_equal_in_all_files_and_what_is_ones_own(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = [said(capsys, fleet, "show-id", f"fleet/{file_name(owner)}") for owner in (1, 2, OPERATOR)]
    lines = [dict((line[:14].strip(), line[14:]) for line in text.splitlines()) for text in shown]
    assert [one.pop("owner") for one in lines] == ["vehicle 1", "vehicle 2", "the operator"]
    assert len({one.pop("file") for one in lines}) == 3
    assert lines[0] == lines[1] == lines[2]
    assert list(lines[0]) == ["fleet", "epoch 0", "operator", "vehicle 1", "vehicle 2", "vehicle 3"]
    assert all(FINGERPRINT.search(value) for value in lines[0].values())
    assert "active" in lines[0]["epoch 0"]


def test_rotation_goes_on_by_itself_and_says_the_step(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for step, words in (
        (Step.NEW_ACCEPTED, "step 1 of 3"),
        (Step.NEW_ACTIVE, "step 2 of 3"),
        (Step.REST, "the rotation is finished"),
    ):
        told = said(capsys, fleet, "rotate", "fleet")
        assert words in told
        assert step_in(fleet) is step
        assert ("when all have them: companion key rotate fleet" in told) is (step is not Step.REST)
        shown = said(capsys, fleet, "show-id", "fleet/vehicle-2.key")
        file = next(line.split()[1] for line in shown.splitlines() if line.startswith("file"))
        assert f"vehicle-2.key   {file}" in told  # to be compared with the board's
    assert list(load_keyring(fleet / "vehicle-1.key", 1).secrets) == [1]


def test_finish_drops_the_old_secret_at_once(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "install it on all before any flies" in said(capsys, fleet, "rotate", "fleet", "--finish")
    assert list(load_keyring(fleet / "vehicle-1.key", 1).secrets) == [1]


def test_revoked_vehicle_has_no_file_and_is_in_none(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = said(capsys, fleet, "revoke", "fleet", "2")
    assert "vehicle 2 is revoked" in told
    assert "step 1 of 3" in told
    assert sorted(path.name for path in fleet.iterdir()) == ["operator.key", "vehicle-1.key", "vehicle-3.key"]
    assert sorted(load_keyring(fleet / "vehicle-3.key", 3).vehicles) == [1, 3]
    again = said(capsys, fleet, "revoke", "fleet", "2", code=2)
    assert again == "companion: fleet: VEHICLE = 2: must be one of 1, 3\n"
    said(capsys, fleet, "revoke", "fleet", "1")
    assert "vehicle 3 is the last" in said(capsys, fleet, "revoke", "fleet", "3", code=2)


@pytest.mark.parametrize(("steps", "warns"), [(0, False), (1, False), (2, True)])
def test_a_revocation_that_gives_up_the_second_step_of_a_rotation_warns(
    steps: int, fleet: Path, capsys: pytest.CaptureFixture[str], *, warns: bool
) -> None:
    for _ in range(steps):
        said(capsys, fleet, "rotate", "fleet")
    told = said(capsys, fleet, "revoke", "fleet", "2")
    assert ("WARNING: a rotation was in its second step" in told) is warns
    assert "step 1 of 3" in told


def interrupt(folder: Path) -> None:
    """Leaves a step at which vehicle 3 has not come to its file."""
    before = (folder / "vehicle-3.key").read_bytes()
    change_fleet(folder, lambda operator: advance(operator, os.urandom(32)))
    (folder / "vehicle-3.key").write_bytes(before)


def test_interrupted_step_is_completed_and_what_was_asked_besides_is_not_done(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    interrupt(fleet)
    told = said(capsys, fleet, "rotate", "fleet")
    assert "completed what was interrupted" in told
    assert step_in(fleet) is Step.NEW_ACCEPTED
    interrupt(fleet)
    assert "vehicle 2 is NOT revoked yet" in said(capsys, fleet, "revoke", "fleet", "2", code=1)
    assert step_in(fleet) is Step.NEW_ACTIVE
    interrupt(fleet)
    assert step_in(fleet) is Step.REST
    assert "completed" in said(capsys, fleet, "rotate", "fleet", "--finish")  # it is
    interrupt(fleet)
    said(capsys, fleet, "rotate", "fleet", "--finish", code=1)
    assert step_in(fleet) is Step.NEW_ACCEPTED
    said(capsys, fleet, "rotate", "fleet", "--finish")
    assert step_in(fleet) is Step.REST


def files_in(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def put(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    path.chmod(0o600)


def lose_last_vehicle(folder: Path) -> None:
    """As `head -n -1` does."""
    put(folder / "operator.key", b"".join((folder / "operator.key").read_bytes().splitlines(keepends=True)[:-1]))


@pytest.mark.parametrize("runs", [1, 2, 3, 4, 6])
def test_older_operator_file_rolls_no_rotation_back(runs: int, fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old = [(fleet / "operator.key").read_bytes()]
    for _ in range(runs):
        said(capsys, fleet, "rotate", "fleet")
        old.append((fleet / "operator.key").read_bytes())
    for data in old[:-1]:
        put(fleet / "operator.key", data)
        before = files_in(fleet)
        for words in (("rotate", "fleet"), ("rotate", "fleet", "--finish"), ("revoke", "fleet", "2")):
            told = said(capsys, fleet, *words, code=2)
            assert told.startswith("companion: fleet/operator.key: is older than vehicle-1.key")
            assert "epoch 0" in told or runs > 3
            assert files_in(fleet) == before
    put(fleet / "operator.key", old[0])
    lose_last_vehicle(fleet)
    before = files_in(fleet)
    assert "is older than" in said(capsys, fleet, "revoke", "fleet", "3", code=2)
    assert files_in(fleet) == before
    put(fleet / "operator.key", old[-1])
    said(capsys, fleet, "rotate", "fleet")
    put(fleet / "operator.key", old[0])
    assert "epoch 0 (active) in it" in said(capsys, fleet, "rotate", "fleet", code=2)


@pytest.mark.parametrize("runs", [0, 1, 2])
def test_older_operator_file_brings_no_revoked_vehicle_back(
    runs: int, fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, lost = (fleet / "operator.key").read_bytes(), (fleet / "vehicle-2.key").read_bytes()
    said(capsys, fleet, "revoke", "fleet", "2")
    for _ in range(runs):
        said(capsys, fleet, "rotate", "fleet")
    put(fleet / "operator.key", old)
    for _ in range(2):
        before = files_in(fleet)
        for words in (("rotate", "fleet"), ("revoke", "fleet", "2"), ("revoke", "fleet", "3")):
            assert "operator.key: is older than vehicle-1.key" in said(capsys, fleet, *words, code=2)
            assert files_in(fleet) == before
        put(fleet / "vehicle-2.key", lost)  # from the same copy


def test_operator_file_of_another_copy_of_the_folder_is_refused(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = files_in(fleet)
    said(capsys, fleet, "rotate", "fleet")
    said(capsys, fleet, "rotate", "fleet")
    other = (fleet / "operator.key").read_bytes()
    for name, data in before.items():
        put(fleet / name, data)
    for _ in range(3):  # one step less than the other copy, as many, one more
        said(capsys, fleet, "rotate", "fleet")
        mine = (fleet / "operator.key").read_bytes()
        put(fleet / "operator.key", other)
        assert "or of another copy of the folder" in said(capsys, fleet, "rotate", "fleet", code=2)
        put(fleet / "operator.key", mine)


@pytest.mark.parametrize("runs", [0, 1, 2, 3])
def test_operator_file_that_lost_a_vehicle_deletes_no_key_unless_it_is_revoked_by_name(
    runs: int, fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(runs):
        said(capsys, fleet, "rotate", "fleet")
    lose_last_vehicle(fleet)
    before = files_in(fleet)
    for words in (("rotate", "fleet"), ("rotate", "fleet", "--finish"), ("revoke", "fleet", "2")):
        told = said(capsys, fleet, *words, code=2)
        assert told.startswith("companion: fleet/operator.key: vehicles.3: is missing, and vehicle-1.key has it")
        assert "companion key revoke fleet 3" in told
        assert files_in(fleet) == before
    secrets = set(load_keyring(fleet / "vehicle-3.key", 3).secrets.values())
    assert "vehicle 3 is revoked" in said(capsys, fleet, "revoke", "fleet", "3")
    assert sorted(files_in(fleet)) == ["operator.key", "vehicle-1.key", "vehicle-2.key"]
    left = load_keyring(fleet / "vehicle-1.key", 1)
    assert (sorted(left.vehicles), len(set(left.secrets.values()) - secrets)) == ([1, 2], 1)
    assert "completed" not in said(capsys, fleet, "rotate", "fleet")


@pytest.mark.parametrize("finish", [(), ("--finish",)])
def test_operator_file_that_lost_a_vehicle_after_an_interrupted_step_deletes_no_key(
    finish: tuple[str, ...], fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = files_in(fleet)
    said(capsys, fleet, "rotate", "fleet", *finish)
    put(fleet / "vehicle-3.key", before["vehicle-3.key"])
    lose_last_vehicle(fleet)
    assert "vehicles.3: is missing" in said(capsys, fleet, "rotate", "fleet", code=2)
    assert (fleet / "vehicle-3.key").read_bytes() == before["vehicle-3.key"]
    put(fleet / "vehicle-1.key", before["vehicle-1.key"])
    put(fleet / "vehicle-2.key", before["vehicle-2.key"])
    if finish:  # a revocation does not end a rotation
        assert "vehicles.3: is missing" in said(capsys, fleet, "rotate", "fleet", code=2)
        assert "vehicle 3 is revoked" in said(capsys, fleet, "revoke", "fleet", "3")
    else:  # by its files it is a revocation of vehicle 3 that was interrupted
        assert "completed" in said(capsys, fleet, "rotate", "fleet")


def test_vehicle_whose_line_and_file_are_lost_is_struck_out_by_name_alone(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lose_last_vehicle(fleet)
    (fleet / "vehicle-3.key").unlink()
    before = files_in(fleet)
    assert "vehicles.3: is missing" in said(capsys, fleet, "rotate", "fleet", code=2)
    assert files_in(fleet) == before
    assert "vehicle 3 is revoked" in said(capsys, fleet, "revoke", "fleet", "3")


def test_interrupted_revocation_is_completed_by_either_command(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = files_in(fleet)
    for words in (("rotate", "fleet"), ("revoke", "fleet", "2")):
        said(capsys, fleet, "revoke", "fleet", "2")
        after = files_in(fleet)
        for name in ("vehicle-2.key", "vehicle-3.key"):
            put(fleet / name, before[name])
        said(capsys, fleet, *words)
        assert files_in(fleet) == after
        for name, data in before.items():
            put(fleet / name, data)


def test_vehicles_file_from_long_ago_is_written_anew(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old = (fleet / "vehicle-1.key").read_bytes()
    said(capsys, fleet, "revoke", "fleet", "2")
    for _ in range(4):
        said(capsys, fleet, "rotate", "fleet")
    now = files_in(fleet)
    put(fleet / "vehicle-1.key", old)
    assert "completed" in said(capsys, fleet, "rotate", "fleet")
    assert files_in(fleet) == now


@pytest.mark.parametrize("data", [b"", b"# SECRET: who", b"format = ", b"\xff\xff", b"\0" * 400])
def test_damaged_file_of_a_vehicle_that_is_revoked_is_deleted(
    data: bytes, fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet / "vehicle-2.key", data)
    for words in (("rotate", "fleet"), ("revoke", "fleet", "3")):
        assert cli.main(["key", *words]) == 2
        told = capsys.readouterr().err
        assert told.startswith("companion: fleet/vehicle-2.key: ")
        assert "take vehicle 2 out of the fleet: companion key revoke fleet 2" in told
    assert cli.main(["key", "revoke", "fleet", "2"]) == 0
    assert "vehicle 2 is revoked" in capsys.readouterr().out
    assert sorted(files_in(fleet)) == ["operator.key", "vehicle-1.key", "vehicle-3.key"]
    put(fleet / "vehicle-2.key", data)  # all but its end was done
    assert cli.main(["key", "revoke", "fleet", "2"]) == 0
    assert sorted(files_in(fleet)) == ["operator.key", "vehicle-1.key", "vehicle-3.key"]
    assert "step 2 of 3" in said(capsys, fleet, "rotate", "fleet")


def test_folder_that_is_none_and_a_file_that_is_refused_are_exit_code_2(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "nowhere: No such file or directory" in said(capsys, fleet, "rotate", "nowhere", code=2)
    (fleet / "vehicle-1.key").chmod(0o644)
    for words in (("show-id", "fleet/vehicle-1.key"), ("rotate", "fleet")):
        assert cli.main(["key", *words]) == 2
        assert capsys.readouterr().err.endswith("fleet/vehicle-1.key: mode 0644: must be 0600 or less (chmod 600)\n")


def test_disk_that_is_full_is_exit_code_3(
    fleet: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(_fd: int, _data: bytes) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr("companion.keys.fleet_folder.os.write", write)
        told = said(capsys, fleet, "rotate", "fleet", code=3)
    assert told == "companion: fleet: No space left on device\n"
    assert step_in(fleet) is Step.REST


def test_program_cannot_be_dumped_while_it_holds_keys(tmp_path: Path) -> None:
    program = (
        "import ctypes, resource, sys\nfrom companion import cli\n"
        "code = cli.main(['key', 'new', 'fleet', '--vehicles', '2'])\n"
        "print(code, resource.getrlimit(resource.RLIMIT_CORE)[0], ctypes.CDLL(None).prctl(3, 0, 0, 0, 0))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout.splitlines()[-1] == "0 0 0"


def test_passphrase_of_an_autopilots_link_goes_to_a_file_alone(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "autopilot-3.passphrase"
    told = said(capsys, fleet, "autopilot", "fleet/vehicle-3.key", "--out", str(out))
    phrase = out.read_text().strip()
    keyring = load_keyring(fleet / "vehicle-3.key", 3)
    assert re.fullmatch("[A-Z2-7]{32}", phrase)
    assert phrase not in told
    assert out.stat().st_mode & 0o777 == 0o600
    assert link_key(keyring) == hashlib.sha256(phrase.encode()).digest()  # as ground stations make it
    assert not [part for part in secret_texts(keyring) if part in phrase + link_key(keyring).hex()]
    assert link_passphrase(load_keyring(fleet / "vehicle-2.key", 2)) != phrase
    assert "must be a vehicle" in said(capsys, fleet, "autopilot", "fleet/operator.key", "--out", str(out), code=2)
    assert out.read_text().strip() == phrase


def test_passphrase_outlives_a_rotation_of_the_swarms_secret(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = link_passphrase(load_keyring(fleet / "vehicle-3.key", 3))
    said(capsys, fleet, "rotate", "fleet", "--finish")
    assert link_passphrase(load_keyring(fleet / "vehicle-3.key", 3)) == before


def test_passphrase_overwrites_no_file(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (fleet / "vehicle-3.key").read_bytes()
    told = said(capsys, fleet, "autopilot", "fleet/vehicle-3.key", "--out", "fleet/vehicle-3.key", code=2)
    assert told == "companion: fleet/vehicle-3.key: is there already: it is never overwritten\n"
    assert (fleet / "vehicle-3.key").read_bytes() == before


@pytest.mark.parametrize("how", [[], ["-u"]])  # -u: each line is written at once
def test_a_reader_that_leaves_early_costs_no_key(how: list[str], fleet: Path) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    process = [sys.executable, *how, "-m", "companion", "key", "revoke", "fleet", "3"]
    try:
        done = subprocess.run(process, stdout=theirs, stderr=subprocess.PIPE, text=True, check=False)
    finally:
        os.close(theirs)
    assert (done.returncode, done.stderr) == (3, "")
    assert not (fleet / file_name(3)).exists()
    _, was_interrupted = change_fleet(fleet, lambda operator: operator)
    assert not was_interrupted
