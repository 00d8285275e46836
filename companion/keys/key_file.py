"""Key files: a keyring as text (TOML), in a file that its owner alone may read. No message of here shows a secret."""

from __future__ import annotations

import os
import re
import stat
import struct
import tomllib
from collections.abc import Mapping
from typing import Any

from companion.keys.crypto import public_key
from companion.keys.keyring import EPOCHS, OPERATOR, PUBLIC_BYTES, SECRET_BYTES, Keyring
from mission.common.problems import printable
from mission.schema.kinds import MAX_VEHICLES

FORMAT = 1
BYTES_MAX = 64 * 1024  # 250 vehicles are 18 KiB
NAMES = ("format", "owner", "seed", "active", "operator", "secrets", "vehicles")
NO_KEY = "# none"  # SetCredential of the service's unit, where there is no file
OWNER_OPERATOR = "operator"
SECRETS_MAX = 2
DIFFERENT_MIN = 8  # of 32 random bytes 30 differ on average
PLACE_CHARS = 200
WORD_CHARS = 24
HEX_RUN = re.compile(r"[0-9a-fA-F]{8}")  # may be a part of a secret that stands where it does not belong
COUNTED = re.compile(r"^\[vehicles\]  # ([1-9][0-9]{0,2}): ", re.MULTILINE)  # or a cut at a line's end is not seen
TOML_PLACE = re.compile(r"\((at [a-z0-9 ,]+)\)$")
ACL = "system.posix_acl_access"
ACL_VERSION = 2  # of the attribute: a number, then tag, permissions and id of each entry (Linux, posix_acl_xattr.h)
ACL_USER, ACL_GROUP_OWNER, ACL_GROUP, ACL_OTHER = 0x02, 0x04, 0x08, 0x20
ACL_READ = 4

HEAD = """\
# SECRET: whoever reads this file is {owner} to the others. What may be shown of it: companion key show-id FILE.
"""


class KeyFileError(Exception):
    """A key file, or a fleet's folder of them, is refused: which, where in it, why."""


class DamagedKeyError(KeyFileError):
    """A key file is refused for its text: cut off, overwritten, or edited."""


def owner_name(owner: int) -> str:
    """Vehicle 3; the operator."""
    return "the operator" if owner == OPERATOR else f"vehicle {owner}"


def load_keyring(path: str | os.PathLike[str], owner: int | None, *, may_lack_vehicles: bool = False) -> Keyring:
    """The keyring in the file `path`, which must be `owner`'s; None: whoever's. KeyFileError, and no other.

    `may_lack_vehicles`: of those that it says to have, as one that was cut at a line's end.
    """
    place = printable(os.fspath(path), PLACE_CHARS)
    try:
        text = _read_private(path, place).decode()
    except UnicodeDecodeError as error:
        raise DamagedKeyError(f"{place}: is not UTF-8 text at byte {error.start}") from None
    try:
        keyring = parse_keyring(text, place, may_lack_vehicles=may_lack_vehicles)
    except KeyFileError as error:
        raise DamagedKeyError(str(error)) from None
    if owner is not None and keyring.owner != owner:
        raise KeyFileError(f"{place}: owner: is {owner_name(keyring.owner)}: must be {owner_name(owner)}")
    return keyring


def render_keyring(keyring: Keyring) -> str:
    """The same keyring gives the same text, and `parse_keyring` of it the same keyring."""
    return fingerprinted_text(keyring).replace("\n[vehicles]  # ", f"\n[vehicles]  # {len(keyring.vehicles)}: ")


def fingerprinted_text(keyring: Keyring) -> str:
    """As before a file said of how many vehicles it is: its fingerprint stays."""
    owner = f'"{OWNER_OPERATOR}"' if keyring.owner == OPERATOR else str(keyring.owner)
    lines = [
        HEAD.format(owner=owner_name(keyring.owner)) + f"format = {FORMAT}",
        f"owner = {owner}",
        f'seed = "{keyring.seed.hex()}"  # Ed25519, private',
        f"active = {keyring.active}  # epoch whose secret frames are signed with",
        f'operator = "{keyring.operator.hex()}"  # Ed25519, public',
        "\n[secrets]  # of the swarm: epoch = secret",
        *(f'{epoch} = "{secret.hex()}"' for epoch, secret in sorted(keyring.secrets.items())),
        "\n[vehicles]  # Ed25519, public: vehicle's id = key",
        *(f'{vehicle} = "{key.hex()}"' for vehicle, key in sorted(keyring.vehicles.items())),
    ]
    return "\n".join(lines) + "\n"


