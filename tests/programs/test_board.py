"""What goes onto a board: the unit, the installer up to where it would change a computer, the archive."""

from __future__ import annotations

import hashlib
import importlib.util
import io
import os
import re
import shlex
import shutil
import stat
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

from companion.cli import build_parser
from companion.keys.key_file import KeyFileError, load_keyring, parse_keyring
from companion.keys.keyring import Keyring
from companion.preflight.computer import BOOT_ID_NAME
from tests.unit.keys.keys_kit import key_file, operator_of, vehicle_of

ROOT = Path(__file__).parents[2]
BOARD = ROOT / "companion" / "board"
UNIT = "understory-companion.service"
INSTALLER = BOARD / "install.sh"
SYSTEM_UNITS = Path("/usr/lib/systemd/system")
EXPOSURE_MAX = 20  # of 100: systemd-analyze calls up to 20 OK


@pytest.fixture(scope="module")
def bundle() -> ModuleType:
    spec = importlib.util.spec_from_file_location("board_bundle", BOARD / "bundle.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def environment() -> dict[str, str]:
    lines = (BOARD / "companion.env").read_text().splitlines()
    return dict(line.split("=", 1) for line in lines if line and not line.startswith("#"))


def directive(name: str) -> str:
    text = (BOARD / UNIT).read_text().replace("\\\n", " ")
    (value,) = re.findall(rf"^{name}=(.*)$", text, re.MULTILINE)
    assert isinstance(value, str)
    return value


# --- the unit ---


def verified(root: Path, text: str) -> str:
    """What systemd-analyze has to say about the unit as installed under `root`."""
    if shutil.which("systemd-analyze") is None or not SYSTEM_UNITS.is_dir():
        pytest.skip("no systemd-analyze on this computer")
    shutil.copytree(SYSTEM_UNITS, root / "usr/lib/systemd/system", symlinks=True)
    for folder in ("etc/systemd/system", "opt/understory/current/bin"):
        (root / folder).mkdir(parents=True)
    program = root / "opt/understory/current/bin/companion"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    (root / "etc/systemd/system" / UNIT).write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", f"--root={root}", UNIT], capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr + ("" if done.returncode == 0 else f"exit code {done.returncode}")


def test_systemd_has_nothing_to_say_about_the_unit(tmp_path: Path) -> None:
    assert verified(tmp_path, (BOARD / UNIT).read_text()) == ""


def test_systemd_would_notice_a_wrong_word(tmp_path: Path) -> None:
    assert "alwys" in verified(tmp_path, (BOARD / UNIT).read_text().replace("Restart=always", "Restart=alwys"))


def test_the_service_is_as_exposed_as_the_guide_says() -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("no systemd-analyze on this computer")
    command = ["systemd-analyze", "security", "--offline=true", f"--threshold={EXPOSURE_MAX}", str(BOARD / UNIT)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-200:]


def test_the_unit_starts_what_the_program_understands() -> None:
    values = {**environment(), "UNDERSTORY_ID": "3", "CREDENTIALS_DIRECTORY": "/run/credentials"}
    command = re.sub(r"\$\{?(\w+)\}?", lambda match: values[match[1]], directive("ExecStart"))
    program, *arguments = shlex.split(command)
    assert program == "/opt/understory/current/bin/companion"
    parsed = build_parser().parse_args(arguments)
    assert (parsed.id, parsed.clock) == (3, "monotonic")


def test_the_service_is_given_the_key_that_the_installer_places() -> None:
    name, _, path = directive("LoadCredential").partition(":")
    assert f"KEY=$CONFIG/{Path(path).name}" in INSTALLER.read_text()
    assert path.startswith("/etc/understory/")
    stand_in, _, text = directive("SetCredential").partition(":")
    assert stand_in == name
    with pytest.raises(KeyFileError, match="no key is installed"):
        parse_keyring(text, path)


def test_the_child_that_fuses_the_stand_may_give_way_and_go_without_the_companion() -> None:
    """It inherits the companion's priority and OOM score: else it would fuse before all else on the board."""
    lines = (BOARD / UNIT).read_text().splitlines()
    assert lines.index("SystemCallFilter=setpriority") > lines.index("SystemCallFilter=~@privileged @resources")
    assert directive("OOMPolicy") == "continue"
    assert int(directive("MemoryMax").removesuffix("M")) >= 128 + 240


def test_the_service_is_told_the_boot_whose_name_it_cannot_read() -> None:
    assert directive("ProcSubset") == "pid"
    assert directive("Environment") == f"{BOOT_ID_NAME}=%b"


def test_memory_of_the_service_goes_to_no_disk() -> None:
    """It holds the keys."""
    assert directive("LimitCORE") == "0"
    assert directive("MemorySwapMax") == "0"


def test_the_service_comes_back_and_is_watched() -> None:
    assert directive("Type") == "notify"
    assert directive("Restart") == "always"
    assert directive("StartLimitIntervalSec") == "0"
    assert float(directive("RestartSec")) <= 0.5
    assert 500 <= int(directive("WatchdogSec").removesuffix("ms")) <= 2000


# --- the installer ---


def run_installer(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["sh", str(folder / "install.sh"), *options], capture_output=True, text=True, check=False, timeout=60
    )


@pytest.fixture
def unpacked(bundle: ModuleType, tmp_path: Path) -> Path:
    """A bundle without wheels: good for what comes before any change."""
    files = {name: (BOARD / name).read_bytes() for name in bundle.FILES}
    with tarfile.open(fileobj=io.BytesIO(bundle.archive("b", files))) as tar:
        for member in tar:  # extractall's filters came with Python 3.11.4
            data = tar.extractfile(member)
            assert data is not None
            file = tmp_path / member.name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data.read())
    return tmp_path / "b"


