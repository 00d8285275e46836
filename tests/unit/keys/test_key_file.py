"""Key files: what is written is read again, and what is wrong with one is said, without a word of its secrets."""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from companion.keys import key_file as module
from companion.keys.fingerprints import file_fingerprint
from companion.keys.key_file import (
    BYTES_MAX,
    KeyFileError,
    fingerprinted_text,
    load_keyring,
    parse_keyring,
    render_keyring,
)
from companion.keys.keyring import OPERATOR
from tests.unit.keys.keys_kit import key_file, operator_of, random_bytes, secret_texts, vehicle_of

FLEET = operator_of(epochs=(255, 0))
KEYRING = vehicle_of(FLEET, 2)
TEXT = render_keyring(KEYRING)
SECRET = KEYRING.secrets[0].hex()


@pytest.mark.parametrize("keyring", [FLEET, KEYRING, operator_of(250)])
def test_keyring_that_is_written_is_read_again(keyring, tmp_path: Path):
    assert load_keyring(key_file(tmp_path / "key", keyring), keyring.owner) == keyring
    assert parse_keyring(render_keyring(keyring), "x") == keyring
    assert len(render_keyring(keyring)) < BYTES_MAX


def test_operators_file_holds_no_private_key_of_a_vehicle():
    text = render_keyring(FLEET)
    assert not any(random_bytes("seed", vehicle).hex() in text for vehicle in FLEET.vehicles)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.replace("format = 1", "format = 2"), "key: format = 2: must be 1"),
        (lambda t: t.replace("format = 1", "format = true"), "key: format = true: must be 1"),
        (lambda t: t.replace("format = 1\n", ""), "key: format: is missing"),
        (lambda _: "", "key: is empty: no key is installed"),
        (lambda _: "# none", "key: is empty: no key is installed"),  # the unit's, where there is no file
        (lambda t: t[:1], "key: has no key in it, only a comment (1 bytes): it may have been cut off"),
        (lambda t: t[:40], "key: has no key in it, only a comment (40 bytes): it may have been cut off"),
        (lambda t: "colour = 1\n" + t, "key: colour: no such key: must be one of format, owner, "),
        (lambda t: f'"{SECRET}" = 1\n' + t, "key: (a name of 64 characters): no such key"),
        (lambda t: t.replace("owner = 2", "owner = 251"), "key: owner = 251: must be a vehicle's id, 1 to 250, or "),
        (lambda t: t.replace("owner = 2", 'owner = "pilot"'), 'key: owner = "pilot": must be'),
        (lambda t: t.replace("owner = 2", f'owner = "{SECRET}"'), "key: owner = (a text of 64 characters): must be"),
        (lambda t: t.replace("owner = 2", "owner = 4"), "key: vehicles.4: is missing, and the file is vehicle 4's"),
        (lambda t: t.replace("owner = 2", "owner = 3"), "key: vehicles.3: is not the public key of seed"),
        (
            lambda t: t.replace("owner = 2", 'owner = "operator"'),
            "key: operator: is not the public key of seed: the file is the operator's, with another's private key",
        ),
        (lambda t: t.replace("active = 255", "active = 7"), "key: active = 7: must be an epoch of secrets, 0 or 255"),
        (lambda t: t.replace("active = 255", "active = [0]"), "key: active = (list): must be an epoch"),
        (lambda t: t.replace("active = 255", f"active = {10**40}"), "key: active = (int): must be an epoch"),
        (lambda t: t.replace("active = 255", "active = false"), "key: active = false: must be an epoch"),
        (
            lambda t: t.replace(SECRET, SECRET[:-1]),
            "key: secrets.0: is a text of 63 characters: must be 64 hexadecimal digits, in lower case",
        ),
        (lambda t: t.replace(SECRET, SECRET[:-1] + "G"), "key: secrets.0: is a text of 64 characters"),
        (lambda t: t.replace(f'"{SECRET}"', "12"), "key: secrets.0: is no text"),
        (lambda t: t.replace(SECRET, "00" * 32), "key: secrets.0: is not random"),
        (lambda t: t.replace(KEYRING.seed.hex(), "ab" * 32), "key: seed: is not random"),
        (lambda t: t.replace("255 = ", "256 = "), "key: secrets.256: must be 0 to 255"),
        (lambda t: t.replace("255 = ", '"-1" = '), "key: secrets.-1: must be a number, 0 to 255"),
        (lambda t: t.replace("255 = ", "1.255 = "), "key: secrets.1: is no text"),
        (lambda t: t.replace("255 = ", '"٣" = '), "must be a number, 0 to 255"),
        (
            lambda t: t.replace("\n[vehicles]", f'7 = "{random_bytes(7).hex()}"\n[vehicles]'),
            "key: secrets: 3 epochs: must be at most 2",
        ),
        (
            lambda t: t.replace(SECRET, KEYRING.secrets[255].hex()),
            "key: secrets: epochs 0 or 255 have the same secret: must be different",
        ),
        (
            lambda t: t.replace(KEYRING.vehicles[3].hex(), KEYRING.vehicles[1].hex()),
            "key: vehicles.1 and vehicles.3 are the same key: must be different",
        ),
        (
            lambda t: t.replace(KEYRING.vehicles[3].hex(), KEYRING.operator.hex()),
            "key: operator and vehicles.3 are the same key: must be different",
        ),
        (lambda t: t.replace("3 = ", "0 = "), "key: vehicles.0: must be 1 to 250"),
        (lambda t: t.partition("\n[vehicles]")[0] + "\nvehicles = 1", "key: vehicles: is missing"),
        (
            lambda t: "vehicles = 1\n" + t.partition("\n[vehicles]")[0],
            "key: vehicles: must be a table with something in",
        ),
        (lambda t: t.partition("\n[vehicles]")[0] + "\n[vehicles]", "key: vehicles: must be a table with something in"),
        (lambda t: t.replace(f'"{SECRET}"', f"{SECRET}"), "key: is not TOML"),
        (lambda t: t.replace(f'"{SECRET}"', f'"{SECRET}'), "key: is not TOML (at line "),
        (lambda t: t + "x = " + "[" * 5000, "key: is nested too deep"),
        (lambda t: t + "x = " + "9" * 5000, "key: is not TOML"),
    ],
)
def test_text_that_is_wrong_is_refused_and_the_message_says_where(change: Callable[[str], str], message: str):
    text = change(TEXT)
    assert text != TEXT
    with pytest.raises(KeyFileError) as refused:
        parse_keyring(text, "key")
    assert message in str(refused.value)
    assert str(refused.value).startswith("key: ")
    assert not any(part in str(refused.value) for part in secret_texts(KEYRING))


