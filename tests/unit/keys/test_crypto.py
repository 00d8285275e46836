"""Keys: what is derived, signed and checked."""

from __future__ import annotations

import pytest

from companion.keys.crypto import Signer, Verifier, public_key, session_key
from companion.keys.keyring import Keyring

SEED = bytes(range(32))


def test_signature_is_that_of_rfc_8032():
    # RFC 8032, 7.1, test 2
    seed = bytes.fromhex("4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb")
    public = bytes.fromhex("3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c")
    assert public_key(seed) == public
    signature = Signer(seed).sign(b"\x72")
    assert signature.hex().startswith("92a009a9f0d4cab8720e820b5f642540")
    assert Verifier(public).holds(signature, b"\x72")


@pytest.mark.parametrize("at", [0, 31, 32, 63])
def test_changed_signature_does_not_hold(at):
    signature = bytearray(Signer(SEED).sign(b"land"))
    signature[at] ^= 1
    assert not Verifier(public_key(SEED)).holds(bytes(signature), b"land")
    assert not Verifier(public_key(SEED)).holds(b"", b"land")


def test_session_keys_of_two_missions_and_of_two_secrets_differ():
    keys = {session_key(secret, mission) for secret in (b"a" * 32, b"b" * 32) for mission in (b"1" * 32, b"2" * 32)}
    assert len(keys) == 4
    assert {len(key) for key in keys} == {32}


def test_keyring_shows_no_secret():
    keyring = Keyring(3, SEED, {0: b"s" * 32}, 0, public_key(SEED), {3: public_key(SEED)})
    assert repr(SEED) not in repr(keyring)
    assert "seed" not in repr(keyring)
    assert "secrets" not in repr(keyring)
