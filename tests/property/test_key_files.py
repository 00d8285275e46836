"""Key files of any bytes: a keyring, or the one error, which shows no part of a secret."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from companion.keys.key_file import BYTES_MAX, KeyFileError, load_keyring, parse_keyring, render_keyring
from companion.keys.keyring import Keyring
from tests.unit.keys.keys_kit import operator_of, secret_texts, vehicle_of

KEYRING = vehicle_of(operator_of(3, (7, 8)), 2)
GOOD = render_keyring(KEYRING).encode()
SECRETS = secret_texts(KEYRING)
FOLDER = Path(tempfile.mkdtemp(prefix="understory-keys-"))

edits = st.lists(
    st.tuples(
        st.integers(0, len(GOOD)),
        st.integers(0, 70),
        st.one_of(
            st.binary(max_size=3),
            st.sampled_from(
                (b"\n", b'"', b"=", b"[", b"]", b"#", b".", b"'", b"\\", b'"""', b"{", b"}", b"inf", b"-1")
            ),
        ),
    ),
    min_size=1,
    max_size=4,
)


def loaded(data: bytes) -> Keyring | str:
    """The keyring, or what the error says. Any other error is the test's."""
    path = FOLDER / f"key-{os.getpid()}"
    path.touch(0o600)
    path.write_bytes(data)
    try:
        return load_keyring(path, None)
    except KeyFileError as error:
        return str(error)
    finally:
        path.unlink()


def check(data: bytes) -> None:
    found = loaded(data)
    if isinstance(found, Keyring):
        assert parse_keyring(render_keyring(found), "x") == found
        assert 1 <= len(found.secrets) <= 2
        assert found.active in found.secrets
    else:
        assert not [part for part in SECRETS if part in found]
        assert "\n" not in found


@settings(max_examples=300)
@given(edits)
def test_file_that_was_damaged_or_changed(changes):
    data = GOOD
    for at, gone, put in changes:
        data = data[:at] + put + data[at + gone :]
    check(data)


@settings(max_examples=200)
@given(st.integers(0, len(GOOD) * 8 - 1))
def test_file_with_one_bit_flipped(bit):
    data = bytearray(GOOD)
    data[bit // 8] ^= 1 << bit % 8
    check(bytes(data))


@given(st.binary(max_size=300))
def test_file_of_any_bytes(data):
    check(data)


@given(
    st.recursive(
        st.one_of(st.integers(), st.booleans(), st.floats().map(repr), st.text(max_size=5).map(repr)),
        lambda inner: st.lists(inner, max_size=3).map(lambda items: f"[{', '.join(map(str, items))}]"),
    ),
    st.sampled_from(("format", "owner", "seed", "active", "operator", "secrets", "vehicles", "more")),
)
def test_file_with_another_value(value, name):
    lines = [line for line in GOOD.decode().splitlines() if not line.startswith(f"{name} = ")]
    check("\n".join([f"{name} = {value}", *lines]).encode(errors="surrogatepass"))


def test_file_of_every_length():
    for size in range(0, len(GOOD), 7):
        check(GOOD[:size])
    check(b"#" * BYTES_MAX)
    check(b"#" * (BYTES_MAX + 1))
    assert loaded(GOOD) == KEYRING