def test_file_that_is_cut_at_a_line_end_is_refused_and_says_what_is_missing():
    lines = render_keyring(operator_of(5)).splitlines(keepends=True)
    words = r"is missing|may have been cut off|must be a table with something in"
    for end in range(1, len(lines)):
        for text in ("".join(lines[:end]), "".join(lines[:end]).rstrip("\n")):
            with pytest.raises(KeyFileError, match=words):
                parse_keyring(text, "key")
    with pytest.raises(KeyFileError, match=r"^key: vehicles: 3 of 5 are there: it may have been cut off$"):
        parse_keyring("".join(lines[:-2]), "key")


def test_file_of_an_earlier_release_says_no_number_and_is_the_same_file():
    text = fingerprinted_text(KEYRING)
    assert "\n[vehicles]  # Ed25519, public: vehicle's id = key\n" in text
    assert parse_keyring(text, "key") == KEYRING
    assert file_fingerprint(operator_of(3)) == "3ea4:c03a:eceb:bf7d:e84d"


def test_file_of_another_vehicle_is_refused(tmp_path: Path):
    path = key_file(tmp_path / "key", KEYRING)
    assert load_keyring(path, 2) == load_keyring(path, None) == KEYRING
    with pytest.raises(KeyFileError, match=r"key: owner: is vehicle 2: must be vehicle 3$"):
        load_keyring(path, 3)
    with pytest.raises(KeyFileError, match=r"must be the operator$"):
        load_keyring(path, OPERATOR)


@pytest.mark.parametrize("mode", [0o400, 0o600, 0o200])
def test_file_that_is_the_owners_alone_is_read(mode: int, tmp_path: Path):
    path = key_file(tmp_path / "key", KEYRING, mode)
    if os.access(path, os.R_OK):
        assert load_keyring(path, 2) == KEYRING


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o610, 0o700, 0o601, 0o4600, 0o440])
def test_file_that_others_may_read_is_refused_with_its_mode(mode: int, tmp_path: Path):
    path = key_file(tmp_path / "key", KEYRING, mode)
    with pytest.raises(KeyFileError, match=f"key: mode {mode:04o}: must be 0600 or less"):
        load_keyring(path, 2)


def access_list(*entries: tuple[int, int, int]) -> bytes:
    """An attribute of Linux: tag, permissions and id of each entry."""
    return struct.pack("<I", 2) + b"".join(struct.pack("<HHI", *entry) for entry in entries)


NOBODY = 0xFFFFFFFF
OWNER, GROUP, MASK, OTHER = (1, 4, NOBODY), (4, 0, NOBODY), (16, 4, NOBODY), (32, 0, NOBODY)
SYSTEMD = (OWNER, (2, 4, 990), GROUP, MASK, OTHER)