def replace_key(folder: Path, keyring: Keyring | None) -> subprocess.CompletedProcess[str]:
    """`understory-install --replace-key` of this keyring, on a board that is vehicle 2's and lies in `folder`."""
    board = {"PREFIX": folder / "opt", "CONFIG": folder / "etc", "USER_NAME": "root"}
    text = INSTALLER.read_text().replace("[ -d /run/systemd/system ]", "false")
    for name, value in board.items():
        text = re.sub(rf"^{name}=.*$", f"{name}={value}", text, flags=re.MULTILINE)
    program = folder / "opt" / "current" / "bin" / "companion"
    if not program.exists():
        program.parent.mkdir(parents=True)
        program.write_text(f'#!/bin/sh\nexec {sys.executable} -m companion "$@"\n')
        program.chmod(0o755)
        (folder / "etc").mkdir()
        (folder / "etc" / "companion.env").write_text("# \nUNDERSTORY_ID=2\n")
    (folder / "install.sh").write_text(text)
    given = key_file(folder / "given", keyring or operator_of(), 0o644)  # as scp leaves it
    if keyring is None:
        given.write_bytes(bytes(range(32)))
    return run_installer(folder, "--replace-key", str(given))


@pytest.mark.skipif(os.getuid() != 0, reason="the installer asks for root first")
class TestInstaller:
    def test_a_folder_that_is_no_bundle_is_refused(self, tmp_path: Path) -> None:
        shutil.copy(INSTALLER, tmp_path)
        done = run_installer(tmp_path)
        assert done.returncode == 2
        assert "no bundle" in done.stderr

    def test_a_damaged_bundle_is_refused(self, unpacked: Path) -> None:
        (unpacked / "companion.env").write_text("x")
        done = run_installer(unpacked)
        assert done.returncode == 2
        assert "companion.env" in done.stdout
        assert "damaged" in done.stderr

    def test_a_python_that_is_not_there_is_named(self, unpacked: Path) -> None:
        done = run_installer(unpacked, "--python", "python9")
        assert (done.returncode, "python9: not found" in done.stderr) == (3, True)

    def test_a_python_without_wheels_is_refused(self, unpacked: Path, tmp_path: Path) -> None:
        old = tmp_path / "python3.10"
        claim = "import sys; sys.version_info = (3, 10, 0, 'final', 0); exec(sys.stdin.read())"
        old.write_text(f"#!/bin/sh\nexec {sys.executable} -c {shlex.quote(claim)}\n")
        old.chmod(0o755)
        done = run_installer(unpacked, "--python", str(old))
        assert done.returncode == 3
        assert "the bundle has wheels for 3.11" in done.stderr

    def test_a_key_that_cannot_be_read_is_named_before_anything_is_made(self, unpacked: Path) -> None:
        done = run_installer(unpacked, "--key", "/nowhere/key", "--python", sys.executable)
        assert (done.returncode, "/nowhere/key" in done.stderr) == (2, True)

    def test_a_key_replaces_the_one_that_is_there_if_it_is_this_vehicles(self, tmp_path: Path) -> None:
        key = tmp_path / "etc" / "vehicle.key"
        done = replace_key(tmp_path, vehicle_of(operator_of(), 2))
        assert (done.returncode, done.stdout) == (
            0,
            f"understory: made {key}, of vehicle 2\n"
            "understory: no systemd is running here: the unit is in /etc/systemd/system, nothing was started\n",
        )
        assert load_keyring(key, 2) == vehicle_of(operator_of(), 2)
        assert stat.S_IMODE(key.stat().st_mode) == 0o600
        before = key.read_bytes()
        for wrong, message in (
            (vehicle_of(operator_of(), 3), "is the key file of vehicle 3, and this is vehicle 2"),
            (operator_of(), "is the key file of the operator, and this is vehicle 2"),
            (None, "no key file, see above"),
        ):
            done = replace_key(tmp_path, wrong)
            assert (done.returncode, message in done.stderr) == (2, True)
            assert [path.name for path in key.parent.glob("vehicle.key*")] == ["vehicle.key"]
            assert key.read_bytes() == before
        (key.parent / "companion.env").write_text("UNDERSTORY_ID=\n")
        assert replace_key(tmp_path, vehicle_of(operator_of(), 3)).returncode == 0
        assert "the operator, and this is vehicle 1 to 250" in replace_key(tmp_path, operator_of()).stderr

    @pytest.mark.parametrize(
        "lines", ['UNDERSTORY_ID="3"', "UNDERSTORY_ID='3' ", " UNDERSTORY_ID = 3\r", "UNDERSTORY_ID=2\nUNDERSTORY_ID=3"]
    )
    def test_the_vehicles_number_is_what_systemd_reads(self, tmp_path: Path, lines: str) -> None:
        assert replace_key(tmp_path, vehicle_of(operator_of(), 2)).returncode == 0
        (tmp_path / "etc" / "companion.env").write_text(f"#UNDERSTORY_ID=4\n{lines}\nUNDERSTORY_PEERS=\n")
        assert replace_key(tmp_path, vehicle_of(operator_of(), 3)).returncode == 0
        assert "and this is vehicle 3" in replace_key(tmp_path, vehicle_of(operator_of(), 2)).stderr

    @pytest.mark.parametrize("options", [["--sideways"], ["--key"], ["--replace-key"]])
    def test_wrong_usage(self, options: list[str]) -> None:
        assert run_installer(BOARD, *options).returncode == 2


