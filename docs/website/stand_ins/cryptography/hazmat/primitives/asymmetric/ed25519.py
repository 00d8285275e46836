"""As in `cryptography`."""

from cryptography import Absent as Ed25519PrivateKey
from cryptography import Absent as Ed25519PublicKey

__all__ = ["Ed25519PrivateKey", "Ed25519PublicKey"]
