"""As in `cryptography`."""

from cryptography import Absent as Encoding
from cryptography import Absent as PublicFormat

__all__ = ["Encoding", "PublicFormat"]