@pytest.mark.parametrize(
    ("entries", "is_taken"),
    [
        (SYSTEMD, True),
        ((OWNER, (2, 4, 991), GROUP, MASK, OTHER), False),  # another user
        ((OWNER, (2, 4, 990), (2, 4, 991), GROUP, MASK, OTHER), False),
        ((OWNER, (2, 6, 990), GROUP, MASK, OTHER), False),  # may write
        ((OWNER, (2, 4, 990), (4, 4, NOBODY), MASK, OTHER), False),  # the group
        ((OWNER, (2, 4, 990), GROUP, (8, 4, 5), MASK, OTHER), False),  # a group
        ((OWNER, (2, 4, 990), GROUP, MASK, (32, 4, NOBODY)), False),  # all
    ],
)
def test_credential_of_systemd_is_taken_and_no_wider_access_list(
    entries: tuple[tuple[int, int, int], ...], is_taken: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = key_file(tmp_path / "key", KEYRING, 0o440)
    status = os.stat(path)
    monkeypatch.setattr(module.os, "getxattr", lambda *_: access_list(*entries))
    monkeypatch.setattr(module.os, "geteuid", lambda: 990)
    monkeypatch.setattr(module.os, "fstat", lambda _: os.stat_result((status.st_mode, 0, 0, 1, 0, 0, *status[6:])))
    if is_taken:
        assert load_keyring(path, 2) == KEYRING
    else:
        with pytest.raises(KeyFileError, match="mode 0440"):
            load_keyring(path, 2)


@pytest.mark.parametrize("mode", [0o444, 0o460, 0o550])
def test_access_list_excuses_no_more_than_the_groups_reading(
    mode: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = key_file(tmp_path / "key", KEYRING, mode)
    monkeypatch.setattr(module.os, "getxattr", lambda *_: access_list(OWNER, (2, 4, os.geteuid()), GROUP, MASK, OTHER))
    with pytest.raises(KeyFileError, match=f"mode {mode:04o}"):
        load_keyring(path, 2)


def test_access_list_as_the_kernel_has_it_is_understood(tmp_path: Path):
    path = key_file(tmp_path / "key", KEYRING, 0o400)
    try:
        os.setxattr(path, module.ACL, access_list(OWNER, (2, 4, os.geteuid()), GROUP, MASK, OTHER))
    except OSError as error:
        pytest.skip(f"no access lists here: {errno.errorcode.get(error.errno or 0)}")
    assert path.stat().st_mode & 0o777 == 0o440
    assert load_keyring(path, 2) == KEYRING
    os.setxattr(path, module.ACL, access_list(OWNER, (2, 4, os.geteuid() + 1), GROUP, MASK, OTHER))
    with pytest.raises(KeyFileError, match="mode 0440"):
        load_keyring(path, 2)


def test_file_of_another_user_is_refused_unless_it_is_roots_or_root_reads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = key_file(tmp_path / "key", KEYRING)
    mine = path.stat().st_uid
    monkeypatch.setattr(module.os, "geteuid", lambda: mine + 1)
    if mine == 0:
        assert load_keyring(path, 2) == KEYRING
        os.chown(path, 7, 7)
        mine = 7
    with pytest.raises(KeyFileError, match=rf"key: is owned by user {mine}: must be this user's, "):
        load_keyring(path, 2)
    monkeypatch.setattr(module.os, "geteuid", lambda: 0)
    assert load_keyring(path, 2) == KEYRING


def test_no_regular_file_and_one_that_is_too_large_are_refused(tmp_path: Path):
    os.mkfifo(tmp_path / "fifo", 0o600)
    for path, message in (
        (tmp_path / "none", "none: cannot be read: No such file or directory"),
        (tmp_path, "is not a regular file"),
        (tmp_path / "fifo", "fifo: is not a regular file"),
        ("\0", "is not a path"),
        (key_file(tmp_path / "large", replace(KEYRING)), "large: is too large: must be at most 64 KiB"),
    ):
        if "large" in str(path):
            with open(path, "a") as file:
                file.write("#" * BYTES_MAX)
        with pytest.raises(KeyFileError) as refused:
            load_keyring(path, 2)
        assert message in str(refused.value)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path):
    path = key_file(tmp_path / "key", KEYRING)
    path.write_bytes(b"\xff" + path.read_bytes())
    with pytest.raises(KeyFileError, match="key: is not UTF-8 text at byte 0"):
        load_keyring(path, 2)


def test_refused_file_is_closed(tmp_path: Path):
    path = key_file(tmp_path / "key", KEYRING, 0o640)
    before = len(os.listdir("/proc/self/fd"))
    for wrong in (path, tmp_path):
        with pytest.raises(KeyFileError):
            load_keyring(wrong, 2)
    assert len(os.listdir("/proc/self/fd")) == before