def test_the_installer_explains_itself() -> None:
    done = run_installer(BOARD, "--help")
    assert (done.returncode, "--rollback" in done.stdout) == (0, True)


def test_the_installer_has_the_pythons_of_the_bundle(bundle: ModuleType) -> None:
    assert bundle.PYTHONS == ("3.11", "3.12", "3.13")
    assert "(3, 11) <= sys.version_info[:2] <= (3, 13)" in INSTALLER.read_text()


def test_shellcheck_has_nothing_to_say() -> None:
    if shutil.which("shellcheck") is None:
        pytest.skip("no shellcheck on this computer")
    done = subprocess.run(["shellcheck", str(INSTALLER)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


# --- the archive ---


def test_the_archive_is_a_function_of_its_files(bundle: ModuleType) -> None:
    files = {"b.sh": b"two", "a": b"one"}
    first = bundle.archive("stem", files)
    assert first == bundle.archive("stem", dict(sorted(files.items())))
    with tarfile.open(fileobj=io.BytesIO(first)) as tar:
        entries = {entry.name: (entry.mode, entry.mtime, entry.uid, entry.uname) for entry in tar}
        sums = tar.extractfile("stem/SHA256SUMS")
        assert sums is not None
        assert sums.read().decode() == "".join(
            f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in sorted(files.items())
        )
    assert entries == {
        "stem/SHA256SUMS": (0o644, bundle.EPOCH, 0, "root"),
        "stem/a": (0o644, bundle.EPOCH, 0, "root"),
        "stem/b.sh": (0o755, bundle.EPOCH, 0, "root"),
    }


def test_a_lock_with_a_bad_condition_is_refused(bundle: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(bundle.BundleError, match=r"(?s)a==1: .*snake_version") as caught:
        bundle.downloaded("a==1 ; snake_version < '3.12' \\\n    --hash=sha256:0\n", tmp_path)
    assert caught.value.exit_code == 2
    assert list(tmp_path.iterdir()) == []


def test_each_target_has_its_own_part_of_the_lock(bundle: ModuleType) -> None:
    """Conditions are those of the target, not of the Python that makes the bundle."""
    lock = (
        "# made\na==1 ; python_full_version < '3.12' \\\n    --hash=sha256:0\n    # via b\n"
        "a==2 ; python_full_version >= '3.12' \\\n    --hash=sha256:1\nb==3 \\\n    --hash=sha256:2\n"
        "c==4 ; platform_machine == 'aarch64' \\\n    --hash=sha256:3\n"
    )
    old, new = (bundle.lock_of(lock, python, "x86_64") for python in ("3.11", "3.13"))
    assert old == "# made\na==1  \\\n    --hash=sha256:0\n    # via b\nb==3 \\\n    --hash=sha256:2\n"
    assert new == "# made\na==2  \\\n    --hash=sha256:1\nb==3 \\\n    --hash=sha256:2\n"
    assert "c==4" in bundle.lock_of(lock, "3.12", "aarch64")


def test_every_target_gets_one_of_each_package_of_the_lock(bundle: ModuleType) -> None:
    lock = bundle.LOCK.read_text()
    for python in bundle.PYTHONS:
        names = re.findall(r"^([\w-]+)==", bundle.lock_of(lock, python, "aarch64"), re.MULTILINE)
        assert len(names) == len(set(names))
        assert set(names) == set(re.findall(r"^([\w-]+)==", lock, re.MULTILINE))


def test_the_boards_lock_is_of_the_board_alone(bundle: ModuleType) -> None:
    names = set(re.findall(r"^([\w-]+)==", bundle.LOCK.read_text(), re.MULTILINE))
    assert {"pydantic", "pymavlink", "pyserial", "fastcrc", "pip"} <= names
    assert {"numpy", "scipy"} <= names  # of a flight that surveys
    assert not names & {"jsbsim", "matplotlib", "rich"}


def test_the_own_wheel_is_the_same_each_time_whatever_the_umask(bundle: ModuleType, tmp_path: Path) -> None:
    made = []
    for name, umask in (("a", 0o022), ("b", 0o077)):
        (tmp_path / name).mkdir()
        before = os.umask(umask)
        try:
            made.append(bundle.own_wheel(tmp_path / name, "9.8.7"))
        finally:
            os.umask(before)
    assert made[0].read_bytes() == made[1].read_bytes()
    assert made[0].name == "understory_uav-9.8.7-py3-none-any.whl"  # install.sh takes it by this name
    assert "wheels/understory_uav-*-none-any.whl" in INSTALLER.read_text()
    with zipfile.ZipFile(made[0]) as wheel:
        names = set(wheel.namelist())
        metadata = wheel.read("understory_uav-9.8.7.dist-info/METADATA").decode()
        assert b'__version__ = "9.8.7"' in wheel.read("mission/__init__.py")
    assert {f"{package}/py.typed" for package in ("mission", "companion", "sim_bridge")} <= names
    assert "understory_uav-9.8.7.dist-info/licenses/LICENSE" in names
    assert "\nLicense-Expression: Apache-2.0\n" in metadata


# --- pip ---


def test_a_bundle_under_way_gives_signs_of_life(
    bundle: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bundle, "SILENT_MAX_S", 0.01)
    bundle._pip("--version")
    assert "pip --version: 0 s\n" in capsys.readouterr().out


def test_a_bundle_that_pip_refuses_says_what_was_asked_of_it(bundle: ModuleType) -> None:
    with pytest.raises(bundle.BundleError, match="pip no-such-command: exit code 1, see above"):
        bundle._pip("no-such-command")