def parse_keyring(text: str, place: str, *, may_lack_vehicles: bool = False) -> Keyring:
    """The keyring that `render_keyring` made this text of. KeyFileError begins with `place`."""
    document = _toml(text, place)
    if not document and text.strip() in ("", NO_KEY):
        raise KeyFileError(f"{place}: is empty: no key is installed")
    if not document:
        raise KeyFileError(f"{place}: has no key in it, only a comment ({len(text)} bytes): it may have been cut off")
    if "format" in document and (type(document["format"]) is not int or document["format"] != FORMAT):
        raise KeyFileError(f"{place}: format = {_shown(document['format'])}: must be {FORMAT}")
    for name in document:
        if name not in NAMES:
            raise KeyFileError(f"{place}: {_word(name)}: no such key: must be one of {', '.join(NAMES)}")
    for name in NAMES:
        if name not in document:
            raise KeyFileError(f"{place}: {name}: is missing")
    keyring = Keyring(
        owner=_owner(document["owner"], place),
        seed=_random(document["seed"], f"{place}: seed"),
        secrets={
            epoch: _random(secret, f"{place}: secrets.{epoch}")
            for epoch, secret in _numbered(document["secrets"], f"{place}: secrets", range(EPOCHS)).items()
        },
        active=document["active"],
        operator=_bytes(document["operator"], f"{place}: operator", PUBLIC_BYTES),
        vehicles={
            vehicle: _bytes(key, f"{place}: vehicles.{vehicle}", PUBLIC_BYTES)
            for vehicle, key in _numbered(
                document["vehicles"], f"{place}: vehicles", range(1, MAX_VEHICLES + 1)
            ).items()
        },
    )
    _check_whole(keyring, place)
    counted = COUNTED.search(text)
    if counted is not None and int(counted[1]) != len(keyring.vehicles) and not may_lack_vehicles:
        raise KeyFileError(
            f"{place}: vehicles: {len(keyring.vehicles)} of {counted[1]} are there: it may have been cut off"
        )
    return keyring


# --- the text ---


def _toml(text: str, place: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise KeyFileError(f"{place}: is nested too deep") from None
    except ValueError as error:  # whose words may quote the file
        where = TOML_PLACE.search(str(error))
        raise KeyFileError(f"{place}: is not TOML{f' ({where[1]})' if where else ''}") from None


def _owner(value: object, place: str) -> int:
    if value == OWNER_OPERATOR:
        return OPERATOR
    if isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= MAX_VEHICLES:
        return value
    allowed = f'must be a vehicle\'s id, 1 to {MAX_VEHICLES}, or "{OWNER_OPERATOR}"'
    raise KeyFileError(f"{place}: owner = {_shown(value)}: {allowed}")


def _numbered(value: object, where: str, allowed: range) -> dict[int, object]:
    """A table whose keys are numbers as one writes them."""
    if not isinstance(value, Mapping) or not value:
        raise KeyFileError(f"{where}: must be a table with something in it")
    found: dict[int, object] = {}
    for name, inner in value.items():
        if not (len(name) <= 3 and name.isascii() and name.isdecimal() and str(int(name)) == name):
            raise KeyFileError(f"{where}.{_word(name)}: must be a number, {allowed[0]} to {allowed[-1]}")
        if int(name) not in allowed:
            raise KeyFileError(f"{where}.{name}: must be {allowed[0]} to {allowed[-1]}")
        found[int(name)] = inner
    return found


def _bytes(value: object, where: str, size: int) -> bytes:
    if not isinstance(value, str) or re.fullmatch(f"[0-9a-f]{{{2 * size}}}", value) is None:
        found = f"a text of {len(value)} characters" if isinstance(value, str) else "no text"
        raise KeyFileError(f"{where}: is {found}: must be {2 * size} hexadecimal digits, in lower case")
    return bytes.fromhex(value)


def _random(value: object, where: str) -> bytes:
    """A secret that nobody can guess, as far as its look tells."""
    secret = _bytes(value, where, SECRET_BYTES)
    if len(set(secret)) < DIFFERENT_MIN:
        raise KeyFileError(f"{where}: is not random")
    return secret


def _check_whole(keyring: Keyring, place: str) -> None:
    """Between keys."""
    epochs = " or ".join(map(str, sorted(keyring.secrets)))
    if len(keyring.secrets) > SECRETS_MAX:
        raise KeyFileError(f"{place}: secrets: {len(keyring.secrets)} epochs: must be at most {SECRETS_MAX}")
    if not isinstance(keyring.active, int) or isinstance(keyring.active, bool) or keyring.active not in keyring.secrets:
        raise KeyFileError(f"{place}: active = {_shown(keyring.active)}: must be an epoch of secrets, {epochs}")
    if len(set(keyring.secrets.values())) < len(keyring.secrets):
        raise KeyFileError(f"{place}: secrets: epochs {epochs} have the same secret: must be different")
    named = {OPERATOR: keyring.operator, **keyring.vehicles}
    names = {OPERATOR: "operator", **{vehicle: f"vehicles.{vehicle}" for vehicle in keyring.vehicles}}
    if len(set(named.values())) < len(named):
        twins = sorted(who for who, key in named.items() if list(named.values()).count(key) > 1)
        raise KeyFileError(f"{place}: {names[twins[0]]} and {names[twins[1]]} are the same key: must be different")
    if keyring.owner not in named:
        raise KeyFileError(
            f"{place}: vehicles.{keyring.owner}: is missing, and the file is {owner_name(keyring.owner)}'s"
        )
    if public_key(keyring.seed) != named[keyring.owner]:
        raise KeyFileError(
            f"{place}: {names[keyring.owner]}: is not the public key of seed: the file is "
            f"{owner_name(keyring.owner)}'s, with another's private key"
        )


def _word(text: str) -> str:
    """A name from the file, unless it may be a part of a secret."""
    if len(text) > WORD_CHARS or HEX_RUN.search(text):
        return f"(a name of {len(text)} characters)"
    return printable(text)


def _shown(value: object) -> str:
    """A value of a key that is no secret, unless it may be one all the same."""
    match value:
        case bool():
            return str(value).lower()
        case int() if abs(value) < 10**6:
            return str(value)
        case str() if len(value) <= WORD_CHARS and not HEX_RUN.search(value):
            return f'"{printable(value)}"'
        case str():
            return f"(a text of {len(value)} characters)"
        case _:
            return f"({type(value).__name__})"


# --- the file ---


def _read_private(path: str | os.PathLike[str], place: str) -> bytes:
    """Content of a regular file that nobody but this user, or root, may read."""
    flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY  # a named pipe would be waited for
    try:
        fd = os.open(path, flags)
        try:
            _check_private(fd, place)
            with open(fd, "rb", closefd=False) as file:
                data = file.read(BYTES_MAX + 1)
        finally:
            os.close(fd)
    except OSError as error:
        raise KeyFileError(f"{place}: cannot be read: {os.strerror(error.errno or 0)}") from None
    except ValueError:  # a NUL in the path
        raise KeyFileError(f"{place}: is not a path") from None
    if len(data) > BYTES_MAX:
        raise KeyFileError(f"{place}: is too large: must be at most {BYTES_MAX // 1024} KiB")
    return data


def _check_private(fd: int, place: str) -> None:
    status = os.fstat(fd)
    mode = stat.S_IMODE(status.st_mode)
    if not stat.S_ISREG(status.st_mode):
        raise KeyFileError(f"{place}: is not a regular file")
    if os.geteuid() not in (0, status.st_uid) and status.st_uid != 0:
        raise KeyFileError(f"{place}: is owned by user {status.st_uid}: must be this user's, {os.geteuid()}")
    if mode & ~0o600 and not _is_own_by_acl(fd, mode):
        raise KeyFileError(f"{place}: mode {mode:04o}: must be 0600 or less (chmod 600)")


def _is_own_by_acl(fd: int, mode: int) -> bool:
    """True when the group's bit of `mode` is an access list's mask, and this user is all that the list adds.

    So systemd hands a credential to a service: root's file, mode 0440, `user:understory:r--`, and `group::---`.
    """
    if mode & ~0o640:
        return False
    try:
        data = os.getxattr(fd, ACL)
    except OSError:
        return False
    if len(data) < 4 or struct.unpack_from("<I", data)[0] != ACL_VERSION:
        return False
    for tag, permissions, user in struct.iter_unpack("<HHI", data[4 : 4 + (len(data) - 4) // 8 * 8]):
        if tag in (ACL_GROUP_OWNER, ACL_OTHER, ACL_GROUP) and permissions:
            return False
        if tag == ACL_USER and (user != os.geteuid() or permissions & ~ACL_READ):
            return False
    return True
